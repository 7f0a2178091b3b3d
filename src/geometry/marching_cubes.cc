#include "nerf/geometry/marching_cubes.h"

#include <algorithm>
#include <array>
#include <bit>

#include "nerf/base/error.h"

namespace nerf {

namespace {

using Polygon = std::vector<uint8_t>;  // edges of a cell

// Other axes than `axis`, the lesser first.
constexpr std::array<int, 2> others(int axis) {
  return axis == 0 ? std::array{1, 2} : axis == 1 ? std::array{0, 2} : std::array{0, 1};
}

// The edge between two neighbouring corners.
uint8_t edge_between(int a, int b) {
  const int axis = std::countr_zero(static_cast<unsigned>(a ^ b)), low = a & b;
  const auto [u, v] = others(axis);
  return static_cast<uint8_t>(4 * axis + (low >> u & 1) + 2 * (low >> v & 1));
}

// Whether two edges lie in one face of the cell.
bool in_one_face(uint8_t a, uint8_t b) {
  const auto faces = [](uint8_t edge) {
    const auto [u, v] = others(edge / 4);
    return 1 << (2 * u + (edge & 1)) | 1 << (2 * v + (edge >> 1 & 1));
  };
  return (faces(a) & faces(b)) != 0;
}

// The surface's polygons in a cell. In each face, seen from outside, a line runs from where one
// comes to inner corners to where one leaves them, so that inner corners that are opposite each
// other are apart: what the neighbour finds too, in the opposite direction.
std::vector<Polygon> polygons_of(int inside) {
  std::array<int, 12> next;
  next.fill(-1);
  for (int axis = 0; axis < 3; ++axis)
    for (int side = 0; side < 2; ++side) {
      const int u = 1 << (axis + 1) % 3, v = 1 << (axis + 2) % 3, base = side << axis;
      // Counterclockwise as seen from outside.
      std::array<int, 4> corners{base, base | u, base | u | v, base | v};
      if (side == 0) std::swap(corners[1], corners[3]);
      const auto is_inside = [&](size_t i) { return inside >> corners[i % 4] & 1; };
      for (size_t i = 0; i < 4; ++i) {
        if (is_inside(i) || !is_inside(i + 1)) continue;
        size_t last = i + 1;
        while (is_inside(last + 1)) ++last;
        next[edge_between(corners[i], corners[(i + 1) % 4])] =
            edge_between(corners[last % 4], corners[(last + 1) % 4]);
      }
    }
  std::vector<Polygon> polygons;
  std::array<bool, 12> done{};
  for (size_t first = 0; first < 12; ++first) {
    if (next[first] < 0 || done[first]) continue;
    Polygon polygon;
    for (size_t e = first; !done[e]; e = static_cast<size_t>(next[e])) {
      done[e] = true;
      polygon.push_back(static_cast<uint8_t>(e));
    }
    polygons.push_back(std::move(polygon));
  }
  return polygons;
}

// Cuts a polygon into triangles with as few diagonals within a face as there can be, since a
// neighbouring cell might have the same diagonal there.
class Triangulation {
 public:
  explicit Triangulation(const Polygon& polygon) : polygon_(polygon), n_(polygon.size()) {
    for (size_t length = 2; length < n_; ++length)
      for (size_t i = 0; i + length < n_; ++i) {
        const size_t j = i + length;
        int best = 1 << 20;
        for (size_t k = i + 1; k < j; ++k) {
          const int cost = cost_[i][k] + cost_[k][j] + diagonal(i, k) + diagonal(k, j);
          if (cost < best) best = cost, middle_[i][j] = k;
        }
        cost_[i][j] = best;
      }
  }
  void append_to(std::vector<uint8_t>& out) const { append(0, n_ - 1, out); }

 private:
  int diagonal(size_t a, size_t b) const {
    return b - a > 1 && b - a < n_ - 1 && in_one_face(polygon_[a], polygon_[b]);
  }
  void append(size_t i, size_t j, std::vector<uint8_t>& out) const {
    if (j - i < 2) return;
    const size_t k = middle_[i][j];
    append(i, k, out);
    out.insert(out.end(), {polygon_[i], polygon_[k], polygon_[j]});
    append(k, j, out);
  }

