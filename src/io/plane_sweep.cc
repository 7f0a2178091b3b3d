#include "nerf/io/plane_sweep.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "scene_statistics.h"
#include "sweep_image.h"

namespace nerf {

namespace {

using internal::SweepImage;

constexpr int kLongest = 192;      // pixels of a small picture
constexpr size_t kMostViews = 64;  // that are swept
constexpr size_t kNeighbours = 4;  // that each is compared with
constexpr int kPlanes = 128;
constexpr int kHalfWindow = 3;             // pixels
constexpr float kLeastDeviation = 0.012f;  // of grey in a window that can be recognised
constexpr float kLeastScore = 0.85f;       // correlation
constexpr float kLeastLead = 0.04f;        // before every plane that is not next to the best one
constexpr float kNone = -2;

// Distance from a photo to what it shows, as far as the cameras alone tell: to the place that the
// axes of all photos meet at, which is the engine's origin, or a unit where it looks elsewhere.
double usual_distance(const Pose& pose) {
  const double along = dot(-pose.translation, pose.rotation.column(2));
  return along > 0.25 ? along : 1.0;
}

// The views that see what `view` shows from the side: angles near 10 degrees first.
std::vector<size_t> neighbours(const std::vector<SweepImage>& images, size_t view) {
  const Pose& pose = images[view].to_engine;
  const Vec3d forward = pose.rotation.column(2);
  const Vec3d shown = pose.translation + forward * usual_distance(pose);
  std::vector<std::pair<double, size_t>> ranked;
  for (size_t i = 0; i < images.size(); ++i) {
    if (i == view || images[i].grey.empty()) continue;
    const Pose& other = images[i].to_engine;
    const Vec3d a = normalized(pose.translation - shown), b = other.translation - shown;
    if (!(length(b) > 0)) continue;
    const double angle =
        std::acos(std::clamp(dot(a, normalized(b)), -1.0, 1.0)) * 180 / std::numbers::pi;
    if (angle < 1.5 || angle > 40 || dot(forward, other.rotation.column(2)) < 0.6) continue;
    ranked.emplace_back(std::abs(std::log(angle / 10)), i);
  }
  std::sort(ranked.begin(), ranked.end());
  std::vector<size_t> out;
  for (size_t i = 0; i < std::min(kNeighbours, ranked.size()); ++i) out.push_back(ranked[i].second);
  return out;
}

// Sums over windows of (2 kHalfWindow + 1)^2 pixels, along one axis and then the other.
class WindowSums {
 public:
  WindowSums(int width, int height)
      : width_(width),
        height_(height),
        along_(static_cast<size_t>(width) * static_cast<size_t>(height)) {}
  void operator()(const std::vector<float>& in, std::vector<float>& out) {
    out.resize(along_.size());
    for (int y = 0; y < height_; ++y) {
      const float* from = in.data() + static_cast<ptrdiff_t>(y) * width_;
      float* to = along_.data() + static_cast<ptrdiff_t>(y) * width_;
      for (int x = kHalfWindow; x < width_ - kHalfWindow; ++x) {
        float sum = 0;
        for (int k = -kHalfWindow; k <= kHalfWindow; ++k) sum += from[x + k];
        to[x] = sum;
      }
    }
    for (int y = kHalfWindow; y < height_ - kHalfWindow; ++y) {
      float* to = out.data() + static_cast<ptrdiff_t>(y) * width_;
      std::fill_n(to, width_, 0.0f);
      for (int k = -kHalfWindow; k <= kHalfWindow; ++k) {
        const float* from = along_.data() + static_cast<ptrdiff_t>(y + k) * width_;
        for (int x = 0; x < width_; ++x) to[x] += from[x];
      }
    }
  }

