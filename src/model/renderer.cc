#include "nerf/model/renderer.h"

#include <algorithm>
#include <memory>
#include <mutex>

#include "model/appearance.h"
#include "model/baked_occupancy.h"
#include "model/moment_occupancy.h"
#include "model/network_renderer.h"
#include "model/object_pixels.h"
#include "model/pixel_lattice.h"
#include "model/sky.h"
#include "model/supersampling.h"
#include "model/tile_renderer.h"
#include "nerf/base/error.h"
#include "nerf/model/grid_field.h"
#include "nerf/model/insertion.h"
#include "nerf/model/radiance_field.h"

namespace nerf {

namespace {

// One picture of the grid method on its way, tile by tile.
class GridPicture {
 public:
  GridPicture(const GridField& field, const internal::GridMoment& moment, const ModelInfo& info,
              const Camera& camera, const Pose& camera_to_world, const RenderOptions& options,
              const internal::ObjectPixels& objects,
              const std::optional<internal::EngineMedium>& medium, ThreadPool& pool,
              const std::function<void(double)>& progress, const Cancel* cancel)
      : field_(field),
        moment_(moment),
        info_(info),
        camera_(camera),
        pose_(info.to_engine.apply(camera_to_world)),
        options_(options),
        objects_(objects),
        box_(internal::oblique_box(info.to_engine, options.bbox)),
        medium_(medium),
        pool_(pool),
        progress_(progress),
        cancel_(cancel) {
    NERF_CHECK(camera.width > 0 && camera.height > 0);
    const size_t pixels = static_cast<size_t>(camera.width) * static_cast<size_t>(camera.height);
    frame_ = {camera.width, camera.height, std::vector<Real>(3 * pixels), std::vector<Real>(pixels),
              std::vector<Real>(pixels)};
    if (options.layers) frame_.layers.resize(pixels, *options.layers);
    pack_layers(field.layers(), field.weights.data(), options.precision, packs_, pool);
    renderers_.resize(static_cast<size_t>(pool.size()));
  }

  // rays_per_side: of the rays whose mean will be a pixel; they may differ by more.
  Frame render(int rays_per_side) {
    if (options_.interpolated > 0)
      render_lattice(rays_per_side);
    else
      each_tile(16, 1, [&](internal::TileRenderer& renderer, int x0, int y0, int x1, int y1) {
        renderer.render_tile(x0, y0, x1, y1, nullptr, frame_, 1 / info_.to_engine.scale);
      });
    for (const auto& renderer : renderers_)
      if (renderer)
        frame_.statistics += renderer->statistics();  // else it came too late for a tile
    return std::move(frame_);
  }

 private:
  void render_lattice(int rays_per_side) {
    internal::LatticeOptions options;
    options.spacing = rays_per_side >= 4 ? 8 : 4;
    options.tolerance = options_.interpolated * static_cast<Real>(rays_per_side);
    options.sky = internal::shows_sky(field_, options_);
    if (rays_per_side > 1) {
      options.depth_ratio = 1.3_r;
      options.sure = false;
    }
    internal::PixelLattice lattice(options, camera_.width, camera_.height, &objects_);
    for (int pass = 0; pass < lattice.passes(); ++pass)
      each_tile(32, lattice.share(pass),
                [&](internal::TileRenderer& renderer, int x0, int y0, int x1, int y1) {
                  if (lattice.choose(pass, x0, y0, x1, y1, frame_) == 0) return;
                  renderer.render_tile(x0, y0, x1, y1, lattice.wanted().data(), frame_,
                                       1 / info_.to_engine.scale);
                  lattice.learn(pass, x0, y0, x1, y1, frame_);
                });
  }

  // Neighbouring rays read neighbouring table rows. `share`: of the whole work, for progress.
  template <class Body>
  void each_tile(int side, double share, const Body& body) {
    const int columns = (camera_.width + side - 1) / side;
    const int rows = (camera_.height + side - 1) / side;
    const double step = share / (static_cast<double>(columns) * rows);
    pool_.parallel_for_thread(int64_t{columns} * rows, [&](int64_t tile, int thread) {
      if (cancel_ && cancel_->requested()) throw Cancelled();
      auto& renderer = renderers_[static_cast<size_t>(thread)];
      if (!renderer)
        renderer = std::make_unique<internal::TileRenderer>(
            field_, moment_, packs_, camera_, pose_, info_, options_, objects_, box_, medium_);
      const int x = static_cast<int>(tile % columns) * side;
      const int y = static_cast<int>(tile / columns) * side;
      body(*renderer, x, y, std::min(x + side, camera_.width), std::min(y + side, camera_.height));
      if (progress_) {
        std::lock_guard lock(mutex_);
        done_ += step;
        progress_(std::min(done_, 1.0));
      }
    });
  }

