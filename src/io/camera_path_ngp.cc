// instant-ngp's base_cam.json.
//
// Its keys are poses in the cube that instant-ngp trains in: a position p of the scene stands at
// s p + o with the axes x, y, z then named z, x, y; s and o are what the capture's transforms.json
// says as "scale" and "offset" (or "aabb"), else 0.33 and (0.5, 0.5, 0.5). Rotations are of cameras
// with OpenCV axes, as quaternions x, y, z, w. fov is vertical, degrees. "scale" and "slice" say
// where its focal plane lies, and do not move the camera.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "camera_path_formats.h"
#include "nerf/base/error.h"
#include "nerf/base/file.h"
#include "nerf/math/camera_paths.h"
#include "paths.h"
#include "transforms_camera.h"

namespace nerf::internal {

namespace fs = std::filesystem;
using nlohmann::json;

namespace {

constexpr double kUsualSeconds = 5, kFps = 30, kMostSeconds = 3600;

// The cube's similarity: p -> scale * p + offset, before the axes change their names.
struct Cube {
  double scale = 0.33;
  Vec3d offset{0.5, 0.5, 0.5};
};

template <size_t N>
std::array<double, N> numbers(const json& value, const std::string& where) {
  std::array<double, N> result{};
  if (!value.is_array() || value.size() != N)
    throw Error(fmt::format("expected {} numbers", N), where);
  for (size_t i = 0; i < N; ++i) {
    result[i] = value[i].is_number() ? value[i].get<double>() : std::nan("");
    if (!(std::abs(result[i]) <= 1e9)) throw Error("holds what is not a number", where);
  }
  return result;
}

Cube cube_of(const fs::path& transforms) {
  Cube cube;
  if (!is_file(transforms)) return cube;
  const std::string where = transforms.string();
  const json document = parse_path_json(read_text_file(transforms, uint64_t{256} << 20), where);
  if (!document.is_object()) return cube;
  const FrameJson file{document, document, where};
  if (const json* aabb = file.find("aabb")) {
    if (!aabb->is_array() || aabb->size() != 2)
      throw Error("expected two corners", where + ": aabb");
    const auto lo = numbers<3>((*aabb)[0], where + ": aabb");
    const auto hi = numbers<3>((*aabb)[1], where + ": aabb");
    double side = 1e-6;
    for (size_t k = 0; k < 3; ++k) side = std::max(side, std::abs(hi[k] - lo[k]));
    cube.scale = 1 / side;
    for (size_t k = 0; k < 3; ++k)
      cube.offset[static_cast<int>(k)] = 0.5 - 0.5 * (lo[k] + hi[k]) * cube.scale;
  }
  cube.scale = file.number("scale").value_or(cube.scale);
  if (!(cube.scale > 0)) throw Error("is no scale", where + ": scale");
  if (const json* offset = file.find("offset")) {
    if (offset->is_array()) {
      const auto o = numbers<3>(*offset, where + ": offset");
      cube.offset = {o[0], o[1], o[2]};
    } else {
      const double o = file.number("offset").value_or(0);
      cube.offset = {o, o, o};
    }
  }
  return cube;
}

struct Key {
  std::array<double, 4> r{};  // x, y, z, w
  std::array<double, 3> t{};
  double fov = 0, timestamp = 0;
};

// Uniform cubic B-spline at `u` in [0, 1] between the second and the third of four keys.
Key spline(double u, const std::array<const Key*, 4>& keys) {
  const double v = 1 - u;
  const std::array<double, 4> w{v * v * v / 6, (3 * u * u * u - 6 * u * u + 4) / 6,
                                (3 * v * v * v - 6 * v * v + 4) / 6, u * u * u / 6};
  Key sum;
  for (size_t k = 0; k < 4; ++k) {
    double same = 0;  // q and -q turn alike: add the one on the sum's side
    for (size_t i = 0; i < 4; ++i) same += sum.r[i] * keys[k]->r[i];
    const double sign = same < 0 ? -1 : 1;
    for (size_t i = 0; i < 4; ++i) sum.r[i] += sign * w[k] * keys[k]->r[i];
    for (size_t i = 0; i < 3; ++i) sum.t[i] += w[k] * keys[k]->t[i];
    sum.fov += w[k] * keys[k]->fov;
  }
  return sum;
}

PathFrame frame_of(const Key& key, const Cube& cube, const Camera& usual) {
  const auto& [x, y, z, w] = key.r;
  const double norm = std::sqrt(x * x + y * y + z * z + w * w);
  const Mat3d r = to_rotation({w / norm, x / norm, y / norm, z / norm});
  const Vec3d t{key.t[0], key.t[1], key.t[2]};
  PathFrame frame;
  for (int c = 0; c < 3; ++c) {
    const Vec3d axis = r.column(c);
    frame.camera_to_world.rotation.set_column(c, {axis.z, axis.x, axis.y});
  }
  frame.camera_to_world.translation = (Vec3d{t.z, t.x, t.y} - cube.offset) / cube.scale;
  frame.camera_to_world.rotation = orthonormalized(frame.camera_to_world.rotation);
  frame.camera = usual;
  const double focal = 0.5 * usual.height / std::tan(key.fov * std::numbers::pi / 360);
  frame.camera.params = {focal, focal, usual.width * 0.5, usual.height * 0.5};
  return frame;
}

std::vector<Key> read_keys(const PathSource& source) {
  const json& list = source.document["path"];
  if (!list.is_array() || list.empty())
    throw Error("expected a list of one key or more", source.where + ": path");
  std::vector<Key> keys;
  for (size_t i = 0; i < list.size(); ++i) {
    const std::string where = fmt::format("{}: path[{}]", source.where, i);
    const FrameJson entry{list[i], list[i], where};
    if (!list[i].is_object()) entry.fail("expected an object");
    for (const char* key : {"R", "T"})
      if (entry.find(key) == nullptr) entry.fail(fmt::format("there is no \"{}\"", key));
    Key key;
    key.r = numbers<4>(*entry.find("R"), where + ".R");
    key.t = numbers<3>(*entry.find("T"), where + ".T");
    const auto [x, y, z, w] = key.r;
    if (!(x * x + y * y + z * z + w * w > 1e-12)) entry.fail("\"R\" is no rotation");
    key.fov = entry.number("fov").value_or(50.625);  // instant-ngp's own default
    if (!(key.fov > 0.01 && key.fov < 179.9))
      entry.fail(fmt::format("\"fov\" is {:g} degrees", key.fov));
    key.timestamp = entry.number("timestamp").value_or(0);
    keys.push_back(key);
  }
  return keys;
}

}  // namespace

CameraPath read_instant_ngp_path(const PathSource& source) {
  const std::vector<Key> keys = read_keys(source);
  const FrameJson root{source.document, source.document, source.where};
  const bool loop = root.flag("loop");
  const double seconds =
      std::clamp(root.number("duration_seconds").value_or(kUsualSeconds), 1 / kFps, kMostSeconds);
  const Cube cube = cube_of(source.folder / "transforms.json");
  const Camera usual = path_camera(source.info);
  CameraPath path;
  path.fps = kFps;

  const int count = static_cast<int>(keys.size());
  const int spans = loop ? count : count - 1;
  const auto key = [&](int i) {
    return &keys[static_cast<size_t>(loop ? (i + count) % count : std::clamp(i, 0, count - 1))];
  };
  // Where each span ends: as the file says, or evenly.
  std::vector<double> ends;
  for (int i = 0; i < spans; ++i) ends.push_back(keys[static_cast<size_t>(i)].timestamp);
  bool timed = !ends.empty() && ends.front() > 0;
  for (size_t i = 1; i < ends.size(); ++i) timed = timed && ends[i] > ends[i - 1];
  if (!timed)
    for (int i = 0; i < spans; ++i) ends[static_cast<size_t>(i)] = i + 1;

  const int frames = spans == 0 ? 1 : std::max(1, static_cast<int>(std::lround(seconds * kFps)));
  for (int f = 0; f < frames; ++f) {
    PathFrame frame;
    if (spans == 0) {
      frame = frame_of(keys.front(), cube, usual);
    } else {
      // A loop's last frame stands one before the first.
      const double u = frames == 1 ? 0.0 : static_cast<double>(f) / (loop ? frames : frames - 1);
      const double time = u * ends.back();
      const auto span = static_cast<int>(std::min<std::ptrdiff_t>(
          std::upper_bound(ends.begin(), ends.end(), time) - ends.begin(), spans - 1));
      const double begin = span == 0 ? 0 : ends[static_cast<size_t>(span) - 1];
      const double within =
          std::clamp((time - begin) / (ends[static_cast<size_t>(span)] - begin), 0.0, 1.0);
      const Key between = spline(within, {key(span - 1), key(span), key(span + 1), key(span + 2)});
      frame = frame_of(between, cube, usual);
    }
    frame.name = source.frame_name(static_cast<size_t>(f));
    if (frames > 1) frame.time = static_cast<double>(f) / (frames - 1);
    path.frames.push_back(std::move(frame));
  }
  return path;
}

}  // namespace nerf::internal
