#include "model/ray_layers.h"

#include <cmath>
#include <utility>

namespace nerf::internal {

void find_normals(std::span<const Ray> rays, std::span<const double> median, FieldQuery& query,
                  std::span<Vec3> normals) {
  std::vector<Vec3d> at, along;
  std::vector<size_t> of;
  for (size_t i = 0; i < rays.size(); ++i) {
    if (!(median[i] > 0)) continue;
    of.push_back(i);
    along.push_back(rays[i].direction);
    at.push_back(rays[i].origin + rays[i].direction * median[i]);
  }
  if (of.empty()) return;
  std::vector<Real> gradient(3 * of.size());
  query.ask({at, along, rays[of.front()].time, -1}, {{}, {}, gradient});
  for (size_t i = 0; i < of.size(); ++i) {
    const Vec3 g{gradient[3 * i], gradient[3 * i + 1], gradient[3 * i + 2]};
    const Real size = length(g);
    if (size > 0 && std::isfinite(size)) normals[of[i]] = g / -size;
  }
}

RayLayers::RayLayers(const Field& field, const Layers& layers, const Similarity& to_engine)
    : field_(field), layers_(layers), to_engine_(to_engine) {}

void RayLayers::begin(size_t n, RaySink& sink) {
  if (layers_.moments) {
    mean_.assign(n, 0.0_r);
    variance_.assign(n, 0.0_r);
    sink.mean = mean_.data();
    sink.variance = variance_.data();
  }
  if (layers_.percentiles) {
    near_.assign(n, 0.0_r);
    far_.assign(n, 0.0_r);
    sink.near = near_.data();
    sink.far = far_.data();
  }
  if (layers_.samples) {
    samples_.assign(n, 0);
    sink.samples = samples_.data();
  }
  if (layers_.normal) normals_.assign(n, Vec3());
  if (layers_.deep) {
    deep_.assign(n, {});
    sink.deep = deep_.data();
  }
}

void RayLayers::finish(std::span<const Ray> rays, std::span<const double> median) {
  if (!layers_.normal) return;
  if (!query_) query_ = field_.query(nullptr);
  find_normals(rays, median, *query_, normals_);
}

void RayLayers::give(size_t ray, double median, double depth_per_distance, size_t pixel,
                     PictureLayers& picture) {
  const double unit = 1 / to_engine_.scale;
  const auto to_input = [&](double x) {
    const double y = x * unit;
    return std::isfinite(y) ? static_cast<Real>(y) : 0.0_r;
  };
  picture.distance[pixel] = to_input(median);
  if (layers_.moments) {
    picture.mean[pixel] = to_input(mean_[ray]);
    picture.variance[pixel] = to_input(static_cast<double>(variance_[ray]) * unit);
  }
  if (layers_.percentiles) {
    picture.near[pixel] = to_input(near_[ray]);
    picture.far[pixel] = to_input(far_[ray]);
  }
  if (layers_.samples) picture.samples[pixel] = static_cast<Real>(samples_[ray]);
  if (layers_.normal) {
    const Vec3d n = to_engine_.rotation.transposed() * normals_[ray].cast<double>();
    for (int k = 0; k < 3; ++k)
      picture.normal[3 * pixel + static_cast<size_t>(k)] = static_cast<Real>(n[k]);
  }
  if (layers_.deep) {
    std::vector<DeepSample>& samples = picture.deep[pixel] = std::move(deep_[ray]);
    for (DeepSample& s : samples) {
      s.front = to_input(s.front * depth_per_distance);
      s.back = to_input(s.back * depth_per_distance);
    }
  }
}

}  // namespace nerf::internal