 private:
  int width_, height_;
  std::vector<float> along_;
};

// Where the pixels of `view` on a plane at z = 1 / inverse_depth lie in `other`, as a homography:
// the pixel (x, y, 1) becomes (u w, v w, w).
Mat3d homography(const SweepImage& view, const SweepImage& other, double inverse_depth) {
  const Pose relative{other.to_engine.rotation.transposed() * view.to_engine.rotation,
                      other.to_engine.inverse() * view.to_engine.translation};
  Mat3d plane = relative.rotation;  // plus t n^T / z, with n the axis
  plane.set_column(2, plane.column(2) + relative.translation * inverse_depth);
  Mat3d to_pixel, from_pixel;
  to_pixel.m = {{{other.focal, 0, other.cx()}, {0, other.focal, other.cy()}, {0, 0, 1}}};
  const double f = 1 / view.focal;
  from_pixel.m = {{{f, 0, -view.cx() * f}, {0, f, -view.cy() * f}, {0, 0, 1}}};
  return to_pixel * (plane * from_pixel);
}

// `other` as seen from `view` if all of it lay on the plane; below 0 where it shows nothing.
void warp(const SweepImage& view, const SweepImage& other, double inverse_depth,
          std::vector<float>& out) {
  const Mat3d h = homography(view, other, inverse_depth);
  out.resize(view.grey.size());
  const float last_x = static_cast<float>(other.width - 1),
              last_y = static_cast<float>(other.height - 1);
  for (int y = 0; y < view.height; ++y) {
    float* row = out.data() + static_cast<ptrdiff_t>(y) * view.width;
    const Vec3d first = h * Vec3d{0.5, y + 0.5, 1}, step = h.column(0);
    for (int x = 0; x < view.width; ++x) {
      row[x] = -1;
      const double w = first.z + step.z * x;
      if (!(w > 1e-6)) continue;
      const float u = static_cast<float>((first.x + step.x * x) / w - 0.5);
      const float v = static_cast<float>((first.y + step.y * x) / w - 0.5);
      if (!(u >= 0 && v >= 0 && u < last_x && v < last_y)) continue;
      const int i = static_cast<int>(u), j = static_cast<int>(v);
      const float a = u - static_cast<float>(i), b = v - static_cast<float>(j);
      const float* at = other.grey.data() + static_cast<ptrdiff_t>(j) * other.width + i;
      const float corners[4] = {at[0], at[1], at[other.width], at[other.width + 1]};
      if (std::min({corners[0], corners[1], corners[2], corners[3]}) < 0) continue;
      row[x] = (corners[0] * (1 - a) + corners[1] * a) * (1 - b) +
               (corners[2] * (1 - a) + corners[3] * a) * b;
    }
  }
}

// Of each pixel the plane whose correlation is best; none (inverse depth below 0) where it is not
// clearly the best.
class Sweep {
 public:
  Sweep(const std::vector<SweepImage>& images, size_t view, double nearest)
      : images_(images),
        view_(images[view]),
        others_(neighbours(images, view)),
        nearest_(nearest),
        sums_(view_.width, view_.height) {}

  const std::vector<size_t>& others() const { return others_; }

  std::vector<float> inverse_depths() {
    const size_t n = view_.grey.size();
    std::vector<float> depth(n, -1.0f);
    if (others_.empty() || view_.width <= 2 * kHalfWindow || view_.height <= 2 * kHalfWindow)
      return depth;
    prepare();
    scores_.assign(n * kPlanes, kNone);
    for (int p = 0; p < kPlanes; ++p) score_plane(p);
    for (size_t i = 0; i < n; ++i) depth[i] = winner(i);
    return depth;
  }

 private:
  double plane(double p) const { return p / (kPlanes - 1) / nearest_; }

  void prepare() {
    std::vector<float> square(view_.grey.size());
    for (size_t i = 0; i < square.size(); ++i) square[i] = view_.grey[i] * view_.grey[i];
    sums_(view_.grey, own_sum_);
    sums_(square, own_square_);
  }

