#include "nerf/model/integrator.h"

#include <algorithm>
#include <memory>
#include <mutex>

#include "model/appearance.h"
#include "model/field_integrator.h"
#include "model/ray_layers.h"
#include "nerf/base/error.h"
#include "nerf/model/field.h"
#include "nerf/model/radiance_field.h"

namespace nerf {

namespace {

constexpr size_t kRays = 256;  // of an item of work

// Room for what is wanted of n rays.
RayResults results_of(size_t n, const Layers& layers) {
  RayResults r;
  r.rgb.resize(3 * n);
  r.opacity.resize(n);
  r.median.resize(n);
  if (layers.moments) {
    r.mean.resize(n);
    r.variance.resize(n);
  }
  if (layers.percentiles) {
    r.near.resize(n);
    r.far.resize(n);
  }
  if (layers.samples) r.samples.resize(n);
  if (layers.normal) r.normal.resize(n);
  if (layers.deep) r.deep.resize(n);
  return r;
}

// Of a vector's part, or null where it is empty.
template <class T>
T* part(std::vector<T>& of, size_t at) {
  return of.empty() ? nullptr : of.data() + at;
}

}  // namespace

RayResults integrate(const RadianceField& radiance, std::span<const Ray> rays, const Layers& layers,
                     const RenderOptions& options, ThreadPool& pool,
                     const std::function<void(double)>& progress, const Cancel* cancel) {
  const size_t n = rays.size();
  RayResults out = results_of(n, layers);
  internal::check_appearance(radiance.field(), options.appearance);
  for (const Ray& ray : rays) internal::check_time(ray.time, "Ray::time");
  const auto integrator = internal::make_integrator(radiance, options, pool);
  std::vector<std::unique_ptr<FieldQuery>> queries(static_cast<size_t>(pool.size()));
  std::mutex mutex;
  int64_t done = 0;
  const int64_t items = static_cast<int64_t>((n + kRays - 1) / kRays);
  pool.parallel_for_thread(items, [&](int64_t item, int thread) {
    if (cancel && cancel->requested()) throw Cancelled();
    const size_t begin = static_cast<size_t>(item) * kRays, count = std::min(kRays, n - begin);
    std::vector<double> median(count);
    internal::RaySink sink{.rgb = out.rgb.data() + 3 * begin,
                           .opacity = out.opacity.data() + begin,
                           .median = median.data(),
                           .mean = part(out.mean, begin),
                           .variance = part(out.variance, begin),
                           .near = part(out.near, begin),
                           .far = part(out.far, begin),
                           .samples = part(out.samples, begin),
                           .deep = part(out.deep, begin)};
    integrator->integrate(rays.subspan(begin, count), sink, thread);
    for (size_t i = 0; i < count; ++i) out.median[begin + i] = static_cast<Real>(median[i]);
    if (layers.normal) {
      auto& query = queries[static_cast<size_t>(thread)];
      if (!query) query = radiance.field().query(nullptr);
      internal::find_normals(rays.subspan(begin, count), median, *query,
                             std::span(out.normal).subspan(begin, count));
    }
    std::lock_guard lock(mutex);
    if (progress) progress(static_cast<double>(++done) / static_cast<double>(items));
  });
  out.statistics = integrator->statistics();
  internal::change_colours(
      options.appearance, out.opacity, [&](size_t i) { return rays[i].background; }, out.rgb);
  return out;
}

}  // namespace nerf
