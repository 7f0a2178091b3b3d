#include "corner_tracks.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

namespace nerf::internal {

namespace {

constexpr size_t kLongest = 24, kShortest = 8, kEvery = 4;  // frames
constexpr int kBlock = 10;                                  // pixels, here and below
constexpr int kHalf = 3;                                    // of a window of kPixels
constexpr int kPixels = (2 * kHalf + 1) * (2 * kHalf + 1);
constexpr int kReach = kTrackedSize / 20;     // from where a corner is looked for
constexpr float kLeastCorner = 2e-4f;         // squared differences of grey
constexpr float kLeastDeviation = 1e-3f;      // of a window's grey
constexpr float kAlike = 0.9f, kSame = 0.8f;  // correlations: next frame, first frame
constexpr double kStill = 3;                  // rms
constexpr double kSmoothStep = 0.7;           // of the largest distance, from frame to frame

struct Place {
  int x = 0, y = 0;
};

// A picture with what correlations of its windows need.
class Windows {
 public:
  explicit Windows(const SweepImage& image)
      : image(image), mean_(image.grey.size()), scale_(image.grey.size()) {
    for (int y = kHalf; y + kHalf < image.height; ++y)
      for (int x = kHalf; x + kHalf < image.width; ++x) measure({x, y});
  }

  // Whether all of the window around p is known and not even.
  bool usable(Place p) const {
    return p.x >= 0 && p.y >= 0 && p.x < image.width && p.y < image.height && scale_[at(p)] > 0;
  }
  const float* grey(Place p) const { return image.grey.data() + at(p); }

  // Of the window around p with those around row y's places of `other` from x on, in [-1, 1]; -2
  // where one is not usable. All windows lie in the pictures.
  void correlate(Place p, const Windows& other, int x, int y, std::span<float> out) const {
    std::ranges::fill(out, 0.0f);
    for (int j = -kHalf; j <= kHalf; ++j)
      for (int i = -kHalf; i <= kHalf; ++i) {
        const float a = grey({p.x, p.y + j})[i];
        const float* b = other.grey({x + i, y + j});
        for (size_t k = 0; k < out.size(); ++k) out[k] += a * b[k];
      }
    const float sum = kPixels * mean_[at(p)], scale = scale_[at(p)];
    const float* means = other.mean_.data() + other.at({x, y});
    const float* scales = other.scale_.data() + other.at({x, y});
    for (size_t k = 0; k < out.size(); ++k)
      out[k] = scales[k] > 0 ? (out[k] - sum * means[k]) * scale * scales[k] : -2;
  }

  const SweepImage& image;

 private:
  size_t at(Place p) const {
    return static_cast<size_t>(p.y) * static_cast<size_t>(image.width) + static_cast<size_t>(p.x);
  }
  void measure(Place p) {
    float sum = 0, squares = 0;
    for (int y = -kHalf; y <= kHalf; ++y)
      for (int x = -kHalf; x <= kHalf; ++x) {
        const float g = grey({p.x, p.y + y})[x];
        if (g < 0) return;
        sum += g;
        squares += g * g;
      }
    const float mean = sum / kPixels;
    const float variance = squares / kPixels - mean * mean;
    if (!(variance > kLeastDeviation * kLeastDeviation)) return;
    mean_[at(p)] = mean;
    scale_[at(p)] = 1 / std::sqrt(kPixels * variance);
  }

