// Captures in the layout of Nerfies (Park et al. 2021) and HyperNeRF: camera/ID.json, rgb/Nx/ID.png
// (the photos, N times reduced), dataset.json (which ids there are, and which are held out),
// metadata.json (ids of the moment, the light and the camera), scene.json (where the authors' code
// samples) and points.npy (points that stand still). All coordinates are in one frame and unit but
// "near" and "far" of scene.json, which are times its "scale".
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <tuple>

#include "image_lookup.h"
#include "lenient_json.h"
#include "nerfies_camera.h"
#include "npy.h"
#include "paths.h"
#include "scene_input.h"
#include "scene_limits.h"
#include "transforms_camera.h"

namespace nerf::internal {

namespace fs = std::filesystem;
using nlohmann::json;

namespace {

constexpr int kMostIds = 1 << 20;  // a row of numbers may be learnt for each

struct Ids {
  std::vector<std::string> all;
  std::vector<char> is_test;  // parallel to all; empty where the file makes no split
};

json read_object(const fs::path& file) {
  json root = read_lenient_json(file);
  if (!root.is_object()) throw Error("does not hold an object", file.string());
  return root;
}

std::vector<std::string> id_list(const json& root, const char* key, const fs::path& file) {
  const auto it = root.find(key);
  if (it == root.end() || it->is_null()) return {};
  std::vector<std::string> ids;
  if (it->is_array())
    for (const json& id : *it) {
      if (id.is_string())
        ids.push_back(id.get<std::string>());
      else if (id.is_number_integer())
        ids.push_back(id.dump());
      else
        break;
    }
  if (!it->is_array() || ids.size() != it->size())
    throw Error(fmt::format("\"{}\" is not a list of ids", key), file.string(),
                "an id is the name of a photo without its folder and .png");
  return ids;
}

// Of every camera file, where nothing says which ids count.
std::vector<std::string> ids_of_cameras(const fs::path& root) {
  std::vector<std::string> ids;
  for (const fs::path& file : nerfies_path_files(root / "camera"))
    ids.push_back(file.stem().string());
  return ids;
}

Ids read_ids(const fs::path& root, SceneInput& input) {
  const fs::path file = root / "dataset.json";
  if (!path_exists(file)) {
    input.warnings.push_back("there is no dataset.json: every camera counts");
    return {ids_of_cameras(root), {}};
  }
  const json dataset = read_object(file);
  const std::vector<std::string> train = id_list(dataset, "train_ids", file),
                                 test = id_list(dataset, "val_ids", file),
                                 listed = id_list(dataset, "ids", file);
  if (train.empty() && test.empty() && listed.empty())
    throw Error("lists no photo", file.string(), "\"train_ids\" and \"val_ids\" list them");
  Ids ids;
  std::set<std::string> seen;
  int both = 0, again = 0;
  const auto add = [&](const std::vector<std::string>& list, bool held_out) {
    std::set<std::string> own;
    for (const std::string& id : list) {
      if (!own.insert(id).second) {
        ++again;
      } else if (!seen.insert(id).second) {
        ++both;
      } else {
        ids.all.push_back(id);
        ids.is_test.push_back(held_out);
      }
    }
  };
  add(test, true);
  const size_t held_out = ids.all.size();
  add(train.empty() && test.empty() ? listed : train, false);
  if (again > 0) input.warnings.push_back(fmt::format("dataset.json lists {} photos again", again));
  if (both > 0)
    input.warnings.push_back(fmt::format(
        "dataset.json has {} photos for training and for measuring: they are held out", both));
  std::vector<std::string> unused;
  for (const std::string& id : listed)
    if (!seen.contains(id)) unused.push_back(id);
  if (!unused.empty())
    input.notes.push_back(
        fmt::format("{} photos are left out, since dataset.json has them neither "
                    "for training nor for measuring: {}",
                    unused.size(), name_list(unused)));
  if (test.empty()) {
    ids.is_test.clear();
    input.notes.push_back("dataset.json has no \"val_ids\": every 8th photo is held out");
  } else {
    input.notes.push_back(
        fmt::format("{} of {} photos are held out, as \"val_ids\" of dataset.json "
                    "says",
                    held_out, ids.all.size()));
  }
  return ids;
}

// The largest photos: rgb/1x, or the least N of those that are there.
fs::path photo_folder(const fs::path& root, SceneInput& input) {
  std::vector<std::pair<int, fs::path>> found;
  for (int n = 1; n <= 64; ++n)
    if (const fs::path folder = root / "rgb" / fmt::format("{}x", n); is_folder(folder))
      if (!list_images(folder).empty()) found.emplace_back(n, folder);
  if (found.empty())
    throw Error("there are no photos", (root / "rgb").string(),
                "rgb/1x (or rgb/2x, rgb/4x, ...) must hold them");
  if (found.front().first > 1)
    input.format += fmt::format(", photos of rgb/{}x/", found.front().first);
  for (size_t i = 1; i < found.size(); ++i)
    input.ignored.push_back(fmt::format("rgb/{}x/", found[i].first));
  return found.front().second;
}

int id_of(const FrameJson& entry, const char* key) {
  const auto value = entry.number(key);
  if (!value) return -1;
  if (!(*value >= 0 && *value < kMostIds && *value == std::floor(*value)))
    entry.fail(fmt::format("\"{}\" is {:g}", key, *value),
               fmt::format("ids are whole numbers from 0 to {}", kMostIds - 1));
  return static_cast<int>(*value);
}

// Ids and, in units of the moments' ids, the times of the views.
void read_metadata(const fs::path& root, const std::vector<std::string>& ids, SceneInput& input) {
  const fs::path file = root / "metadata.json";
  if (!path_exists(file)) {
    input.warnings.push_back(
        "there is no metadata.json: the photos have no times (--times gives them some)");
    return;
  }
  const json metadata = read_object(file);
  std::vector<std::string> missing;
  for (const std::string& id : ids)
    if (!metadata.contains(id)) missing.push_back(id);
  if (!missing.empty())
    throw Error(fmt::format("has no entry for {} of {} photos: {}", missing.size(), ids.size(),
                            name_list(missing)),
                file.string(),
                "add their warp_id, appearance_id and camera_id, or take them out of dataset.json");
  std::set<int> cameras;
  for (size_t i = 0; i < ids.size(); ++i) {
    const json& own = metadata[ids[i]];
    const FrameJson entry{own, own, fmt::format("{}, \"{}\"", file.string(), printable(ids[i]))};
    if (!own.is_object()) entry.fail("is not an object");
    ViewIds& view = input.views[i].ids;
    view.moment = id_of(entry, "warp_id");
    view.appearance = id_of(entry, "appearance_id");
    view.camera = id_of(entry, "camera_id");
    const int time = id_of(entry, "time_id");
    if (view.moment < 0 && time < 0)
      entry.fail("has neither \"warp_id\" nor \"time_id\"", "one of them says its moment");
    if (view.moment < 0) view.moment = time;
    input.views[i].time = time >= 0 ? time : view.moment;
    if (view.camera >= 0) cameras.insert(view.camera);
  }
  if (cameras.size() == 1)
    input.notes.push_back(fmt::format(
        "the capture is of one camera (camera_id is {} everywhere): its motion alone shows depth",
        *cameras.begin()));
  input.times = SceneInput::Times{"ids of metadata.json"};
}

void read_region(const fs::path& root, SceneInput& input) {
  const fs::path file = root / "scene.json";
  if (!path_exists(file))
    throw Error(
        "there is no scene.json", root.string(),
        "Nerfies' layout has it: {\"scale\": 1, \"center\": [0, 0, 0], \"near\": N, \"far\": "
        "F}, the nearest and the farthest distance from a camera, times scale");
  const json scene = read_object(file);
  const FrameJson entries{scene, scene, file.string()};
  const auto positive = [&](const char* key) {
    const auto value = entries.number(key);
    if (!value) entries.fail(fmt::format("there is no \"{}\"", key));
    if (!(*value > 0)) entries.fail(fmt::format("\"{}\" is {:g}, not above 0", key, *value));
    return *value;
  };
  const double scale = positive("scale"), near = positive("near"), far = positive("far");
  if (!(near < far))
    entries.fail(fmt::format("\"near\" is {:g} and \"far\" {:g}: nothing lies between", near, far));
  input.published = SceneInput::Depths{near / scale, far / scale};
}

void read_points(const fs::path& root, SceneInput& input) {
  const fs::path file = root / "points.npy";
  if (!path_exists(file)) {
    input.notes.push_back("there is no points.npy: near and far are those of scene.json");
    // Of what every view sees.
    input.depths.assign(input.views.size(), *input.published);
    return;
  }
  const char* hint = "N rows of x, y, z: numpy.save(\"points.npy\", points.astype(\"<f4\"))";
  const NpyArray array = read_npy(file);
  if (array.shape.size() != 2 || array.shape[1] != 3)
    throw Error(fmt::format("has the shape ({}), not (N, 3)", fmt::join(array.shape, ", ")),
                file.string(), hint);
  if (array.integers) throw Error("holds whole numbers, not coordinates", file.string(), hint);
  size_t dropped = 0;
  for (size_t i = 0; i < array.shape[0]; ++i) {
    const Vec3d p{array.values[3 * i], array.values[3 * i + 1], array.values[3 * i + 2]};
    if (coordinate_ok(p))
      input.points.push_back({p, 0, 0});
    else
      ++dropped;
  }
  if (dropped == array.shape[0] && dropped > 0)
    throw Error("holds no finite point", file.string(), hint);
  if (dropped > 0)
    input.warnings.push_back(fmt::format(
        "{} of {} points of points.npy are not finite and left out", dropped, array.shape[0]));
}

}  // namespace

bool is_nerfies_scene(const fs::path& root) {
  return is_folder(root / "camera") && is_folder(root / "rgb") &&
         std::ranges::any_of(std::array{"scene.json", "dataset.json", "metadata.json"},
                             [&](const char* name) { return path_exists(root / name); });
}

SceneInput read_nerfies_scene(const fs::path& root) {
  SceneInput input;
  input.format = "Nerfies";
  read_region(root, input);
  const Ids ids = read_ids(root, input);
  const fs::path photos = photo_folder(root, input);
  const std::vector<FoundImage> found = find_images(photos, ids.all, &input.notes);
  for (size_t i = 0; i < ids.all.size(); ++i) {
    const std::string& id = ids.all[i];
    const fs::path dataset = root / "dataset.json", file = root / "camera" / (id + ".json");
    const bool held_out = !ids.is_test.empty() && ids.is_test[i];
    const std::string where =
        fmt::format("{}, {}", dataset.string(), held_out ? "\"val_ids\"" : "\"train_ids\"");
    if (!is_file(file))
      throw Error(
          fmt::format("names {}, which has no camera/{}.json", printable(id), printable(id)), where,
          "take the id out, or put its camera there");
    View view;
    view.image_path = found[i].path.empty() ? photos / (id + ".png") : found[i].path;
    view.name = view.image_path.lexically_relative(photos).generic_string();
    if (held_out && found[i].path.empty())
      throw Error(fmt::format("names {}, of which there is no photo", printable(id)), where,
                  fmt::format("take the id out, or put {} there", view.image_path.string()));
    const NerfiesCamera own = read_nerfies_camera(file);
    view.pose = own.pose;
    const auto key = [](const Camera& c) {
      return std::tuple{c.model, c.width, c.height, c.params};
    };
    const auto same = std::ranges::find(input.cameras, key(own.camera), key);
    view.camera = static_cast<int>(same - input.cameras.begin());
    if (same == input.cameras.end()) input.cameras.push_back(own.camera);
    input.views.push_back(std::move(view));
  }
  input.is_test = ids.is_test;
  input.image_folder = photos;
  input.listing = root / "dataset.json";
  input.mask_folders = {root / "masks"};
  input.images_total = static_cast<int>(ids.all.size());
  read_metadata(root, ids.all, input);
  read_points(root, input);
  return input;
}

}  // namespace nerf::internal
