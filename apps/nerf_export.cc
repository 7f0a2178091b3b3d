// nerf_export: a trained model's surface, points and cameras as files for other programs.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>
#include <string>

#include "app.h"
#include "appearance.h"
#include "export_options.h"
#include "nerf/base/error.h"
#include "nerf/base/memory.h"
#include "nerf/base/nearest_name.h"
#include "nerf/base/progress.h"
#include "nerf/geometry/point_cloud.h"
#include "nerf/io/camera_path.h"
#include "nerf/io/mesh_file.h"
#include "nerf/model/radiance_field.h"
#include "nerf/model/surface.h"
#include "render_plan.h"
#include "target_file.h"

namespace nerf::apps {
namespace {

constexpr const char* kHelp =
    "nerf_export COMMAND RUN -o FILE [OPTIONS]\n"
    "  mesh     the surface as triangles with colours: .glb (metres, +Y up) or .ply (input's "
    "coordinates)\n"
    "  points   points on the surface with normals and colours: .ply\n"
    "  cameras  the training cameras, and a path where one is named: .glb\n"
    "nerf_export COMMAND --help says more.\n"
    "Exit code 0: done, 2: something to correct, 128 + n: stopped by signal n.\n";

ProgramText text_of(const std::string& command, const std::string& description,
                    const std::string& examples) {
  return {"nerf_export " + command, description, "", examples};
}

std::string size_text(const RadianceField& field, const SurfaceRegion& region) {
  const Vec3d size = region.box.size() / field.info().to_engine.scale;
  return fmt::format("{:.4g} x {:.4g} x {:.4g}", size.x, size.y, size.z);
}

// A field that is being looked at: what all exports of its surface have in common.
class SurfaceExport {
 public:
  explicit SurfaceExport(const FieldCommand& command)
      : pool_(command.threads), field_(RadianceField::load(find_model_file(command.run))) {
    log_machine("nerf_export", pool_.size(), command.precision);
    target_.emplace(command.out);
    options_.render.precision = command.precision;
    options_.render.time = static_cast<Real>(command.time);
    RenderPlan plan;
    plan.frames.emplace_back();
    give_appearance(command.appearance, field_, plan);
    options_.render.appearance = plan.frames.front().appearance;
  }

  SurfaceOptions& options() { return options_; }
  const RadianceField& field() const { return field_; }
  const Similarity& to_engine() const { return field_.info().to_engine; }
  const Cancel& cancel() const { return stop_.cancel(); }

  template <class Body>
  auto stage(const std::string& title, const Body& body) {
    Progress progress(title);
    SurfaceWork work{pool_, available_memory_bytes(),
                     [&](double fraction) { progress.update(fraction); }, &stop_.cancel()};
    auto result = body(work);
    progress.finish();
    log_info(fmt::format("{}: {:.1f} s", title, progress.elapsed_seconds()));
    return result;
  }

  SurfaceRegion region(const std::optional<Box3>& bbox) {
    if (bbox) return region_of(field_, *bbox);
    const SurfaceRegion found = stage("looking for the scene", [&](const SurfaceWork& work) {
      return find_region(field_, options_, work);
    });
    log_info(
        fmt::format("box of {} input units (--bbox chooses another)", size_text(field_, found)));
    return found;
  }

  // From the region's coordinates to the input's.
  Similarity to_input(const SurfaceRegion& region) const {
    return to_engine().inverse() * Similarity{1, region.from_engine.transposed(), {}};
  }

