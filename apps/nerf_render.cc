// nerf_render: new views of a trained model as pictures and video.
#include <fmt/format.h>

#include <optional>

#include "app.h"
#include "appearance.h"
#include "layer_files.h"
#include "medium_option.h"
#include "nerf/base/file.h"
#include "nerf/base/memory.h"
#include "nerf/base/progress.h"
#include "nerf/base/threads.h"
#include "nerf/io/video.h"
#include "nerf/model/radiance_field.h"
#include "nerf/model/renderer.h"
#include "options_cli.h"
#include "render_frames.h"
#include "render_options.h"
#include "render_plan.h"
#include "target_file.h"

namespace nerf::apps {
namespace {

void make_video(const RenderCommand& command, const RenderedFiles& files, double fps,
                const Cancel& cancel) {
  Progress progress("encoding");
  VideoOptions video;
  video.frames_per_second = fps;
  video.cancel = &cancel;
  video.progress = [&](int done, int total) { progress.update(static_cast<double>(done) / total); };
  write_video(command.mp4, files.film.empty() ? files.color : files.film, video);
  progress.finish();
  log_info(fmt::format("video at {:g} frames per second: {}", fps, command.mp4.string()));
}

// A paper method's model asks its network at every sample of every ray unless it is known where
// there is nothing.
void bake(RadianceField& field, const RenderPlan& plan, ThreadPool& pool, const Cancel& cancel) {
  uint64_t pixels = 0;
  for (const auto& frame : plan.frames)
    pixels += static_cast<uint64_t>(frame.camera.width) *
              static_cast<uint64_t>(frame.camera.height) * (frame.right ? 2 : 1);
  Progress clock("baking");
  if (field.bake(pixels, pool, &cancel))
    log_info(fmt::format("empty space found in {:.1f} s", clock.elapsed_seconds()));
}

// Seen from above, since a direction must be given; densities depend on it next to nowhere.
PathOptions::Density density_of(const RadianceField& field, ThreadPool& pool) {
  return [&](std::span<const Vec3d> points) {
    const std::vector<Vec3d> directions(points.size(), Vec3d{0, 0, -1});
    std::vector<Real> density(points.size()), rgb(3 * points.size());
    field.query(points, directions, density, rgb, pool);
    return std::vector<double>(density.begin(), density.end());
  };
}

int render_main(int argc, char** argv) {
  RenderCommand command;
  if (parse_command_line(argc, argv, render_program_text(), command).exit) return kExitOk;
  const SignalCancel stop;
  ThreadPool pool(command.threads);
  log_machine("nerf_render", pool.size(), command.precision);

  const auto model = find_model_file(command.run);
  RadianceField field = RadianceField::load(model);
  RenderPlan plan =
      make_render_plan(command, field.info(), available_memory_bytes(),
                       {density_of(field, pool), field.shows_background(), field.moves()});
  for (const std::string& note : plan.notes) log_warning(note);
  give_appearance(command.appearance, field, plan);
  // What would make the video fail is found before the frames are rendered, not after.
  std::optional<TargetFile> film;
  if (!command.mp4.empty()) {
    check_video_tools();
    film.emplace(command.mp4);
  }
  const LayerFiles layers(command.layers, !command.object.insert.empty(), command.exposure,
                          field.info());

  RenderOptions options;
  options.background = command.background.value_or(field.info().background);
  options.bbox = command.bbox;
  options.sky = !command.background;
  options.precision = command.precision;
  options.supersample = command.supersample;
  if (!command.medium.empty()) options.medium = parse_medium(command.medium, field.info());
  if (command.medium.empty() && field.medium())
    log_info("shown through the medium that was learnt; --medium off leaves it out");
  if (layers.wanted()) options.layers = layers.layers();
  if (command.depth && command.look.depth_map == DepthLook::kNormal) {
    if (!options.layers) options.layers.emplace();
    options.layers->normal = true;
  }
  // Where it does not move its light is that of the first frame.
  RenderOptions first_frame = options;
  first_frame.time = static_cast<Real>(plan.frames.front().time);
  first_frame.appearance = plan.frames.front().appearance;
  InsertedObject object =
      insert_object(command.object, field, plan.frames.front().seconds, first_frame, pool);
  for (const std::string& note : object.notes) log_info(note);
  make_writable_folder(command.out);
  layers.begin(command.out);
  bake(field, plan, pool, stop.cancel());
  const RenderFunction render_one = [&](const Camera& camera, const Pose& camera_to_world,
                                        const PlannedFrame& frame, bool preview,
                                        const std::function<void(double)>& progress) {
    RenderOptions own = options;
    own.time = static_cast<Real>(frame.time);
    own.appearance = frame.appearance;
    if (preview) {
      own.supersample = 1;
      own.layers.reset();
    }
    object.show(frame.seconds, own, pool);
    Frame picture = render(field, camera, camera_to_world, own, pool, progress, &stop.cancel(),
                           object.insertion.get());
    change_exposure(command.exposure, picture.rgb);
    return picture;
  };
  const PlannedFrame& first = plan.frames.front();
  const int rays = rays_per_side(field, options, first.camera, first.camera_to_world);
  if (command.supersample == 0 && rays > 1)
    log_info(
        fmt::format("pixels are wider than those of the photos: each averages {} x {} rays "
                    "(--supersample 1 takes one, faster)",
                    rays, rays));
  Progress progress("rendering");
  FrameWriter write_layers;
  if (layers.wanted())
    write_layers = [&](const PlannedFrame& planned, const Frame& frame) {
      layers.write(command.out, plan, planned, frame);
    };
  const RenderedFiles files =
      render_frames(plan, command.out, render_one, progress, stop.cancel(), write_layers);
  progress.finish();

  const std::string folder = command.out.string();
  if (files.cancelled) {
    log_info(fmt::format("nerf_render: stopped by a signal; {} of {} frames are in {}",
                         files.color.size(), plan.frames.size(), folder));
    return stop.exit_code();
  }
  const double seconds = progress.elapsed_seconds();
  log_info(fmt::format("{} frames in {}, {:.2f} s each: {}", files.color.size(),
                       format_duration(seconds), seconds / static_cast<double>(files.color.size()),
                       folder));
  const auto ends = ends_of(command.look.depth_map);
  if (command.depth && !files.depth.empty())
    log_info(fmt::format("depth from {:.4g} ({}) to {:.4g} ({}), input unit: {}", files.depth.near,
                         ends[0], files.depth.far, ends[1], (command.out / "depth").string()));
  if (!command.mp4.empty()) make_video(command, files, plan.fps, stop.cancel());
  return kExitOk;
}

}  // namespace
}  // namespace nerf::apps

int main(int argc, char** argv) {
  return nerf::apps::run_main("nerf_render", [&] { return nerf::apps::render_main(argc, argv); });
}
