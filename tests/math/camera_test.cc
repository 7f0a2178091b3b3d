#include "nerf/math/camera.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <limits>
#include <numbers>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "support/cameras.h"

namespace nerf {
namespace {

using test::make_camera;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();

// One lens of each model, with every coefficient in use.
std::vector<Camera> all_cameras() {
  using enum CameraModel;
  return {
      make_camera(kSimplePinhole, {501, 322, 238}),
      make_camera(kPinhole, {501, 498, 322, 238}),
      make_camera(kSimpleRadial, {501, 322, 238, -0.09}),
      make_camera(kRadial, {501, 322, 238, 0.11, -0.02}),
      make_camera(kOpenCV, {501, 498, 322, 238, -0.1, 0.04, 0.002, -0.003}),
      make_camera(kOpenCVFisheye, {301, 298, 322, 238, 0.02, -0.01, 0.004, -0.0005}),
      make_camera(kFullOpenCV,
                  {501, 498, 322, 238, 0.3, 0.05, 0.001, -0.001, 0.003, 0.4, 0.08, 0.002}),
      make_camera(kFov, {501, 498, 322, 238, 0.9}),
      make_camera(kSimpleRadialFisheye, {301, 322, 238, -0.02}),
      make_camera(kRadialFisheye, {301, 322, 238, 0.02, -0.004}),
      make_camera(kThinPrismFisheye, {301, 298, 322, 238, 0.02, -0.01, 0.001, -0.001, 0.003,
                                      -0.0004, 0.0007, -0.0005}),
      make_camera(kRadTanThinPrismFisheye,
                  {301, 298, 322, 238, 0.02, -0.02, 0.007, -0.002, 0.0004, -0.00003, 0.001, -0.0008,
                   0.0006, -0.0002, -0.0004, 0.0003}),
      make_camera(kEquirectangular,
                  {320 / std::numbers::pi, 480 / std::numbers::pi, 320, 240, 0.03}),
  };
}

bool is_wide(CameraModel model) {
  return model == CameraModel::kEquirectangular ||
         camera_model_name(model).find("FISHEYE") != std::string_view::npos;
}

TEST(CameraModelTable, IdsAndNamesRoundTrip) {
  for (int id = 0; id < 12; ++id) {
    const auto model = camera_model_from_id(id);
    ASSERT_TRUE(model) << id;
    EXPECT_EQ(static_cast<int>(*model), id);
    EXPECT_EQ(camera_model_from_name(camera_model_name(*model)), model);
    EXPECT_LE(camera_model_params(*model), kMaxCameraParams);
  }
  EXPECT_EQ(camera_model_name(CameraModel::kFullOpenCV), "FULL_OPENCV");
  EXPECT_EQ(camera_model_params(CameraModel::kRadTanThinPrismFisheye), 16);
  EXPECT_FALSE(camera_model_from_id(-1));
  EXPECT_FALSE(camera_model_from_id(12));
  EXPECT_EQ(camera_model_from_id(17), CameraModel::kEquirectangular);
  EXPECT_EQ(camera_model_from_name("EQUIRECTANGULAR"), CameraModel::kEquirectangular);
  EXPECT_FALSE(camera_model_from_id(18));
  EXPECT_FALSE(camera_model_from_id(int64_t{1} << 40));
  EXPECT_FALSE(camera_model_from_name("opencv"));
  EXPECT_FALSE(camera_model_from_name(""));
}

TEST(Camera, MatchesGoldenPixels) {
  std::ifstream file(std::string(NERF_SOURCE_DIR) + "/tests/golden/camera_models.txt");
  ASSERT_TRUE(file);
  int lines = 0;
  std::array<int, 12> seen{};
  for (std::string line; std::getline(file, line); ++lines) {
    std::istringstream in(line);
    std::string name;
    Camera camera;
    int count = 0;
    in >> name >> camera.width >> camera.height >> count;
    const auto model = camera_model_from_name(name);
    ASSERT_TRUE(model) << name;
    ASSERT_EQ(count, camera_model_params(*model));
    camera.model = *model;
    ++seen[static_cast<size_t>(*model)];
    for (int i = 0; i < count; ++i) in >> camera.params[static_cast<size_t>(i)];
    Vec3d d;
    Vec2d expected;
    in >> d.x >> d.y >> d.z >> expected.x >> expected.y;
    ASSERT_TRUE(in) << line;
    const auto pixel = project(camera, d);
    ASSERT_TRUE(pixel) << line;
    EXPECT_NEAR(pixel->x, expected.x, 1e-9) << line;
    EXPECT_NEAR(pixel->y, expected.y, 1e-9) << line;
  }
  EXPECT_GE(lines, 80);
  for (int id = 0; id < 12; ++id) EXPECT_GE(seen[static_cast<size_t>(id)], 6) << id;
}

TEST(Camera, ProjectInvertsUnprojectOverTheImage) {
  for (const Camera& camera : all_cameras()) {
    SCOPED_TRACE(camera_model_name(camera.model));
    for (int j = 0; j <= 12; ++j) {
      for (int i = 0; i <= 16; ++i) {
        const Vec2d pixel{i * 40.0, j * 40.0};
        const auto d = unproject(camera, pixel);
        ASSERT_TRUE(d) << pixel.x << " " << pixel.y;
        if (is_wide(camera.model)) {
          EXPECT_NEAR(length(*d), 1, 1e-12);
        } else {
          EXPECT_EQ(d->z, 1);
        }
        const auto back = project(camera, *d);
        ASSERT_TRUE(back) << pixel.x << " " << pixel.y;
        EXPECT_NEAR(back->x, pixel.x, 1e-8);
        EXPECT_NEAR(back->y, pixel.y, 1e-8);
      }
    }
  }
}

TEST(Camera, UnprojectInvertsProjectOverDirections) {
  for (const Camera& camera : all_cameras()) {
    SCOPED_TRACE(camera_model_name(camera.model));
    const double max_angle = is_wide(camera.model) ? 1.3 : 0.7;
    for (int ring = 0; ring <= 8; ++ring) {
      for (int k = 0; k < 12; ++k) {
        const double theta = max_angle * ring / 8, phi = k * std::numbers::pi / 6;
        // Any length: a direction is not a point.
        const Vec3d d = Vec3d{std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi),
                              std::cos(theta)} *
                        (0.1 + k);
        const auto pixel = project(camera, d);
        ASSERT_TRUE(pixel) << theta << " " << phi;
        const auto back = unproject(camera, *pixel);
        ASSERT_TRUE(back) << theta << " " << phi;
        EXPECT_LT(length(normalized(*back) - normalized(d)), 1e-10) << theta << " " << phi;
      }
    }
  }
}

TEST(Camera, ARowIsItsPixelsUnprojected) {
  for (Camera camera : all_cameras()) {
    SCOPED_TRACE(camera_model_name(camera.model));
    // From beyond the left border to beyond the right one, where some lenses see nothing.
    constexpr int kFirst = -2000;
    std::vector<Vec3d> row(5000);
    for (const int y : {-1500, 0, 479}) {
      unproject_row(camera, kFirst, y, row);
      for (size_t i = 0; i < row.size(); i += 7) {
        const auto d = unproject(camera, {kFirst + static_cast<double>(i) + 0.5, y + 0.5});
        EXPECT_EQ(row[i], d ? normalized(*d) : Vec3d()) << i << ' ' << y;
      }
    }
    camera.params[0] = kNan;
    unproject_row(camera, 0, 0, row);
    EXPECT_EQ(row[0], Vec3d());
  }
}

TEST(Camera, FisheyeSeesBehindThePlaneThatAPinholeDoesNot) {
  const Camera fisheye = make_camera(CameraModel::kOpenCVFisheye, {300, 300, 320, 240, 0, 0, 0, 0});
  const Vec3d behind{1, 0, -0.5};
  const auto pixel = project(fisheye, behind);
  ASSERT_TRUE(pixel);
  EXPECT_NEAR(pixel->x, 320 + 300 * std::atan2(1, -0.5), 1e-9);
  const auto back = unproject(fisheye, *pixel);
  ASSERT_TRUE(back);
  EXPECT_LT(length(*back - normalized(behind)), 1e-12);
  EXPECT_FALSE(project(fisheye, {0, 0, -1}));                // a whole circle of the image
  EXPECT_FALSE(unproject(fisheye, {320 + 300 * 3.2, 240}));  // an angle beyond 180 degrees

  const Camera pinhole = make_camera(CameraModel::kPinhole, {300, 300, 320, 240});
  EXPECT_FALSE(project(pinhole, behind));
  EXPECT_FALSE(project(pinhole, {1, 1, 0}));
}

// k = -0.3: r + k r^3 rises until r = sqrt(1/0.9) and folds back beyond it.
TEST(Camera, RejectsWhatLiesBeyondTheFoldOfARadialDistortion) {
  const Camera camera = make_camera(CameraModel::kSimpleRadial, {500, 320, 240, -0.3});
  const double fold = std::sqrt(1 / 0.9);
  EXPECT_TRUE(project(camera, {fold * 0.999, 0, 1}));
  EXPECT_FALSE(project(camera, {fold * 1.001, 0, 1}));
  const double edge = 500 * fold * (1 - 0.3 * fold * fold);
  const auto inside = unproject(camera, {320, 240 + edge * 0.999});
  ASSERT_TRUE(inside);
  EXPECT_LT(inside->y, fold);
  EXPECT_FALSE(unproject(camera, {320, 240 + edge * 1.001}));
  EXPECT_FALSE(unproject(camera, {-4000, 240}));
}

// The slope 1 + 3 k1 s + 5 k2 s^2 dips below zero between s = 0.63 and 1.27 only: a point beyond
// the dip has a rising slope again but two more directions share its pixel.
TEST(Camera, RejectsWhatLiesBeyondADipOfTheSlope) {
  const Camera camera = make_camera(CameraModel::kRadial, {500, 320, 240, -0.79, 0.249});
  const auto slope = [](double s) { return 1 - 3 * 0.79 * s + 5 * 0.249 * s * s; };
  ASSERT_GT(slope(2.25), 0);
  ASSERT_LT(slope(1.0), 0);
  EXPECT_FALSE(project(camera, {1.5, 0, 1}));
  EXPECT_TRUE(project(camera, {0.7, 0, 1}));
  EXPECT_FALSE(project(camera, {0, 1.0, 1}));
  // Its pixel, unprojected, may only give the direction of the first branch, or nothing.
  const double rd = 1.5 * (1 - 0.79 * 2.25 + 0.249 * 2.25 * 2.25);
  const auto d = unproject(camera, {320 + 500 * rd, 240});
  if (d) {
    EXPECT_LT(d->x * d->x, 0.7);
  }
}

// 1 + k1 s + k2 s^2 that only just stays monotonic: decided by subdivision, not by the quick bound.
TEST(Camera, AcceptsADipThatStaysAboveZero) {
  // slope = 1 - 1.9 s + 0.95 s^2 = 0.95 (s - 1)^2 + 0.05.
  const Camera camera = make_camera(CameraModel::kRadial, {500, 320, 240, -1.9 / 3, 0.95 / 5});
  for (double r : {0.5, 0.99, 1.0, 1.2, 1.8}) {
    const auto pixel = project(camera, {0, r, 1});
    ASSERT_TRUE(pixel) << r;
    const auto back = unproject(camera, *pixel);
    ASSERT_TRUE(back) << r;
    EXPECT_NEAR(back->y, r, 1e-9);
  }
}

TEST(Camera, RejectsThePoleOfARationalDistortion) {
  // Denominator 1 - 0.5 s has its pole at r = sqrt(2).
  const Camera camera =
      make_camera(CameraModel::kFullOpenCV, {500, 500, 320, 240, 0, 0, 0, 0, 0, -0.5, 0, 0});
  EXPECT_TRUE(project(camera, {1.3, 0, 1}));
  EXPECT_FALSE(project(camera, {1.5, 0, 1}));
  const auto d = unproject(camera, {320 + 500 * 1.3 / (1 - 0.5 * 1.69), 240});
  ASSERT_TRUE(d);
  EXPECT_NEAR(d->x, 1.3, 1e-9);
}

// r N/D with the first zero and the first two poles of tan(r): rising again between the poles, with
// a positive factor from its zero on, yet on another branch.
TEST(Camera, RejectsTheBranchBehindAPole) {
  const double a = 1 / (std::numbers::pi * std::numbers::pi);
  const Camera camera =
      make_camera(CameraModel::kFullOpenCV,
                  {500, 500, 320, 240, -a, 0, 0, 0, 0, -4 * a - 4 * a / 9, 16 * a * a / 9, 0});
  EXPECT_TRUE(project(camera, {1.4, 0, 1}));
  EXPECT_FALSE(project(camera, {2.0, 0, 1}));
  EXPECT_FALSE(project(camera, {std::sqrt(10.5), 0, 1}));
}

TEST(Camera, FovIsExactForAnyOmega) {
  for (double omega : {0.0, 1e-12, 1e-5, 0.009, 0.011, 0.5, 1.5, -0.5}) {
    const Camera camera = make_camera(CameraModel::kFov, {500, 500, 320, 240, omega});
    for (double r : {0.0, 1e-9, 0.005, 0.02, 0.8}) {
      const auto pixel = project(camera, {r, 0, 1});
      ASSERT_TRUE(pixel) << omega << " " << r;
      const double w = std::abs(omega);
      const double expected = w == 0 ? r : std::atan(2 * r * std::tan(w / 2)) / w;
      if (w == 0 || w > 1e-6) {
        EXPECT_NEAR(pixel->x, 320 + 500 * expected, 1e-9) << omega;
      }
      const auto back = unproject(camera, *pixel);
      ASSERT_TRUE(back) << omega << " " << r;
      EXPECT_NEAR(back->x, r, 1e-12);
    }
  }
  // Image radius beyond pi / (2 omega) has no direction.
  const Camera camera = make_camera(CameraModel::kFov, {500, 500, 320, 240, 1.5});
  EXPECT_FALSE(unproject(camera, {320 + 500 * 1.05, 240}));
  EXPECT_TRUE(unproject(camera, {320 + 500 * 1.04, 240}));
}

TEST(Camera, InvalidInputHasNoValue) {
  for (const Camera& good : all_cameras()) {
    SCOPED_TRACE(camera_model_name(good.model));
    EXPECT_FALSE(project(good, {0, 0, 0}));
    EXPECT_FALSE(project(good, {kNan, 0, 1}));
    EXPECT_FALSE(project(good, {0, kInf, 1}));
    EXPECT_FALSE(unproject(good, {kNan, 1}));
    EXPECT_FALSE(unproject(good, {1, -kInf}));
    for (int i = 0; i < camera_model_params(good.model); ++i) {
      Camera bad = good;
      bad.params[static_cast<size_t>(i)] = kNan;
      EXPECT_FALSE(project(bad, {0.1, 0.1, 1})) << i;
      EXPECT_FALSE(unproject(bad, {300, 200})) << i;
    }
    for (double focal : {0.0, -500.0}) {
      Camera bad = good;
      bad.params[0] = focal;
      EXPECT_FALSE(project(bad, {0.1, 0.1, 1}));
      EXPECT_FALSE(unproject(bad, {300, 200}));
    }
  }
}

TEST(Camera, ScaledToKeepsTheRayOfEveryRelativePosition) {
  for (const Camera& camera : all_cameras()) {
    SCOPED_TRACE(camera_model_name(camera.model));
    for (const auto& [w, h] : {std::pair{320, 240}, {160, 121}, {1283, 959}}) {
      const Camera scaled = camera.scaled_to(w, h);
      EXPECT_EQ(scaled.width, w);
      EXPECT_EQ(scaled.height, h);
      for (const Vec2d pixel : {Vec2d{0, 0}, Vec2d{640, 480}, Vec2d{100.5, 400.5}}) {
        const auto d = unproject(camera, pixel);
        const auto e = unproject(scaled, {pixel.x * w / 640, pixel.y * h / 480});
        ASSERT_TRUE(d && e);
        EXPECT_LT(length(*d - *e), 1e-11);
      }
    }
  }
}

TEST(Camera, RowsAreAPartOfTheSamePicture) {
  for (const Camera& camera : all_cameras()) {
    SCOPED_TRACE(camera_model_name(camera.model));
    const Camera part = camera.rows(130, 77);
    EXPECT_EQ(part.width, camera.width);
    EXPECT_EQ(part.height, 77);
    for (const Vec2d pixel : {Vec2d{0, 0}, Vec2d{640, 77}, Vec2d{100.5, 40.5}}) {
      const auto d = unproject(camera, {pixel.x, pixel.y + 130});
      const auto e = unproject(part, pixel);
      ASSERT_TRUE(d && e);
      EXPECT_LT(length(*d - *e), 1e-11);
    }
  }
  EXPECT_THROW(all_cameras().front().rows(470, 11), std::logic_error);
}

TEST(Camera, ScaledToKeepsOneFocalLengthWhereRatiosAreEqual) {
  const Camera camera = make_camera(CameraModel::kSimpleRadial, {501, 322, 238, -0.09});
  const Camera half = camera.scaled_to(320, 240);
  EXPECT_EQ(half.model, CameraModel::kSimpleRadial);
  EXPECT_EQ(half.fx(), 250.5);
  EXPECT_EQ(half.cy(), 119);
  const Camera uneven = camera.scaled_to(320, 241);
  EXPECT_EQ(uneven.model, CameraModel::kOpenCV);
  EXPECT_DOUBLE_EQ(uneven.fy(), 501.0 * 241 / 480);
  EXPECT_DOUBLE_EQ(uneven.cx(), 161);
  EXPECT_EQ(uneven.params[4], -0.09);
  EXPECT_EQ(uneven.params[5], 0);
  EXPECT_EQ(make_camera(CameraModel::kSimplePinhole, {5, 3, 2}).scaled_to(640, 240).model,
            CameraModel::kPinhole);
  EXPECT_EQ(make_camera(CameraModel::kRadialFisheye, {5, 3, 2, 0, 0}).scaled_to(640, 240).model,
            CameraModel::kOpenCVFisheye);
  EXPECT_THROW(camera.scaled_to(0, 10), std::logic_error);
}

}  // namespace
}  // namespace nerf
