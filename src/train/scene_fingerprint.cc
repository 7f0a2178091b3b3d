#include "train/scene_fingerprint.h"

#include <fmt/format.h>

#include <bit>
#include <cstdint>

#include "nerf/math/random.h"

namespace nerf::internal {
namespace {

class Hash {
 public:
  void add(uint64_t x) { state_ = mix64(state_ ^ x); }
  void add(double x) { add(std::bit_cast<uint64_t>(x)); }
  void add(const Vec3d& v) {
    for (int i = 0; i < 3; ++i) add(v[i]);
  }
  void add(const Mat3d& m) {
    for (const auto& row : m.m)
      for (double x : row) add(x);
  }
  void add(const std::string& text) {
    add(uint64_t{text.size()});
    for (const char c : text) add(uint64_t{static_cast<unsigned char>(c)});
  }
  std::string text() const { return fmt::format("{:016x}", state_); }

 private:
  uint64_t state_ = 0;
};

}  // namespace

SceneFingerprint scene_fingerprint(const Scene& scene, const PhotoSet& photos, bool clock) {
  Hash moments, names, sizes, split, cameras, poses, times, frame;
  bool timed = false;
  for (size_t i = 0; i < scene.views.size(); ++i) {
    const View& view = scene.views[i];
    names.add(view.name);
    poses.add(view.pose.rotation);
    poses.add(view.pose.translation);
    times.add(view.time);
    timed |= view.time != 0;
    if (view.ids != ViewIds{}) {
      for (const int id : {view.ids.moment, view.ids.appearance, view.ids.camera})
        times.add(static_cast<uint64_t>(id));
      timed = true;
    }
    const Photo& photo = photos.photos[i];
    for (const int x : {photo.width, photo.height, photo.channels})
      sizes.add(static_cast<uint64_t>(x));
    sizes.add(uint64_t{!photo.mask.empty()});
    if (!photo.depth.empty())
      for (const int x : {photo.depth.width, photo.depth.height})
        sizes.add(static_cast<uint64_t>(x));
    const Camera& camera = photos.cameras[i];
    cameras.add(static_cast<uint64_t>(camera.model));
    for (const double p : camera.params) cameras.add(p);
  }
  for (const int v : scene.train) split.add(static_cast<uint64_t>(v));
  split.add(~uint64_t{0});
  for (const int v : scene.test) split.add(static_cast<uint64_t>(v));
  frame.add(scene.to_engine.scale);
  frame.add(scene.to_engine.rotation);
  frame.add(scene.to_engine.center);
  frame.add(scene.near);
  frame.add(scene.far);
  if (scene.published_near > 0) frame.add(scene.published_near);
  frame.add(uint64_t{scene.unbounded});
  frame.add(uint64_t{scene.alpha});
  SceneFingerprint all{{"names of the images", names.text()},
                       {"sizes of the photos", sizes.text()},
                       {"split into training and test", split.text()},
                       {"cameras", cameras.text()},
                       {"poses", poses.text()},
                       {"region and up direction", frame.text()}};
  if (timed) all.emplace_back("times", times.text());
  if (!clock) return all;
  for (const View& view : scene.views) moments.add(view.clock.value_or(-1));
  moments.add(scene.frame_interval);
  all.emplace_back("times of the frames", moments.text());
  return all;
}

}  // namespace nerf::internal
