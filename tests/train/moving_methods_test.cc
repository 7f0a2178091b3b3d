// The papers' methods of scenes that move: what they learn of motion, what they keep of moments,
// and what they cannot be asked for.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <string>
#include <vector>

#include "nerf/model/field.h"
#include "nerf/model/renderer.h"
#include "nerf/train/evaluation.h"
#include "support/synthetic_scene.h"
#include "support/temp_folder.h"
#include "support/tiny_options.h"
#include "train/capture_moments.h"
#include "train/network_trainer.h"
#include "train/still_points.h"

namespace nerf {
namespace {

using test::capture_of;
using test::contains;
using test::error_of;
using test::sphere_capture;
using test::tiny_method_options;

constexpr double kWay = 0.5;  // of the sphere, along z, from the first moment to the last

// The sphere travels up: photo i is of the moment i / (views - 1), so that the held-out ones are of
// moments between the others'.
test::SyntheticCapture travelling_sphere(int views, int size) {
  test::SyntheticCapture c = sphere_capture(views, size);
  for (int i = 0; i < views; ++i) {
    View& view = c.scene.views[static_cast<size_t>(i)];
    view.time = static_cast<double>(i) / (views - 1);
    Pose beside = view.pose;
    beside.translation.z -= kWay * (view.time - 0.5);
    c.photos.photos[static_cast<size_t>(i)] = test::sphere_photo(c.scene.cameras[0], beside);
  }
  return c;
}

TrainOptions options_of(const std::string& method, int64_t steps) {
  TrainOptions o = tiny_method_options(method, steps);
  o.network.deform.width = 32;
  o.network.image_code = o.network.camera_code = 0;
  return o;
}

class MovingMethods : public ::testing::TestWithParam<std::string> {};

TEST_P(MovingMethods, LearnWhatMoves) {
  const auto c = travelling_sphere(32, 24);
  ThreadPool pool(2);
  const auto psnr_of = [&](const std::string& method) {
    Trainer trainer(c.scene, c.photos, options_of(method, 1000), pool);
    trainer.run({});
    return evaluate(trainer.snapshot(), c.scene, c.photos, {}, pool).psnr;
  };
  const double still = psnr_of("nerf"), moving = psnr_of(GetParam());
  RecordProperty("nerf", std::to_string(still));
  RecordProperty(GetParam(), std::to_string(moving));
  EXPECT_GT(moving, still + 3);
}

// A file holds codes of moments and how far windows are open; pictures and points at any time are
// those of the model that was saved, between moments too.
TEST_P(MovingMethods, AreReadFromTheirFiles) {
  const auto c = capture_of(GetParam(), 8, 24);
  ThreadPool pool(1);
  Trainer trainer(c.scene, c.photos, tiny_method_options(GetParam(), 20), pool);
  for (int i = 0; i < 12; ++i) trainer.step();
  const test::TempFolder folder;
  const RadianceField field = trainer.snapshot();
  field.save(folder / "m");
  const RadianceField again = RadianceField::load(folder / "m");
  const double tolerance = std::is_same_v<Real, float> ? 0 : 1e-4;
  EXPECT_EQ(again.network().windows.warp, field.network().windows.warp);
  EXPECT_EQ(again.field().codes().moments, field.field().codes().moments);
  std::vector<Real> at_first;
  for (const Real time : {0.0_r, 0.3_r, 1.0_r}) {
    RenderOptions options;
    options.time = time;
    const Pose& pose = c.scene.views[0].pose;
    const auto a = render(field, test::sphere_camera(8), pose, options, pool).rgb;
    const auto b = render(again, test::sphere_camera(8), pose, options, pool).rgb;
    for (size_t i = 0; i < a.size(); ++i) ASSERT_NEAR(a[i], b[i], tolerance) << time;
    if (at_first.empty()) at_first = a;
    if (time > 0) {
      EXPECT_NE(a, at_first) << "something moves";
    }
  }
}

// Points asked for by themselves are those of pictures: their density and its gradient at a time.
TEST_P(MovingMethods, AnswerAtPointsOfATime) {
  const auto c = capture_of(GetParam(), 8, 24);
  ThreadPool pool(1);
  TrainOptions o = tiny_method_options(GetParam(), 40);
  o.network.density = DensityActivation::kSoftplus;
  Trainer trainer(c.scene, c.photos, o, pool);
  trainer.run({});
  NetworkField field = trainer.snapshot().network();
  // What a few steps leave nearly standing: motions and codes that count, a window that is half
  // open.
  field.windows.warp = 1.5;
  Random random(11, 0, 0);
  const DeformNetworks& deform = field.networks.back().deform;
  for (const LinearWeights* w : std::initializer_list<const LinearWeights*>{
           &deform.warp.last, &deform.sheet.last, &field.books.deformation})
    for (int j = 0; j < w->out; ++j)
      for (int k = 0; k < w->in; ++k)
        field.weights[w->offset + static_cast<size_t>(j * weight_stride(w->in) + k)] =
            (w == &field.books.deformation ? 1 : 0.1_r) * (2 * random.uniform() - 1);
  const auto query = field.query(nullptr);
  const auto density = [&](const Vec3d& p, Real time) {
    Real out = 0;
    query->ask({std::span(&p, 1), {}, time}, {std::span(&out, 1), {}, {}});
    return static_cast<double>(out);
  };
  const Vec3d p{0.2, -0.1, 0.3};
  EXPECT_NE(density(p, 0.25_r), density(p, 0.75_r));
  EXPECT_EQ(density(p, 0.25_r), density(p, 0.25_r));
  // Along a way the gradients sum up to what density changes by. A difference at one point would be
  // of another slope where a ReLU of the warp or of the field bends beside it.
  constexpr int kSteps = 1600;
  constexpr double kLength = 0.8;
  for (const Real time : {0.0_r, 0.4_r})
    for (int k = 0; k < 3; ++k) {
      std::vector<Vec3d> points(kSteps, p);
      for (int i = 0; i < kSteps; ++i) points[i][k] += kLength * ((i + 0.5) / kSteps - 0.5);
      std::vector<Real> gradients(3 * kSteps);
      query->ask({points, {}, time}, {{}, {}, gradients});
      double sum = 0, ways = 0;
      for (int i = 0; i < kSteps; ++i) {
        const double change =
            static_cast<double>(gradients[static_cast<size_t>(3 * i + k)]) * kLength / kSteps;
        sum += change;
        ways += std::fabs(change);
      }
      Vec3d up = p, down = p;
      up[k] += kLength / 2;
      down[k] -= kLength / 2;
      const double change = density(up, time) - density(down, time);
      EXPECT_NEAR(sum, change, 0.01 * ways) << time << " axis " << k;
    }
}

TEST_P(MovingMethods, NeedPhotosOfSeveralMoments) {
  const auto c = sphere_capture(6, 24);
  ThreadPool pool(1);
  const std::string error = error_of(
      [&] { Trainer trainer(c.scene, c.photos, tiny_method_options(GetParam(), 4), pool); });
  EXPECT_TRUE(contains(error, "--times frame")) << error;
  EXPECT_TRUE(contains(error, GetParam())) << error;
}

TEST_P(MovingMethods, RefuseTimesThatAreNone) {
  const auto c = capture_of(GetParam(), 6, 24);
  ThreadPool pool(1);
  Trainer trainer(c.scene, c.photos, tiny_method_options(GetParam(), 4), pool);
  const RadianceField field = trainer.snapshot();
  for (const Real time : {-0.1_r, 1.5_r, Real{NAN}}) {
    RenderOptions options;
    options.time = time;
    const auto picture = [&] {
      render(field, test::sphere_camera(4), c.scene.views[0].pose, options, pool);
    };
    EXPECT_TRUE(contains(error_of(picture), "not from 0 to 1")) << time;
  }
}

INSTANTIATE_TEST_SUITE_P(Methods, MovingMethods, ::testing::Values("dnerf", "nerfies", "hypernerf"),
                         [](const auto& info) { return info.param; });

// At time 0 nothing moves, whatever is learnt: density is that of the canonical scene, which a warp
// without weights has at any time.
TEST(Dnerf, StandsStillAtTimeZero) {
  const auto c = capture_of("dnerf", 8, 24);
  ThreadPool pool(1);
  TrainOptions o = tiny_method_options("dnerf", 30);
  o.network.density = DensityActivation::kSoftplus;
  Trainer trainer(c.scene, c.photos, o, pool);
  trainer.run({});
  NetworkField field = trainer.snapshot().network();
  const auto densities = [&](Real time) {
    std::vector<Vec3d> points;
    for (uint64_t i = 0; i < 50; ++i) {
      Random random(3, 0, i);
      Vec3d p;
      for (int k = 0; k < 3; ++k) p[k] = 2 * static_cast<double>(random.uniform()) - 1;
      points.push_back(p);
    }
    std::vector<Real> out(points.size());
    field.query(nullptr)->ask({points, {}, time}, {out, {}, {}});
    return out;
  };
  const auto start = densities(0), later = densities(0.5_r);
  const DeformNetworks& deform = field.networks.back().deform;
  for (size_t i = deform.begin; i < deform.end; ++i) field.weights[i] = 0;
  EXPECT_EQ(start, densities(0));
  EXPECT_EQ(start, densities(0.5_r));
  EXPECT_NE(start, later);
}

// One network for both levels, and no loss of the coarse one: its samples only say where the fine
// ones are.
TEST(Dnerf, LearnsFromTheFinePixelAlone) {
  const TrainOptions o = method_options("dnerf", Scale::kPaper);
  const NetworkField field(o.network, 2, 6);
  EXPECT_EQ(field.networks.size(), 1u);
  NetworkLevels levels(field, 1, true, losses_of(o.recipe, false));
  EXPECT_FALSE(levels.tape(0).learns());
  EXPECT_TRUE(levels.tape(1).learns());
  EXPECT_EQ(levels.renderings(), 1);
}

TEST(Dnerf, PhotosComeInTheOrderOfTime) {
  NetworkRecipe r;
  r.curriculum_steps = 1000;
  EXPECT_EQ(photos_in_time(r, 0, 50), 3u);
  EXPECT_EQ(photos_in_time(r, 59, 50), 3u);
  EXPECT_EQ(photos_in_time(r, 200, 50), 10u);
  EXPECT_EQ(photos_in_time(r, 1000, 50), 50u);
  EXPECT_EQ(photos_in_time(r, 0, 2), 2u);
  // In a capture whose names do not follow time.
  auto c = capture_of("dnerf", 9, 24);
  for (View& view : c.scene.views) view.time = 1 - view.time;
  TrainOptions o = tiny_method_options("dnerf", 1000);
  o.recipe.curriculum_steps = 1000;
  o.recipe.crop_steps = 0;
  ThreadPool pool(1);
  for (const bool one_photo : {false, true}) {
    o.recipe.one_photo = one_photo;
    NetworkTrainer trainer(c.scene, c.photos, o, pool);
    trainer.draw();
    std::set<Real> times;
    for (const NetworkRay& ray : trainer.rays) times.insert(ray.time);
    EXPECT_EQ(times.size(), one_photo ? 1u : 3u);
    EXPECT_LE(*times.rbegin(), 0.4_r);  // of the moments 0.125, 0.25 and 0.375; others are held out
  }
}

TEST(Windows, OpenWithTheSteps) {
  const TrainOptions o = method_options("hypernerf", Scale::kPaper);
  EXPECT_EQ(windows_at(o.network, o.recipe, 0).warp, 0);
  EXPECT_EQ(windows_at(o.network, o.recipe, 40000).warp, 3);
  EXPECT_EQ(windows_at(o.network, o.recipe, 80000).warp, 6);
  EXPECT_EQ(windows_at(o.network, o.recipe, 200000).warp, 6);
  EXPECT_EQ(windows_at(o.network, o.recipe, 1000).ambient, 0);
  EXPECT_EQ(windows_at(o.network, o.recipe, 6000).ambient, 0.5);
  EXPECT_EQ(windows_at(o.network, o.recipe, 11000).ambient, 1);
}

TEST(Nerfies, ElasticLossFalls) {
  const NetworkRecipe r = method_options("nerfies", Scale::kPaper).recipe;
  EXPECT_EQ(elastic_at(r, 0), 0.01_r);
  EXPECT_EQ(elastic_at(r, 49999), 0.01_r);
  EXPECT_NEAR(elastic_at(r, 100000), 0.005, 1e-6);
  EXPECT_NEAR(elastic_at(r, 150000), 1e-8, 1e-12);
  EXPECT_NEAR(elastic_at(r, 250000), 1e-8, 1e-12);
  NetworkRecipe constant = r;
  constant.elastic_fall_steps = 0;
  EXPECT_EQ(elastic_at(constant, 250000), 0.01_r);
}

// Photos of one moment share a row, whatever their order; cameras have numbers of their own.
TEST(CaptureMoments, AreThoseOfTheTrainingPhotos) {
  auto c = sphere_capture(8, 8);
  const double times[] = {0.1, 1, 0.5, 0.5, 0.9, 0, 0.5, 1};
  for (size_t i = 0; i < 8; ++i) {
    c.scene.views[i].time = times[i];
    c.scene.views[i].ids.camera = i % 2 ? 9 : 4;
  }
  const CaptureMoments m(c.scene);  // of the photos 1, 2, 3, 5, 6, 7
  EXPECT_EQ(m.times, (std::vector<double>{0, 0.5, 1}));
  EXPECT_EQ(m.of_photo, (std::vector<int>{2, 1, 1, 0, 1, 2}));
  EXPECT_EQ(m.by_time, (std::vector<size_t>{3, 1, 2, 4, 0, 5}));
  EXPECT_EQ(m.cameras, (std::vector<int>{4, 9}));
  EXPECT_EQ(m.camera_of, (std::vector<int>{1, 0, 1, 1, 0, 1}));
  EXPECT_EQ(m.nearest(0.2), 0);
  EXPECT_EQ(m.nearest(0.3), 1);
  EXPECT_EQ(m.nearest(1), 2);
  // The same instant, told apart by the capture's numbers.
  for (size_t i = 0; i < 8; ++i) c.scene.views[i].ids.moment = static_cast<int>(i);
  EXPECT_EQ(CaptureMoments(c.scene).times, (std::vector<double>{0, 0.5, 0.5, 0.5, 1, 1}));
}

// Of a rig colours depend on the camera; of one camera on the photo.
TEST(Nerfies, ColoursDependOnTheCameraOrOnThePhoto) {
  ThreadPool pool(1);
  auto c = capture_of("nerfies", 8, 16);
  const TrainOptions o = tiny_method_options("nerfies", 4);
  const auto books_of = [&] {
    return Trainer(c.scene, c.photos, o, pool).snapshot().field().codes();
  };
  const CodeBooks rig = books_of();
  EXPECT_EQ(rig.cameras, (std::vector<int>{0, 1}));
  EXPECT_EQ(rig.camera.in, o.network.camera_code);
  EXPECT_EQ(rig.appearance.out, 0);
  for (View& view : c.scene.views) view.ids.camera = 5;
  const CodeBooks one = books_of();
  EXPECT_EQ(one.camera.out, 0);
  EXPECT_EQ(one.appearance.out, 6);
  EXPECT_EQ(one.deformation.out, 6);
}

// Sparse points are kept where they are: after steps of that loss alone they move less than others.
TEST(StillPoints, AreKeptInPlace) {
  const auto c = capture_of("nerfies", 8, 16);
  ThreadPool pool(1);
  TrainOptions o = tiny_method_options("nerfies", 4);
  o.recipe.still = 1;
  NetworkTrainer trainer(c.scene, c.photos, o, pool);
  // A warp that moves everything.
  const DeformNetworks& deform = trainer.field.networks.back().deform;
  const LinearWeights& last = deform.warp.last;
  for (int k = 3; k < 6; ++k)
    trainer.field.weights[last.bias_offset() + static_cast<size_t>(k)] = 0.01_r;
  AlignedArray<Real> gradient(trainer.field.weights.size());
  const double loss = trainer.still.backward(1, 0, 0, 0, gradient.data());
  // Of 256 of the 300 points: |x' - x|^2 is 3e-4, u = 300, rho = 0.001 600 / 304.
  EXPECT_NEAR(loss, 256.0 / 300 * 0.001 * 600 / 304, 2e-5);
  for (int k = 3; k < 6; ++k) EXPECT_GT(gradient[last.bias_offset() + static_cast<size_t>(k)], 0);
  // By a difference: of the bias that moves points along x.
  const size_t at = last.bias_offset() + 3;
  const double step = 1e-4;
  AlignedArray<Real> unused(gradient.size());
  trainer.field.weights[at] += static_cast<Real>(step);
  const double up = trainer.still.backward(1, 0, 0, 0, unused.data());
  trainer.field.weights[at] -= static_cast<Real>(2 * step);
  const double down = trainer.still.backward(1, 0, 0, 0, unused.data());
  EXPECT_NEAR(gradient[at], (up - down) / (2 * step), 0.02 * std::fabs(gradient[at]));
}

// The publications' settings, from their authors' configurations.
TEST(MovingMethods, PaperRecipes) {
  const TrainOptions d = method_options("dnerf", Scale::kPaper);
  EXPECT_EQ(d.steps, 800000);
  EXPECT_NEAR(d.rate * d.final_rate, 5e-4 * std::pow(0.1, 1.6), 1e-12);
  EXPECT_EQ(d.recipe.rays, 500);
  EXPECT_TRUE(d.recipe.one_photo);
  EXPECT_EQ(d.recipe.crop_steps, 500);
  EXPECT_EQ(d.recipe.curriculum_steps, 10000);
  EXPECT_EQ(d.recipe.coarse, 0);
  EXPECT_EQ(d.network.sampling.coarse, 64);
  EXPECT_EQ(d.network.sampling.fine, 128);
  // 63 + 21 numbers, 8 layers of 256, the position's 63 again before the sixth.
  const NetworkField dnerf(d.network, 2, 6);
  const WarpNetwork& warp = dnerf.networks.back().deform.warp;
  ASSERT_EQ(warp.hidden.size(), 8u);
  EXPECT_EQ(warp.hidden[0].in, 84);
  EXPECT_EQ(warp.hidden[4].in, 256);
  EXPECT_EQ(warp.hidden[5].in, 319);
  EXPECT_EQ(warp.last.out, 3);

  const TrainOptions n = method_options("nerfies", Scale::kPaper);
  EXPECT_EQ(n.steps, 250000);
  EXPECT_EQ(n.rate, 1e-3);
  EXPECT_EQ(n.final_rate, 0.1);
  EXPECT_EQ(n.recipe.rays, 6144);
  EXPECT_EQ(n.recipe.window_steps, 80000);
  EXPECT_EQ(n.recipe.elastic, 0.01_r);
  EXPECT_EQ(n.recipe.still, 1);
  EXPECT_EQ(n.recipe.still_points, 16384);
  const NetworkField nerfies(n.network, 2, 6);
  const WarpNetwork& se3 = nerfies.networks.back().deform.warp;
  ASSERT_EQ(se3.hidden.size(), 6u);
  EXPECT_EQ(se3.hidden[0].in, 51 + 8);
  EXPECT_EQ(se3.hidden[4].in, 128 + 59);  // before the fifth
  EXPECT_EQ(se3.last.out, 6);
  EXPECT_EQ(nerfies.networks.back().view.in, 256 + 27 + 8 + 2);

  const TrainOptions h = method_options("hypernerf", Scale::kPaper);
  EXPECT_EQ(h.recipe.elastic, 0);
  EXPECT_EQ(h.recipe.still, 1);
  EXPECT_EQ(h.recipe.ambient_start, 1000);
  EXPECT_EQ(h.recipe.ambient_steps, 10000);
  const NetworkField hyper(h.network, 2, 6);
  const PointNetwork& sheet = hyper.networks.back().deform.sheet;
  ASSERT_EQ(sheet.hidden.size(), 6u);
  EXPECT_EQ(sheet.hidden[0].in, 36 + 8);
  EXPECT_EQ(sheet.hidden[4].in, 64 + 44);
  EXPECT_EQ(sheet.last.out, 2);
  EXPECT_EQ(hyper.networks.back().trunk[0].in, 51 + 4);
}

}  // namespace
}  // namespace nerf
