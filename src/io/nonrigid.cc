// Captures of Non-Rigid NeRF (Tretschk et al. 2021): precomputed.json beside images/, a frame per
// moment in the order of the sorted names. Its "poses" are what load_llff.py returns: LLFF's rows
// with the camera's axes turned to right, up and backwards, about the cameras' mean; "bds" are the
// nearest and the farthest depth of each.
#include <fmt/format.h>

#include <array>
#include <limits>

#include "lenient_json.h"
#include "llff_row.h"
#include "scene_input.h"

namespace nerf::internal {

namespace fs = std::filesystem;
using nlohmann::json;

namespace {

double number(const json& value) {
  return value.is_number() ? value.get<double>() : std::numeric_limits<double>::quiet_NaN();
}

const json& list_of(const json& root, const char* key, const fs::path& file) {
  const auto it = root.find(key);
  if (it == root.end() || !it->is_array() || it->empty())
    throw Error(fmt::format("there is no list \"{}\"", key), file.string(),
                "it has an entry per image");
  return *it;
}

bool is_list(const json& value, size_t count) { return value.is_array() && value.size() == count; }

}  // namespace

SceneInput read_nonrigid_scene(const fs::path& root) {
  const fs::path file = root / "precomputed.json";
  const json precomputed = read_lenient_json(file);
  if (!precomputed.is_object()) throw Error("does not hold an object", file.string());
  const json& poses = list_of(precomputed, "poses", file);
  const json& depths = list_of(precomputed, "bds", file);
  SceneInput input;
  input.format = "Non-Rigid NeRF";
  input.image_folder = root / "images";
  const std::vector<std::string> names = list_images(input.image_folder);
  if (names.empty())
    throw Error("there are no images", input.image_folder.string(), "images/ must hold them");
  if (poses.size() != names.size() || depths.size() != names.size())
    throw Error(fmt::format("has {} \"poses\" and {} \"bds\", but {} holds {} images", poses.size(),
                            depths.size(), input.image_folder.string(), names.size()),
                file.string(), "they belong together in the order of the names");
  for (size_t i = 0; i < names.size(); ++i) {
    const std::string where = fmt::format("{}, poses[{}]", file.string(), i);
    std::array<double, 17> row;
    if (!is_list(poses[i], 3)) throw Error("is not 3 rows of 5 numbers", where);
    for (size_t r = 0; r < 3; ++r) {
      if (!is_list(poses[i][r], 5)) throw Error("is not 3 rows of 5 numbers", where);
      for (size_t c = 0; c < 5; ++c) row[5 * r + c] = number(poses[i][r][c]);
    }
    if (!is_list(depths[i], 2))
      throw Error("is not the nearest and the farthest depth",
                  fmt::format("{}, bds[{}]", file.string(), i));
    row[15] = number(depths[i][0]);
    row[16] = number(depths[i][1]);
    add_llff_view(parse_llff_row(row.data(), LlffAxes::kRightUpBack, where), names[i], input);
    input.views.back().time = static_cast<double>(i);
    input.views.back().ids.moment = static_cast<int>(i);
  }
  input.times = SceneInput::Times{"order of the frames"};
  input.images_total = static_cast<int>(names.size());
  input.listing = file;
  input.mask_folders = {root / "masks"};
  for (const char* key : {"render_poses", "i_test"})
    if (precomputed.contains(key))
      input.ignored.push_back(fmt::format("\"{}\" of precomputed.json", key));
  return input;
}

}  // namespace nerf::internal
