#include "nerf/io/camera_files.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "io/colmap.h"
#include "io/transforms_camera.h"
#include "nerf/base/error.h"
#include "nerf/base/file.h"
#include "nerf/math/refined_camera.h"
#include "support/temp_folder.h"

namespace nerf {
namespace {

std::vector<CameraOfPhoto> photos() {
  using enum CameraModel;
  std::vector<CameraOfPhoto> out;
  for (const CameraModel model :
       {kSimplePinhole, kPinhole, kSimpleRadial, kRadial, kOpenCV, kFullOpenCV,
        kSimpleRadialFisheye, kRadialFisheye, kOpenCVFisheye}) {
    Camera camera{model, 640, 480, {500, 500, 330, 250}};
    const int count = camera_model_params(model);
    const bool one = count < 4 || camera.fy() != camera.params[1] || model == kSimpleRadial ||
                     model == kRadial || model == kSimpleRadialFisheye || model == kRadialFisheye;
    if (one) camera.params = {500, 330, 250};
    for (int i = one ? 3 : 4; i < count; ++i)
      camera.params[static_cast<size_t>(i)] = 0.01 / (i + 1);
    const double x = static_cast<double>(out.size());
    const std::string name = "set one/" + std::to_string(out.size()) + ".jpg";
    out.push_back({name,
                   "images/" + name,
                   camera,
                   {rotation_by({0.3 * x, 2 - x, 0.1}), {x, 1 / (1 + x), -3.25}}});
  }
  out.push_back(out.back());  // of the same camera
  out.back().name = "again.jpg";
  return out;
}

void expect_near(const Pose& a, const Pose& b) {
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(a.translation[i], b.translation[i], 1e-13);
    for (int j = 0; j < 3; ++j)
      EXPECT_NEAR(a.rotation.column(j)[i], b.rotation.column(j)[i], 1e-14);
  }
}

TEST(CameraFiles, ColmapTextIsReadAgain) {
  const test::TempFolder folder;
  const std::vector<CameraOfPhoto> written = photos();
  write_colmap_text(folder / "model", written);
  const internal::ColmapModel model = internal::read_colmap_model(folder / "model");
  ASSERT_EQ(model.images.size(), written.size());
  EXPECT_EQ(model.cameras.size(), written.size() - 1);
  for (const CameraOfPhoto& photo : written) {
    const auto image = std::ranges::find_if(
        model.images, [&](const internal::ColmapImage& i) { return i.name == photo.name; });
    ASSERT_NE(image, model.images.end()) << photo.name;
    const Camera& camera = model.cameras[static_cast<size_t>(image->camera)];
    EXPECT_EQ(camera.model, photo.camera.model);
    EXPECT_EQ(camera.params, photo.camera.params);
    expect_near(image->pose, photo.pose);
  }
}

TEST(CameraFiles, TransformsSayTheSameLens) {
  const test::TempFolder folder;
  const std::vector<CameraOfPhoto> written = photos();
  write_transforms(folder / "transforms.json", written);
  const auto json = nlohmann::json::parse(read_text_file(folder / "transforms.json"));
  ASSERT_EQ(json["frames"].size(), written.size());
  for (size_t i = 0; i < written.size(); ++i) {
    const auto& frame = json["frames"][i];
    EXPECT_EQ(frame["file_path"], written[i].file);
    std::string warning;
    const Camera camera =
        internal::frame_camera({frame, nlohmann::json::object(), "frame"}, {640, 480}, &warning);
    EXPECT_EQ(warning, "");
    const Vec3d direction{0.2, -0.3, 1};
    const auto a = project(camera, direction), b = project(written[i].camera, direction);
    ASSERT_TRUE(a && b);
    EXPECT_NEAR(a->x, b->x, 1e-10) << i;
    EXPECT_NEAR(a->y, b->y, 1e-10) << i;
    EXPECT_EQ(frame["transform_matrix"][0][0], written[i].pose.rotation.m[0][0]);
    EXPECT_EQ(frame["transform_matrix"][1][1], -written[i].pose.rotation.m[1][1]);
    EXPECT_EQ(frame["transform_matrix"][2][3], written[i].pose.translation.z);
  }
  EXPECT_FALSE(transforms_know(CameraModel::kFov));
  std::vector<CameraOfPhoto> unknown = {written[0]};
  unknown[0].camera.model = CameraModel::kFov;
  EXPECT_THROW(write_transforms(folder / "t.json", unknown), Error);
}

}  // namespace
}  // namespace nerf
