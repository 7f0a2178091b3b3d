#include "nerf/geometry/depth_fusion.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <memory>
#include <string>

#include "nerf/base/error.h"

namespace nerf {

namespace {

constexpr int kTile = 8;  // pixels along the side of what has a greatest depth

// A view as fusion looks at it: where a sample of the volume is in the picture, and what is there.
class FusedView {
 public:
  FusedView(const DepthView& view, double spacing)
      : view_(view), to_camera_(view.to_world.inverse()), spacing_(spacing) {
    NERF_CHECK_EQ(view.depth.size(),
                  static_cast<size_t>(view.width) * static_cast<size_t>(view.height));
    find_cosines();
    find_tiles();
  }

  const DepthView& view() const { return view_; }

  // Adds what the view says of the block's samples. `corner`: its first sample.
  void add_to(VoxelVolume::Block& block, const Vec3d& corner, double truncation) const {
    const Vec3d first = to_camera_ * corner;
    const double extent = (VoxelVolume::kSide - 1) * spacing_;
    Box3 box;  // of the block, camera axes
    for (int k = 0; k < 8; ++k) box.extend(first + step(k & 1, k >> 1 & 1, k >> 2, extent));
    if (box.max.z <= kLeastDepth) return;
    if (box.min.z > kLeastDepth) {
      int x0, y0, x1, y1;
      if (!pixels_of(first, extent, x0, y0, x1, y1)) return;
      // Behind everything, as far as is to be known.
      if (box.min.z > double{greatest_depth(x0, y0, x1, y1)} + truncation) return;
    }
    const Mat3d& r = to_camera_.rotation;
    const Vec3d dx = r.column(0) * spacing_, dy = r.column(1) * spacing_,
                dz = r.column(2) * spacing_;
    size_t i = 0;
    for (int z = 0; z < VoxelVolume::kSide; ++z)
      for (int y = 0; y < VoxelVolume::kSide; ++y) {
        Vec3d p = first + dz * z + dy * y;
        for (int x = 0; x < VoxelVolume::kSide; ++x, ++i, p = p + dx)
          add(p, truncation, block.value[i], block.weight[i]);
      }
  }

 private:
  static constexpr double kLeastDepth = 1e-9;

  Vec3d step(int x, int y, int z, double length) const {
    const Mat3d& r = to_camera_.rotation;
    return (r.column(0) * x + r.column(1) * y + r.column(2) * z) * length;
  }

  float depth(int x, int y) const {
    return view_
        .depth[static_cast<size_t>(y) * static_cast<size_t>(view_.width) + static_cast<size_t>(x)];
  }
  static bool is_surface(float d) { return d > 0 && d < DepthView::kNothing; }

  // Between a pixel's ray and the surface, from the differences to its neighbours that are nearer
  // in depth; 1 where there are none.
  void find_cosines() {
    const auto nearer = [&](float d, float a, float b, double& slope, int& side) {
      const bool has_a = is_surface(a), has_b = is_surface(b);
      if (!has_a && !has_b) return false;
      const bool take_b = has_b && (!has_a || std::fabs(b - d) < std::fabs(a - d));
      slope = take_b ? double{b} - double{d} : double{d} - double{a};
      side = take_b ? 1 : -1;
      return true;
    };
    cosine_.assign(view_.depth.size(), 1.0f);
    for (int y = 0; y < view_.height; ++y)
      for (int x = 0; x < view_.width; ++x) {
        const float d = depth(x, y);
        if (!is_surface(d)) continue;
        double ax, ay;
        int sx, sy;
        if (!nearer(d, x > 0 ? depth(x - 1, y) : 0, x + 1 < view_.width ? depth(x + 1, y) : 0, ax,
                    sx) ||
            !nearer(d, y > 0 ? depth(x, y - 1) : 0, y + 1 < view_.height ? depth(x, y + 1) : 0, ay,
                    sy))
          continue;
        // Of the surface's points by x and y.
        const Vec3d along = view_.direction(x, y);
        const Vec3d u = along * ax + Vec3d{double{d} / view_.focal, 0, 0};
        const Vec3d v = along * ay + Vec3d{0, double{d} / view_.focal, 0};
        const double cosine = std::fabs(dot(normalized(cross(u, v)), normalized(along)));
        cosine_[static_cast<size_t>(y) * static_cast<size_t>(view_.width) +
                static_cast<size_t>(x)] = static_cast<float>(std::max(cosine, kLeastCosine));
      }
  }
  static constexpr double kLeastCosine = 0.1;