  const Polygon& polygon_;
  size_t n_;
  int cost_[12][12] = {};
  size_t middle_[12][12] = {};
};

std::array<std::vector<uint8_t>, 256> make_cases() {
  std::array<std::vector<uint8_t>, 256> cases;
  for (int inside = 0; inside < 256; ++inside)
    for (const Polygon& polygon : polygons_of(inside))
      Triangulation(polygon).append_to(cases[static_cast<size_t>(inside)]);
  return cases;
}

constexpr int kSide = VoxelVolume::kSide;
constexpr size_t kWords = VoxelVolume::kSamples / 64;  // of a bit for each sample

int sample_at(int x, int y, int z) { return (z * kSide + y) * kSide + x; }

// The edges of a block's samples towards greater x, y, z that the surface crosses, and how many
// come before each word of them.
struct CrossedEdges {
  std::array<uint64_t, 3 * kWords> bits{};
  std::array<uint16_t, 3 * kWords> before{};
  uint32_t count = 0;
  uint32_t first = 0;  // vertex of the mesh

  void mark(int axis, int sample) {
    bits[static_cast<size_t>(axis) * kWords + static_cast<size_t>(sample) / 64] |= uint64_t{1}
                                                                                   << (sample % 64);
  }
  void add_up() {
    for (size_t w = 0; w < bits.size(); ++w) {
      before[w] = static_cast<uint16_t>(count);
      count += static_cast<uint32_t>(std::popcount(bits[w]));
    }
  }
  uint32_t vertex(int axis, int sample) const {
    const size_t w = static_cast<size_t>(axis) * kWords + static_cast<size_t>(sample) / 64;
    const uint64_t below = (uint64_t{1} << (sample % 64)) - 1;
    return first + before[w] + static_cast<uint32_t>(std::popcount(bits[w] & below));
  }
};

class Marcher {
 public:
  Marcher(const VoxelVolume& volume, ThreadPool& pool)
      : volume_(volume), blocks_(volume.blocks()), edges_(blocks_.size()), pool_(pool) {}

  TriangleMesh march() {
    const int64_t n = static_cast<int64_t>(blocks_.size());
    pool_.parallel_for(n, [&](int64_t b) { find_edges(static_cast<size_t>(b)); });
    uint64_t vertices = 0;
    for (CrossedEdges& e : edges_) {
      e.first = static_cast<uint32_t>(vertices);
      vertices += e.count;
    }
    NERF_CHECK_LT(vertices, uint64_t{1} << 32);
    mesh_.positions.resize(static_cast<size_t>(vertices));
    std::vector<std::vector<TriangleMesh::Triangle>> triangles(blocks_.size());
    pool_.parallel_for(n, [&](int64_t b) {
      place_vertices(static_cast<size_t>(b));
      add_triangles(static_cast<size_t>(b), triangles[static_cast<size_t>(b)]);
    });
    size_t total = 0;
    for (const auto& t : triangles) total += t.size();
    mesh_.triangles.reserve(total);
    for (const auto& t : triangles)
      mesh_.triangles.insert(mesh_.triangles.end(), t.begin(), t.end());
    drop_unused_vertices(mesh_);
    return std::move(mesh_);
  }

 private:
  // A block and those that its cells reach into, by which of x, y, z are one further.
  struct Around {
    std::array<int32_t, 8> slot;
    std::array<const VoxelVolume::Block*, 8> block;
  };
  Around around(size_t b) const {
    Around a;
    const auto& at = blocks_[b].at;
    for (int k = 0; k < 8; ++k) {
      const size_t i = static_cast<size_t>(k);
      a.slot[i] = volume_.slot(at[0] + (k & 1), at[1] + (k >> 1 & 1), at[2] + (k >> 2));
      a.block[i] = a.slot[i] < 0 ? nullptr : &blocks_[static_cast<size_t>(a.slot[i])];
    }
    return a;
  }
  // Of samples of which some are in a neighbour.
  struct Place {
    size_t neighbour;
    int sample;
  };
  static Place place(int x, int y, int z) {
    return {static_cast<size_t>(x / kSide + 2 * (y / kSide) + 4 * (z / kSide)),
            sample_at(x % kSide, y % kSide, z % kSide)};
  }
  // Whether the sample is known; its value.
  static bool look(const Around& a, const Place& p, float& value) {
    const VoxelVolume::Block* block = a.block[p.neighbour];
    if (!block || !(block->weight[static_cast<size_t>(p.sample)] > 0)) return false;
    value = block->value[static_cast<size_t>(p.sample)];
    return true;
  }

