// A folder of cameras in Nerfies' layout (camera-paths/NAME/*.json) as a path.
#include <fmt/format.h>

#include "camera_path_formats.h"
#include "nerf/base/error.h"
#include "nerfies_camera.h"

namespace nerf::internal {

CameraPath read_nerfies_path(const std::filesystem::path& folder, const ModelInfo& info) {
  const std::vector<std::filesystem::path> files = nerfies_path_files(folder);
  if (files.empty())
    throw Error("there are no cameras (*.json) in this folder", folder.string(),
                "give a folder of Nerfies' camera-paths/, or a camera path file");
  const std::filesystem::path clean = (folder / "").lexically_normal().parent_path();
  CameraPath path;
  path.own_lenses = true;
  const bool timed = has_times(info);
  for (size_t i = 0; i < files.size(); ++i) {
    const NerfiesCamera own = read_nerfies_camera(files[i]);
    PathFrame frame{fmt::format("{}_{:04}", clean.filename().string(), i), own.camera, own.pose, 0};
    // The files say no times: what moves does so once along the path.
    if (timed && files.size() > 1)
      frame.time = static_cast<double>(i) / static_cast<double>(files.size() - 1);
    path.frames.push_back(std::move(frame));
  }
  return path;
}

}  // namespace nerf::internal
