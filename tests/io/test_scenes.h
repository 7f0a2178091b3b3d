// For tests: tiny captures written as files. A ring of level cameras round the origin, +z up, that
// look at it; points in a ball round it. Everything a COLMAP model has, as .bin or .txt.
#pragma once

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <string>
#include <vector>

#include "nerf/io/image.h"
#include "nerf/io/scene.h"
#include "nerf/math/camera.h"
#include "nerf/math/vec.h"
#include "support/temp_folder.h"

namespace nerf::test {

struct TestCamera {
  uint32_t id = 1;
  int32_t model = 1;  // PINHOLE
  uint64_t width = 40, height = 30;
  std::vector<double> params{50, 50, 20, 15};
};

struct TestImage {
  uint32_t id = 1;
  std::array<double, 7> pose{1, 0, 0, 0, 0, 0, 0};  // camera from world: w x y z, translation
  uint32_t camera = 1;
  std::string name = "a.png";
  std::vector<std::array<double, 3>> points2d{{1.5, 2.5, 7}};  // x, y, point id (-1: none)
};

struct TestPoint {
  uint64_t id = 7;
  Vec3d position;
  double error = 0.5;
  std::vector<std::array<uint32_t, 2>> track;  // image id, 2D point
};

struct TestModel {
  std::vector<TestCamera> cameras;
  std::vector<TestImage> images;
  std::vector<TestPoint> points;
};

// Camera-to-world pose at `eye` that looks at `target`, level against `up`.
inline Pose look_at(const Vec3d& eye, const Vec3d& target, const Vec3d& up = {0, 0, 1}) {
  const Vec3d forward = normalized(target - eye), right = normalized(cross(forward, up));
  Pose pose;
  pose.rotation.set_column(0, right);
  pose.rotation.set_column(1, cross(forward, right));
  pose.rotation.set_column(2, forward);
  pose.translation = eye;
  return pose;
}

// As COLMAP stores it: quaternion w x y z and translation of the inverse.
inline std::array<double, 7> colmap_pose(const Pose& camera_to_world) {
  const Pose p = camera_to_world.inverse();
  const auto& m = p.rotation.m;
  const double trace = m[0][0] + m[1][1] + m[2][2];
  double w, x, y, z;
  if (trace > 0) {
    const double s = std::sqrt(trace + 1) * 2;
    w = s / 4, x = (m[2][1] - m[1][2]) / s, y = (m[0][2] - m[2][0]) / s,
    z = (m[1][0] - m[0][1]) / s;
  } else if (m[0][0] > m[1][1] && m[0][0] > m[2][2]) {
    const double s = std::sqrt(1 + m[0][0] - m[1][1] - m[2][2]) * 2;
    w = (m[2][1] - m[1][2]) / s, x = s / 4, y = (m[0][1] + m[1][0]) / s,
    z = (m[0][2] + m[2][0]) / s;
  } else if (m[1][1] > m[2][2]) {
    const double s = std::sqrt(1 + m[1][1] - m[0][0] - m[2][2]) * 2;
    w = (m[0][2] - m[2][0]) / s, x = (m[0][1] + m[1][0]) / s, y = s / 4,
    z = (m[1][2] + m[2][1]) / s;
  } else {
    const double s = std::sqrt(1 + m[2][2] - m[0][0] - m[1][1]) * 2;
    w = (m[1][0] - m[0][1]) / s, x = (m[0][2] + m[2][0]) / s, y = (m[1][2] + m[2][1]) / s,
    z = s / 4;
  }
  return {w, x, y, z, p.translation.x, p.translation.y, p.translation.z};
}

// Where image i of n of the ring stands; `height` above the origin.
inline Pose ring_pose(int i, int n, double radius = 4, double height = 1) {
  const double a = 2 * std::numbers::pi * i / n;
  return look_at({radius * std::cos(a), radius * std::sin(a), height}, {0, 0, 0});
}

// Where a camera as TestCamera's sees a point: pixels, and the point's id.
inline std::array<double, 3> keypoint_of(const Pose& pose, const TestPoint& point) {
  const Vec3d d = pose.inverse() * point.position;
  return {50 * d.x / d.z + 20, 50 * d.y / d.z + 15, static_cast<double>(point.id)};
}

// n images "00.png".. of one camera; every point is seen by the first images, where its keypoints
// say.
inline TestModel ring_model(int n = 4, int points = 3) {
  TestModel model;
  model.cameras.push_back({});
  for (int i = 0; i < n; ++i) {
    TestImage image;
    image.id = static_cast<uint32_t>(i) + 1;
    image.pose = colmap_pose(ring_pose(i, n));
    image.name = fmt::format("{:02}.png", i);
    model.images.push_back(image);
  }
  for (int i = 0; i < points; ++i) {
    TestPoint point;
    point.id = static_cast<uint64_t>(i) + 7;
    // Spread evenly over a ball of radius 1: a sequence of irrational steps.
    const double z = std::fmod(i * 0.618, 1.0) * 2 - 1, a = i * 2.4,
                 r = std::cbrt(std::fmod(i * 0.754, 1.0));
    const double flat = r * std::sqrt(1 - z * z);
    point.position = {flat * std::cos(a), flat * std::sin(a), r * z};
    for (int k = 0; k < std::min(n, 3); ++k) {
      auto& keypoints = model.images[static_cast<size_t>(k)].points2d;
      if (i == 0) keypoints.clear();
      point.track.push_back(
          {static_cast<uint32_t>(k) + 1, static_cast<uint32_t>(keypoints.size())});
      keypoints.push_back(keypoint_of(ring_pose(k, n), point));
    }
    model.points.push_back(point);
  }
  return model;
}

class ByteWriter {
 public:
  template <class T>
  void put(T value) {
    static_assert(std::endian::native == std::endian::little);
    const auto at = bytes_.size();
    bytes_.resize(at + sizeof(T));
    std::memcpy(bytes_.data() + at, &value, sizeof(T));
  }
  void text(const std::string& value) {
    bytes_.insert(bytes_.end(), value.c_str(), value.c_str() + value.size() + 1);
  }
  const std::vector<char>& bytes() const { return bytes_; }

