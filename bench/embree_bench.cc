// nerf_bench_embree [FILE.glb ...]: this project's tree of triangles beside Embree's, in turns on
// one thread: building, the nearest hit and any hit, of a camera's rays and of rays that go
// anywhere. Built with -DNERF_BENCH_EMBREE=ON only (Debian's libembree-dev).
#include <embree3/rtcore.h>
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "nerf/base/error.h"
#include "nerf/geometry/triangle_bvh.h"
#include "nerf/geometry/triangle_mesh.h"
#include "nerf/io/object_file.h"
#include "nerf/math/random.h"

namespace nerf {
namespace {

constexpr int kTurns = 9;      // the median of which counts
constexpr int kSide = 512;     // of the camera's picture
constexpr float kFar = 1e30f;  // beyond everything

struct Line {
  Vec3d origin, direction;
};

TriangleMesh sphere(int rings, double bumps) {
  TriangleMesh mesh;
  const int around = rings;
  for (int r = 0; r <= rings; ++r)
    for (int a = 0; a <= around; ++a) {
      const double polar = M_PI * r / rings, angle = 2 * M_PI * a / around;
      const double radius = 1 + bumps * std::sin(23 * polar) * std::sin(31 * angle);
      const Vec3d p{std::sin(polar) * std::cos(angle), std::sin(polar) * std::sin(angle),
                    std::cos(polar)};
      mesh.positions.push_back((p * radius).cast<Real>());
    }
  const auto at = [&](int r, int a) { return static_cast<uint32_t>(r * (around + 1) + a); };
  for (int r = 0; r < rings; ++r)
    for (int a = 0; a < around; ++a) {
      mesh.triangles.push_back({at(r, a), at(r + 1, a), at(r + 1, a + 1)});
      mesh.triangles.push_back({at(r, a), at(r + 1, a + 1), at(r, a + 1)});
    }
  return mesh;
}

// Rays of a camera that sees all of the box, row after row.
std::vector<Line> camera_rays(const Box3& box) {
  const double radius = 0.5 * length(box.size());
  const Vec3d forward = normalized(Vec3d{-1, -0.7, -0.4});
  const Vec3d right = normalized(cross(forward, Vec3d{0, 0, 1})), down = cross(forward, right);
  const Vec3d eye = box.center() - forward * (3 * radius);
  std::vector<Line> rays;
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x) {
      const double u = 0.7 * ((x + 0.5) / kSide - 0.5), v = 0.7 * ((y + 0.5) / kSide - 0.5);
      rays.push_back({eye, normalized(forward + right * u + down * v)});
    }
  return rays;
}

// From anywhere around the box to anywhere in it.
std::vector<Line> scattered_rays(const Box3& box) {
  Random random(3, 5, 0);
  const auto inside = [&] {
    const Vec3d s = box.size();
    return box.min + Vec3d{s.x * random.uniform(), s.y * random.uniform(), s.z * random.uniform()};
  };
  std::vector<Line> rays;
  while (rays.size() < kSide * kSide) {
    const Vec3d d{random.uniform() - 0.5, random.uniform() - 0.5, random.uniform() - 0.5};
    if (!(length(d) > 0.01 && length(d) < 0.5)) continue;
    const Vec3d eye = box.center() + normalized(d) * length(box.size());
    rays.push_back({eye, normalized(inside() - eye)});
  }
  return rays;
}

// Embree's scene of one mesh.
class EmbreeTree {
 public:
  EmbreeTree(RTCDevice device, const TriangleMesh& mesh) : scene_(rtcNewScene(device)) {
    const RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    auto* const positions = static_cast<float*>(rtcSetNewGeometryBuffer(
        geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, mesh.positions.size()));
    for (size_t i = 0; i < mesh.positions.size(); ++i)
      for (int k = 0; k < 3; ++k)
        positions[3 * i + static_cast<size_t>(k)] = static_cast<float>(mesh.positions[i][k]);
    auto* const corners = static_cast<uint32_t*>(rtcSetNewGeometryBuffer(
        geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, mesh.triangles.size()));
    for (size_t i = 0; i < mesh.triangles.size(); ++i)
      for (size_t k = 0; k < 3; ++k) corners[3 * i + k] = mesh.triangles[i][k];
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene_, geometry);
    rtcReleaseGeometry(geometry);
    rtcCommitScene(scene_);
  }
  ~EmbreeTree() { rtcReleaseScene(scene_); }
  EmbreeTree(const EmbreeTree&) = delete;
  EmbreeTree& operator=(const EmbreeTree&) = delete;

  // Infinite where nothing is hit.
  double nearest(const Line& line) const {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    RTCRayHit hit{};
    hit.ray = ray_of(line);
    hit.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    rtcIntersect1(scene_, &context, &hit);
    return hit.hit.geomID == RTC_INVALID_GEOMETRY_ID ? INFINITY : double{hit.ray.tfar};
  }
  bool any(const Line& line) const {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    RTCRay ray = ray_of(line);
    rtcOccluded1(scene_, &context, &ray);
    return ray.tfar < 0;
  }

