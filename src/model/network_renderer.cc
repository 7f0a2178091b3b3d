#include "model/network_renderer.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <mutex>
#include <vector>

#include "model/oblique_box.h"
#include "nerf/base/error.h"
#include "nerf/math/contraction.h"
#include "nerf/model/network_levels.h"

namespace nerf::internal {

namespace {

// What is seen where a model of opaque photos lets light through: it was trained before black.
Vec3 background_of(const ModelInfo& info, const RenderOptions& options) {
  return info.alpha ? options.background : Vec3{0, 0, 0};
}

}  // namespace

Frame render_network(const NetworkField& field, const ModelInfo& info,
                     const BakedOccupancy* occupancy, const Camera& camera,
                     const Pose& camera_to_world, const RenderOptions& options, ThreadPool& pool,
                     const std::function<void(double)>& progress, const Cancel* cancel) {
  const auto box = oblique_box(info.to_engine, options.bbox);
  if (box && field.options.opaque_end) {
    NetworkField open_end = field;
    open_end.options.opaque_end = false;
    return render_network(open_end, info, occupancy, camera, camera_to_world, options, pool,
                          progress, cancel);
  }
  NERF_CHECK(camera.width > 0 && camera.height > 0);
  const Pose pose = info.to_engine.apply(camera_to_world);
  const Vec3 background = background_of(info, options);
  const int64_t pixels = int64_t{camera.width} * camera.height;
  Frame frame{camera.width, camera.height, std::vector<Real>(static_cast<size_t>(3 * pixels)),
              std::vector<Real>(static_cast<size_t>(pixels)),
              std::vector<Real>(static_cast<size_t>(pixels))};
  LayerPacks packs;
  pack_layers(field.layers(), field.weights.data(), options.precision, packs, pool);
  // Where most samples are skipped more rays fill a chunk.
  const int per_chunk = NetworkLevels::rays_per_chunk(field.options) * (occupancy ? 4 : 1);
  std::vector<std::unique_ptr<NetworkLevels>> levels(static_cast<size_t>(pool.size()));
  std::mutex mutex;
  int64_t done = 0;
  const int64_t chunks = (pixels + per_chunk - 1) / per_chunk;
  constexpr int64_t kChunksPerItem = 16;
  const int64_t items = (chunks + kChunksPerItem - 1) / kChunksPerItem;
  pool.parallel_for_thread(items, [&](int64_t item, int thread) {
    if (cancel && cancel->requested()) throw Cancelled();
    auto& own = levels[static_cast<size_t>(thread)];
    if (!own) {
      own = std::make_unique<NetworkLevels>(field, per_chunk);
      own->skip_empty(occupancy);
      own->use_packs(&packs);
      if (box) own->cut_rays();
    }
    int64_t asked = 0, coloured = 0, cast_rays = 0;
    std::vector<NetworkRay> rays;
    std::vector<int64_t> pixel_of;
    std::vector<Ray> lines;       // of the rays, engine coordinates
    std::vector<double> forward;  // depth_per_distance()
    for (int64_t chunk = item * kChunksPerItem;
         chunk < std::min(chunks, (item + 1) * kChunksPerItem); ++chunk) {
      rays.clear();
      pixel_of.clear();
      lines.clear();
      forward.clear();
      for (int64_t p = chunk * per_chunk; p < std::min(pixels, (chunk + 1) * per_chunk); ++p) {
        const Vec2d at{static_cast<double>(p % camera.width) + 0.5,
                       static_cast<double>(p / camera.width) + 0.5};
        for (int k = 0; k < 3; ++k) frame.rgb[static_cast<size_t>(3 * p + k)] = background[k];
        auto line = camera_ray(camera, pose, at);
        if (!line) continue;
        line->radius = cast_radius(field, camera, pose, at);
        line->background = background;
        line->time = options.time;
        auto ray = sampled_ray(field, *line);
        if (!ray) continue;
        if (box) {
          double near = 0, far = std::numeric_limits<double>::infinity();
          if (!box->clip(line->origin, line->direction, near, far)) continue;
          ray->drawn_from = static_cast<Real>(ray_parameter(field, *line, near));
          ray->drawn_to = static_cast<Real>(ray_parameter(field, *line, far));
        }
        rays.push_back(*ray);
        pixel_of.push_back(p);
        lines.push_back(*line);
        forward.push_back(
            depth_per_distance(camera, pose.rotation.transposed() * ray->view.cast<double>()));
      }
      if (rays.empty()) continue;
      own->forward(rays, 1);
      asked += own->dense_samples();
      coloured += own->coloured_samples();
      cast_rays += static_cast<int64_t>(rays.size());
      for (size_t r = 0; r < rays.size(); ++r) {
        const size_t p = static_cast<size_t>(pixel_of[r]);
        own->pixel(static_cast<int>(r), &frame.rgb[3 * p], frame.alpha[p]);
        // Weights are rounded before they are added up.
        frame.alpha[p] = std::min(frame.alpha[p], 1.0_r);
        for (size_t k = 0; k < 3; ++k)
          frame.rgb[3 * p + k] = std::clamp(frame.rgb[3 * p + k], 0.0_r, 1.0_r);
        const double t = static_cast<double>(own->median_distance(static_cast<int>(r)));
        const double distance = t < 0 ? 0 : ray_distance(field, lines[r], t);
        const double depth = distance * forward[r] / info.to_engine.scale;
        frame.depth_z[p] = std::isfinite(depth) ? static_cast<Real>(depth) : 0.0_r;
      }
    }
    std::lock_guard lock(mutex);
    frame.statistics.rays += cast_rays;
    frame.statistics.density_evaluations += asked;
    frame.statistics.colour_evaluations += coloured;
    if (progress) {
      progress(static_cast<double>(++done) / static_cast<double>(items));
    }
  });
  return frame;
}

}  // namespace nerf::internal
