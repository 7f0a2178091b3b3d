// Entries as nerfstudio ("Data conventions" of its documentation, and its dataparser) and
// instant-ngp (nerf_loader.cu) read them.
#include "transforms_fields.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <map>

#include "image_lookup.h"
#include "lenient_json.h"
#include "scene_limits.h"

namespace nerf::internal {

namespace fs = std::filesystem;
using nlohmann::json;

namespace {

// Words for entries whose meaning has another place here.
const std::map<std::string, const char*>& instead() {
  static const std::map<std::string, const char*> kInstead{
      {"aabb", "--bbox sets the box to reconstruct"},
      {"aabb_scale", "--bbox sets the box to reconstruct"},
      {"applied_transform", "coordinates are the file's, not the reconstruction's"},
      {"applied_scale", "coordinates are the file's, not the reconstruction's"},
      {"scale", "coordinates are the file's"},
      {"offset", "coordinates are the file's"},
      {"fisheye_crop_radius", "a mask says which pixels do not count"},
      {"mask_color", "masks/ or alpha say which pixels do not count"},
      {"white_transparent", "alpha says what is transparent"},
      {"black_transparent", "alpha says what is transparent"},
      {"rolling_shutter", "every photo has one pose"},
      {"transform_matrix_end", "every photo has one pose"}};
  return kInstead;
}

std::vector<std::string> file_names(const json& root, const char* key, const fs::path& file) {
  const auto it = root.find(key);
  if (it == root.end() || it->is_null()) return {};
  std::vector<std::string> names;
  if (it->is_array()) {
    for (const json& name : *it) {
      if (!name.is_string()) break;
      names.push_back(clean_image_name(name.get<std::string>()));
    }
  }
  if (!it->is_array() || names.size() != it->size())
    throw Error(fmt::format("\"{}\" is not a list of names", key), file.string(),
                "it lists file_path of frames");
  return names;
}

// Which views a list names; a word in the report on names that are no frame's.
std::vector<char> listed(const json& root, const char* key, const fs::path& file,
                         SceneInput& input) {
  std::map<std::string, std::vector<size_t>> index;
  for (size_t i = 0; i < input.views.size(); ++i) {
    const fs::path name = input.views[i].name;
    index[name.string()].push_back(i);
    index[(name.parent_path() / name.stem()).generic_string()].push_back(i);
  }
  std::vector<char> is_listed(input.views.size());
  std::vector<std::string> unknown;
  for (const std::string& name : file_names(root, key, file)) {
    const auto it = index.find(name);
    if (it == index.end()) unknown.push_back(name);
    for (const size_t i : it == index.end() ? std::vector<size_t>() : it->second) is_listed[i] = 1;
  }
  if (!unknown.empty())
    input.warnings.push_back(fmt::format("\"{}\" lists {} that {} no frame: {}", key,
                                         unknown.size(), unknown.size() == 1 ? "is" : "are",
                                         name_list(unknown)));
  return is_listed;
}

}  // namespace

bool is_read_entry(const std::string& key) {
  constexpr std::array kRead{"frames",
                             "file_path",
                             "transform_matrix",
                             "transform_matrix_start",
                             "mask_path",
                             "depth_file_path",
                             "depth_path",
                             "depth_confidence_path",
                             "depth_unit_scale_factor",
                             "integer_depth_scale",
                             "depth_reach",
                             "enable_depth_loading",
                             "time",
                             "w",
                             "h",
                             "fl_x",
                             "fl_y",
                             "camera_angle_x",
                             "camera_angle_y",
                             "x_fov",
                             "y_fov",
                             "cx",
                             "cy",
                             "k1",
                             "k2",
                             "k3",
                             "k4",
                             "k5",
                             "k6",
                             "p1",
                             "p2",
                             "camera_model",
                             "is_fisheye",
                             "ply_file_path",
                             "up",
                             "train_filenames",
                             "val_filenames",
                             "test_filenames",
                             "orientation_override"};
  return std::find(kRead.begin(), kRead.end(), key) != kRead.end();
}

void collect_unread(const json& object, std::set<std::string>& unread) {
  constexpr size_t kMost = 100;
  for (const auto& item : object.items())
    if (unread.size() < kMost && !item.value().is_null() && !is_read_entry(item.key()))
      unread.insert(item.key());
}

std::vector<std::string> describe_unread(const std::set<std::string>& unread,
                                         const std::string& file) {
  constexpr size_t kShown = 12;
  std::vector<std::string> lines, others;
  for (const std::string& key : unread) {
    const auto it = instead().find(key);
    if (it != instead().end())
      lines.push_back(fmt::format("\"{}\" of {} ({})", key, file, it->second));
    else
      others.push_back('"' + printable(key) + '"');
  }
  if (others.empty()) return lines;
  const bool cut = others.size() > kShown;
  others.resize(std::min(others.size(), kShown));
  lines.push_back(fmt::format("{}{} of {}", fmt::join(others, ", "), cut ? ", ..." : "", file));
  return lines;
}

void read_common_entries(const json& root, const fs::path& file, SceneInput& input) {
  if (const auto it = root.find("ply_file_path"); it != root.end() && it->is_string()) {
    std::string name = it->get<std::string>();
    std::replace(name.begin(), name.end(), '\\', '/');
    fs::path path = file.parent_path() / name;
    // Written on another computer it may be absolute.
    if (std::error_code none; !fs::is_regular_file(path, none))
      path = file.parent_path() / fs::path(name).filename();
    if (!name.empty()) input.point_files.push_back(path);
  }
  if (const auto it = root.find("up"); it != root.end() && it->is_array() && it->size() == 3) {
    Vec3d up;
    for (int k = 0; k < 3; ++k) {
      const json& value = (*it)[static_cast<size_t>(k)];
      up[k] = value.is_number() ? value.get<double>() : 0;
    }
    if (coordinate_ok(up) && length(up) > 1e-6) {
      input.up = normalized(up);
      input.notes.push_back("up is the file's \"up\"");
    }
  }
  const auto it = root.find("orientation_override");
  if (!input.up && it != root.end() && *it == "none") {
    input.up = Vec3d{0, 0, 1};
    input.notes.push_back("up is +z: the file's \"orientation_override\" is \"none\"");
  }
}

void read_depth_entries(const FrameJson& frame, const fs::path& root, View& view) {
  const FrameJson own{frame.frame, frame.frame, frame.where};
  const auto file = [&](const char* key) {
    const std::string name = own.text(key);
    if (name.empty()) return fs::path();
    const FoundImage found = find_images(root, {name}).front();
    return found.path.empty() ? root / name : found.path;
  };
  const bool ngp = own.find("depth_file_path") == nullptr;
  if (ngp && frame.find("enable_depth_loading") != nullptr && !frame.flag("enable_depth_loading"))
    return;
  view.depth_path = file(ngp ? "depth_path" : "depth_file_path");
  if (view.depth_path.empty()) return;
  view.depth_confidence_path = file("depth_confidence_path");
  for (const char* key : {"integer_depth_scale", "depth_unit_scale_factor"}) {
    const auto unit = frame.number(key);
    if (!unit) continue;
    if (!(*unit > 0)) frame.fail(fmt::format("\"{}\" is not above 0", key));
    view.depth_unit = *unit;
  }
  view.depth_reach = frame.number("depth_reach").value_or(view.depth_reach);
}

void obey_split(const json& root, const fs::path& file, SceneInput& input) {
  input.is_test.clear();
  const auto count = [](const std::vector<char>& list) {
    return std::count(list.begin(), list.end(), 1);
  };
  const std::vector<char> train = listed(root, "train_filenames", file, input);
  const std::vector<char> test = listed(root, "test_filenames", file, input);
  const std::vector<char> val = listed(root, "val_filenames", file, input);
  const bool has_train = count(train) > 0;
  const std::vector<char>& held_out = count(test) > 0 ? test : val;
  if (!has_train && count(held_out) == 0) return;

  std::vector<char> keep(input.views.size(), 1), is_test(input.views.size());
  std::vector<std::string> left_out;
  int both = 0;
  for (size_t i = 0; i < input.views.size(); ++i) {
    is_test[i] = held_out[i];
    both += held_out[i] && train[i];
    keep[i] = held_out[i] || (has_train ? train[i] : !val[i]);
    if (!keep[i]) left_out.push_back(input.views[i].name);
  }
  input.is_test = std::move(is_test);
  input.notes.push_back(fmt::format(
      "{} of {} photos are held out, as \"{}\" of the file says", count(held_out),
      input.views.size(), count(test) > 0 || count(val) == 0 ? "test_filenames" : "val_filenames"));
  if (both > 0)
    input.warnings.push_back(fmt::format(
        "{} photos are listed for training and for measuring: they are held out", both));
  if (!left_out.empty()) {
    input.warnings.push_back(
        fmt::format("{} photos are left out, since the file's split has them on neither side: {}",
                    left_out.size(), name_list(left_out)));
    keep_views(input, keep);
  }
}

}  // namespace nerf::internal