  template <class Body>
  static void each_sample(const Body& body) {
    for (int z = 0; z < kSide; ++z)
      for (int y = 0; y < kSide; ++y)
        for (int x = 0; x < kSide; ++x) body(x, y, z);
  }
  template <class Body>  // body(axis, sample, value here, value at the other end)
  static void each_crossing(const Around& a, const Body& body) {
    each_sample([&](int x, int y, int z) {
      float here, there;
      if (!look(a, {0, sample_at(x, y, z)}, here)) return;
      for (int axis = 0; axis < 3; ++axis)
        if (look(a, place(x + (axis == 0), y + (axis == 1), z + (axis == 2)), there) &&
            (here < 0) != (there < 0))
          body(axis, sample_at(x, y, z), here, there);
    });
  }

  void find_edges(size_t b) {
    const Around a = around(b);
    each_crossing(a, [&](int axis, int sample, float, float) { edges_[b].mark(axis, sample); });
    edges_[b].add_up();
  }

  void place_vertices(size_t b) {
    if (edges_[b].count == 0) return;
    const Vec3d corner = volume_.corner(blocks_[b]);
    const double spacing = volume_.lattice().spacing;
    each_crossing(around(b), [&](int axis, int sample, float here, float there) {
      // Away from the samples, where the vertices of several edges would be one point.
      const double t = std::clamp(double{here} / (double{here} - double{there}), 1e-3, 1 - 1e-3);
      Vec3d at{double(sample % kSide), double(sample / kSide % kSide),
               double(sample / (kSide * kSide))};
      at[axis] += t;
      mesh_.positions[edges_[b].vertex(axis, sample)] = (corner + at * spacing).cast<Real>();
    });
  }

  void add_triangles(size_t b, std::vector<TriangleMesh::Triangle>& out) const {
    const Around a = around(b);
    each_sample([&](int x, int y, int z) {
      int inside = 0;
      for (int k = 0; k < 8; ++k) {
        float value;
        if (!look(a, place(x + (k & 1), y + (k >> 1 & 1), z + (k >> 2)), value)) return;
        inside |= (value < 0) << k;
      }
      const std::vector<uint8_t>& edges = marching_cubes_case(inside);
      for (size_t t = 0; t < edges.size(); t += 3) {
        TriangleMesh::Triangle triangle;
        for (size_t k = 0; k < 3; ++k) triangle[k] = vertex(a, edges[t + k], x, y, z);
        out.push_back(triangle);
      }
    });
  }

  uint32_t vertex(const Around& a, uint8_t edge, int x, int y, int z) const {
    const int axis = edge / 4;
    const auto [u, v] = others(axis);
    std::array<int, 3> at{x, y, z};
    at[static_cast<size_t>(u)] += edge & 1;
    at[static_cast<size_t>(v)] += edge >> 1 & 1;
    const Place p = place(at[0], at[1], at[2]);
    return edges_[static_cast<size_t>(a.slot[p.neighbour])].vertex(axis, p.sample);
  }

  const VoxelVolume& volume_;
  const std::vector<VoxelVolume::Block>& blocks_;
  std::vector<CrossedEdges> edges_;  // of each block
  ThreadPool& pool_;
  TriangleMesh mesh_;
};

}  // namespace

const std::vector<uint8_t>& marching_cubes_case(int inside) {
  static const std::array<std::vector<uint8_t>, 256> cases = make_cases();
  return cases[static_cast<size_t>(inside)];
}

TriangleMesh marching_cubes(const VoxelVolume& volume, ThreadPool& pool) {
  return Marcher(volume, pool).march();
}

}  // namespace nerf
