#include "nerf/model/renderer.h"

#include <algorithm>
#include <memory>
#include <mutex>

#include "model/network_renderer.h"
#include "model/supersampling.h"
#include "model/tile_renderer.h"
#include "nerf/base/error.h"
#include "nerf/model/grid_field.h"
#include "nerf/model/radiance_field.h"

namespace nerf {

namespace {

Frame render_grid(const GridField& field, const ModelInfo& info, const Camera& camera,
                  const Pose& camera_to_world, const RenderOptions& options, ThreadPool& pool,
                  const std::function<void(double)>& progress, const Cancel* cancel) {
  NERF_CHECK(camera.width > 0 && camera.height > 0);
  const Pose pose = info.to_engine.apply(camera_to_world);
  const auto box = internal::oblique_box(info.to_engine, options.bbox);
  const size_t pixels = static_cast<size_t>(camera.width) * static_cast<size_t>(camera.height);
  Frame frame{camera.width, camera.height, std::vector<Real>(3 * pixels), std::vector<Real>(pixels),
              std::vector<Real>(pixels)};

  LayerPacks packs;
  pack_layers(field.layers(), field.weights.data(), options.precision, packs, pool);

  constexpr int kTile = 16;  // neighbouring rays read neighbouring table rows
  const int columns = (camera.width + kTile - 1) / kTile;
  const int rows = (camera.height + kTile - 1) / kTile;
  std::vector<std::unique_ptr<internal::TileRenderer>> renderers(static_cast<size_t>(pool.size()));
  std::mutex mutex;
  int done = 0;
  pool.parallel_for_thread(int64_t{columns} * rows, [&](int64_t tile, int thread) {
    if (cancel && cancel->requested()) throw Cancelled();
    auto& renderer = renderers[static_cast<size_t>(thread)];
    if (!renderer)
      renderer = std::make_unique<internal::TileRenderer>(field, packs, camera, pose, info.near,
                                                          options, box);
    const int x = static_cast<int>(tile % columns) * kTile;
    const int y = static_cast<int>(tile / columns) * kTile;
    renderer->render_tile(x, y, std::min(x + kTile, camera.width),
                          std::min(y + kTile, camera.height), frame, 1 / info.to_engine.scale);
    if (progress) {
      std::lock_guard lock(mutex);
      progress(static_cast<double>(++done) / (columns * rows));
    }
  });
  for (const auto& renderer : renderers) {
    if (!renderer) continue;  // of a thread that came too late for a tile
    frame.statistics += renderer->statistics();
  }
  return frame;
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
             const std::function<void(double)>& progress, const Cancel* cancel) {
  const ModelInfo& info = radiance.info();
  const auto render_part = [&](const Camera& given, const std::function<void(double)>& at) {
    const Camera part = given.in_unit(info.to_engine.scale);
    return radiance.is_grid()
               ? render_grid(radiance.grid(), info, part, camera_to_world, options, pool, at,
                             cancel)
               : internal::render_network(radiance.network(), info,
                                          options.unclipped ? nullptr : radiance.baked(), part,
                                          camera_to_world, options, pool, at, cancel);
  };
  const int n = rays_per_side(radiance, options, camera, camera_to_world);
  return n > 1 ? internal::render_supersampled(n, camera, progress, render_part)
               : render_part(camera, progress);
}

}  // namespace nerf
