// COLMAP models: cameras, images and points3D, as .bin or as .txt.
//
// Layout and meaning: COLMAP's documentation, "Output Format". Models written since COLMAP 3.12
// have rigs and frames beside the three old files; images still carries every image's own pose
// (sensor from rig composed with rig from world, as COLMAP writes it), so that nothing here needs
// them.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <unordered_map>
#include <unordered_set>
#include <vector>

#include "cursor.h"
#include "nerf/io/scene.h"

namespace nerf::internal {

struct ColmapImage {
  std::string name;
  int camera = 0;  // index into ColmapModel::cameras
  Pose pose;       // camera-to-world
};

struct ColmapModel {
  std::string format;  // "COLMAP binary, with rigs and frames"
  std::vector<Camera> cameras;
  std::vector<ColmapImage> images;
  std::vector<ScenePoint> points;
  std::vector<Observation> observations;
  std::vector<Vec2d> keypoints;  // of the observations, pixels; not a number where none is stored
  std::vector<std::string> warnings;
};

// Checks what every format says and turns ids into indices. Every function throws through `at`.
// Images whose camera or pose holds what is not a number, and those whose camera no lens has, are
// left out with a warning; where that leaves none, finish() throws what was wrong with the first.
class ColmapBuilder {
 public:
  void add_camera(const Cursor& at, uint32_t id, CameraModel model, uint64_t width, uint64_t height,
                  const std::array<double, kMaxCameraParams>& params);
  // Quaternion w x y z and translation of camera-from-world, as stored.
  void add_image(const Cursor& at, uint32_t id, const std::array<double, 7>& camera_from_world,
                 uint32_t camera_id, std::string name);
  // The next place that the image added last saw something at, and the point that this is;
  // kNoPoint: none.
  static constexpr uint64_t kNoPoint = ~uint64_t{0};
  void add_keypoint(const Vec2d& pixel, uint64_t point) {
    if (image_kept_) keypoints_.back().push_back({pixel, point});
  }
  // Begins a point; add_track adds an image that sees it and which of its keypoints that is. A
  // point that is not finite is left out.
  void add_point(uint64_t id, const Vec3d& position, double error);
  void add_track(uint32_t image_id, uint32_t keypoint);
  void warn(std::string text) { model_.warnings.push_back(std::move(text)); }
  ColmapModel finish();

 private:
  void leave_out(const std::string& problem, const std::string& where, uint32_t id,
                 std::string name);

  ColmapModel model_;
  std::unordered_map<uint32_t, int> camera_index_, image_index_;
  struct Unusable {
    std::string problem, where;
  };
  std::unordered_map<uint32_t, Unusable> unusable_cameras_;
  std::vector<std::string> left_out_;  // names
  std::optional<Error> first_problem_;
  std::unordered_set<std::string> names_;
  struct Keypoint {
    Vec2d pixel;
    uint64_t point;
  };
  std::vector<std::vector<Keypoint>> keypoints_;  // of each image
  uint64_t point_ = kNoPoint;                     // the one that was added last
  bool image_kept_ = false, point_kept_ = false;
  int points_dropped_ = 0;
};

// `id` as in cameras.bin: an Error that names it and the way out, where it is not one of ours.
CameraModel colmap_camera_model(const Cursor& at, int64_t id);

// Number of parameters that COLMAP's files give a camera; for EQUIRECTANGULAR they are width and
// height.
int colmap_camera_params(CameraModel model);

// Read one file each; in this order.
void read_colmap_cameras_binary(const std::filesystem::path& file, ColmapBuilder& builder);
void read_colmap_images_binary(const std::filesystem::path& file, ColmapBuilder& builder);
void read_colmap_points_binary(const std::filesystem::path& file, ColmapBuilder& builder);
void read_colmap_cameras_text(const std::filesystem::path& file, ColmapBuilder& builder);
void read_colmap_images_text(const std::filesystem::path& file, ColmapBuilder& builder);
void read_colmap_points_text(const std::filesystem::path& file, ColmapBuilder& builder);

// True where the folder holds at least one file of a model.
bool is_colmap_model(const std::filesystem::path& folder);

// Registered images as the file says it, without reading the model; 0 where unreadable.
uint64_t colmap_image_count(const std::filesystem::path& folder);

// Reads a model, .bin before .txt. Throws Error: a file missing, truncated, damaged, with values
// that no model can have. Points may be missing (with a warning).
ColmapModel read_colmap_model(const std::filesystem::path& folder);

// Path of an image below its folder, for names and output: without "..", roots and backslashes.
std::string clean_image_name(std::string_view name);

// Names from files for a person: "a.jpg, b.jpg, ...".
std::string name_list(const std::vector<std::string>& names);

// Text from a file made fit for a terminal: control characters as \xNN, cut after 120 characters.
std::string printable(std::string_view text);

}  // namespace nerf::internal