 private:
  static RTCRay ray_of(const Line& line) {
    RTCRay ray{};
    ray.org_x = static_cast<float>(line.origin.x);
    ray.org_y = static_cast<float>(line.origin.y);
    ray.org_z = static_cast<float>(line.origin.z);
    ray.dir_x = static_cast<float>(line.direction.x);
    ray.dir_y = static_cast<float>(line.direction.y);
    ray.dir_z = static_cast<float>(line.direction.z);
    ray.tfar = kFar;
    ray.mask = ~0u;
    return ray;
  }
  RTCScene scene_;
};

class OwnTree {
 public:
  explicit OwnTree(const TriangleMesh& mesh) : bvh_(mesh.positions, mesh.triangles) {}
  const Box3& box() const { return bvh_.box(); }
  double nearest(const Line& line) const {
    TriangleHit hit;
    const auto always = [](const TriangleHit&) { return true; };
    return bvh_.nearest(line.origin, line.direction, 0, kFar, hit, always) ? hit.t : INFINITY;
  }
  bool any(const Line& line) const {
    bool found = false;
    bvh_.each(line.origin, line.direction, 0, kFar, [&](const TriangleHit&) {
      found = true;
      return false;
    });
    return found;
  }

 private:
  TriangleBvh bvh_;
};

double seconds_of(const std::function<void()>& work) {
  const auto begin = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

// Medians of the seconds that each of two takes, one after the other.
void compare(const std::string& what, double each, const std::function<void()>& own,
             const std::function<void()>& embree) {
  std::vector<double> a, b;
  for (int turn = 0; turn < kTurns; ++turn) {
    a.push_back(seconds_of(own) * each);
    b.push_back(seconds_of(embree) * each);
  }
  std::ranges::sort(a);
  std::ranges::sort(b);
  const double x = a[kTurns / 2], y = b[kTurns / 2];
  fmt::print("  {:<44} own {:8.3f} s   Embree {:8.3f} s   ratio {:5.2f}\n", what, x, y, x / y);
  std::fflush(stdout);
}

template <class Tree>
std::function<void()> all_nearest(const std::unique_ptr<Tree>& tree, const std::vector<Line>& rays,
                                  std::vector<double>& hits) {
  return [&] {
    for (size_t i = 0; i < rays.size(); ++i) hits[i] = tree->nearest(rays[i]);
  };
}

template <class Tree>
std::function<void()> all_any(const std::unique_ptr<Tree>& tree, const std::vector<Line>& rays,
                              std::vector<double>& hits) {
  return [&] {
    for (size_t i = 0; i < rays.size(); ++i) hits[i] = tree->any(rays[i]);
  };
}

// Rays whose nearest hits are not the same to a hundred-thousandth.
size_t differing(const std::vector<double>& a, const std::vector<double>& b) {
  size_t n = 0;
  for (size_t i = 0; i < a.size(); ++i) n += a[i] != b[i] && !(std::abs(a[i] / b[i] - 1) < 1e-5);
  return n;
}

void compare_mesh(const std::string& name, const TriangleMesh& mesh, RTCDevice device) {
  fmt::print("{}: {} triangles; the median of {} turns\n", name, mesh.triangles.size(), kTurns);
  std::unique_ptr<OwnTree> own;
  std::unique_ptr<EmbreeTree> embree;
  compare(
      "building", 1, [&] { own = std::make_unique<OwnTree>(mesh); },
      [&] { embree = std::make_unique<EmbreeTree>(device, mesh); });
  for (const bool coherent : {true, false}) {
    const auto rays = coherent ? camera_rays(own->box()) : scattered_rays(own->box());
    const std::string which = coherent ? "a camera's" : "scattered";
    const double million = 1e6 / static_cast<double>(rays.size());
    std::vector<double> a(rays.size()), b(rays.size());
    compare("a million rays, " + which + ", nearest hit", million, all_nearest(own, rays, a),
            all_nearest(embree, rays, b));
    const auto hits = std::ranges::count_if(a, [](double t) { return t < INFINITY; });
    fmt::print("    {} of {} rays hit, {} differ\n", hits, rays.size(), differing(a, b));
    compare("a million rays, " + which + ", any hit", million, all_any(own, rays, a),
            all_any(embree, rays, b));
    fmt::print("    {} differ\n", differing(a, b));
  }
}

int run(int argc, char** argv) {
  const RTCDevice device = rtcNewDevice("threads=1");
  if (device == nullptr) throw Error("Embree has no device", "rtcNewDevice");
  fmt::print("Embree {}, one thread\n", RTC_VERSION_STRING);
  compare_mesh("sphere", sphere(224, 0), device);
  compare_mesh("sphere with bumps", sphere(224, 0.05), device);
  for (int i = 1; i < argc; ++i) compare_mesh(argv[i], read_object(argv[i]).object.mesh, device);
  rtcReleaseDevice(device);
  return 0;
}

}  // namespace
}  // namespace nerf

int main(int argc, char** argv) {
  try {
    return nerf::run(argc, argv);
  } catch (const std::exception& error) {
    fmt::print(stderr, "nerf_bench_embree: {}\n", error.what());
    return 2;
  }
}
