#include "nerf/geometry/triangle_bvh.h"

#include <cmath>
#include <numeric>

#include "nerf/base/error.h"

namespace nerf {

namespace {

constexpr size_t kLeaf = 4;    // triangles that are not worth a split
constexpr int kBins = 16;      // along an axis
constexpr int kDeepest = 90;   // levels; the stacks of the walks hold a few more
constexpr double kStep = 1.0;  // cost of a step to two children against that of a triangle

double half_area(const Box3& box) {
  if (box.empty()) return 0;
  const Vec3d s = box.size();
  return s.x * s.y + s.y * s.z + s.z * s.x;
}
void extend(Box3& box, const Box3& other) {
  if (other.empty()) return;
  box.extend(other.min);
  box.extend(other.max);
}

}  // namespace

class TriangleBvh::Builder {
 public:
  Builder(std::span<const Vec3> positions, std::span<const TriangleMesh::Triangle> triangles,
          TriangleBvh& out)
      : out_(out) {
    for (size_t t = 0; t < triangles.size(); ++t) {
      Box3 box;
      Corners c;
      const auto corner = [&](size_t k) { return positions[triangles[t][k]].cast<double>(); };
      c.a = corner(0);
      c.ab = corner(1) - c.a;
      c.ac = corner(2) - c.a;
      const double area = length(cross(c.ab, c.ac));
      if (!(area > 0) || !std::isfinite(area)) continue;
      for (size_t k = 0; k < 3; ++k) box.extend(corner(k));
      boxes_.push_back(box);
      centres_.push_back(box.center());
      corners_.push_back(c);
      given_.push_back(static_cast<uint32_t>(t));
    }
    order_.resize(boxes_.size());
    std::iota(order_.begin(), order_.end(), uint32_t{0});
  }

  void build() {
    if (order_.empty()) return;
    out_.nodes_.emplace_back();
    split(0, 0, order_.size(), 0);
    for (const uint32_t i : order_) {
      out_.corners_.push_back(corners_[i]);
      out_.indices_.push_back(given_[i]);
    }
    for (const Box3& box : boxes_) extend(out_.box_, box);
  }

 private:
  struct Bin {
    Box3 box;
    size_t count = 0;
  };

  // Of [begin, end) of the order, which becomes the triangles of `node`.
  void split(size_t node, size_t begin, size_t end, int level) {
    Box3 box, centres;
    for (size_t i = begin; i < end; ++i) {
      extend(box, boxes_[order_[i]]);
      centres.extend(centres_[order_[i]]);
    }
    set_box(out_.nodes_[node], box);
    const size_t n = end - begin;
    const size_t middle =
        n <= kLeaf || level >= kDeepest ? begin : best_split(box, centres, begin, end);
    if (middle == begin) {
      out_.nodes_[node].first = static_cast<uint32_t>(begin);
      out_.nodes_[node].count = static_cast<uint32_t>(n);
      return;
    }
    const size_t child = out_.nodes_.size();
    out_.nodes_[node].first = static_cast<uint32_t>(child);
    out_.nodes_[node].count = 0;
    out_.nodes_.resize(child + 2);
    split(child, begin, middle, level + 1);
    split(child + 1, middle, end, level + 1);
  }

  static void set_box(Node& node, const Box3& box) {
    for (int k = 0; k < 3; ++k) {
      const size_t i = static_cast<size_t>(k);
      constexpr float kInfinity = std::numeric_limits<float>::infinity();
      // Outwards, so that nothing is lost in rounding.
      node.min[i] = std::nextafter(static_cast<float>(box.min[k]), -kInfinity);
      node.max[i] = std::nextafter(static_cast<float>(box.max[k]), kInfinity);
    }
  }

  // Where the second half begins; `begin` where one leaf is better.
  size_t best_split(const Box3& box, const Box3& centres, size_t begin, size_t end) {
    const double whole = half_area(box);
    double best = std::numeric_limits<double>::infinity();
    int best_axis = -1, best_bin = 0;
    for (int axis = 0; axis < 3; ++axis) {
      if (!(centres.size()[axis] > 0)) continue;
      std::array<Bin, kBins> bins;
      for (size_t i = begin; i < end; ++i) {
        Bin& bin = bins[static_cast<size_t>(bin_of(centres, axis, order_[i]))];
        extend(bin.box, boxes_[order_[i]]);
        ++bin.count;
      }
      std::array<double, kBins> after{};  // cost of what comes behind a bin
      Bin sum;
      for (int b = kBins - 1; b > 0; --b) {
        extend(sum.box, bins[static_cast<size_t>(b)].box);
        sum.count += bins[static_cast<size_t>(b)].count;
        after[static_cast<size_t>(b - 1)] = half_area(sum.box) * static_cast<double>(sum.count);
      }
      sum = {};
      for (int b = 0; b + 1 < kBins; ++b) {
        extend(sum.box, bins[static_cast<size_t>(b)].box);
        sum.count += bins[static_cast<size_t>(b)].count;
        if (sum.count == 0 || sum.count == end - begin) continue;
        const double cost = kStep * whole + half_area(sum.box) * static_cast<double>(sum.count) +
                            after[static_cast<size_t>(b)];
        if (cost < best) best = cost, best_axis = axis, best_bin = b;
      }
    }
    const size_t n = end - begin;
    if (best_axis < 0) return n > 4 * kLeaf ? begin + n / 2 : begin;  // all in one place
    if (n <= 4 * kLeaf && best >= whole * static_cast<double>(n)) return begin;
    const auto at = std::partition(order_.begin() + static_cast<ptrdiff_t>(begin),
                                   order_.begin() + static_cast<ptrdiff_t>(end), [&](uint32_t i) {
                                     return bin_of(centres, best_axis, i) <= best_bin;
                                   });
    return static_cast<size_t>(at - order_.begin());
  }

  int bin_of(const Box3& centres, int axis, uint32_t triangle) const {
    const double at = (centres_[triangle][axis] - centres.min[axis]) / centres.size()[axis];
    return std::min(kBins - 1, static_cast<int>(at * kBins));
  }

  TriangleBvh& out_;
  std::vector<Box3> boxes_;
  std::vector<Vec3d> centres_;
  std::vector<Corners> corners_;
  std::vector<uint32_t> given_, order_;
};

TriangleBvh::TriangleBvh(std::span<const Vec3> positions,
                         std::span<const TriangleMesh::Triangle> triangles) {
  Builder(positions, triangles, *this).build();
}

}  // namespace nerf
