// Training of the paper methods, each in a size that takes milliseconds a step.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "nerf/model/network_field.h"
#include "nerf/model/renderer.h"
#include "nerf/train/evaluation.h"
#include "nerf/train/methods.h"
#include "nerf/train/run.h"
#include "support/network_options.h"
#include "support/synthetic_scene.h"
#include "support/temp_folder.h"
#include "support/tiny_options.h"
#include "train/ray_batch.h"

namespace nerf {
namespace {

using test::bits_of;
using test::capture_of;
using test::error_of;
using test::sphere_capture;
using test::tiny_method_options;

// Pictures of a field and of its file, whose 32 bits are all there is in float.
void expect_alike(const std::vector<Real>& a, const std::vector<Real>& b) {
  ASSERT_EQ(a.size(), b.size());
  const double tolerance = std::is_same_v<Real, float> ? 0 : 1e-4;
  for (size_t i = 0; i < a.size(); ++i) ASSERT_NEAR(a[i], b[i], tolerance) << i;
}

// Every method but the grid's, which has tests of its own.
class NetworkTraining : public ::testing::TestWithParam<std::string> {
 protected:
  static std::vector<uint8_t> bits_after(const test::SyntheticCapture& c, int threads,
                                         const TrainOptions& options, int64_t steps) {
    ThreadPool pool(threads);
    Trainer trainer(c.scene, c.photos, options, pool);
    for (int64_t i = 0; i < steps; ++i) trainer.step();
    return bits_of(trainer);
  }
};

TEST_P(NetworkTraining, ThreadsChangeNothing) {
  const auto c = capture_of(GetParam());
  const auto one = bits_after(c, 1, tiny_method_options(GetParam(), 10), 6);
  EXPECT_EQ(one, bits_after(c, 2, tiny_method_options(GetParam(), 10), 6));
  EXPECT_EQ(one, bits_after(c, 3, tiny_method_options(GetParam(), 10), 6));
}

TEST_P(NetworkTraining, GoesOnBitForBit) {
  const auto c = capture_of(GetParam());
  const TrainOptions options = tiny_method_options(GetParam(), 20);
  test::TempFolder folder;
  ThreadPool pool(2);
  {
    Trainer first(c.scene, c.photos, options, pool);
    for (int i = 0; i < 8; ++i) first.step();
    first.save_checkpoint(folder / "c");
  }
  Trainer second(c.scene, c.photos, options, pool);
  second.step();  // what was there before must not matter
  second.load_checkpoint(folder / "c");
  EXPECT_EQ(second.steps_done(), 8);
  for (int i = 0; i < 8; ++i) second.step();
  EXPECT_EQ(bits_of(second), bits_after(c, 1, options, 16));
  // A restart is a beginning.
  second.restart(0, 1);
  for (int i = 0; i < 4; ++i) second.step();
  EXPECT_EQ(bits_of(second), bits_after(c, 1, options, 4));
}

TEST_P(NetworkTraining, LearnsTheSphere) {
  const auto c = capture_of(GetParam(), 24, 32);
  ThreadPool pool(2);
  TrainOptions options = tiny_method_options(GetParam(), 700);
  Trainer trainer(c.scene, c.photos, options, pool);
  StepReport first, last;
  trainer.run([&](const StepReport& r) {
    if (r.step == 1) first = r;
    last = r;
    return true;
  });
  EXPECT_LT(last.loss, first.loss);
  EXPECT_EQ(last.rays, 96);
  const NetworkOptions& n = options.network;
  const int merged = n.sampling.resampling == Resampling::kCoarseFine ? n.sampling.coarse : 0;
  const int64_t all = 96 * (n.sampling.rounds * n.sampling.coarse + n.sampling.fine + merged);
  EXPECT_EQ(first.samples, all);
  // The space around the sphere is empty, or nearly, to all but a softplus's proposals; where
  // something may be transient nothing is left out.
  const bool proposal = n.sampling.resampling == Resampling::kProposal;
  const bool transient = n.transient_code > 0;
  EXPECT_LE(last.samples, proposal || transient ? all : all / 2);
  EXPECT_GE(last.samples, transient ? all : proposal ? all - 96 * n.sampling.fine : 96);
  const RadianceField field = trainer.snapshot();
  EXPECT_EQ(field.info().method, GetParam());
  const Evaluation e = evaluate(field, c.scene, c.photos, {}, pool);
  // A white picture has 11 dB; longer trainings reach 28 dB and more.
  EXPECT_GT(e.psnr, 22);
}

// The counter of work says what the switches leave out.
TEST_P(NetworkTraining, SkippingIsCounted) {
  const auto c = capture_of(GetParam(), 16, 32);
  ThreadPool pool(2);
  const auto last_samples = [&](bool skip, Real negligible, int empty_steps = 0) {
    const int64_t steps = skip || empty_steps > 0 ? 200 : 20;
    TrainOptions o = tiny_method_options(GetParam(), steps);
    o.recipe.skip = skip;
    o.recipe.negligible = negligible;
    o.recipe.empty_steps = empty_steps;
    Trainer trainer(c.scene, c.photos, o, pool);
    StepReport last;
    for (int64_t i = 0; i < steps; ++i) last = trainer.step();
    return last.samples / last.rays;
  };
  const TrainOptions o = tiny_method_options(GetParam(), 1);
  EXPECT_EQ(last_samples(false, 0), o.network.sampling.all_samples());
  EXPECT_EQ(last_samples(false, 0.2_r), o.network.sampling.all_samples());
  const int64_t few = last_samples(true, 0.2_r);
  // At least a tenth of them stands where nothing was found for so long.
  const int64_t where_matter_was = last_samples(false, 0.2_r, 64);
  if (o.network.transient_code > 0) {  // what is transient may be anywhere
    EXPECT_EQ(few, o.network.sampling.all_samples());
    EXPECT_EQ(where_matter_was, o.network.sampling.all_samples());
  } else {
    EXPECT_LT(few, o.network.sampling.all_samples());
    EXPECT_LT(10 * where_matter_was, 9 * o.network.sampling.all_samples());
  }
  EXPECT_LE(few, last_samples(true, 0));
}

// Between two looks at what is empty, too.
TEST_P(NetworkTraining, EmptySpaceIsTheSameOnAnyThreadsAndAfterAStop) {
  const auto c = capture_of(GetParam());
  TrainOptions options = tiny_method_options(GetParam(), 70);
  options.recipe.empty_steps = 32;  // looked for after every second step
  const std::vector<uint8_t> want = bits_after(c, 1, options, 70);
  EXPECT_EQ(bits_after(c, 2, options, 70), want);
  test::TempFolder folder;
  ThreadPool pool(3);
  {
    Trainer first(c.scene, c.photos, options, pool);
    for (int i = 0; i < 41; ++i) first.step();
    first.save_checkpoint(folder / "c");
  }
  Trainer second(c.scene, c.photos, options, pool);
  second.step();
  second.load_checkpoint(folder / "c");
  for (int i = 41; i < 70; ++i) second.step();
  EXPECT_EQ(bits_of(second), want);
}

// What is opaque stays so, and nothing stands in the empty space that imitates white.
TEST_P(NetworkTraining, LearnsOverBlack) {
  const auto c = capture_of(GetParam(), 24, 32);
  ThreadPool pool(2);
  TrainOptions options = tiny_method_options(GetParam(), 400);
  options.background = Background::kBlack;
  Trainer trainer(c.scene, c.photos, options, pool);
  trainer.run({});
  const RadianceField field = trainer.snapshot();
  EXPECT_EQ(field.info().background, (Vec3{0, 0, 0}));
  EXPECT_GT(evaluate(field, c.scene, c.photos, {}, pool).psnr, 18);
  RenderOptions over_black;
  over_black.background = field.info().background;
  const size_t view = static_cast<size_t>(c.scene.test.front());
  const Frame frame =
      render(field, c.photos.cameras[view], c.scene.views[view].pose, over_black, pool);
  for (int k = 0; k < 3; ++k) EXPECT_NEAR(frame.rgb[static_cast<size_t>(k)], 0, 0.1) << k;
}

// Cameras side by side that all look the same way, at two moments: were each photo of a moment of
// its own, what moves past one camera would look like what stands at another distance.
test::SyntheticCapture forward_facing_capture(const std::string& method) {
  test::SyntheticCapture c = capture_of(method, 20, 32);
  for (size_t i = 0; i < c.scene.views.size(); ++i) {
    Pose pose;
    pose.translation = {0.3 * (static_cast<double>(i % 5) - 2),
                        0.3 * (static_cast<double>(i / 5) - 1.5), -test::kCameraDistance};
    c.scene.views[i].pose = pose;
    c.photos.photos[i] = test::sphere_photo(c.scene.cameras[0], pose);
    c.scene.views[i].time = static_cast<double>(i / 2 % 2);
    c.scene.views[i].ids.moment = static_cast<int>(i / 2 % 2);
  }
  c.scene.near = 1.5;
  return c;
}

TEST_P(NetworkTraining, LearnsInNormalisedDeviceCoordinates) {
  const auto c = forward_facing_capture(GetParam());
  ThreadPool pool(2);
  TrainOptions options = tiny_method_options(GetParam(), 500);
  if (options.network.deform.any())
    options.steps = 1000;  // of each moment there are half the photos
  options.network.space = Space::kNdc;
  options.network.sampling.spacing = Spacing::kUniform;
  Trainer trainer(c.scene, c.photos, options, pool);
  trainer.run({});
  const RadianceField field = trainer.snapshot();
  EXPECT_GT(evaluate(field, c.scene, c.photos, {}, pool).psnr, 22);
  // The sphere's front is 2.3 before the camera in the middle. One of 16 intervals is 0.22 long
  // there (1.5 / (1 - t)^2 / 16): two of them.
  const Frame frame = render(field, c.scene.cameras[0], c.scene.views[7].pose, {}, pool);
  EXPECT_NEAR(frame.depth_z[16 * 32 + 16], 2.3, 0.45);
  // Saved with its reference camera.
  test::TempFolder folder;
  field.save(folder / "m");
  const Frame again = render(RadianceField::load(folder / "m"), c.scene.cameras[0],
                             c.scene.views[7].pose, {}, pool);
  expect_alike(frame.rgb, again.rgb);
  expect_alike(frame.depth_z, again.depth_z);

  const auto around = capture_of(GetParam());
  EXPECT_TRUE(
      test::contains(error_of([&] { Trainer wrong(around.scene, around.photos, options, pool); }),
                     "--network-space identity"));
}

// Photos of three exposures from the same places and moments, so that neither the view direction
// nor what is learnt of a moment can tell them apart: with a code each is learnt as it is. New
// views have none; the model keeps the photos'.
TEST_P(NetworkTraining, PhotosCodesTakeUpWhatDiffersBetweenPhotos) {
  auto c = capture_of(GetParam(), 16, 32);
  for (size_t i = 0; i < c.scene.views.size(); ++i) {
    const size_t place = i / 4 * 4;  // the held-out one of the four
    if (i == place) continue;
    c.scene.views[i].pose = c.scene.views[place].pose;
    c.photos.photos[i] = c.photos.photos[place];
    c.scene.views[i].time = c.scene.views[place].time;
    c.scene.views[i].ids.moment = c.scene.views[place].ids.moment;
    std::vector<uint8_t>& rgba = c.photos.photos[i].pixels8;
    for (size_t k = 0; k < rgba.size(); ++k)
      if (k % 4 != 3) rgba[k] = static_cast<uint8_t>(rgba[k] * (i % 4) / 3);
  }
  // What a deformation, or one network for all, takes longer to tell apart.
  const int64_t steps = GetParam() == "dnerf" || GetParam() == "mipnerf360" ? 1000 : 500;
  ThreadPool pool(2);
  const auto psnr_after = [&](int code) {
    TrainOptions options = tiny_method_options(GetParam(), steps);
    options.network.image_code = code;
    // Either would stand in its place.
    options.network.camera_code = options.network.transient_code = 0;
    Trainer trainer(c.scene, c.photos, options, pool);
    double sum = 0;
    trainer.run([&](const StepReport& r) {
      if (r.step > steps - 100) sum += r.psnr / 100;
      return true;
    });
    const RadianceField field = trainer.snapshot();
    EXPECT_EQ(field.field().codes().appearance.out, code > 0 ? 12 : 0);
    test::TempFolder folder;
    field.save(folder / "m");
    const Pose& pose = c.scene.views[0].pose;
    expect_alike(render(field, c.scene.cameras[0], pose, {}, pool).rgb,
                 render(RadianceField::load(folder / "m"), c.scene.cameras[0], pose, {}, pool).rgb);
    return sum;
  };
  EXPECT_GT(psnr_after(4), psnr_after(0) + 3);
}

TEST_P(NetworkTraining, MemoryEstimateFollowsTheSetting) {
  const TrainOptions small = tiny_method_options(GetParam(), 10);
  const TrainOptions paper = method_options(GetParam(), Scale::kPaper);
  const uint64_t few = training_memory_bytes(small, false, 1);
  const uint64_t many = training_memory_bytes(paper, false, 2);
  EXPECT_GT(many, few);
  EXPECT_GT(many, training_memory_bytes(paper, false, 1));
  // The paper's setting at its largest, mip-NeRF 360 on two threads.
  EXPECT_LT(many, uint64_t{4} << 30);
}

TEST(PixelSource, DrawsTheMiddleOfAPhoto) {
  const auto c = sphere_capture(3, 32);
  const PixelSource source(c.scene, c.photos);
  for (const double share : {1.0, 0.5, 0.01}) {
    const int middle = std::max(1, static_cast<int>(share * 32)), first = (32 - middle) / 2;
    int low[2] = {32, 32}, high[2] = {-1, -1};
    for (uint64_t i = 0; i < 2000; ++i) {
      Random random(5, 0, i);
      PixelSource::Pixel pixel;
      ASSERT_TRUE(source.draw_from(1, random, share, pixel));
      EXPECT_EQ(pixel.source, 1u);
      for (const auto& [axis, at] : {std::pair{0, pixel.x}, {1, pixel.y}}) {
        low[axis] = std::min(low[axis], at);
        high[axis] = std::max(high[axis], at);
      }
    }
    // 2000 draws leave out a given one of 32 columns once in 10^27.
    for (const int axis : {0, 1}) {
      EXPECT_EQ(low[axis], first) << share;
      EXPECT_EQ(high[axis], first + middle - 1) << share;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Methods, NetworkTraining,
                         ::testing::Values("nerf", "mipnerf", "mipnerf360", "nerfw", "dnerf",
                                           "nerfies", "hypernerf"),
                         [](const auto& info) { return info.param; });

}  // namespace
}  // namespace nerf