  void find_tiles() {
    columns_ = (view_.width + kTile - 1) / kTile;
    const int rows = (view_.height + kTile - 1) / kTile;
    greatest_.assign(static_cast<size_t>(columns_) * static_cast<size_t>(rows), 0.0f);
    for (int y = 0; y < view_.height; ++y)
      for (int x = 0; x < view_.width; ++x) {
        const size_t tile = static_cast<size_t>(y / kTile) * static_cast<size_t>(columns_) +
                            static_cast<size_t>(x / kTile);
        greatest_[tile] = std::max(greatest_[tile], depth(x, y));
      }
  }

  // The pixels that a block before the camera may be in, one more all around; false: none.
  bool pixels_of(const Vec3d& first, double extent, int& x0, int& y0, int& x1, int& y1) const {
    double left = 1e300, right = -1e300, top = 1e300, bottom = -1e300;
    for (int k = 0; k < 8; ++k) {
      const Vec3d p = first + step(k & 1, k >> 1 & 1, k >> 2, extent);
      const double u = view_.focal * p.x / p.z, v = view_.focal * p.y / p.z;
      left = std::min(left, u);
      right = std::max(right, u);
      top = std::min(top, v);
      bottom = std::max(bottom, v);
    }
    const double w = 0.5 * view_.width, h = 0.5 * view_.height;
    if (right < -w || left > w || bottom < -h || top > h) return false;
    x0 = static_cast<int>(std::clamp(left + w - 1, 0.0, view_.width - 1.0));
    x1 = static_cast<int>(std::clamp(right + w + 1, 0.0, view_.width - 1.0));
    y0 = static_cast<int>(std::clamp(top + h - 1, 0.0, view_.height - 1.0));
    y1 = static_cast<int>(std::clamp(bottom + h + 1, 0.0, view_.height - 1.0));
    return true;
  }

  float greatest_depth(int x0, int y0, int x1, int y1) const {
    float greatest = 0;
    for (int y = y0 / kTile; y <= y1 / kTile; ++y)
      for (int x = x0 / kTile; x <= x1 / kTile; ++x)
        greatest =
            std::max(greatest, greatest_[static_cast<size_t>(y) * static_cast<size_t>(columns_) +
                                         static_cast<size_t>(x)]);
    return greatest;
  }

  // A sample at p, camera axes.
  void add(const Vec3d& p, double truncation, float& value, float& weight) const {
    if (!(p.z > kLeastDepth)) return;
    const double inverse = 1 / p.z;
    const double u = view_.focal * p.x * inverse + 0.5 * view_.width;
    const double v = view_.focal * p.y * inverse + 0.5 * view_.height;
    if (!(u >= 0 && v >= 0 && u < view_.width && v < view_.height)) return;
    const int x = static_cast<int>(u), y = static_cast<int>(v);
    const size_t at =
        static_cast<size_t>(y) * static_cast<size_t>(view_.width) + static_cast<size_t>(x);
    const float nearest = view_.depth[at];
    if (!(nearest > 0)) return;
    const double ray = length(p) * inverse;  // distance per depth
    double w = static_cast<double>(cosine_[at]) * inverse * inverse, distance = 1;
    if (nearest < DepthView::kNothing) {
      const double d = smooth_depth(u - 0.5, v - 0.5, nearest, truncation);
      distance = (d - p.z) * ray / truncation;
      if (distance < -1) return;
      // Matter may be thin: what lies behind its surface is the less certain the deeper.
      if (distance < 0) w *= 1 + distance;
      distance = std::min(distance, 1.0);
    }
    value += static_cast<float>(w * distance);
    weight += static_cast<float>(w);
  }

