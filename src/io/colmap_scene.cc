// A COLMAP capture: which model, and where its images are.
#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <map>
#include <set>

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

// Where an image of the model is below `folder`, or an empty path.
fs::path find_image(const fs::path& folder, const std::string& name) {
  if (is_file(folder / name)) return folder / name;
  std::string forward = name;  // written on Windows
  std::replace(forward.begin(), forward.end(), '\\', '/');
  if (forward != name && is_file(folder / forward)) return folder / forward;
  return {};
}

// The folder that image names are relative to: the one that holds most of the model's images; of
// equals `images`, then the smallest divisor, then the scene's folder itself (names such as
// "images/a.jpg").
fs::path choose_image_folder(const fs::path& root, const ColmapModel& model, SceneInput& input) {
  const std::array<fs::path, 5> candidates{root / "images", root / "images_2", root / "images_4",
                                           root / "images_8", root};
  fs::path chosen;
  std::ptrdiff_t most = 0;
  for (const fs::path& folder : candidates) {
    if (!is_folder(folder)) continue;
    const auto found = std::count_if(
        model.images.begin(), model.images.end(),
        [&](const ColmapImage& image) { return !find_image(folder, image.name).empty(); });
    if (found > most) {
      chosen = folder;
      most = found;
    }
  }
  for (const fs::path& folder : candidates)
    if (folder != root && folder != chosen && is_folder(folder))
      input.ignored.push_back(folder.filename().string() + "/");
  if (!chosen.empty()) return chosen;
  throw Error(
      fmt::format("none of the model's {} images was found", model.images.size()), root.string(),
      fmt::format("images/ (or images_2, images_4, images_8) must hold the files by the names "
                  "that the model has, such as {}",
                  printable(model.images.front().name)));
}

}  // namespace

std::vector<fs::path> find_colmap_models(const fs::path& root) {
  std::vector<fs::path> found;
  for (const fs::path& base : {root / "sparse", root / "colmap" / "sparse"}) {
    for (fs::path& folder : numbered_folders(base)) {
      if (is_colmap_model(folder)) found.push_back(std::move(folder));
    }
    if (is_colmap_model(base)) found.push_back(base);
  }
  if (found.empty() && is_colmap_model(root)) found.push_back(root);
  return found;
}

SceneInput read_colmap_scene(const fs::path& root) {
  const std::vector<fs::path> models = find_colmap_models(root);
  if (models.empty()) {
    throw Error("no COLMAP model was found", root.string(),
                "looked for cameras.bin or cameras.txt in sparse/0, sparse and colmap/sparse/0");
  }
  std::vector<uint64_t> counts;
  for (const fs::path& model : models) counts.push_back(colmap_image_count(model));
  const auto largest = static_cast<size_t>(std::max_element(counts.begin(), counts.end()) -
                                           counts.begin());  // the first of equals
  const fs::path& folder = models[largest];

  SceneInput input;
  for (size_t i = 0; i < models.size(); ++i) {
    if (i == largest) continue;
    input.ignored.push_back(fmt::format("{} ({} images; {} is the largest model with {})",
                                        relative_name(models[i], root), counts[i],
                                        relative_name(folder, root), counts[largest]));
  }
  ColmapModel model = read_colmap_model(folder);
  if (model.images.empty()) {
    throw Error("the COLMAP model has no registered image", folder.string(),
                "run COLMAP again with more overlap between the photos");
  }
  if (model.format.find("binary") != std::string::npos && path_exists(folder / "images.txt")) {
    input.ignored.push_back(relative_name(folder, root) + "/*.txt (the .bin files are read)");
  }

  input.image_folder = choose_image_folder(root, model, input);
  input.format = model.format + ", " + relative_name(folder, root);
  input.cameras = std::move(model.cameras);
  input.points = std::move(model.points);
  input.observations = std::move(model.observations);
  input.warnings = std::move(model.warnings);
  std::set<std::string> registered;
  for (ColmapImage& image : model.images) {
    View view;
    view.name = clean_image_name(image.name);
    view.image_path = find_image(input.image_folder, image.name);
    view.camera = image.camera;
    view.pose = image.pose;
    registered.insert(view.name);
    input.views.push_back(std::move(view));
  }
  // Unregistered photos are not in the model: they are what else lies in the image folder.
  input.images_total = static_cast<int>(registered.size());
  if (input.image_folder != root) {
    for (const std::string& name : list_images(input.image_folder)) {
      input.images_total += registered.count(name) == 0;
    }
  }
  const std::string suffix = input.image_folder == root
                                 ? ""
                                 : input.image_folder.filename().string().substr(6);  // images_4
  input.mask_folders = {root / ("masks" + suffix), root / "masks"};
  return input;
}

}  // namespace nerf::internal