 private:
  SignalCancel stop_;
  ThreadPool pool_;
  RadianceField field_;
  std::optional<TargetFile> target_;
  SurfaceOptions options_;
};

int export_mesh(int argc, char** argv) {
  MeshCommand command;
  const auto text = text_of("mesh", "Writes a trained model's surface as triangles.",
                            "  nerf_export mesh run -o scene.glb\n"
                            "  nerf_export mesh run -o scene.ply --resolution 1024 --triangles 0");
  if (parse_command_line(argc, argv, text, command).exit) return kExitOk;
  SurfaceExport job(command);
  job.options().resolution = command.resolution;
  job.options().density = command.density / job.to_engine().scale;
  const SurfaceRegion region = job.region(command.bbox);
  const auto views = job.stage("depth", [&](const SurfaceWork& work) {
    return depth_views(job.field(), region, job.options(), work);
  });
  TriangleMesh mesh = job.stage("surface", [&](const SurfaceWork& work) {
    return command.from == SurfaceSource::kDepth
               ? mesh_from_depth(region, views, job.options(), work)
               : mesh_from_density(job.field(), region, views, job.options(), work);
  });
  const Vec3d size = region.box.size();
  const double voxel = std::max({size.x, size.y, size.z}) / command.resolution;
  const int64_t dropped = drop_small_components(mesh, 4 * voxel, command.least_part);
  if (mesh.triangles.empty())
    throw Error("there is no surface in this box", "--bbox", "give another box");
  log_info(fmt::format("{} triangles, {} small parts dropped", mesh.triangles.size(), dropped));
  if (command.triangles > 0)
    job.stage("fewer triangles", [&](const SurfaceWork&) {
      decimate(mesh, static_cast<size_t>(command.triangles));
      return 0;
    });
  if (command.colours)
    mesh.colours = job.stage("colours", [&](const SurfaceWork& work) {
      return surface_colours(job.field(), region, views, mesh.positions, mesh.normals, 2 * voxel,
                             job.options(), work);
    });
  const Similarity to_input = job.to_input(region);
  if (command.out.extension() == ".ply") {
    write_ply(command.out, mesh, to_input);
  } else {
    const Similarity to_gltf = input_to_gltf(job.field().info(), command.metres);
    write_glb(command.out, mesh, to_gltf * to_input, to_gltf);
  }
  log_info(fmt::format("{} triangles, {} vertices: {}", mesh.triangles.size(),
                       mesh.positions.size(), command.out.string()));
  return kExitOk;
}

int export_points(int argc, char** argv) {
  PointsCommand command;
  const auto text = text_of("points", "Writes points on a trained model's surface.",
                            "  nerf_export points run -o scene.ply --points 200000");
  if (parse_command_line(argc, argv, text, command).exit) return kExitOk;
  SurfaceExport job(command);
  const SurfaceRegion region = job.region(command.bbox);
  // So many points have so many cubes along a side, about.
  job.options().resolution =
      std::clamp(static_cast<int>(std::sqrt(static_cast<double>(command.points) / 2)), 64, 2048);
  const auto views = job.stage("depth", [&](const SurfaceWork& work) {
    return depth_views(job.field(), region, job.options(), work);
  });
  PointOptions options;
  options.points = command.points;
  options.box = region.box;
  TriangleMesh cloud = job.stage("points", [&](const SurfaceWork& work) {
    return points_from_depths(views, options, work.pool);
  });
  if (cloud.positions.empty())
    throw Error("there is no surface in this box", "--bbox", "give another box");
  const Vec3d size = region.box.size();
  const double width = 2 * std::max({size.x, size.y, size.z}) / job.options().resolution;
  cloud.colours = job.stage("colours", [&](const SurfaceWork& work) {
    return surface_colours(job.field(), region, views, cloud.positions, cloud.normals, width,
                           job.options(), work);
  });
  write_ply(command.out, cloud, job.to_input(region));
  log_info(fmt::format("{} points: {}", cloud.positions.size(), command.out.string()));
  return kExitOk;
}

int export_cameras(int argc, char** argv) {
  CamerasCommand command;
  const auto text = text_of("cameras", "Writes a trained model's cameras for Blender and others.",
                            "  nerf_export cameras run -o cameras.glb --path orbit");
  if (parse_command_line(argc, argv, text, command).exit) return kExitOk;
  const TargetFile target(command.out);
  const ModelInfo info = RadianceField::load(find_model_file(command.run)).info();
  CameraPath path;
  if (!command.path.empty()) {
    const auto kinds = option_names(PathKind{});
    const auto kind = std::find_if(kinds.begin(), kinds.end(),
                                   [&](const auto& entry) { return command.path == entry.name; });
    path = kind == kinds.end() ? read_camera_path(command.path, info)
                               : make_camera_path(info, kind->value, {.frames = command.frames});
  }
  const auto notes =
      write_glb_cameras(command.out, info, path, input_to_gltf(info, command.metres));
  for (const std::string& note : path.notes) log_warning(note);
  for (const std::string& note : notes) log_info(note);
  log_info(fmt::format("{} cameras{}: {}",
                       std::count_if(info.views.begin(), info.views.end(),
                                     [](const ModelView& v) { return !v.held_out; }),
                       path.frames.empty() ? "" : " and a path", command.out.string()));
  return kExitOk;
}

int export_main(int argc, char** argv) {
  const std::string command = argc > 1 ? argv[1] : "--help";
  if (command == "--help" || command == "-h") {
    std::fputs(kHelp, stdout);
    return kExitOk;
  }
  if (command == "--version") {
    std::printf("%s\n", version_text("nerf_export").c_str());
    return kExitOk;
  }
  if (command == "mesh") return export_mesh(argc - 1, argv + 1);
  if (command == "points") return export_points(argc - 1, argv + 1);
  if (command == "cameras") return export_cameras(argc - 1, argv + 1);
  const std::vector<std::string> known = {"mesh", "points", "cameras"};
  throw Error("unknown command '" + command + "'", "", nearest_name_hint(command, known));
}

}  // namespace
}  // namespace nerf::apps

int main(int argc, char** argv) {
  return nerf::apps::run_main("nerf_export", [&] { return nerf::apps::export_main(argc, argv); });
}