  const GridField& field_;
  const internal::GridMoment moment_;
  const ModelInfo& info_;
  const Camera& camera_;
  const Pose pose_;
  const RenderOptions& options_;
  const internal::ObjectPixels& objects_;
  const std::optional<internal::ObliqueBox> box_;
  const std::optional<internal::EngineMedium>& medium_;
  ThreadPool& pool_;
  const std::function<void(double)>& progress_;
  const Cancel* cancel_;
  Frame frame_;
  LayerPacks packs_;
  std::vector<std::unique_ptr<internal::TileRenderer>> renderers_;  // of each thread
  std::mutex mutex_;
  double done_ = 0;
};

// Layers are before any background, which their picture gets last, and of every pixel's own rays.
RenderOptions for_layers(const RenderOptions& options) {
  RenderOptions drawn = options;
  drawn.background = {0, 0, 0};
  drawn.interpolated = 0;
  return drawn;
}

// The field without inserted objects.
RenderOptions alone(const RenderOptions& options) {
  RenderOptions drawn = options;
  drawn.layers = Layers{};
  return drawn;
}

void interleave(const std::vector<Real>& rgb, const std::vector<Real>& alpha,
                std::vector<Real>& rgba) {
  for (size_t i = 0; i < alpha.size(); ++i) {
    for (size_t k = 0; k < 3; ++k) rgba[4 * i + k] = rgb[3 * i + k];
    rgba[4 * i + 3] = alpha[i];
  }
}

void lay_over(const Vec3& background, Frame& frame) {
  frame.layers.rgb = frame.rgb;
  for (size_t i = 0; i < frame.alpha.size(); ++i)
    for (int k = 0; k < 3; ++k)
      frame.rgb[3 * i + static_cast<size_t>(k)] += (1 - frame.alpha[i]) * background[k];
}

}  // namespace

RenderStatistics& RenderStatistics::operator+=(const RenderStatistics& other) {
  rays += other.rays;
  segments += other.segments;
  density_evaluations += other.density_evaluations;
  colour_evaluations += other.colour_evaluations;
  return *this;
}

Frame render(const RadianceField& radiance, const Camera& camera, const Pose& camera_to_world,
             const RenderOptions& options, ThreadPool& pool,
             const std::function<void(double)>& progress, const Cancel* cancel,
             const Insertion* insertion) {
  const ModelInfo& info = radiance.info();
  internal::check_appearance(radiance.field(), options.appearance);
  internal::check_time(options.time, "RenderOptions::time");
  const int n = rays_per_side(radiance, options, camera, camera_to_world);
  const RenderOptions drawn = options.layers ? for_layers(options) : options;
  const auto medium = internal::engine_medium(radiance, options);
  std::optional<OccupancyGrid> occupancy;
  std::optional<internal::MatterCells> baked;
  std::optional<internal::MotionLattice> lattice;
  const int64_t rays = int64_t{n} * n * camera.width * camera.height;
  if (radiance.field().moves() && !options.unclipped) {
    if (radiance.is_grid()) {
      lattice.emplace(radiance.grid(), options.time);
      occupancy = internal::occupancy_at(radiance.grid(), options.precision, options.time, rays,
                                         pool, cancel);
    } else {
      baked = internal::occupancy_at(radiance.network(), info, options.time, rays, pool, cancel);
    }
  }
  const auto draw = [&](const Insertion* inserted, const RenderOptions& chosen,
                        const std::function<void(double)>& progress) {
    const auto render_part = [&](const Camera& given, const std::function<void(double)>& at) {
      const Camera part = given.in_unit(info.to_engine.scale);
      const Pose to_engine = info.to_engine.apply(camera_to_world);
      internal::ObjectPixels objects;
      if (inserted) objects = inserted->look(part, to_engine, chosen, pool, cancel);
      Frame picture =
          radiance.is_grid()
              ? GridPicture(radiance.grid(),
                            {occupancy ? *occupancy : radiance.grid().occupancy,
                             lattice ? &*lattice : nullptr},
                            info, part, camera_to_world, chosen, objects, medium, pool, at, cancel)
                    .render(n)
              : internal::render_network(radiance, baked ? &*baked : radiance.baked(), part,
                                         camera_to_world, chosen, objects, pool, at, cancel);
      if (inserted) inserted->finish(objects, part, to_engine, chosen, pool, picture);
      return picture;
    };
    return n > 1 ? internal::render_supersampled(n, camera, progress, render_part)
                 : render_part(camera, progress);
  };
  const bool twice = insertion && options.layers && options.layers->apart;
  const auto half = [&](double from) -> std::function<void(double)> {
    if (!progress || !twice) return progress;
    return [&progress, from](double share) { progress(from + 0.5 * share); };
  };
  Frame frame = draw(insertion, drawn, half(0));
  if (options.layers) {
    const auto change = [&](const std::vector<Real>& alpha, std::vector<Real>& rgb) {
      internal::change_colours(options.appearance, alpha, [](size_t) { return Vec3{}; }, rgb);
    };
    lay_over(radiance.shows_background() ? options.background : Vec3{}, frame);
    change(frame.alpha, frame.layers.rgb);
    if (twice) {
      Frame field = draw(nullptr, alone(drawn), half(0.5));
      change(field.alpha, field.rgb);
      interleave(field.rgb, field.alpha, frame.layers.field);
    } else if (options.layers->apart) {
      interleave(frame.layers.rgb, frame.alpha, frame.layers.field);
    }
  }
  internal::change_colours(
      options.appearance, frame.alpha, [&](size_t) { return options.background; }, frame.rgb);
  return frame;
}

}  // namespace nerf
