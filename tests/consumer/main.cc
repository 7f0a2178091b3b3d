// Uses the installed library through its public headers only. argv[1] is a capture (data/demo).
#include <cmath>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <vector>

#include "composed_method.h"
#include "nerf/base/cancel.h"
#include "nerf/base/error.h"
#include "nerf/base/threads.h"
#include "nerf/io/photos.h"
#include "nerf/io/scene.h"
#include "nerf/math/camera.h"
#include "nerf/model/radiance_field.h"
#include "nerf/model/renderer.h"
#include "nerf/train/trainer.h"

namespace {

using nerf::Real;

void expect(bool condition, const char* what) {
  if (!condition) throw nerf::Error(what, "consumer");
}

// A lens of the kind of the demo's: pixel -> direction -> pixel.
void use_cameras() {
  nerf::Camera camera;
  camera.model = nerf::CameraModel::kSimpleRadial;
  camera.width = 640;
  camera.height = 480;
  camera.params = {520, 320, 240, -0.12};
  for (const nerf::Vec2d pixel : {nerf::Vec2d{0.5, 0.5}, {320, 240}, {639.5, 100.25}}) {
    const auto direction = nerf::unproject(camera, pixel);
    expect(direction.has_value(), "unproject found no direction");
    const auto back = nerf::project(camera, *direction * 3.0);
    expect(back.has_value(), "project found no pixel");
    expect(std::hypot(back->x - pixel.x, back->y - pixel.y) < 1e-6, "project is not the inverse");
  }
}

// Objects made by the library and read here must have the same layout under any compiler flags.
void use_scene(const char* folder) {
  const nerf::Scene scene = nerf::load_scene(folder);
  expect(scene.views.size() >= 40, "the demo has at least 40 views");
  expect(scene.test.size() == (scene.views.size() + 7) / 8, "every 8th view is held out");
  expect(scene.train.size() + scene.test.size() == scene.views.size(), "a view is in no split");
  for (const nerf::View& view : scene.views) {
    const nerf::Camera& camera = scene.cameras.at(view.camera);
    expect(camera.width == 640 && camera.height == 480, "the demo's photos are 640x480");
    const nerf::Vec3d forward = view.pose.rotation.column(2);
    expect(std::abs(nerf::length(forward) - 1) < 1e-6, "a pose is not a rotation");
    const nerf::Pose engine = scene.to_engine.apply(view.pose);
    expect(std::isfinite(nerf::length(engine.translation)), "a pose is not finite");
  }
  std::printf("%zu views, %zu points\n", scene.views.size(), scene.points.size());
}

// Two trainers side by side, stopped by a callback and by a cancel; the field is asked, rendered,
// saved and loaded. A few steps: what was learnt is not looked at.
void use_training(const char* folder) {
  nerf::ThreadPool pool;
  nerf::SceneOptions load;
  load.downscale = 8;
  const nerf::Scene scene = nerf::load_scene(folder, load);
  const nerf::PhotoSet photos = nerf::load_photos(scene, pool);
  nerf::TrainOptions options;
  options.steps = 20;
  options.grid_recipe.batch_samples = 2400;
  options.grid.levels = 4;
  options.grid.log2_entries = 12;
  options.grid.hidden = 16;
  nerf::Trainer trainer(scene, photos, options, pool), other(scene, photos, options, pool);
  trainer.run([](const nerf::StepReport& report) { return report.step < 5; });
  expect(trainer.steps_done() == 5, "the callback stops a training");
  nerf::Cancel cancel;
  other.run(
      [&](const nerf::StepReport& report) {
        if (report.step == 3) cancel.request();
        return true;
      },
      &cancel);
  expect(other.steps_done() == 3, "a cancel stops a training");
  trainer.run({});
  expect(trainer.steps_done() == options.steps, "a training goes on where it was stopped");

  const nerf::RadianceField field = trainer.snapshot();
  const auto view = static_cast<std::size_t>(scene.test.front());
  const nerf::Pose& pose = scene.views[view].pose;
  const nerf::Camera& camera = photos.cameras[view];
  const nerf::Frame frame = nerf::render(field, camera, pose, {}, pool);
  const auto pixels = static_cast<std::size_t>(camera.width * camera.height);
  expect(frame.rgb.size() == 3 * pixels && frame.depth_z.size() == pixels, "a frame's size");
  for (const Real v : frame.rgb) expect(v >= 0 && v <= 1, "colours lie in [0, 1]");

  const std::vector<nerf::Vec3d> points(3, pose.translation + pose.rotation.column(2));
  const std::vector<nerf::Vec3d> directions(3, pose.rotation.column(2));
  std::vector<Real> density(3), rgb(9);
  field.query(points, directions, density, rgb, pool);
  expect(density[0] >= 0 && density[0] == density[2], "equal points have equal densities");

  const std::filesystem::path file = "consumer.nerf";  // where the test runs, a folder of its own
  field.save(file);
  const nerf::RadianceField loaded = nerf::RadianceField::load(file);
  std::filesystem::remove(file);
  expect(loaded.info().views.size() == scene.views.size(), "a model knows its views");
}

// Parts of the library make a method that it does not hold.
void use_parts(const char* folder) {
  nerf::ThreadPool pool;
  nerf::SceneOptions load;
  load.downscale = 8;
  const nerf::Scene scene = nerf::load_scene(folder, load);
  const nerf::PhotoSet photos = nerf::load_photos(scene, pool);
  const ComposedResult r = train_composed_method(scene, photos, 200, 1);
  std::printf("composed: squared error %.4f -> %.4f, loss %.4f -> %.4f\n", r.first.squared_error,
              r.last.squared_error, r.first.loss, r.last.loss);
  expect(r.last.squared_error < 0.5 * r.first.squared_error, "a composed method learns");
  expect(std::isfinite(r.last.loss) && r.last.loss < r.first.loss, "its loss falls");
}

// A loss that the library does not have: the mean absolute error of pixels drawn from the photos.
void use_own_loss(const char* folder) {
  nerf::ThreadPool pool;
  nerf::SceneOptions load;
  load.downscale = 8;
  const nerf::Scene scene = nerf::load_scene(folder, load);
  const nerf::PhotoSet photos = nerf::load_photos(scene, pool);
  nerf::TrainOptions options;
  options.steps = 250;
  options.grid_recipe.batch_samples = 9600;
  options.grid.levels = 4;
  options.grid.log2_entries = 12;
  nerf::Trainer trainer(scene, photos, options, pool);
  double first = 0, last = 0;
  for (int step = 0; step < options.steps; ++step) {
    const nerf::RayPixels& pixels = trainer.begin_step();
    std::vector<Real> gradient(pixels.rgba.size());
    const Real share = 1 / static_cast<Real>(3 * pixels.rays.size());
    double loss = 0;
    for (std::size_t r = 0; r < pixels.rays.size(); ++r)
      for (std::size_t k = 0; k < 3; ++k) {
        const Real e = pixels.rgba[4 * r + k] - pixels.target[3 * r + k];
        loss += std::fabs(e) * share;
        gradient[4 * r + k] = e > 0 ? share : -share;
      }
    trainer.finish_step(gradient, loss);
    if (step == 0) first = loss;
    last = loss;
  }
  std::printf("own loss: %.4f -> %.4f\n", first, last);
  expect(last < 0.6 * first, "a loss of the caller's is learnt");
}

// The library's exceptions cross its border.
void use_errors() {
  try {
    nerf::load_scene("/nonexistent/capture");
  } catch (const nerf::Error& e) {
    std::printf("as expected: %s\n", e.what());
    return;
  }
  expect(false, "a missing capture must be an error");
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: consumer CAPTURE\n");
    return 2;
  }
  try {
    use_cameras();
    use_scene(argv[1]);
    use_training(argv[1]);
    use_parts(argv[1]);
    use_own_loss(argv[1]);
    use_errors();
  } catch (const std::exception& e) {
    std::fprintf(stderr, "%s\n", e.what());
    return 1;
  }
  return 0;
}
