#include "nerf/geometry/triangle_bvh.h"

#include <embree3/rtcore.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "nerf/base/error.h"

namespace nerf {

namespace {

// Of a distance: what float may be off by against double.
constexpr double kSlack = 1e-5;

// Builds in the thread that asks.
RTCDevice device() {
  struct Device {
    RTCDevice handle = rtcNewDevice("threads=1,start_threads=0,set_affinity=0");
    ~Device() { rtcReleaseDevice(handle); }
  };
  static const Device own;
  if (!own.handle)
    throw Error("Embree cannot be used on this processor: error " +
                    std::to_string(rtcGetDeviceError(nullptr)),
                "inserted objects");
  return own.handle;
}

}  // namespace

struct TriangleBvh::Tree {
  struct Corners {
    Vec3d a, ab, ac;
  };
  RTCScene scene = nullptr;
  std::vector<Corners> corners;  // of the triangles that have an area
  std::vector<uint32_t> given;   // their indices as given

  Tree() = default;
  Tree(const Tree&) = delete;
  Tree& operator=(const Tree&) = delete;
  ~Tree() {
    if (scene) rtcReleaseScene(scene);
  }

  // Moeller and Trumbore 1997, for a ray that is known to meet the triangle.
  static TriangleHit hit_of(const Corners& c, const Vec3d& origin, const Vec3d& direction) {
    TriangleHit hit;
    const Vec3d p = cross(direction, c.ac);
    const double inverse = 1 / dot(c.ab, p);
    const Vec3d s = origin - c.a, q = cross(s, c.ab);
    hit.u = std::clamp(dot(s, p) * inverse, 0.0, 1.0);
    hit.v = std::clamp(dot(direction, q) * inverse, 0.0, 1 - hit.u);
    hit.t = dot(c.ac, q) * inverse;
    return hit;
  }

  void build() {
    scene = rtcNewScene(device());
    // Without gaps; and no triangle stands in the tree twice, as it may with a finer one.
    rtcSetSceneFlags(scene, static_cast<RTCSceneFlags>(RTC_SCENE_FLAG_ROBUST |
                                                       RTC_SCENE_FLAG_CONTEXT_FILTER_FUNCTION));
    rtcSetSceneBuildQuality(scene, RTC_BUILD_QUALITY_MEDIUM);
    const RTCGeometry geometry = rtcNewGeometry(device(), RTC_GEOMETRY_TYPE_TRIANGLE);
    auto* vertices = static_cast<float*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                3 * sizeof(float), 3 * corners.size()));
    auto* indices = static_cast<uint32_t*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                3 * sizeof(uint32_t), corners.size()));
    NERF_CHECK(vertices && indices);
    uint32_t next = 0;
    for (const Corners& c : corners)
      for (const Vec3d& p : {c.a, c.a + c.ab, c.a + c.ac}) {
        for (int k = 0; k < 3; ++k) *vertices++ = static_cast<float>(p[k]);
        *indices++ = next++;
      }
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene, geometry);
    rtcReleaseGeometry(geometry);
    rtcCommitScene(scene);
    NERF_CHECK_EQ(static_cast<int>(rtcGetDeviceError(device())), 0);
  }

  // A question that is asked of every candidate.
  struct Query {
    RTCIntersectContext context;  // first: Embree hands it back
    const Tree* tree;
    Vec3d origin, direction;
    double near, far;
    const void* body;
    Call call;
    TriangleHit best{};
    bool found = false;

    Query(const Tree& tree, const Vec3d& origin, const Vec3d& direction, double near, double far,
          const void* body, Call call)
        : tree(&tree),
          origin(origin),
          direction(direction),
          near(near),
          far(far),
          body(body),
          call(call) {
      rtcInitIntersectContext(&context);
    }

    RTCRay ray() const {
      RTCRay r{};
      r.org_x = static_cast<float>(origin.x);
      r.org_y = static_cast<float>(origin.y);
      r.org_z = static_cast<float>(origin.z);
      r.dir_x = static_cast<float>(direction.x);
      r.dir_y = static_cast<float>(direction.y);
      r.dir_z = static_cast<float>(direction.z);
      r.tnear = static_cast<float>(near * (1 - kSlack));
      r.tfar = static_cast<float>(far * (1 + kSlack));
      r.mask = ~0u;
      return r;
    }
    bool within(const RTCFilterFunctionNArguments* of, TriangleHit& hit) const {
      const unsigned triangle = RTCHitN_primID(of->hit, 1, 0);
      hit = hit_of(tree->corners[triangle], origin, direction);
      hit.triangle = tree->given[triangle];
      return hit.t > near && hit.t < far;
    }
    static Query& of(const RTCFilterFunctionNArguments* arguments) {
      return *reinterpret_cast<Query*>(arguments->context);
    }
  };
};

TriangleBvh::TriangleBvh() = default;
TriangleBvh::~TriangleBvh() = default;
TriangleBvh::TriangleBvh(TriangleBvh&&) noexcept = default;
TriangleBvh& TriangleBvh::operator=(TriangleBvh&&) noexcept = default;

TriangleBvh::TriangleBvh(std::span<const Vec3> positions,
                         std::span<const TriangleMesh::Triangle> triangles) {
  auto tree = std::make_unique<Tree>();
  for (size_t t = 0; t < triangles.size(); ++t) {
    const auto corner = [&](size_t k) { return positions[triangles[t][k]].cast<double>(); };
    const Tree::Corners c{corner(0), corner(1) - corner(0), corner(2) - corner(0)};
    const double area = length(cross(c.ab, c.ac));
    if (!(area > 0) || !std::isfinite(area)) continue;
    for (size_t k = 0; k < 3; ++k) box_.extend(corner(k));
    tree->corners.push_back(c);
    tree->given.push_back(static_cast<uint32_t>(t));
  }
  if (tree->corners.empty()) return;
  tree->build();
  tree_ = std::move(tree);
}

bool TriangleBvh::find_nearest(const Vec3d& origin, const Vec3d& direction, double near, double far,
                               TriangleHit& hit, const void* body, Call accept) const {
  if (!tree_) return false;
  Tree::Query query(*tree_, origin, direction, near, far, body, accept);
  query.context.filter = [](const RTCFilterFunctionNArguments* arguments) {
    Tree::Query& q = Tree::Query::of(arguments);
    TriangleHit h;
    if (!q.within(arguments, h) || !q.call(q.body, h)) {
      arguments->valid[0] = 0;
      return;
    }
    // Of equally near ones that of the lesser triangle.
    if (!q.found || h.t < q.best.t || (h.t == q.best.t && h.triangle < q.best.triangle)) q.best = h;
    q.found = true;
  };
  RTCRayHit asked{query.ray(), {}};
  asked.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  rtcIntersect1(tree_->scene, &query.context, &asked);
  if (query.found) hit = query.best;
  return query.found;
}

void TriangleBvh::find_each(const Vec3d& origin, const Vec3d& direction, double near, double far,
                            const void* body, Call visit) const {
  if (!tree_) return;
  Tree::Query query(*tree_, origin, direction, near, far, body, visit);
  // A ray is done with where a hit is let stand.
  query.context.filter = [](const RTCFilterFunctionNArguments* arguments) {
    Tree::Query& q = Tree::Query::of(arguments);
    TriangleHit h;
    if (!q.within(arguments, h) || q.call(q.body, h)) arguments->valid[0] = 0;
  };
  RTCRay ray = query.ray();
  rtcOccluded1(tree_->scene, &query.context, &ray);
}

}  // namespace nerf
