#include "nerf/geometry/triangle_mesh.h"

#include <meshoptimizer.h>

#include <algorithm>
#include <numeric>

#include "nerf/base/error.h"

namespace nerf {

namespace {

constexpr uint32_t kUnused = 0xffffffff;

template <class T>
void keep_marked(const std::vector<uint32_t>& place, std::vector<T>& of) {
  for (size_t i = 0; i < of.size(); ++i)
    if (place[i] != kUnused) of[place[i]] = of[i];
}

// Sets of vertices that triangles join (Tarjan 1975, with halved paths).
class DisjointSets {
 public:
  explicit DisjointSets(size_t n) : parent_(n) {
    std::iota(parent_.begin(), parent_.end(), uint32_t{0});
  }
  uint32_t find(uint32_t a) {
    while (parent_[a] != a) a = parent_[a] = parent_[parent_[a]];
    return a;
  }
  // The lesser one stands for both, whatever the order.
  void join(uint32_t a, uint32_t b) {
    a = find(a);
    b = find(b);
    parent_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::vector<uint32_t> parent_;
};

}  // namespace

void find_normals(TriangleMesh& mesh) {
  std::vector<Vec3d> sums(mesh.positions.size());
  for (size_t t = 0; t < mesh.triangles.size(); ++t) {
    const Vec3d a = mesh.corner(t, 0).cast<double>();
    const Vec3d n =
        cross(mesh.corner(t, 1).cast<double>() - a, mesh.corner(t, 2).cast<double>() - a);
    for (const uint32_t v : mesh.triangles[t]) sums[v] = sums[v] + n;
  }
  mesh.normals.resize(sums.size());
  for (size_t v = 0; v < sums.size(); ++v) {
    const Vec3d n = normalized(sums[v]);
    mesh.normals[v] = n == Vec3d() ? Vec3{0, 0, 1} : n.cast<Real>();
  }
}

void drop_unused_vertices(TriangleMesh& mesh) {
  std::vector<uint32_t> place(mesh.positions.size(), kUnused);
  for (const auto& triangle : mesh.triangles)
    for (const uint32_t v : triangle) place[v] = 0;
  uint32_t used = 0;
  for (uint32_t& p : place)
    if (p != kUnused) p = used++;
  for (auto* of : {&mesh.positions, &mesh.normals, &mesh.colours}) {
    if (of->empty()) continue;
    keep_marked(place, *of);
    of->resize(used);
  }
  for (auto& triangle : mesh.triangles)
    for (uint32_t& v : triangle) v = place[v];
}

int64_t drop_small_components(TriangleMesh& mesh, double least_diagonal, double least_share) {
  DisjointSets sets(mesh.positions.size());
  for (const auto& t : mesh.triangles) {
    sets.join(t[0], t[1]);
    sets.join(t[0], t[2]);
  }
  struct Component {
    Box3 box;
    int64_t triangles = 0;
  };
  std::vector<Component> components(mesh.positions.size());  // of which roots have triangles
  for (size_t v = 0; v < mesh.positions.size(); ++v)
    components[sets.find(static_cast<uint32_t>(v))].box.extend(mesh.positions[v].cast<double>());
  int64_t most = 0;
  for (const auto& t : mesh.triangles)
    most = std::max(most, ++components[sets.find(t[0])].triangles);
  const double least = least_share * static_cast<double>(most);
  const auto is_small = [&](const Component& c) {
    return length(c.box.size()) < least_diagonal || static_cast<double>(c.triangles) < least;
  };
  const int64_t dropped =
      std::count_if(components.begin(), components.end(),
                    [&](const Component& c) { return c.triangles > 0 && is_small(c); });
  if (dropped == 0) return 0;
  std::erase_if(mesh.triangles, [&](const TriangleMesh::Triangle& t) {
    return is_small(components[sets.find(t[0])]);
  });
  drop_unused_vertices(mesh);
  return dropped;
}

void decimate(TriangleMesh& mesh, size_t triangles) {
  if (mesh.triangles.size() <= triangles) return;
  std::vector<float> positions;
  positions.reserve(3 * mesh.positions.size());
  for (const Vec3& p : mesh.positions)
    for (int k = 0; k < 3; ++k) positions.push_back(static_cast<float>(p[k]));
  const unsigned* const indices = mesh.triangles.front().data();
  std::vector<unsigned> kept(3 * mesh.triangles.size());
  constexpr float kAnyError = 1e9f;
  kept.resize(meshopt_simplify(kept.data(), indices, kept.size(), positions.data(),
                               mesh.positions.size(), 3 * sizeof(float), 3 * triangles, kAnyError,
                               0, nullptr));
  mesh.triangles.resize(kept.size() / 3);
  for (size_t i = 0; i < kept.size(); ++i) mesh.triangles[i / 3][i % 3] = kept[i];
  drop_unused_vertices(mesh);
}

}  // namespace nerf
