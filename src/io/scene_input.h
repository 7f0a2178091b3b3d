// A capture as its files say it, before images are looked at and the engine's frame is chosen: what
// every format's reader fills in.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "colmap.h"
#include "nerf/io/scene.h"

namespace nerf::internal {

struct SceneInput {
  std::string format;
  std::vector<Camera> cameras;  // as the files say it; width 0 where they do not say
  std::vector<View> views;      // registered; image_path is where the image should be
  std::vector<char> is_test;    // parallel to views; empty where the files make no split
  std::vector<ScenePoint> points;
  std::vector<Observation> observations;  // indices into views and points
  struct Depths {
    double near, far;  // of what a view sees, input units
  };
  std::vector<Depths> depths;       // where the files say so, of all registered views
  std::optional<Depths> published;  // where the authors' code samples; Scene::published_near, _far
  // Of View::time, which readers leave in the files' unit. None: the files say no times.
  struct Times {
    std::string source = {};  // CaptureTimes::source
    bool seconds = false;
    bool on_request = false;  // used where something moves (moving_film.h) or SceneOptions asks
    double interval = 0;      // between the film's own frames, of which the views are some; 0: ?
  };
  std::optional<Times> times;
  std::filesystem::path image_folder;  // what View::name is relative to, for masks
  std::filesystem::path listing;       // the file that names the images, for errors; may be empty
  std::vector<std::filesystem::path> mask_folders;  // looked into in this order
  int images_total = 0;           // listed by the files or found beside the registered ones
  bool keypoints = false;         // the files say where photos saw points
  bool cameras_adjusted = false;  // they are not those of the files
  bool blender = false;           // rendered: +z is up, and alpha, where there is any, is real
  std::optional<Vec3d> up;        // where the files say it
  std::vector<std::filesystem::path> point_files;  // named as the points; read where there are none
  std::vector<std::string> notes, ignored, warnings;
};

// Leaves out the views whose entry is 0, with what runs parallel to them.
void keep_views(SceneInput& input, const std::vector<char>& keep);

// Models below root: sparse/N, sparse, colmap/sparse/N, dense/sparse, distorted/sparse/0, or root
// itself.
std::vector<std::filesystem::path> find_colmap_models(const std::filesystem::path& root);
// Throws Error, Cancelled.
SceneInput read_colmap_scene(const std::filesystem::path& root,
                             AdjustCameras adjust = AdjustCameras::kOff,
                             const std::function<void(const std::string&)>& progress = {},
                             const Cancel* cancel = nullptr);

// transforms.json of nerfstudio or instant-ngp.
SceneInput read_transforms_scene(const std::filesystem::path& file);
// Polycam's or Record3D's own folders (phone_scans.h).
SceneInput read_phone_scene(const std::filesystem::path& root);
// transforms_train.json with transforms_test.json or transforms_val.json beside it.
SceneInput read_blender_scene(const std::filesystem::path& root);

// poses_bounds.npy of LLFF with images/, images_2/, images_4/ or images_8/.
SceneInput read_llff_scene(const std::filesystem::path& root);

// precomputed.json of Non-Rigid NeRF with images/.
SceneInput read_nonrigid_scene(const std::filesystem::path& root);

// Whether the folder is in Nerfies' layout, whole or with one of its files missing.
bool is_nerfies_scene(const std::filesystem::path& root);
SceneInput read_nerfies_scene(const std::filesystem::path& root);

// Looks at every view's image (its header) and mask: leaves out views without a file, scales
// cameras to the size of the stored image, fills in the report's counts and the memory that photos
// take. Sets *alpha, and `downscale` where it is 0. Throws Error: unreadable, transposed or cropped
// images, over half missing.
void resolve_images(SceneInput& input, int& downscale, SceneReport& report, bool* alpha);

bool is_image_file(const std::filesystem::path& path);
// Image files below a folder, as clean names, sorted bytewise; empty where there is no such folder.
std::vector<std::string> list_images(const std::filesystem::path& folder);

}  // namespace nerf::internal
