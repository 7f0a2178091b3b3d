#include "exr_header.h"

#include <OpenEXR/ImfChromaticities.h>
#include <OpenEXR/ImfMatrixAttribute.h>
#include <OpenEXR/ImfStandardAttributes.h>
#include <OpenEXR/ImfStringAttribute.h>
#include <OpenEXR/ImfVecAttribute.h>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cmath>
#include <numbers>

namespace nerf::internal {

namespace {

constexpr double kFilmWidth = 36;  // mm

void set_text(Imf::Header& header, const std::string& name, const std::string& text) {
  header.insert(name, Imf::StringAttribute(text));
}

// Whether straight lines stay straight.
bool is_pinhole(const Camera& camera) {
  return camera.model == CameraModel::kPinhole || camera.model == CameraModel::kSimplePinhole;
}

// Points are rows, as in Imath: p' = p M.
Imath::M44f world_to_camera(const Pose& camera_to_world) {
  const Pose to = camera_to_world.inverse();  // x right, y down, z forward
  Imath::M44f m;
  for (int axis = 0; axis < 3; ++axis) {
    const double sign = axis == 1 ? -1 : 1;  // y up
    for (int k = 0; k < 3; ++k) m[k][axis] = static_cast<float>(sign * to.rotation.m[axis][k]);
    m[3][axis] = static_cast<float>(sign * to.translation[axis]);
  }
  return m;
}

// In front of the camera w is the depth, and x / w and y / w go from 0 to 1 over the picture.
Imath::M44f world_to_ndc(const Camera& camera, const Pose& camera_to_world) {
  const Pose to = camera_to_world.inverse();
  const double w = camera.width, h = camera.height;
  const double rows[4][3] = {{camera.fx() / w, 0, camera.cx() / w},
                             {0, camera.fy() / h, camera.cy() / h},
                             {0, 0, 1},
                             {0, 0, 1}};
  Imath::M44f m;
  for (int r = 0; r < 4; ++r)
    for (int c = 0; c < 4; ++c) {
      double sum = 0;
      for (int k = 0; k < 3; ++k)
        sum += rows[r][k] * (c < 3 ? to.rotation.m[k][c] : to.translation[k]);
      m[c][r] = static_cast<float>(sum);
    }
  return m;
}

// Rows of the matrix that leads columns from the camera's axes (y up, z backward) to the world.
std::string nuke_matrix(const Pose& pose) {
  std::vector<double> numbers;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) numbers.push_back((c == 0 ? 1 : -1) * pose.rotation.m[r][c]);
    numbers.push_back(pose.translation[r]);
  }
  numbers.insert(numbers.end(), {0, 0, 0, 1});
  return fmt::format("[{}]", fmt::join(numbers, ", "));
}

void add_lens(Imf::Header& header, const Camera& camera) {
  const double w = camera.width, h = camera.height;
  const double focal = kFilmWidth * camera.fx() / w;
  set_text(header, "nuke/camera/focal", fmt::format("{}", focal));
  set_text(header, "nuke/camera/haperture", fmt::format("{}", kFilmWidth));
  set_text(header, "nuke/camera/vaperture", fmt::format("{}", focal * h / camera.fy()));
  header.insert("nerf/focalLength", Imf::V2fAttribute({static_cast<float>(camera.fx()),
                                                       static_cast<float>(camera.fy())}));
  header.insert("nerf/principalPoint", Imf::V2fAttribute({static_cast<float>(camera.cx()),
                                                          static_cast<float>(camera.cy())}));
}

}  // namespace

Imf::Header exr_header(int width, int height, const ExrHeader& given) {
  const Camera& camera = given.camera;
  const bool pinhole = given.single_eye && is_pinhole(camera);
  // The plane at distance 1, whose x and y point left and up (OpenEXR's technical introduction).
  const Imath::V2f centre =
      pinhole ? Imath::V2f(static_cast<float>((camera.cx() - 0.5 * width) / camera.fx()),
                           static_cast<float>((camera.cy() - 0.5 * height) / camera.fy()))
              : Imath::V2f(0, 0);
  Imf::Header header(width, height, 1, centre,
                     pinhole ? static_cast<float>(width / camera.fx()) : 1.0f, Imf::INCREASING_Y,
                     Imf::ZIP_COMPRESSION);
  Imf::addChromaticities(header, Imf::Chromaticities());  // Rec. 709, D65: sRGB's
  if (given.single_eye) {
    Imf::addWorldToCamera(header, world_to_camera(given.camera_to_world));
    if (pinhole) Imf::addWorldToNDC(header, world_to_ndc(camera, given.camera_to_world));
    set_text(header, "nuke/camera/matrix", nuke_matrix(given.camera_to_world));
    if (!is_panorama(camera)) add_lens(header, camera);
    const double azimuths = is_panorama(camera) ? camera.width / camera.fx() : 0;
    if (std::abs(azimuths - 2 * std::numbers::pi) < 1e-6)
      Imf::addEnvmap(header, Imf::ENVMAP_LATLONG);
  }
  const auto parameters = static_cast<size_t>(camera_model_params(camera.model));
  set_text(header, "nerf/lens",
           fmt::format("{} {} {} {}", camera_model_name(camera.model), camera.width, camera.height,
                       fmt::join(std::span(camera.params).first(parameters), " ")));
  set_text(
      header, "nerf/colour",
      "linear light, Rec. 709 primaries, times opacity, before any background; sRGB's transfer "
      "function (IEC 61966-2-1) was decoded");
  set_text(header, "nerf/unit",
           "that of the capture the model was trained on; 0 where there is no surface");
  set_text(header, "nerf/axes",
           "normal: the capture's; normal_camera: x right, y up, z towards the camera");
  for (const auto& [name, text] : given.texts) set_text(header, name, text);
  return header;
}

}  // namespace nerf::internal