  // Between the four pixels around, where they belong to one surface: else the nearest's.
  double smooth_depth(double u, double v, float nearest, double truncation) const {
    const int x = static_cast<int>(std::floor(u)), y = static_cast<int>(std::floor(v));
    if (x < 0 || y < 0 || x + 1 >= view_.width || y + 1 >= view_.height) return double{nearest};
    const float a = depth(x, y), b = depth(x + 1, y), c = depth(x, y + 1), d = depth(x + 1, y + 1);
    const float least = std::min(std::min(a, b), std::min(c, d));
    const float most = std::max(std::max(a, b), std::max(c, d));
    if (!(least > 0) || !(double{most} - double{least} < truncation)) return double{nearest};
    const double s = u - x, t = v - y;
    return (1 - t) * ((1 - s) * double{a} + s * double{b}) +
           t * ((1 - s) * double{c} + s * double{d});
  }

  const DepthView& view_;
  Pose to_camera_;
  double spacing_;
  std::vector<float> cosine_;  // of each pixel
  int columns_ = 0;
  std::vector<float> greatest_;  // of tiles
};

// Marks the blocks around a view's surface.
void mark_blocks(const DepthView& view, const VoxelVolume& volume,
                 std::vector<std::atomic<uint8_t>>& marks) {
  constexpr double kMargin = 2;  // samples
  const VoxelLattice& lattice = volume.lattice();
  const std::array<int, 3>& along = volume.blocks_along();
  for (int y = 0; y < view.height; ++y)
    for (int x = 0; x < view.width; ++x) {
      const float d = view.depth[static_cast<size_t>(y) * static_cast<size_t>(view.width) +
                                 static_cast<size_t>(x)];
      if (!(d > 0 && d < DepthView::kNothing)) continue;
      const Vec3d p = view.to_world * (view.direction(x, y) * double{d});
      const Vec3d at = (p - lattice.origin) / lattice.spacing;
      int low[3], high[3];
      bool inside = true;
      for (int k = 0; k < 3; ++k) {
        const double end = along[static_cast<size_t>(k)] * VoxelVolume::kSide;
        inside = inside && at[k] > -kMargin && at[k] < end + kMargin;
        if (!inside) break;
        const int last = along[static_cast<size_t>(k)] - 1;
        low[k] = std::clamp(static_cast<int>((at[k] - kMargin) / VoxelVolume::kSide), 0, last);
        high[k] = std::clamp(static_cast<int>((at[k] + kMargin) / VoxelVolume::kSide), 0, last);
      }
      if (!inside) continue;
      for (int k = low[2]; k <= high[2]; ++k)
        for (int j = low[1]; j <= high[1]; ++j)
          for (int i = low[0]; i <= high[0]; ++i)
            marks[static_cast<size_t>(volume.block_index(i, j, k))].store(
                1, std::memory_order_relaxed);
    }
}

}  // namespace

VoxelVolume fuse_depths(std::span<const DepthView> views, const VoxelLattice& lattice,
                        const FusionOptions& options, uint64_t memory_bytes, ThreadPool& pool,
                        const Cancel* cancel) {
  NERF_CHECK_GT(options.truncation, 0.0);
  VoxelVolume volume(lattice);
  std::vector<std::unique_ptr<FusedView>> fused(views.size());
  {
    std::vector<std::atomic<uint8_t>> marks(static_cast<size_t>(volume.block_count()));
    pool.parallel_for(static_cast<int64_t>(views.size()), [&](int64_t v) {
      if (cancel && cancel->requested()) throw Cancelled();
      const size_t i = static_cast<size_t>(v);
      mark_blocks(views[i], volume, marks);
      fused[i] = std::make_unique<FusedView>(views[i], lattice.spacing);
    });
    const std::vector<uint8_t> wanted(marks.begin(), marks.end());
    const int64_t blocks = std::count(wanted.begin(), wanted.end(), 1);
    // Triangles take about as much again.
    if (2 * VoxelVolume::bytes_of(blocks) > memory_bytes)
      throw Error("the surface's volume needs " +
                      std::to_string(2 * VoxelVolume::bytes_of(blocks) >> 20) +
                      " MB of memory, and " + std::to_string(memory_bytes >> 20) + " MB are there",
                  "--resolution", "give a smaller one, or a smaller --bbox");
    volume.allocate(wanted);
  }
  std::vector<VoxelVolume::Block>& blocks = volume.blocks();
  pool.parallel_for(static_cast<int64_t>(blocks.size()), [&](int64_t b) {
    if (cancel && cancel->requested()) throw Cancelled();
    VoxelVolume::Block& block = blocks[static_cast<size_t>(b)];
    const Vec3d corner = volume.corner(block);
    for (const auto& view : fused) view->add_to(block, corner, options.truncation);
    for (size_t i = 0; i < block.value.size(); ++i)
      if (block.weight[i] > options.least_weight)
        block.value[i] /= block.weight[i];
      else
        block.weight[i] = 0;
  });
  return volume;
}

void carve_unseen(std::span<const DepthView> views, double truncation, VoxelVolume& volume,
                  ThreadPool& pool, const Cancel* cancel) {
  std::vector<std::unique_ptr<FusedView>> fused(views.size());
  pool.parallel_for(static_cast<int64_t>(views.size()), [&](int64_t v) {
    const size_t i = static_cast<size_t>(v);
    fused[i] = std::make_unique<FusedView>(views[i], volume.lattice().spacing);
  });
  std::vector<VoxelVolume::Block>& blocks = volume.blocks();
  pool.parallel_for(static_cast<int64_t>(blocks.size()), [&](int64_t b) {
    if (cancel && cancel->requested()) throw Cancelled();
    VoxelVolume::Block& block = blocks[static_cast<size_t>(b)];
    VoxelVolume::Block seen;
    for (const auto& view : fused) view->add_to(seen, volume.corner(block), truncation);
    for (size_t i = 0; i < seen.weight.size(); ++i)
      block.weight[i] = block.weight[i] > 0 && seen.weight[i] > 0 ? 1.0f : 0.0f;
  });
}

std::vector<Vec3d> mean_view_directions(std::span<const DepthView> views,
                                        std::span<const Vec3> positions,
                                        std::span<const Vec3> normals, double width,
                                        ThreadPool& pool) {
  NERF_CHECK_EQ(normals.size(), positions.size());
  std::vector<Pose> to_camera;
  for (const DepthView& view : views) to_camera.push_back(view.to_world.inverse());
  std::vector<Vec3d> means(positions.size());
  constexpr size_t kPoints = 1024;
  const size_t n = positions.size();
  pool.parallel_for(static_cast<int64_t>((n + kPoints - 1) / kPoints), [&](int64_t part) {
    const size_t begin = static_cast<size_t>(part) * kPoints, end = std::min(n, begin + kPoints);
    for (size_t i = begin; i < end; ++i) {
      const Vec3d point = positions[i].cast<double>(), normal = normals[i].cast<double>();
      Vec3d sum;
      for (size_t v = 0; v < views.size(); ++v) {
        const DepthView& view = views[v];
        const Vec3d towards = normalized(view.to_world.translation - point);
        const double cosine = dot(towards, normal);
        if (!(cosine > 0)) continue;
        const Vec3d p = to_camera[v] * point;
        if (!(p.z > 0)) continue;
        const double x = view.focal * p.x / p.z + 0.5 * view.width;
        const double y = view.focal * p.y / p.z + 0.5 * view.height;
        if (!(x >= 0 && y >= 0 && x < view.width && y < view.height)) continue;
        const float d = view.depth[static_cast<size_t>(y) * static_cast<size_t>(view.width) +
                                   static_cast<size_t>(x)];
        if (d > 0 && p.z < double{d} + width) sum = sum + towards * cosine;
      }
      means[i] = sum == Vec3d() ? normal : normalized(sum);
    }
  });
  return means;
}

}  // namespace nerf
