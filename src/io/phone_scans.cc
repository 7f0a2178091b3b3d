// Both applications write ARKit's poses: camera-to-world, OpenGL's camera axes, +y up.
#include "phone_scans.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "lenient_json.h"
#include "nerf/math/camera_paths.h"
#include "paths.h"
#include "scene_input.h"

namespace nerf::internal {

namespace fs = std::filesystem;
using nlohmann::json;

namespace {

struct PolycamFolders {
  fs::path cameras;
  std::string images;  // below the root
};

// Poses corrected by loop closure where there are any.
PolycamFolders polycam_folders(const fs::path& root) {
  const fs::path keyframes = root / "keyframes";
  for (const char* corrected : {"corrected_", ""}) {
    const std::string images = std::string(corrected) + "images";
    const fs::path cameras = keyframes / (std::string(corrected) + "cameras");
    if (is_folder(cameras) && !list_images(keyframes / images).empty())
      return {cameras, "keyframes/" + images};
  }
  return {};
}

// "The max range of the lidar sensor is 5M, so the depth map for any part of the scene larger than
// that is a total guess" (README of Polycam's polyform, which tells the files too).
constexpr double kLidarReach = 5;

// Adds the depth map below the root that has the photo's name, if there is one.
void add_depth(const fs::path& root, const std::string& folder, const std::string& stem,
               double unit, json& frame) {
  for (const char* extension : {".png", ".exr", ".tif", ".tiff", ".npy"}) {
    const std::string name = fmt::format("{}/{}{}", folder, stem, extension);
    if (!is_file(root / name)) continue;
    frame["depth_file_path"] = name;
    frame["depth_unit_scale_factor"] = unit;
    frame["depth_reach"] = kLidarReach;
    return;
  }
}

PhoneScan read_polycam(const fs::path& root, const PolycamFolders& folders) {
  PhoneScan scan{"Polycam raw data", folders.cameras, json::object()};
  std::vector<fs::path> files;
  std::error_code problem;
  for (fs::directory_iterator it(folders.cameras, problem), end; !problem && it != end;
       it.increment(problem))
    if (is_file(it->path()) && lower_extension(it->path()) == ".json") files.push_back(it->path());
  std::sort(files.begin(), files.end());
  json frames = json::array();
  for (const fs::path& file : files) {
    const json camera = read_lenient_json(file);
    const auto entry = [&](const std::string& key) -> const json& {
      const auto it = camera.is_object() ? camera.find(key) : camera.end();
      if (it == camera.end())
        throw Error(fmt::format("there is no \"{}\"", key), file.string(),
                    "not a camera of Polycam's raw data");
      return *it;
    };
    json matrix = json::array();
    for (int r = 0; r < 3; ++r) {
      json row = json::array();
      for (int c = 0; c < 4; ++c) row.push_back(entry(fmt::format("t_{}{}", r, c)));
      matrix.push_back(std::move(row));
    }
    frames.push_back({{"file_path", folders.images + "/" + file.stem().string()},
                      {"transform_matrix", std::move(matrix)},
                      {"fl_x", entry("fx")},
                      {"fl_y", entry("fy")},
                      {"cx", entry("cx")},
                      {"cy", entry("cy")},
                      {"w", entry("width")},
                      {"h", entry("height")}});
    const std::string stem = file.stem().string();
    add_depth(root, "keyframes/depth", stem, 1e-3, frames.back());
    const std::string confidence = fmt::format("keyframes/confidence/{}.png", stem);
    if (is_file(root / confidence)) frames.back()["depth_confidence_path"] = confidence;
  }
  scan.transforms = {{"frames", std::move(frames)}, {"up", {0, 1, 0}}};
  return scan;
}

std::vector<double> numbers(const json& value, size_t count, const std::string& what,
                            const fs::path& file) {
  std::vector<double> out;
  if (value.is_array())
    for (const json& number : value)
      out.push_back(number.is_number() ? number.get<double>() : std::nan(""));
  if (out.size() != count)
    throw Error(fmt::format("{} is not {} numbers", what, count), file.string(),
                "not Record3D's metadata");
  return out;
}

PhoneScan read_record3d(const fs::path& root) {
  const fs::path file = root / "metadata.json";
  PhoneScan scan{"Record3D", file, json::object()};
  const json metadata = read_lenient_json(file);
  if (!metadata.is_object())
    throw Error("is not an object", file.string(), "it is not the metadata that Record3D writes");
  const std::vector<double> k = numbers(metadata.value("K", json()), 9, "\"K\"", file);
  const json poses = metadata.value("poses", json::array());
  std::vector<std::string> images = list_images(root / "rgb");
  // 0.jpg, 1.jpg, ... 10.jpg
  std::stable_sort(images.begin(), images.end(),
                   [](const auto& a, const auto& b) { return a.size() < b.size(); });
  if (!poses.is_array() || poses.size() != images.size())
    throw Error(fmt::format("has {} poses, but rgb/ holds {} images", poses.size(), images.size()),
                file.string(), "export the capture again");
  json frames = json::array();
  for (size_t i = 0; i < images.size(); ++i) {
    // Quaternion x, y, z, w, then the position.
    const auto p = numbers(poses[i], 7, fmt::format("pose {}", i), file);
    const Mat3d r = to_rotation({p[3], p[0], p[1], p[2]});
    json matrix = json::array();
    for (size_t row = 0; row < 3; ++row)
      matrix.push_back({r.m[row][0], r.m[row][1], r.m[row][2], p[4 + row]});
    frames.push_back({{"file_path", "rgb/" + images[i]}, {"transform_matrix", std::move(matrix)}});
    const std::string stem = fs::path(images[i]).stem().string();
    // Metres in EXR; in integers millimetres.
    const bool floats = is_file(root / "depth" / (stem + ".exr"));
    add_depth(root, "depth", stem, floats ? 1 : 1e-3, frames.back());
  }
  scan.transforms = {{"frames", std::move(frames)},
                     {"up", {0, 1, 0}},
                     // By columns.
                     {"fl_x", k[0]},
                     {"fl_y", k[4]},
                     {"cx", k[6]},
                     {"cy", k[7]}};
  if (!images.empty() && is_file(root / "depth" / (fs::path(images[0]).stem().string() + ".depth")))
    scan.ignored.push_back(
        "depth/*.depth (compressed by LZFSE: Record3D's export as EXR + RGB has depth maps that "
        "are "
        "read)");
  for (const char* key : {"w", "h"})
    if (metadata.contains(key)) scan.transforms[key] = metadata[key];
  return scan;
}

bool is_record3d(const fs::path& root) {
  return is_file(root / "metadata.json") && is_folder(root / "rgb") &&
         !list_images(root / "rgb").empty();
}

}  // namespace

bool is_phone_scan(const fs::path& root) {
  return !polycam_folders(root).images.empty() || is_record3d(root);
}

PhoneScan read_phone_scan(const fs::path& root) {
  const PolycamFolders polycam = polycam_folders(root);
  return polycam.images.empty() ? read_record3d(root) : read_polycam(root, polycam);
}

}  // namespace nerf::internal