 private:
  std::vector<char> bytes_;
};

inline void write_bytes(const std::filesystem::path& path, const std::vector<char>& bytes) {
  std::filesystem::create_directories(path.parent_path());
  std::ofstream out(path, std::ios::binary);
  out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  ASSERT_TRUE(out.flush()) << path;
}
inline std::vector<char> cameras_bytes(const TestModel& model) {
  ByteWriter out;
  out.put(uint64_t{model.cameras.size()});
  for (const TestCamera& c : model.cameras) {
    out.put(c.id);
    out.put(c.model);
    out.put(c.width);
    out.put(c.height);
    for (double p : c.params) out.put(p);
  }
  return out.bytes();
}

inline std::vector<char> images_bytes(const TestModel& model) {
  ByteWriter out;
  out.put(uint64_t{model.images.size()});
  for (const TestImage& image : model.images) {
    out.put(image.id);
    for (double v : image.pose) out.put(v);
    out.put(image.camera);
    out.text(image.name);
    out.put(uint64_t{image.points2d.size()});
    for (const auto& p : image.points2d) {
      out.put(p[0]);
      out.put(p[1]);
      out.put(static_cast<int64_t>(p[2]));
    }
  }
  return out.bytes();
}

inline std::vector<char> points_bytes(const TestModel& model) {
  ByteWriter out;
  out.put(uint64_t{model.points.size()});
  for (const TestPoint& point : model.points) {
    out.put(point.id);
    for (int k = 0; k < 3; ++k) out.put(point.position[k]);
    for (int k = 0; k < 3; ++k) out.put(uint8_t{200});
    out.put(point.error);
    out.put(uint64_t{point.track.size()});
    for (const auto& t : point.track) {
      out.put(t[0]);
      out.put(t[1]);
    }
  }
  return out.bytes();
}

inline void write_binary(const TestModel& model, const std::filesystem::path& folder) {
  write_bytes(folder / "cameras.bin", cameras_bytes(model));
  write_bytes(folder / "images.bin", images_bytes(model));
  write_bytes(folder / "points3D.bin", points_bytes(model));
}

// As newer versions write beside the three: one rig whose second camera sits `offset` to the side,
// a frame per pair of images. Deliberately not the identity, so that using them would show.
inline void write_rigs_and_frames(const TestModel& model, const std::filesystem::path& folder) {
  ByteWriter rigs, frames;
  rigs.put(uint64_t{1});
  rigs.put(uint32_t{1});
  rigs.put(uint32_t{2});
  rigs.put(int32_t{0});
  rigs.put(uint32_t{1});
  rigs.put(int32_t{0});
  rigs.put(uint32_t{2});
  rigs.put(uint8_t{1});
  for (double v : {0.0, 1.0, 0.0, 0.0, 0.5, 0.0, 0.0}) rigs.put(v);
  frames.put(uint64_t{model.images.size() / 2});
  for (size_t i = 0; i + 1 < model.images.size(); i += 2) {
    frames.put(static_cast<uint32_t>(i + 1));
    frames.put(uint32_t{1});
    for (double v : {1.0, 0.0, 0.0, 0.0, 9.0, 9.0, 9.0}) frames.put(v);
    frames.put(uint32_t{2});
    for (size_t k = 0; k < 2; ++k) {
      frames.put(int32_t{0});
      frames.put(static_cast<uint32_t>(k + 1));
      frames.put(uint64_t{model.images[i + k].id});
    }
  }
  write_bytes(folder / "rigs.bin", rigs.bytes());
  write_bytes(folder / "frames.bin", frames.bytes());
}

inline void write_colmap_text(const TestModel& model, const std::filesystem::path& folder) {
  std::string cameras =
      fmt::format("# Camera list with one line of data per camera:\n# Number of cameras: {}\n",
                  model.cameras.size());
  for (const TestCamera& c : model.cameras) {
    cameras +=
        fmt::format("{} {} {} {} {}\n", c.id, camera_model_name(static_cast<CameraModel>(c.model)),
                    c.width, c.height, fmt::join(c.params, " "));
  }
  std::string images = fmt::format(
      "# Image list with two lines of data per image:\n# Number of images: {}, mean observations: "
      "1\n",
      model.images.size());
  for (const TestImage& image : model.images) {
    images += fmt::format("{} {} {} {}\n", image.id, fmt::join(image.pose, " "), image.camera,
                          image.name);
    for (const auto& p : image.points2d) {
      images += fmt::format("{} {} {} ", p[0], p[1], static_cast<int64_t>(p[2]));
    }
    images += "\n";
  }
  std::string points = fmt::format("# Number of points: {}\n", model.points.size());
  for (const TestPoint& p : model.points) {
    points += fmt::format("{} {} {} {} 200 200 200 {}", p.id, p.position.x, p.position.y,
                          p.position.z, p.error);
    for (const auto& t : p.track) points += fmt::format(" {} {}", t[0], t[1]);
    points += "\n";
  }
  write_text(folder / "cameras.txt", cameras);
  write_text(folder / "images.txt", images);
  write_text(folder / "points3D.txt", points);
}

// A transforms file of the ring: names prefix + 0, 1, .. + extension, and `head` before the frames,
// such as "\"fl_x\":50".
inline std::string transforms_text(int n, const std::string& prefix, const std::string& extension,
                                   const std::string& head) {
  std::vector<std::string> frames;
  for (int i = 0; i < n; ++i) {
    const Pose p = ring_pose(i, n);
    std::string rows;
    for (size_t r = 0; r < 3; ++r) {
      const auto& m = p.rotation.m[r];
      // OpenGL's axes: y and z turned round.
      rows += fmt::format("[{},{},{},{}],", m[0], -m[1], -m[2], p.translation[static_cast<int>(r)]);
    }
    frames.push_back(fmt::format("{{\"file_path\":\"{}{}{}\",\"transform_matrix\":[{}[0,0,0,1]]}}",
                                 prefix, i, extension, rows));
  }
  return fmt::format("{{{},\n\"frames\":[{}]}}", head, fmt::join(frames, ",\n"));
}

// A picture of one colour; with 4 channels the left half is transparent (or nothing is).
inline void write_picture(const std::filesystem::path& path, int width = 40, int height = 30,
                          int channels = 3, bool transparent = true) {
  std::filesystem::create_directories(path.parent_path());
  Image8 image{width, height, channels, {}};
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      for (int c = 0; c < channels; ++c) {
        image.pixels.push_back(c == 3 && transparent && x < width / 2 ? 0 : c == 3 ? 255 : 100);
      }
    }
  }
  write_image(path, image);
}

// The whole capture: model in sparse/0, pictures in images/.
inline void write_capture(const TestModel& model, const std::filesystem::path& root) {
  write_binary(model, root / "sparse" / "0");
  for (const TestImage& image : model.images) write_picture(root / "images" / image.name);
}

inline bool any_contains(const std::vector<std::string>& lines, const std::string& part) {
  return std::any_of(lines.begin(), lines.end(),
                     [&](const std::string& line) { return line.find(part) != line.npos; });
}

inline std::string load_error(const std::filesystem::path& path, const SceneOptions& options = {}) {
  return error_of([&] { load_scene(path, options); });
}

}  // namespace nerf::test
