// transforms.json (nerfstudio, instant-ngp) and Blender's transforms_{train,val,test}.json.
//
// Camera axes in these files are OpenGL's (x right, y up, z backward), poses camera-to-world; here
// they become OpenCV's by turning y and z round. World coordinates stay the file's.
#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <set>
#include <tuple>

#include "nerf/base/file.h"
#include "nerf/io/image.h"
#include "paths.h"
#include "scene_input.h"
#include "scene_limits.h"
#include "transforms_camera.h"

namespace nerf::internal {

namespace fs = std::filesystem;
using nlohmann::json;

namespace {

json read_json(const fs::path& file) {
  const std::string text = read_text_file(file, uint64_t{256} << 20);
  try {
    return json::parse(text);
  } catch (const json::exception& e) {
    // "[json.exception.parse_error.101] parse error at line 3, column 5: ..."
    std::string what = e.what();
    if (const size_t end = what.find("] "); end != what.npos) what = what.substr(end + 2);
    throw Error(printable(what), file.string(), "not a JSON file, or cut off");
  }
}

// The file that a frame names, which may lack an extension; where there is none, what it would be.
fs::path frame_image(const fs::path& root, const std::string& file_path) {
  std::string forward = file_path;
  std::replace(forward.begin(), forward.end(), '\\', '/');
  for (const std::string& name : {file_path, forward}) {
    for (const char* extension :
         {"", ".png", ".jpg", ".jpeg", ".PNG", ".JPG", ".JPEG", ".webp", ".exr", ".tif"}) {
      const fs::path path = root / (name + extension);
      if (is_file(path)) return path.lexically_normal();
    }
  }
  return (root / forward).lexically_normal();
}

Pose frame_pose(const FrameJson& frame) {
  const json* matrix = frame.find("transform_matrix");
  if (matrix == nullptr || !matrix->is_array() || matrix->size() < 3 || matrix->size() > 4) {
    frame.fail("\"transform_matrix\" is not 4 rows of 4 numbers");
  }
  Eigen::Matrix3d rotation;
  Vec3d center;
  for (int r = 0; r < 3; ++r) {
    const json& row = (*matrix)[static_cast<size_t>(r)];
    if (!row.is_array() || row.size() != 4) {
      frame.fail("\"transform_matrix\" is not 4 rows of 4 numbers");
    }
    for (int c = 0; c < 4; ++c) {
      const json& cell = row[static_cast<size_t>(c)];
      const double value = cell.is_number() ? cell.get<double>() : std::nan("");
      if (!std::isfinite(value)) frame.fail("\"transform_matrix\" holds what is not a number");
      (c < 3 ? rotation(r, c) : center[r]) = value;
    }
  }
  if (!coordinate_ok(center)) frame.fail("\"transform_matrix\" has an absurd position");
  // A camera object scaled in its program scales all three axes; anything else is no camera.
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> squared(rotation.transpose() * rotation);
  const Eigen::Vector3d& s2 = squared.eigenvalues();
  if (!(s2(0) > 1e-18 && s2(2) < 1.1 * s2(0)) || rotation.determinant() <= 0) {
    frame.fail("\"transform_matrix\" does not begin with a rotation",
               "its first three columns are the camera's x, y, z axes: orthogonal, of one length, "
               "right-handed");
  }
  const Eigen::Matrix3d orthonormal = rotation * squared.operatorInverseSqrt();
  Pose pose;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) {
      pose.rotation.m[static_cast<size_t>(r)][static_cast<size_t>(c)] =
          c == 0 ? orthonormal(r, c) : -orthonormal(r, c);
    }
  }
  pose.translation = center;
  return pose;
}

class TransformsReader {
 public:
  explicit TransformsReader(SceneInput& input) : input_(input) {}

  void read(const fs::path& file, bool test) {
    const json root = read_json(file);
    if (!root.is_object() || !root.contains("frames") || !root["frames"].is_array()) {
      throw Error("there is no list \"frames\"", file.string(),
                  "a transforms file has one entry per image in \"frames\"");
    }
    const json& frames = root["frames"];
    for (size_t i = 0; i < frames.size(); ++i) {
      FrameJson frame{frames[i], root, fmt::format("{}, frames[{}]", file.string(), i)};
      if (!frames[i].is_object()) frame.fail("the frame is not an object");
      add(frame, file.parent_path(), test);
    }
    note_flavour(root);
  }

  bool nerfstudio() const { return nerfstudio_; }
  bool instant_ngp() const { return instant_ngp_; }

