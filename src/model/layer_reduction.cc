#include "model/layer_reduction.h"

#include <algorithm>
#include <span>
#include <vector>

#include "nerf/math/vec.h"

namespace nerf::internal {

namespace {

// Of the numbers above 0 the one so far along their order; 0 where most are not above 0.
Real ranked(std::span<const Real> values, double rank, std::vector<Real>& seen) {
  seen.clear();
  for (const Real v : values)
    if (v > 0) seen.push_back(v);
  if (2 * seen.size() <= values.size()) return 0;
  const size_t at =
      std::min(static_cast<size_t>(rank * static_cast<double>(seen.size())), seen.size() - 1);
  std::nth_element(seen.begin(), seen.begin() + static_cast<ptrdiff_t>(at), seen.end());
  return seen[at];
}

// What a pixel's rays give, gathered one array after the other.
class Pixel {
 public:
  Pixel(const Frame& from, int n) : from_(from), n_(n), of_(static_cast<size_t>(n * n)) {}

  void move_to(int x, int y) {
    for (int i = 0; i < n_ * n_; ++i)
      of_[static_cast<size_t>(i)] =
          static_cast<size_t>(y * n_ + i / n_) * static_cast<size_t>(from_.width) +
          static_cast<size_t>(x * n_ + i % n_);
  }

  Real middle(const std::vector<Real>& values, double rank) {
    numbers_.clear();
    for (const size_t i : of_) numbers_.push_back(values[i]);
    return ranked(numbers_, rank, seen_);
  }

  Real sum(const std::vector<Real>& values) const {
    Real sum = 0;
    for (const size_t i : of_) sum += values[i];
    return sum;
  }

  void append_means(const std::vector<Real>& values, size_t per_pixel,
                    std::vector<Real>& out) const {
    if (values.empty()) return;
    const Real share = 1.0_r / static_cast<Real>(of_.size());
    for (size_t k = 0; k < per_pixel; ++k) {
      Real sum = 0;
      for (const size_t i : of_) sum += values[per_pixel * i + k];
      out.push_back(sum * share);
    }
  }

  // Of the light that all rays stop.
  void moments(Real& mean, Real& variance) const {
    double light = 0, first = 0, second = 0;
    for (const size_t i : of_) {
      const double m = from_.layers.mean[i];
      if (!(m > 0)) continue;
      const double w = from_.alpha[i];
      light += w;
      first += w * m;
      second += w * (m * m + from_.layers.variance[i]);
    }
    mean = variance = 0;
    if (!(light > 0)) return;
    mean = static_cast<Real>(first / light);
    const double square = (first / light) * (first / light);
    variance = static_cast<Real>(std::max(0.0, second / light - square));
  }

  Vec3 normal() const {
    Vec3 sum;
    size_t count = 0;
    for (const size_t i : of_) {
      const Real* n = from_.layers.normal.data() + 3 * i;
      const Vec3 own{n[0], n[1], n[2]};
      count += own != Vec3();
      sum = sum + own;
    }
    return 2 * count > of_.size() ? normalized(sum) : Vec3();
  }

  std::vector<DeepSample> deep() const {
    const Real share = 1.0_r / static_cast<Real>(of_.size());
    std::vector<DeepSample> all;
    for (const size_t i : of_)
      for (DeepSample s : from_.layers.deep[i]) {
        s.weight *= share;
        for (Real& c : s.rgb) c *= share;
        all.push_back(s);
      }
    std::ranges::stable_sort(all, {}, &DeepSample::back);
    join_deep_samples(all);
    return all;
  }

 private:
  const Frame& from_;
  int n_;
  std::vector<size_t> of_;
  std::vector<Real> numbers_, seen_;
};

}  // namespace

void append_reduced_layers(const Frame& from, int n, PictureLayers& out) {
  const PictureLayers& layers = from.layers;
  if (layers.empty()) return;
  Pixel pixel(from, n);
  for (int y = 0; y < from.height / n; ++y)
    for (int x = 0; x < from.width / n; ++x) {
      pixel.move_to(x, y);
      out.distance.push_back(pixel.middle(layers.distance, 0.5));
      if (!layers.near.empty()) out.near.push_back(pixel.middle(layers.near, 0));
      if (!layers.far.empty()) out.far.push_back(pixel.middle(layers.far, 1));
      if (!layers.samples.empty()) out.samples.push_back(pixel.sum(layers.samples));
      if (!layers.mean.empty()) pixel.moments(out.mean.emplace_back(), out.variance.emplace_back());
      if (!layers.normal.empty()) {
        const Vec3 normal = pixel.normal();
        for (int k = 0; k < 3; ++k) out.normal.push_back(normal[k]);
      }
      if (!layers.deep.empty()) out.deep.push_back(pixel.deep());
      pixel.append_means(layers.field, 4, out.field);
      pixel.append_means(layers.cover, 1, out.cover);
      pixel.append_means(layers.shadow, 3, out.shadow);
    }
}

}  // namespace nerf::internal
