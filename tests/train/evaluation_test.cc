#include "nerf/train/evaluation.h"

#include <algorithm>

#include "nerf/train/metrics.h"
#include "nerf/train/run.h"
#include "support/synthetic_scene.h"
#include "support/temp_folder.h"
#include "support/tiny_options.h"

namespace nerf {
namespace {

using test::sphere_capture;
using test::tiny_options;

struct Trained {
  test::SyntheticCapture capture = sphere_capture(24, 48);
  ThreadPool pool{2};
  Trainer trainer{capture.scene, capture.photos, options(), pool};
  RadianceField field;

  static TrainOptions options() {
    TrainOptions o = tiny_options(300);
    o.grid_recipe.batch_samples = 9600;
    o.grid.table_bits = 32;  // more than a model file keeps
    return o;
  }
  Trained() : field((run_training(trainer, RunOptions(), {}), trainer.snapshot())) {}
};

// One for all tests: it is trained only once.
class EvaluationTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { trained = new Trained; }
  static void TearDownTestSuite() { delete trained; }
  static inline Trained* trained = nullptr;

  static Evaluation evaluation(const EvaluationOptions& options = {}) {
    return evaluate(trained->field, trained->capture.scene, trained->capture.photos, options,
                    trained->pool);
  }
  // What is compared: photo and rendering of a view over white.
  static Image8 photo_of(int view) {
    return photo_over(trained->capture.photos.photos[static_cast<size_t>(view)],
                      evaluation_background(trained->field.info()));
  }
  static Image8 rendering_of(int view) {
    RenderOptions options;
    options.background = evaluation_background(trained->field.info());
    const size_t v = static_cast<size_t>(view);
    Frame frame = render(trained->field, trained->capture.photos.cameras[v],
                         trained->capture.scene.views[v].pose, options, trained->pool);
    return to_8bit(ImageF{frame.width, frame.height, 3, std::move(frame.rgb)});
  }
};

TEST_F(EvaluationTest, SeesThatTheSceneWasLearnt) {
  const Evaluation e = evaluation();
  ASSERT_EQ(e.views.size(), 6u);
  EXPECT_EQ(e.counted, 6);
  EXPECT_EQ(e.views[1].name, "r_104");
  double psnr = 0, ssim = 0;
  for (size_t i = 0; i < 6; ++i) {
    const ViewScore& v = e.views[i];
    // Half of the error (6 dB) that a picture without anything in it has, and more alike.
    const Image8 truth = photo_of(trained->capture.scene.test[i]);
    Image8 empty = truth;
    std::fill(empty.pixels.begin(), empty.pixels.end(), uint8_t{255});
    EXPECT_GT(v.psnr.value(), nerf::psnr(truth, empty).value() + 6) << v.name;
    EXPECT_GT(v.ssim.value(), nerf::ssim(truth, empty, trained->pool).value()) << v.name;
    psnr += v.psnr.value() / 6;
    ssim += v.ssim.value() / 6;
  }
  EXPECT_NEAR(e.psnr, psnr, 1e-9);
  EXPECT_NEAR(e.ssim, ssim, 1e-9);
  EXPECT_LT(e.ssim, 1);
  EXPECT_GT(e.seconds, 0);
}

TEST_F(EvaluationTest, TakesSomeViewsSpreadEvenly) {
  EvaluationOptions options;
  options.max_views = 2;
  const Evaluation e = evaluation(options);
  ASSERT_EQ(e.views.size(), 2u);
  EXPECT_EQ(e.views[0].name, "r_104");
  EXPECT_EQ(e.views[1].name, "r_116");
}

TEST_F(EvaluationTest, MaskedPixelsDoNotCount) {
  Photo& photo = trained->capture.photos.photos[0];
  const Photo good = photo;
  const Image8 truth = photo_of(0), rendering = rendering_of(0);
  // Half of the photo is spoilt, and masked out.
  photo.mask.assign(48 * 48, 255);
  for (size_t i = 0; i < 48 * 24; ++i) {
    photo.mask[i] = 0;
    photo.pixels8[4 * i] ^= 0x80;
    photo.pixels8[4 * i + 3] = 255;
  }
  const ViewScore half = evaluation().views[0];
  EXPECT_EQ(half.psnr, psnr(truth, rendering, photo.mask));
  // Windows of SSIM reach over the mask's border: only their centres must count.
  EXPECT_EQ(half.ssim, ssim(photo_of(0), rendering, trained->pool, photo.mask));
  photo.mask.assign(48 * 48, 0);
  const Evaluation e = evaluation();
  EXPECT_FALSE(e.views[0].psnr || e.views[0].ssim);
  EXPECT_EQ(e.counted, 5);
  double psnr = 0;
  for (size_t i = 1; i < 6; ++i) psnr += e.views[i].psnr.value() / 5;
  EXPECT_NEAR(e.psnr, psnr, 1e-9);
  photo = good;
}

TEST_F(EvaluationTest, WritesPicturesSideBySide) {
  test::TempFolder folder;
  EvaluationOptions options;
  options.max_views = 1;
  options.pictures = folder / "eval";
  const Evaluation e = evaluation(options);
  const Image8 picture = read_image_8bit(folder / "eval" / (e.views[0].name + ".png"));
  EXPECT_EQ(picture.width, 3 * 48 + 8);
  EXPECT_EQ(picture.height, 48);
  EXPECT_EQ(e.views[0].picture, e.views[0].name + ".png");
  EXPECT_FALSE(std::filesystem::exists(options.pictures / kPictureMasks));
  // The sphere's radius is 0.7, 3 from the camera.
  EXPECT_GT(e.views[0].depth.near, 2);
  EXPECT_LT(e.views[0].depth.far, 4);
  // The corner is background: white in photo and rendering, black in the depth.
  EXPECT_EQ(picture.pixels[0], 255);
  EXPECT_EQ(picture.pixels[3 * 52], 255);
  EXPECT_EQ(picture.pixels[3 * 104], 0);
  const int view = trained->capture.scene.test[3];
  ASSERT_EQ(trained->capture.scene.views[static_cast<size_t>(view)].name, e.views[0].name);
  const Image8 truth = photo_of(view), rendering = rendering_of(view);
  for (size_t y = 0; y < 48; ++y)
    for (size_t i = 0; i < 3 * 48; ++i) {
      const size_t row = 3 * y * static_cast<size_t>(picture.width);
      ASSERT_EQ(picture.pixels[row + i], truth.pixels[3 * 48 * y + i]);
      ASSERT_EQ(picture.pixels[row + 3 * 52 + i], rendering.pixels[3 * 48 * y + i]);
    }
}

TEST_F(EvaluationTest, KeepsTheMasksOfItsPictures) {
  test::TempFolder folder;
  EvaluationOptions options;
  options.max_views = 1;
  options.pictures = folder / "eval";
  options.fit_light = FitLight::kOn;  // the right half counts
  const std::string picture = evaluation(options).views.at(0).picture;
  const Image8 mask = read_image_8bit(options.pictures / kPictureMasks / picture);
  EXPECT_EQ(mask.channels, 1);
  ASSERT_EQ(mask.pixels.size(), 48u * 48);
  for (size_t i = 0; i < mask.pixels.size(); ++i)
    ASSERT_EQ(mask.pixels[i], i % 48 < 24 ? 0 : 255) << i;
}

TEST_F(EvaluationTest, PicturesOfLongNamesAreShortened) {
  // Three folders deep, whose names are one in the picture's; both views begin alike.
  const std::string deep = std::string(150, 'a') + "/" + std::string(150, 'b') + "/";
  std::vector<View>& views = trained->capture.scene.views;
  const std::vector<View> good = views;
  for (const int v : trained->capture.scene.test)
    views[static_cast<size_t>(v)].name = deep + std::to_string(v) + ".jpg";
  test::TempFolder folder;
  EvaluationOptions options;
  options.max_views = 2;
  options.pictures = folder / "eval";
  evaluation(options);
  views = good;
  const std::string stem = std::string(150, 'a') + "_" + std::string(49, 'b');
  EXPECT_TRUE(std::filesystem::exists(folder / "eval" / (stem + ".png")));
  EXPECT_TRUE(std::filesystem::exists(folder / "eval" / (stem + "_2.png")));
}

TEST_F(EvaluationTest, SaysWhatIsNewInHeldOutViews) {
  EXPECT_TRUE(evaluation().held_out.empty());
  Scene& scene = trained->capture.scene;
  const std::vector<View> good = scene.views;
  for (size_t v = 0; v < scene.views.size(); ++v)
    scene.views[v].time = 0.01 * static_cast<double>(v);
  // Of the moment of another's; to rounding of files.
  for (size_t i = 0; i < 2; ++i)
    scene.views[static_cast<size_t>(scene.test[i])].time =
        scene.views[static_cast<size_t>(scene.train[i])].time + 1e-9;
  const Evaluation e = evaluation();
  scene.views = good;
  ASSERT_EQ(e.held_out.size(), 2u);
  EXPECT_EQ(e.held_out[0].held_out, HeldOut::kSpace);
  EXPECT_EQ(e.held_out[0].counted, 2);
  EXPECT_NEAR(e.held_out[0].psnr, (*e.views[0].psnr + *e.views[1].psnr) / 2, 1e-12);
  EXPECT_EQ(e.held_out[1].held_out, HeldOut::kTime);
  EXPECT_EQ(e.held_out[1].counted, 4);
  EXPECT_EQ(e.views[1].held_out, HeldOut::kSpace);
  EXPECT_EQ(e.views[2].held_out, HeldOut::kTime);
}

TEST_F(EvaluationTest, CanBeCancelled) {
  Cancel cancel;
  double last = 0;
  EXPECT_THROW(
      evaluate(
          trained->field, trained->capture.scene, trained->capture.photos, {}, trained->pool,
          [&](double f) {
            last = f;
            if (f > 0.3) cancel.request();
          },
          &cancel),
      Cancelled);
  EXPECT_LT(last, 0.7);
}

TEST_F(EvaluationTest, WithoutHeldOutViewsThereIsNothing) {
  Scene scene = trained->capture.scene;
  scene.test.clear();
  const Evaluation e = evaluate(trained->field, scene, trained->capture.photos, {}, trained->pool);
  EXPECT_EQ(e.counted, 0);
  EXPECT_EQ(e.psnr, 0);
  EXPECT_TRUE(e.views.empty());
}

// The model file rounds the table to half floats: that must not be seen.
TEST_F(EvaluationTest, AModelFileRendersAsTheFieldItCameFrom) {
  test::TempFolder folder;
  trained->field.save(folder / "m");
  const RadianceField loaded = RadianceField::load(folder / "m");
  const Evaluation e = evaluation();
  const Evaluation f =
      evaluate(loaded, trained->capture.scene, trained->capture.photos, {}, trained->pool);
  for (size_t i = 0; i < e.views.size(); ++i)
    EXPECT_NEAR(e.views[i].psnr.value(), f.views[i].psnr.value(), 0.01) << e.views[i].name;
  RecordProperty("psnr_difference", std::to_string(f.psnr - e.psnr));
}

TEST(Evaluation, PhotoOverBackground) {
  Photo photo;
  photo.width = 2;
  photo.height = 1;
  photo.channels = 4;
  photo.pixels8 = {255, 0, 128, 255, 10, 20, 30, 0};
  ModelInfo info;
  info.alpha = true;
  const Image8 white = photo_over(photo, evaluation_background(info));
  EXPECT_EQ(white.pixels, (std::vector<uint8_t>{255, 0, 128, 255, 255, 255}));
  info.background = {0, 0, 0};
  const Image8 black = photo_over(photo, evaluation_background(info));
  EXPECT_EQ(black.pixels, (std::vector<uint8_t>{255, 0, 128, 0, 0, 0}));
  info.alpha = false;
  const Image8 grey = photo_over(photo, evaluation_background(info));
  EXPECT_EQ(grey.pixels, (std::vector<uint8_t>{255, 0, 128, 128, 128, 128}));
}

TEST(Evaluation, MaskedPixelsAreDarkenedInThePicture) {
  Image8 photo{1, 2, 3, {200, 100, 40, 200, 100, 40}};
  Frame frame{1, 2, std::vector<Real>(6, 0.5_r), std::vector<Real>(2, 0.0_r),
              std::vector<Real>(2, 0.0_r)};
  const Image8 out =
      side_by_side(photo, {255, 0}, photo, frame, depth_range(frame.depth_z, frame.alpha));
  EXPECT_EQ(out.width, 11);
  EXPECT_EQ(out.pixels[0], 200);
  EXPECT_EQ(out.pixels[3 * 11], 50);
  EXPECT_EQ(out.pixels[3 * 11 + 3 * 5], 200);
}

}  // namespace
}  // namespace nerf
