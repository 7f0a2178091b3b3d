// A COLMAP capture: which model, and where its images are.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <map>
#include <set>

#include "colmap_adjustment.h"
#include "image_lookup.h"
#include "paths.h"
#include "scene_input.h"

namespace nerf::internal {

namespace fs = std::filesystem;

namespace {

// Sub-folders with a number for a name, by number: 0, 1, 2, 10.
std::vector<fs::path> numbered_folders(const fs::path& folder) {
  std::map<unsigned long, fs::path> found;
  std::error_code problem;
  for (fs::directory_iterator it(folder, problem), end; !problem && it != end;
       it.increment(problem)) {
    const std::string name = it->path().filename().string();
    const bool number = name.size() <= 6 && std::all_of(name.begin(), name.end(), [](char c) {
                          return std::isdigit(static_cast<unsigned char>(c)) != 0;
                        });
    if (number && is_folder(it->path())) found.emplace(std::stoul(name), it->path());
  }
  std::vector<fs::path> out;
  for (auto& [number, path] : found) out.push_back(std::move(path));
  return out;
}

std::string relative_name(const fs::path& path, const fs::path& root) {
  const auto relative = path.lexically_relative(root);
  return relative.empty() || relative == "." ? path.string() : relative.generic_string();
}

// A model, and the workspace that it belongs to, where its images lie.
struct Candidate {
  fs::path folder, workspace;
  uint64_t images = 0;  // registered
};

std::vector<fs::path> models_in(const fs::path& folder) {
  std::vector<fs::path> found;
  for (fs::path& numbered : numbered_folders(folder))
    if (is_colmap_model(numbered)) found.push_back(std::move(numbered));
  if (is_colmap_model(folder)) found.push_back(folder);
  return found;
}

// In the order of trust. Undistorted workspaces (dense/) have images of their own; what 3D Gaussian
// splatting's converter ran COLMAP on (distorted/) are the photos of input/.
std::vector<Candidate> model_candidates(const fs::path& root) {
  std::vector<Candidate> found;
  const auto look = [&](const fs::path& models, const fs::path& workspace) {
    for (fs::path& model : models_in(models)) {
      const uint64_t images = colmap_image_count(model);
      found.push_back({std::move(model), workspace, images});
    }
  };
  look(root / "sparse", root);
  look(root / "colmap" / "sparse", root);
  for (const char* workspace : {"dense", "dense/0", "undistorted", "distorted", "colmap/dense",
                                "colmap/dense/0", "sfm", "output"})
    look(root / workspace / "sparse", root / workspace);
  if (found.empty()) look(root / "colmap", root);
  if (found.empty()) look(root, root);
  return found;
}

// The largest model of the first workspace that has one; of equals the first.
const Candidate& choose_model(const std::vector<Candidate>& models) {
  const Candidate* best = &models.front();
  for (const Candidate& model : models) {
    const bool same = model.workspace == best->workspace;
    if (model.images > best->images && (same || best->images == 0)) best = &model;
  }
  return *best;
}

constexpr std::array kImageFolders{"images", "images_2", "images_4", "images_8", "input"};

// Folders that image names may be relative to, the likeliest first.
std::vector<fs::path> image_folders(const fs::path& root, const fs::path& workspace) {
  std::vector<fs::path> folders;
  const auto add = [&](const fs::path& folder) {
    if (is_folder(folder) && std::find(folders.begin(), folders.end(), folder) == folders.end())
      folders.push_back(folder);
  };
  for (const fs::path& base : {workspace, root})
    for (const char* name : kImageFolders) add(base / name);
  for (const char* name : {"rgb", "color", "photos", "frames", "imgs", "image", "dslr/images"})
    add(root / name);
  add(root / "colmap" / "images");
  add(root);
  // The path is that of the model itself, sparse/0.
  const fs::path whole = fs::absolute(root).lexically_normal();
  for (fs::path above = whole.parent_path(); is_colmap_model(whole); above = above.parent_path()) {
    for (const char* name : kImageFolders) add(above / name);
    if (above.filename() != "sparse") break;
  }
  return folders;
}

// The folder that holds most of the model's images; of equals the first. Where the names are to be
// found as they are, no other ways are tried.
fs::path choose_image_folder(const fs::path& root, const Candidate& model,
                             const std::vector<std::string>& names, SceneInput& input) {
  const std::vector<fs::path> folders = image_folders(root, model.workspace);
  fs::path chosen;
  size_t most = 0;
  const auto choose = [&](const auto& count) {
    for (const fs::path& folder : folders) {
      const size_t found = count(folder);
      if (found <= most) continue;
      chosen = folder;
      most = found;
    }
  };
  choose([&](const fs::path& folder) { return count_as_named(folder, names); });
  if (2 * most < names.size()) {
    choose([&](const fs::path& folder) {
      const std::vector<FoundImage> found = find_images(folder, names);
      return static_cast<size_t>(std::count_if(
          found.begin(), found.end(), [](const FoundImage& f) { return !f.path.empty(); }));
    });
  }
  // Names may begin with the folder: "images/a.jpg".
  const auto is_named = [&](const fs::path& folder) {
    return std::ranges::any_of(names, [&](const std::string& name) {
      return name.starts_with(folder.filename().string() + "/");
    });
  };
  for (const fs::path& folder : folders)
    if (folder != root && folder != chosen && folder.parent_path() == root &&
        !(chosen == root && is_named(folder)))
      input.ignored.push_back(folder.filename().string() + "/");
  if (!chosen.empty()) return chosen;
  throw Error(fmt::format("none of the model's {} images was found", names.size()), root.string(),
              fmt::format("images/ (or images_2, images_4, images_8, input) must hold the files by "
                          "the names that the model has, such as {}",
                          printable(names.front())));
}

}  // namespace

std::vector<fs::path> find_colmap_models(const fs::path& root) {
  std::vector<fs::path> found;
  for (const Candidate& candidate : model_candidates(root)) found.push_back(candidate.folder);
  return found;
}

SceneInput read_colmap_scene(const fs::path& root, AdjustCameras adjust,
                             const std::function<void(const std::string&)>& progress,
                             const Cancel* cancel) {
  const std::vector<Candidate> models = model_candidates(root);
  if (models.empty()) {
    throw Error("no COLMAP model was found", root.string(),
                "looked for cameras.bin or cameras.txt in sparse/0, sparse and colmap/sparse/0");
  }
  const Candidate& used = choose_model(models);
  const fs::path& folder = used.folder;

  SceneInput input;
  for (const Candidate& other : models) {
    if (&other == &used) continue;
    const char* why = other.workspace == used.workspace ? "is the largest model" : "is read";
    input.ignored.push_back(fmt::format("{} ({} images; {} {} with {})",
                                        relative_name(other.folder, root), other.images,
                                        relative_name(folder, root), why, used.images));
  }
  ColmapModel model = read_colmap_model(folder);
  if (model.images.empty()) {
    throw Error("the COLMAP model has no registered image", folder.string(),
                "run COLMAP again with more overlap between the photos");
  }
  if (model.format.find("binary") != std::string::npos && path_exists(folder / "images.txt")) {
    input.ignored.push_back(relative_name(folder, root) + "/*.txt (the .bin files are read)");
  }

  std::vector<std::string> names;
  for (const ColmapImage& image : model.images) names.push_back(image.name);
  input.image_folder = choose_image_folder(root, used, names, input);
  const std::vector<FoundImage> files = find_images(input.image_folder, names, &input.notes);
  input.keypoints = has_keypoints(model);
  input.cameras_adjusted = adjust_cameras(adjust, model, input.notes, progress, cancel);
  input.format = model.format + ", " + relative_name(folder, root);
  input.cameras = std::move(model.cameras);
  input.points = std::move(model.points);
  input.observations = std::move(model.observations);
  input.warnings = std::move(model.warnings);
  std::set<std::string> registered;
  for (size_t i = 0; i < files.size(); ++i) {
    View view;
    view.name = files[i].name;
    view.image_path = files[i].path;
    view.camera = model.images[i].camera;
    view.pose = model.images[i].pose;
    registered.insert(clean_image_name(
        files[i].path.lexically_relative(input.image_folder.lexically_normal()).generic_string()));
    input.views.push_back(std::move(view));
  }
  // Unregistered photos are not in the model: they are what else lies in the image folder.
  input.images_total = static_cast<int>(files.size());
  if (input.image_folder != root) {
    for (const std::string& name : list_images(input.image_folder)) {
      input.images_total += registered.count(name) == 0;
    }
  }
  const std::string folder_name = input.image_folder.filename().string();
  const std::string suffix = folder_name.starts_with("images") ? folder_name.substr(6) : "";  // _4
  for (const fs::path& base : {used.workspace, root}) {
    input.mask_folders.push_back(base / ("masks" + suffix));
    input.mask_folders.push_back(base / "masks");
  }
  input.point_files = {folder / "points3D.ply"};  // of 3D Gaussian splatting's converter
  if (!is_file(input.point_files.front())) input.point_files.clear();
  return input;
}

}  // namespace nerf::internal