 private:
  void add(const FrameJson& frame, const fs::path& root, bool test) {
    // Only the frame's own: a file_path for the whole file makes no sense.
    const FrameJson own{frame.frame, frame.frame, frame.where};
    const std::string file_path = own.text("file_path");
    if (clean_image_name(file_path).empty()) frame.fail("there is no \"file_path\"");

    View view;
    view.image_path = frame_image(root, file_path);
    view.name = clean_image_name(file_path);
    const std::string stored = view.image_path.filename().string();
    if (stored.size() > fs::path(view.name).filename().string().size()) {
      view.name += view.image_path.extension().string();
    }
    if (!names_.insert(view.name).second) {
      input_.warnings.push_back(fmt::format("{} is listed again by {}: the first one counts",
                                            printable(view.name), frame.where));
      return;
    }
    view.pose = frame_pose(own);
    view.time = own.number("time").value_or(0);
    const std::string mask = own.text("mask_path");
    if (!mask.empty()) view.mask_path = root / mask;
    view.camera = camera(frame, view);
    input_.views.push_back(std::move(view));
    input_.is_test.push_back(test);
  }

  int camera(const FrameJson& frame, const View& view) {
    FrameSize size = frame_size(frame);
    if (size.width == 0 && is_file(view.image_path)) {
      const ImageInfo info = read_image_info(view.image_path);
      size = {info.width, info.height};
    }
    Camera camera;
    if (size.width > 0) {
      std::string warning;
      camera = frame_camera(frame, size, &warning);
      if (!warning.empty() && warnings_.insert(warning).second) input_.warnings.push_back(warning);
    }  // else the image is missing and the view will be left out
    const auto key = std::tuple{camera.model, camera.width, camera.height, camera.params};
    const auto it = std::find_if(
        input_.cameras.begin(), input_.cameras.end(),
        [&](const Camera& c) { return std::tuple{c.model, c.width, c.height, c.params} == key; });
    if (it != input_.cameras.end()) return static_cast<int>(it - input_.cameras.begin());
    input_.cameras.push_back(camera);
    return static_cast<int>(input_.cameras.size()) - 1;
  }

  void note_flavour(const json& root) {
    for (const char* key :
         {"camera_model", "applied_transform", "ply_file_path", "orientation_override"})
      nerfstudio_ = nerfstudio_ || root.contains(key);
    instant_ngp_ = instant_ngp_ || root.contains("aabb_scale");
    for (const char* key :
         {"train_filenames", "val_filenames", "test_filenames", "ply_file_path"}) {
      if (root.contains(key)) input_.ignored.push_back(fmt::format("\"{}\" of the file", key));
    }
  }

  SceneInput& input_;
  std::set<std::string> names_, warnings_;
  bool nerfstudio_ = false, instant_ngp_ = false;
};

void finish(SceneInput& input, const fs::path& root) {
  // Masks lie beside the image folder that most names begin with.
  const fs::path first = fs::path(input.views.front().name);
  input.image_folder = first.has_parent_path() ? root / *first.begin() : root;
  input.mask_folders = {root / "masks"};
  input.images_total = static_cast<int>(input.views.size());

  const auto [lo, hi] =
      std::minmax_element(input.views.begin(), input.views.end(),
                          [](const View& a, const View& b) { return a.time < b.time; });
  const double start = lo->time, end = hi->time;
  if (start >= 0 && end <= 1) return;
  for (View& view : input.views) view.time = end > start ? (view.time - start) / (end - start) : 0;
  input.warnings.push_back(
      fmt::format("times from {:g} to {:g} were brought to the range 0 to 1", start, end));
}

void require_frames(const SceneInput& input, const fs::path& file) {
  if (input.views.empty()) {
    throw Error("\"frames\" is empty: there is no image with a pose", file.string(),
                "a transforms file has one entry per image in \"frames\"");
  }
}

}  // namespace

SceneInput read_transforms_scene(const fs::path& file) {
  SceneInput input;
  TransformsReader reader(input);
  reader.read(file, false);
  require_frames(input, file);
  input.is_test.clear();
  input.format = fmt::format("{}{}", file.filename().string(),
                             reader.nerfstudio()    ? " (nerfstudio)"
                             : reader.instant_ngp() ? " (instant-ngp)"
                                                    : "");
  finish(input, file.parent_path());
  return input;
}

SceneInput read_blender_scene(const fs::path& root) {
  const fs::path train = root / "transforms_train.json", test = root / "transforms_test.json",
                 val = root / "transforms_val.json";
  if (!path_exists(train)) {
    throw Error("there is no transforms_train.json", root.string(),
                "a Blender scene has transforms_train.json and transforms_test.json");
  }
  SceneInput input;
  input.blender = true;
  TransformsReader reader(input);
  reader.read(train, false);
  require_frames(input, train);
  const size_t trained = input.views.size();
  if (path_exists(test)) {
    reader.read(test, true);
    if (path_exists(val)) input.ignored.push_back("transforms_val.json");
  } else if (path_exists(val)) {
    reader.read(val, true);
    input.warnings.push_back("there is no transforms_test.json: transforms_val.json is held out");
  }
  if (input.views.size() == trained) {
    input.is_test.clear();
    input.warnings.push_back("there is no transforms_test.json: every 8th view is held out");
  }
  input.format = "Blender transforms";
  finish(input, root);
  input.mask_folders.clear();  // transparency is in the images
  return input;
}

}  // namespace nerf::internal