  std::vector<float> mean_;
  std::vector<float> scale_;  // 1 / (standard deviation sqrt(kPixels)); 0: not usable
};

// The smaller eigenvalue of the mean structure tensor around p; 0 where not all is known.
float corner_strength(const Windows& w, Place p) {
  if (p.x <= kHalf || p.y <= kHalf || p.x + kHalf + 1 >= w.image.width ||
      p.y + kHalf + 1 >= w.image.height || !w.usable(p))
    return 0;
  float xx = 0, xy = 0, yy = 0;
  for (int y = -kHalf; y <= kHalf; ++y)
    for (int x = -kHalf; x <= kHalf; ++x) {
      const float* g = w.grey({p.x + x, p.y + y});
      const float left = g[-1], right = g[1], above = g[-w.image.width], below = g[w.image.width];
      if (left < 0 || right < 0 || above < 0 || below < 0) return 0;
      const float dx = 0.5f * (right - left), dy = 0.5f * (below - above);
      xx += dx * dx;
      xy += dx * dy;
      yy += dy * dy;
    }
  return 0.5f / kPixels * (xx + yy - std::sqrt((xx - yy) * (xx - yy) + 4 * xy * xy));
}

struct Found {
  Place place;
  float correlation = -2;
};

// Where `to` looks most like `from` around p.
Found find(const Windows& from, Place p, const Windows& to, Place around, int reach) {
  Found best;
  const int left = std::max(around.x - reach, kHalf);
  const int right = std::min(around.x + reach, to.image.width - kHalf - 1);
  const int top = std::max(around.y - reach, kHalf);
  const int bottom = std::min(around.y + reach, to.image.height - kHalf - 1);
  if (left > right) return best;
  float row[2 * kReach + 1];
  const std::span<float> used(row, static_cast<size_t>(right - left + 1));
  for (int y = top; y <= bottom; ++y) {
    from.correlate(p, to, left, y, used);
    const auto most = std::ranges::max_element(used);
    if (*most > best.correlation) best = {{left + static_cast<int>(most - used.begin()), y}, *most};
  }
  return best;
}

// In camera axes, z = 1.
Vec3d direction_of(const SweepImage& image, Place p) {
  return {(p.x + 0.5 - image.cx()) / image.focal, (p.y + 0.5 - image.cy()) / image.focal, 1};
}

// Where in `to` a far thing is that `from` shows at p.
Place turned(const SweepImage& from, Place p, const SweepImage& to) {
  const Vec3d d =
      to.to_engine.rotation.transposed() * (from.to_engine.rotation * direction_of(from, p));
  if (!(d.z > 0.1)) return p;
  return {static_cast<int>(std::lround(to.focal * d.x / d.z + to.cx() - 0.5)),
          static_cast<int>(std::lround(to.focal * d.y / d.z + to.cy() - 0.5))};
}

// The corner at p of frames[0], as far as it can be followed.
std::vector<Place> follow(std::span<const Windows> frames, Place p) {
  std::vector<Place> track{p};
  while (track.size() < frames.size()) {
    const Windows& now = frames[track.size() - 1];
    const Windows& next = frames[track.size()];
    const Place last = track.back();
    Place expected = turned(now.image, last, next.image);
    if (track.size() > 1) {
      const Place before = track[track.size() - 2];
      expected = {2 * last.x - before.x, 2 * last.y - before.y};
    }
    const Found found = find(now, last, next, expected, kReach);
    if (found.correlation < kAlike) break;
    const Found back = find(next, found.place, now, last, kReach);
    if (std::abs(back.place.x - last.x) > 1 || std::abs(back.place.y - last.y) > 1) break;
    // By the first frame, so that small errors do not add up.
    const Found first = find(frames[0], p, next, found.place, 1);
    track.push_back(first.correlation > kSame ? first.place : found.place);
  }
  return track;
}

// Whether no point of the first place's ray is where the track is.
bool moves(std::span<const Windows> frames, std::span<const Place> track) {
  const SweepImage& first = frames[0].image;
  const Vec3d ray = first.to_engine.rotation * direction_of(first, track[0]);
  struct Line {  // in a frame's camera axes: far + w near, w the inverse depth in the first frame
    Vec3d far, near, seen;
    double z(double w) const { return std::max(far.z + w * near.z, 1e-3 * std::abs(far.z)); }
    Vec2d off(double w, double focal) const {
      return {focal * ((far.x + w * near.x) / z(w) - seen.x),
              focal * ((far.y + w * near.y) / z(w) - seen.y)};
    }
  };
  std::vector<Line> lines;
  for (size_t k = 1; k < track.size(); ++k) {
    const SweepImage& image = frames[k].image;
    const Mat3d turn = image.to_engine.rotation.transposed();
    lines.push_back({turn * ray, turn * (first.to_engine.translation - image.to_engine.translation),
                     direction_of(image, track[k])});
  }
  // The least sum of squared distances: linear in w but for z, which is the last round's.
  double w = 0;
  for (int round = 0; round < 4; ++round) {
    double across = 0, squares = 0;
    for (const Line& l : lines) {
      const double weight = 1 / (l.z(w) * l.z(w));
      const double ax = l.far.x - l.seen.x * l.far.z, bx = l.near.x - l.seen.x * l.near.z;
      const double ay = l.far.y - l.seen.y * l.far.z, by = l.near.y - l.seen.y * l.near.z;
      across += weight * (ax * bx + ay * by);
      squares += weight * (bx * bx + by * by);
    }
    w = squares > 0 ? std::max(0.0, -across / squares) : 0;
  }
  double sum = 0, largest = 0, step = 0;
  Vec2d before{};
  for (const Line& l : lines) {
    const Vec2d off = l.off(w, first.focal);
    sum += off.x * off.x + off.y * off.y;
    largest = std::max(largest, std::hypot(off.x, off.y));
    step = std::max(step, std::hypot(off.x - before.x, off.y - before.y));
    before = off;
  }
  return std::sqrt(sum / static_cast<double>(lines.size())) > kStill &&
         step <= kSmoothStep * largest;
}

CornerTracks follow_from(std::span<const Windows> frames, const Cancel* cancel) {
  CornerTracks out;
  const SweepImage& image = frames[0].image;
  for (int top = 0; top + kBlock <= image.height; top += kBlock) {
    if (cancel && cancel->requested()) throw Cancelled();
    for (int left = 0; left + kBlock <= image.width; left += kBlock) {
      float best = 0;
      Place corner;
      for (int y = top; y < top + kBlock; ++y)
        for (int x = left; x < left + kBlock; ++x) {
          const float strength = corner_strength(frames[0], {x, y});
          if (strength <= best) continue;
          best = strength;
          corner = {x, y};
        }
      if (best < kLeastCorner) continue;
      const std::vector<Place> track = follow(frames, corner);
      if (track.size() < kShortest) continue;
      ++out.followed;
      out.moving += moves(frames, track);
    }
  }
  return out;
}

}  // namespace

CornerTracks follow_corners(std::span<const SweepImage> frames, ThreadPool& pool,
                            const Cancel* cancel) {
  CornerTracks all;
  if (frames.size() < kShortest) return all;
  std::vector<std::optional<Windows>> made(frames.size());
  pool.parallel_for(static_cast<int64_t>(frames.size()), [&](int64_t i) {
    made[static_cast<size_t>(i)].emplace(frames[static_cast<size_t>(i)]);
  });
  std::vector<Windows> windows;
  for (std::optional<Windows>& w : made) windows.push_back(std::move(*w));
  const size_t starts = (frames.size() - kShortest) / kEvery + 1;
  std::vector<CornerTracks> found(starts);
  pool.parallel_for(static_cast<int64_t>(starts), [&](int64_t i) {
    const size_t begin = static_cast<size_t>(i) * kEvery;
    const std::span<const Windows> rest = std::span<const Windows>(windows).subspan(begin);
    found[static_cast<size_t>(i)] =
        follow_from(rest.first(std::min(rest.size(), kLongest)), cancel);
  });
  for (const CornerTracks& f : found) {
    all.followed += f.followed;
    all.moving += f.moving;
  }
  return all;
}

}  // namespace nerf::internal
