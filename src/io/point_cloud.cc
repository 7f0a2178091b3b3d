#include "point_cloud.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "paths.h"
#include "ply.h"

namespace nerf::internal {

namespace fs = std::filesystem;

namespace {

// PLY files in the folder: those that exporters call so first, then a single other one.
std::vector<fs::path> point_files_in(const fs::path& folder) {
  std::vector<fs::path> known, others;
  for (const char* name :
       {"sparse_pc.ply", "points3D.ply", "points3d.ply", "point_cloud.ply", "pointcloud.ply"})
    if (is_file(folder / name)) known.push_back(folder / name);
  std::error_code problem;
  for (fs::directory_iterator it(folder, problem), end; !problem && it != end;
       it.increment(problem)) {
    const fs::path& path = it->path();
    if (is_file(path) && lower_extension(path) == ".ply" &&
        std::find(known.begin(), known.end(), path) == known.end())
      others.push_back(path);
  }
  if (others.size() == 1) known.push_back(others.front());
  return known;
}

// Points of another coordinate system lie where no camera looks, or where nearly none does.
bool are_looked_at(const std::vector<ScenePoint>& points, const SceneInput& input) {
  size_t looking = 0;
  for (const View& view : input.views) {
    const Camera& camera = input.cameras[static_cast<size_t>(view.camera)];
    const size_t seen = points_in_picture(points, camera, view.pose).size();
    looking += seen > 0 && seen >= std::min<size_t>(points.size(), 20000) / 500;
  }
  return 2 * looking >= input.views.size();
}

std::vector<ScenePoint> read_points(const fs::path& file, bool named, std::string* problem) {
  std::vector<ScenePoint> points;
  try {
    const PlyPoints ply = read_ply_points(file);
    if (ply.splats && !named) *problem = "holds Gaussians, not measured points";
    if (ply.positions.empty()) *problem = "holds no point";
    for (const Vec3d& p : ply.positions) points.push_back({p, 0, 0});
  } catch (const Error& error) {
    *problem = error.what();
  }
  return points;
}

}  // namespace

std::vector<size_t> points_in_picture(const std::vector<ScenePoint>& points, const Camera& camera,
                                      const Pose& pose) {
  constexpr size_t kMost = 20000;
  const size_t stride = points.size() / kMost + 1;
  const Pose world_to_camera = pose.inverse();
  std::vector<size_t> seen;
  for (size_t i = 0; i < points.size(); i += stride) {
    const Vec3d p = world_to_camera * points[i].position;
    const auto pixel = project(camera, p);
    if (pixel && pixel->x >= 0 && pixel->y >= 0 && pixel->x <= camera.width &&
        pixel->y <= camera.height)
      seen.push_back(i);
  }
  return seen;
}

void add_points_from_files(SceneInput& input, const fs::path& root, SceneReport& report) {
  struct Candidate {
    fs::path path;
    bool named;
  };
  std::vector<Candidate> candidates;
  for (const fs::path& path : input.point_files) {
    if (is_file(path))
      candidates.push_back({path, true});
    else
      report.warnings.push_back(
          fmt::format("the points' file {} does not exist", printable(path.string())));
  }
  // Beside rendered pictures such files hold random points that splatting began with.
  for (const fs::path& path : input.blender ? std::vector<fs::path>() : point_files_in(root)) {
    const bool again = std::any_of(candidates.begin(), candidates.end(), [&](const Candidate& c) {
      return c.path.lexically_normal() == path;
    });
    if (!again) candidates.push_back({path, false});
  }
  for (const Candidate& candidate : candidates) {
    const std::string name = candidate.path.filename().string();
    if (!input.points.empty()) {
      report.ignored.push_back(name + " (there are points already)");
      continue;
    }
    std::string problem;
    std::vector<ScenePoint> points = read_points(candidate.path, candidate.named, &problem);
    if (problem.empty() && !candidate.named && !are_looked_at(points, input))
      problem = "its points are not where the cameras look";
    if (!problem.empty()) {
      report.warnings.push_back(fmt::format("{} is not used: {}", name, problem));
      continue;
    }
    input.points = std::move(points);
    report.notes.push_back(fmt::format("points of {}", name));
  }
}

}  // namespace nerf::internal
