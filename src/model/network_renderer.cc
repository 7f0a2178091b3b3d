#include "model/network_renderer.h"

#include <algorithm>
#include <cmath>
#include <mutex>
#include <optional>
#include <vector>

#include "model/network_integrator.h"
#include "model/ray_layers.h"
#include "nerf/base/error.h"
#include "nerf/model/radiance_field.h"

namespace nerf::internal {

Frame render_network(const RadianceField& radiance, const MatterCells* occupancy,
                     const Camera& camera, const Pose& camera_to_world,
                     const RenderOptions& options, const ObjectPixels& objects, ThreadPool& pool,
                     const std::function<void(double)>& progress, const Cancel* cancel) {
  NERF_CHECK(camera.width > 0 && camera.height > 0);
  const NetworkField& field = radiance.network();
  const ModelInfo& info = radiance.info();
  const Pose pose = info.to_engine.apply(camera_to_world);
  const Vec3 background = radiance.shows_background() ? options.background : Vec3{0, 0, 0};
  const int64_t pixels = int64_t{camera.width} * camera.height;
  Frame frame{camera.width, camera.height, std::vector<Real>(static_cast<size_t>(3 * pixels)),
              std::vector<Real>(static_cast<size_t>(pixels)),
              std::vector<Real>(static_cast<size_t>(pixels))};
  NetworkIntegrator integrator(field, occupancy, options, oblique_box(info.to_engine, options.bbox),
                               engine_medium(radiance, options), pool);
  if (options.layers) frame.layers.resize(static_cast<size_t>(pixels), *options.layers);
  std::mutex mutex;
  int64_t done = 0;
  const int64_t per_item = 16 * int64_t{integrator.chunk()};
  const int64_t items = (pixels + per_item - 1) / per_item;
  pool.parallel_for_thread(items, [&](int64_t item, int thread) {
    if (cancel && cancel->requested()) throw Cancelled();
    std::vector<Ray> rays;
    std::vector<size_t> pixel_of;
    for (int64_t p = item * per_item; p < std::min(pixels, (item + 1) * per_item); ++p) {
      const Vec2d at{static_cast<double>(p % camera.width) + 0.5,
                     static_cast<double>(p / camera.width) + 0.5};
      for (int k = 0; k < 3; ++k) frame.rgb[static_cast<size_t>(3 * p + k)] = background[k];
      auto ray = camera_ray(camera, pose, at);
      if (!ray) continue;
      ray->radius = cast_radius(field, camera, pose, at);
      ray->background = background;
      ray->time = options.time;
      objects.cut(static_cast<size_t>(p), *ray);
      rays.push_back(*ray);
      pixel_of.push_back(static_cast<size_t>(p));
    }
    std::vector<Real> rgb(3 * rays.size()), opacity(rays.size());
    std::vector<double> median(rays.size());
    RaySink sink{.rgb = rgb.data(), .opacity = opacity.data(), .median = median.data()};
    std::optional<RayLayers> layers;
    if (options.layers) {
      layers.emplace(field, *options.layers, info.to_engine);
      layers->begin(rays.size(), sink);
    }
    integrator.integrate(rays, sink, thread);
    if (layers) layers->finish(rays, median);
    for (size_t r = 0; r < rays.size(); ++r) {
      const size_t p = pixel_of[r];
      std::copy_n(rgb.data() + 3 * r, 3, frame.rgb.data() + 3 * p);
      frame.alpha[p] = opacity[r];
      const double forward =
          depth_per_distance(camera, pose.rotation.transposed() * rays[r].direction);
      const double depth = median[r] * forward / info.to_engine.scale;
      frame.depth_z[p] = std::isfinite(depth) ? static_cast<Real>(depth) : 0.0_r;
      if (layers) layers->give(r, median[r], forward, p, frame.layers);
    }
    std::lock_guard lock(mutex);
    if (progress) progress(static_cast<double>(++done) / static_cast<double>(items));
  });
  frame.statistics = integrator.statistics();
  return frame;
}

}  // namespace nerf::internal
