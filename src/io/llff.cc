// Captures of LLFF (Mildenhall et al. 2019): poses_bounds.npy beside images/ or images_4/,
// images_8/.
//
// A row per image, in the order of the sorted names: 3 x 5 numbers, whose first three columns are
// the camera's axes down, right and backwards in the world, the fourth its position, the fifth
// height, width and focal length in pixels; then the nearest and the farthest depth of what it
// sees.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "llff_row.h"
#include "nerf/math/camera_paths.h"
#include "npy.h"
#include "scene_input.h"
#include "scene_limits.h"

namespace nerf::internal {

namespace fs = std::filesystem;

namespace {

constexpr size_t kColumns = 17;

}  // namespace

LlffRow parse_llff_row(const double* v, LlffAxes axes, const std::string& where) {
  for (size_t i = 0; i < kColumns; ++i)
    if (!std::isfinite(v[i])) throw Error("holds what is not a number", where);
  const auto column = [&](size_t c) { return Vec3d{v[c], v[5 + c], v[10 + c]}; };
  LlffRow row;
  // Rows 0 to 2 of the fifth column.
  row.camera.model = CameraModel::kSimplePinhole;
  const double height = v[4], width = v[9], focal = v[14];
  if (!(width >= 1 && width <= kMaxImageSide && height >= 1 && height <= kMaxImageSide))
    throw Error(fmt::format("says {} x {} pixels", width, height), where, kImageSizeHint);
  row.camera.width = static_cast<int>(std::lround(width));
  row.camera.height = static_cast<int>(std::lround(height));
  row.camera.params = {focal, 0.5 * width, 0.5 * height};
  if (const auto problem = camera_problem(row.camera)) throw Error(*problem, where, kImageSizeHint);
  const bool turned = axes == LlffAxes::kRightUpBack;
  Mat3d rotation;  // OpenCV: right, down, forward
  rotation.set_column(0, turned ? column(0) : column(1));
  rotation.set_column(1, turned ? -column(1) : column(0));
  rotation.set_column(2, -column(2));
  if (!(orthonormality_error(rotation) < 0.02))
    throw Error("does not hold a rotation", where,
                turned ? "its first three columns are the camera's axes right, up and backwards"
                       : "its first three columns are the camera's axes down, right and backwards");
  // What rounding to four bytes left is taken out.
  const Vec3d right = normalized(rotation.column(0));
  const Vec3d down = normalized(rotation.column(1) - right * dot(right, rotation.column(1)));
  rotation.set_column(0, right);
  rotation.set_column(1, down);
  rotation.set_column(2, cross(right, down));
  row.pose.rotation = rotation;
  row.pose.translation = column(3);
  if (!coordinate_ok(row.pose.translation)) throw Error("has an absurd position", where);
  row.depths = {v[15], v[16]};
  if (!(row.depths.near > 0 && row.depths.near < row.depths.far))
    throw Error(fmt::format("has the depths {} to {}", row.depths.near, row.depths.far), where,
                "the nearest must be above 0 and below the farthest");
  return row;
}

void add_llff_view(const LlffRow& row, const std::string& name, SceneInput& input) {
  View view;
  view.name = name;
  view.image_path = input.image_folder / name;
  view.camera = static_cast<int>(input.cameras.size());
  view.pose = row.pose;
  input.cameras.push_back(row.camera);
  input.views.push_back(std::move(view));
  input.depths.push_back(row.depths);
}

SceneInput read_llff_scene(const fs::path& root) {
  const fs::path file = root / "poses_bounds.npy";
  const NpyArray array = read_npy(file);
  if (array.shape.size() != 2 || array.shape[1] != kColumns || array.shape[0] == 0)
    throw Error(fmt::format("is not an array of {} numbers per image", kColumns), file.string(),
                "LLFF's imgs2poses.py writes it");
  SceneInput input;
  input.format = "LLFF";
  constexpr std::array kFolders{"images", "images_2", "images_4", "images_8"};
  std::vector<std::string> names;
  for (const char* folder : kFolders) {
    std::vector<std::string> found = list_images(root / folder);
    if (found.empty()) continue;
    if (names.empty()) {
      input.image_folder = root / folder;
      names = std::move(found);
      if (folder != kFolders[0]) input.format += fmt::format(", photos of {}/", folder);
    } else {
      input.ignored.push_back(std::string(folder) + "/");
    }
  }
  if (names.empty())
    throw Error("there are no images", root.string(),
                "images/ (or images_2, images_4, images_8) must hold them");
  if (names.size() != array.shape[0])
    throw Error(fmt::format("has {} rows, but {} holds {} images", array.shape[0],
                            input.image_folder.string(), names.size()),
                file.string(), "rows and images belong together in the order of the names");
  for (size_t i = 0; i < names.size(); ++i) {
    const std::string where = fmt::format("{}: row {}", file.string(), i);
    const double* row = array.values.data() + i * kColumns;
    add_llff_view(parse_llff_row(row, LlffAxes::kDownRightBack, where), names[i], input);
  }
  input.images_total = static_cast<int>(names.size());
  input.mask_folders = {root / "masks"};
  return input;
}

}  // namespace nerf::internal
