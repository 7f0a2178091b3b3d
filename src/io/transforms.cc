// transforms.json (nerfstudio, instant-ngp) and Blender's transforms_{train,val,test}.json.
//
// Camera axes in these files are OpenGL's (x right, y up, z backward), poses camera-to-world; here
// they become OpenCV's by turning y and z round. World coordinates stay the file's.
#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <optional>
#include <set>
#include <tuple>

#include "image_lookup.h"
#include "lenient_json.h"
#include "nerf/io/image.h"
#include "paths.h"
#include "phone_scans.h"
#include "scene_input.h"
#include "scene_limits.h"
#include "transforms_camera.h"
#include "transforms_fields.h"

namespace nerf::internal {

namespace fs = std::filesystem;
using nlohmann::json;

namespace {

Pose frame_pose(const FrameJson& frame) {
  const json* matrix = frame.find("transform_matrix");
  if (matrix == nullptr) matrix = frame.find("transform_matrix_start");  // a moving camera
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
      if (is_not_finite(cell) || cell.is_null())  // which is what some write for NaN
        throw NotFinite("\"transform_matrix\" holds what is not a number", frame.where);
      if (!cell.is_number()) frame.fail("\"transform_matrix\" holds what is not a number");
      const auto value = cell.get<double>();
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

  // `test`: all of the file's views are held out. `split`: the file may say which ones are.
  void read(const fs::path& file, bool test, bool split = false) {
    read(read_lenient_json(file), file, file.parent_path(), test, split);
  }

  // `root` as the file says it, whose images lie below `root_folder`.
  void read(const json& root, const fs::path& file, const fs::path& root_folder, bool test,
            bool split) {
    if (!root.is_object() || !root.contains("frames") || !root["frames"].is_array()) {
      throw Error("there is no list \"frames\"", file.string(),
                  "a transforms file has one entry per image in \"frames\"");
    }
    const json& frames = root["frames"];
    const auto frame_at = [&](size_t i) {
      return FrameJson{frames[i], root, fmt::format("{}, frames[{}]", file.string(), i)};
    };
    std::vector<std::string> names;
    for (size_t i = 0; i < frames.size(); ++i) {
      const FrameJson frame = frame_at(i);
      if (!frames[i].is_object()) frame.fail("the frame is not an object");
      // Only the frame's own: a file_path for the whole file makes no sense.
      names.push_back(FrameJson{frame.frame, frame.frame, frame.where}.text("file_path"));
      if (clean_image_name(names.back()).empty()) frame.fail("there is no \"file_path\"");
      collect_unread(frames[i], unread_);
    }
    const std::vector<FoundImage> images = find_images(root_folder, names, &input_.notes);
    for (size_t i = 0; i < frames.size(); ++i) {
      try {
        add(frame_at(i), images[i], root_folder, test);
      } catch (const NotFinite& problem) {
        if (!unusable_) unusable_ = problem;
        unusable_names_.push_back(images[i].name);
      }
    }
    listed_ += frames.size();
    collect_unread(root, unread_);
    if (!test) read_common_entries(root, file, input_);
    if (split) obey_split(root, file, input_);
    note_flavour(root);
  }

  // What is said once, of all files together.
  void finish(const std::string& file) {
    for (std::string& line : describe_unread(unread_, file))
      input_.ignored.push_back(std::move(line));
    if (with_time_ > 0) {
      input_.times = SceneInput::Times{"\"time\" of " + file};
      if (with_time_ < input_.views.size())
        input_.warnings.push_back(fmt::format("{} of {} frames have no \"time\" and get 0",
                                              input_.views.size() - with_time_,
                                              input_.views.size()));
    }
    if (unusable_names_.empty()) return;
    if (input_.views.empty()) throw *unusable_;
    input_.warnings.push_back(
        fmt::format("{} of {} photos are left out, their camera or pose is not finite: {}",
                    unusable_names_.size(), listed_, name_list(unusable_names_)));
  }

  bool nerfstudio() const { return nerfstudio_; }
  bool instant_ngp() const { return instant_ngp_; }

 private:
  void add(const FrameJson& frame, const FoundImage& image, const fs::path& root, bool test) {
    const FrameJson own{frame.frame, frame.frame, frame.where};
    View view;
    view.image_path = image.path;
    view.name = image.name;
    const std::string stored = view.image_path.filename().string();
    if (image.how != FoundImage::How::kByStem &&
        stored.size() > fs::path(view.name).filename().string().size()) {
      view.name += view.image_path.extension().string();
    }
    if (!names_.insert(view.name).second) {
      input_.warnings.push_back(fmt::format("{} is listed again by {}: the first one counts",
                                            printable(view.name), frame.where));
      return;
    }
    view.pose = frame_pose(own);
    view.time = time_of(own);
    const std::string mask = own.text("mask_path");
    if (!mask.empty()) {
      const FoundImage found = find_images(root, {mask}).front();
      view.mask_path = found.path.empty() ? root / mask : found.path;
    }
    read_depth_entries(frame, root, view);
    view.camera = camera(frame, view);
    input_.views.push_back(std::move(view));
    input_.is_test.push_back(test);
  }

  double time_of(const FrameJson& own) {
    const json* entry = own.find("time");
    if (entry != nullptr && is_not_finite(*entry)) own.fail("\"time\" is not finite");
    const auto time = own.number("time");
    with_time_ += time.has_value();
    // D-NeRF's files promise it (load_blender.py); elsewhere the unit is the file's.
    if (time && input_.blender && !(*time >= 0 && *time <= 1))
      own.fail(fmt::format("\"time\" is {:g}", *time),
               "times of transforms_train.json run from 0 to 1: divide by the last one");
    return time.value_or(0);
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
  }

  SceneInput& input_;
  std::set<std::string> names_, warnings_, unread_;
  std::vector<std::string> unusable_names_;
  std::optional<NotFinite> unusable_;  // the first
  size_t listed_ = 0, with_time_ = 0;
  bool nerfstudio_ = false, instant_ngp_ = false;
};

void finish(SceneInput& input, const fs::path& root) {
  // Masks lie beside the image folder that most names begin with.
  const fs::path first = fs::path(input.views.front().name);
  input.image_folder = first.has_parent_path() ? root / *first.begin() : root;
  input.mask_folders = {root / "masks"};
  input.images_total = static_cast<int>(input.views.size());
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
  reader.read(file, false, true);
  reader.finish(file.filename().string());
  require_frames(input, file);
  input.listing = file;
  input.format = fmt::format("{}{}", file.filename().string(),
                             reader.nerfstudio()    ? " (nerfstudio)"
                             : reader.instant_ngp() ? " (instant-ngp)"
                                                    : "");
  finish(input, file.parent_path());
  return input;
}

SceneInput read_phone_scene(const fs::path& root) {
  const PhoneScan scan = read_phone_scan(root);
  SceneInput input;
  TransformsReader reader(input);
  reader.read(scan.transforms, scan.where, root, false, false);
  reader.finish(scan.where.filename().string());
  require_frames(input, scan.where);
  input.ignored.insert(input.ignored.end(), scan.ignored.begin(), scan.ignored.end());
  input.is_test.clear();
  input.listing = scan.where;
  input.format = scan.format;
  finish(input, root);
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
  reader.finish("the transforms files");
  input.listing = train;
  input.format = "Blender transforms";
  finish(input, root);
  input.mask_folders.clear();  // transparency is in the images
  return input;
}

}  // namespace nerf::internal