  // The mean of the two neighbours that agree best: a third may not see the place.
  void score_plane(int p) {
    const size_t n = view_.grey.size();
    std::vector<float> best(n, kNone), second(n, kNone);
    for (const size_t other : others_) {
      warp(view_, images_[other], plane(p), warped_);
      square_.resize(n);
      product_.resize(n);
      missing_.resize(n);
      for (size_t i = 0; i < n; ++i) {
        const bool none = warped_[i] < 0 || view_.grey[i] < 0;
        missing_[i] = none ? 1.0f : 0.0f;
        const float g = none ? 0.0f : warped_[i];
        warped_[i] = g;
        square_[i] = g * g;
        product_[i] = g * view_.grey[i];
      }
      sums_(warped_, sum_);
      sums_(square_, sum_square_);
      sums_(product_, sum_product_);
      sums_(missing_, sum_missing_);
      constexpr float kCount = (2 * kHalfWindow + 1) * (2 * kHalfWindow + 1);
      constexpr float kLeastVariance = kLeastDeviation * kLeastDeviation;
      for (int y = kHalfWindow; y < view_.height - kHalfWindow; ++y)
        for (int x = kHalfWindow; x < view_.width - kHalfWindow; ++x) {
          const size_t i =
              static_cast<size_t>(y) * static_cast<size_t>(view_.width) + static_cast<size_t>(x);
          if (sum_missing_[i] > 0) continue;
          const float ma = own_sum_[i] / kCount, mb = sum_[i] / kCount;
          const float va = own_square_[i] / kCount - ma * ma,
                      vb = sum_square_[i] / kCount - mb * mb;
          if (!(va > kLeastVariance) || !(vb > kLeastVariance)) continue;
          const float score = (sum_product_[i] / kCount - ma * mb) / std::sqrt(va * vb);
          if (score > best[i]) {
            second[i] = best[i];
            best[i] = score;
          } else if (score > second[i]) {
            second[i] = score;
          }
        }
    }
    for (size_t i = 0; i < n; ++i)
      if (best[i] > kNone)
        scores_[i * kPlanes + static_cast<size_t>(p)] = others_.size() == 1 ? best[i]
                                                        : second[i] > kNone
                                                            ? 0.5f * (best[i] + second[i])
                                                            : kNone;
  }

  float winner(size_t i) const {
    const float* s = scores_.data() + i * kPlanes;
    const int p = static_cast<int>(std::max_element(s, s + kPlanes) - s);
    // The first plane is infinity; the last may hide a better one before it.
    if (!(s[p] > kLeastScore) || p == 0 || p == kPlanes - 1) return -1;
    for (int q = 0; q < kPlanes; ++q)
      if (std::abs(q - p) > 3 && s[q] > s[p] - kLeastLead) return -1;
    double shift = 0;  // of the parabola through three scores
    const float a = s[p - 1], b = s[p], c = s[p + 1];
    if (a > kNone && c > kNone && a - 2 * b + c < 0)
      shift = std::clamp(0.5 * static_cast<double>((a - c) / (a - 2 * b + c)), -0.5, 0.5);
    return static_cast<float>(plane(p + shift));
  }

  const std::vector<SweepImage>& images_;
  const SweepImage& view_;
  std::vector<size_t> others_;
  double nearest_;
  WindowSums sums_;
  std::vector<float> own_sum_, own_square_;
  std::vector<float> warped_, square_, product_, missing_, sum_, sum_square_, sum_product_,
      sum_missing_;
  std::vector<float> scores_;  // [pixel][plane]
};

struct Found {
  Vec3d position;  // engine coordinates
  std::vector<size_t> views;
};

// Places of one view that at least one neighbour finds at the same depth.
std::vector<Found> agreed(const std::vector<SweepImage>& images,
                          const std::vector<std::vector<float>>& depths, size_t view,
                          const std::vector<size_t>& others, double step) {
  constexpr int kEvery = 3;  // pixels: a point for each stands for its window
  constexpr double kMostSteps = 2;
  const SweepImage& image = images[view];
  std::vector<Found> out;
  for (int y = kEvery / 2; y < image.height; y += kEvery)
    for (int x = kEvery / 2; x < image.width; x += kEvery) {
      const float inverse = depths[view][static_cast<size_t>(y) * static_cast<size_t>(image.width) +
                                         static_cast<size_t>(x)];
      if (!(inverse > 0)) continue;
      const double z = 1 / static_cast<double>(inverse);
      Found found{image.to_engine * Vec3d{(x + 0.5 - image.cx()) / image.focal * z,
                                          (y + 0.5 - image.cy()) / image.focal * z, z},
                  {view}};
      for (const size_t other : others) {
        if (depths[other].empty()) continue;
        const SweepImage& o = images[other];
        const Vec3d p = o.to_engine.inverse() * found.position;
        if (!(p.z > 0)) continue;
        const double u = p.x / p.z * o.focal + o.cx(), v = p.y / p.z * o.focal + o.cy();
        if (!(u >= 0 && v >= 0 && u < o.width && v < o.height)) continue;
        const float there = depths[other][static_cast<size_t>(v) * static_cast<size_t>(o.width) +
                                          static_cast<size_t>(u)];
        if (there > 0 && std::abs(static_cast<double>(there) - 1 / p.z) < kMostSteps * step)
          found.views.push_back(other);
      }
      if (found.views.size() > 1) out.push_back(std::move(found));
    }
  return out;
}

// Of the points those that some photo is said to see.
int points_seen(const Scene& scene) {
  std::vector<uint8_t> seen(scene.points.size());
  for (const Observation& o : scene.observations) seen[static_cast<size_t>(o.point)] = 1;
  return static_cast<int>(std::count(seen.begin(), seen.end(), uint8_t{1}));
}

// A sweep sees 50 degrees to each side: of a lens that sees more it would take for empty what it
// did not look at.
bool is_narrow(const Camera& camera) {
  const auto edge = unproject(camera, {0, 0.5 * camera.height});
  return !is_panorama(camera) && edge && edge->z > 0 && std::abs(edge->x) < 1.19 * edge->z;
}

}  // namespace

int add_swept_points(Scene& scene, const PhotoSet& photos, ThreadPool& pool, const Cancel* cancel) {
  if (scene.alpha || points_seen(scene) >= kFewPoints) return 0;
  // Where nobody says who sees the points they still say where content begins.
  const bool has_near = static_cast<int>(scene.points.size()) >= kFewPoints || scene.states_depths;
  std::vector<int> views;
  for (const int v : scene.train)
    if (scene.views[static_cast<size_t>(v)].scale == 1 &&
        is_narrow(photos.cameras[static_cast<size_t>(v)]))
      views.push_back(v);
  if (views.size() < 2) return 0;
  const size_t taken = std::min(kMostViews, views.size());
  for (size_t i = 0; i < taken; ++i) views[i] = views[i * views.size() / taken];
  views.resize(taken);

  std::vector<SweepImage> images(taken);
  pool.parallel_for(static_cast<int64_t>(taken), [&](int64_t i) {
    const size_t v = static_cast<size_t>(views[static_cast<size_t>(i)]);
    images[static_cast<size_t>(i)] = internal::make_sweep_image(
        photos.photos[v], photos.cameras[v], scene.to_engine.apply(scene.views[v].pose), kLongest);
  });
  // A tenth of the way to what the photos show, but for a few that were taken close up: nobody
  // holds a camera closer.
  std::vector<double> usual;
  for (const SweepImage& image : images) usual.push_back(usual_distance(image.to_engine));
  const auto low = usual.begin() + static_cast<std::ptrdiff_t>(taken / 5);
  std::nth_element(usual.begin(), low, usual.end());
  const double nearest = 0.1 * *low, step = 1 / nearest / (kPlanes - 1);
  std::vector<std::vector<float>> depths(taken);
  std::vector<std::vector<size_t>> others(taken);
  pool.parallel_for(static_cast<int64_t>(taken), [&](int64_t i) {
    if (cancel && cancel->requested()) throw Cancelled();
    Sweep sweep(images, static_cast<size_t>(i), nearest);
    depths[static_cast<size_t>(i)] = sweep.inverse_depths();
    others[static_cast<size_t>(i)] = sweep.others();
  });
  int added = 0;
  std::vector<double> distances;
  for (size_t i = 0; i < taken; ++i)
    for (const Found& found : agreed(images, depths, i, others[i], step)) {
      const auto point = static_cast<int32_t>(scene.points.size());
      scene.points.push_back(
          {scene.to_engine.apply_inverse(found.position), 0, static_cast<int>(found.views.size())});
      for (const size_t v : found.views) {
        scene.observations.push_back({static_cast<int32_t>(views[v]), point});
        distances.push_back(length(found.position - images[v].to_engine.translation));
      }
      ++added;
    }
  if (added >= kFewPoints && scene.unbounded && !has_near) internal::set_near_far(distances, scene);
  return added;
}

}  // namespace nerf
