#include "panorama_cuts.h"

#include <OpenImageIO/imageio.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "nerf/base/error.h"
#include "nerf/math/camera_paths.h"

namespace nerf::internal {
namespace {

constexpr int kFilmFocal = 17;                                     // mm, of a film 35 mm wide
constexpr int kLeastSide = 256;                                    // smaller ones hold no features
constexpr double kAgree = 2 * std::numbers::pi / 180;              // between two cuts' rotations
constexpr double kTurn = 2 * std::numbers::pi / kCutsPerPanorama;  // from cut to cut

double angle_between(const Mat3d& a, const Mat3d& b) {
  double trace = 0;
  for (int c = 0; c < 3; ++c) trace += dot(a.column(c), b.column(c));
  return std::acos(std::clamp(0.5 * (trace - 1), -1.0, 1.0));
}

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const size_t n = values.size();
  return 0.5 * (values[(n - 1) / 2] + values[n / 2]);
}

// Bilinear; round the seam, and no further than the poles.
void sample(const Image8& image, const Vec2d& at, uint8_t* out) {
  const double x = at.x - 0.5, y = std::clamp(at.y - 0.5, 0.0, image.height - 1.0);
  const int x0 = static_cast<int>(std::floor(x)), y0 = static_cast<int>(y);
  const double fx = x - x0, fy = y - y0;
  const auto pixel = [&](int u, int v) {
    u = (u + image.width) % image.width;
    v = std::min(v, image.height - 1);
    return image.pixels.data() +
           (static_cast<size_t>(v) * static_cast<size_t>(image.width) + static_cast<size_t>(u)) *
               static_cast<size_t>(image.channels);
  };
  const uint8_t *a = pixel(x0, y0), *b = pixel(x0 + 1, y0);
  const uint8_t *c = pixel(x0, y0 + 1), *d = pixel(x0 + 1, y0 + 1);
  for (int i = 0; i < image.channels; ++i)
    out[i] = static_cast<uint8_t>(std::lround(std::lerp(
        std::lerp(1.0 * a[i], 1.0 * b[i], fx), std::lerp(1.0 * c[i], 1.0 * d[i], fx), fy)));
}

}  // namespace

Mat3d cut_rotation(int k) {
  const double turn = kTurn * k, c = std::cos(turn), s = std::sin(turn);
  Mat3d r;
  r.set_column(0, {c, 0, -s});
  r.set_column(1, {0, 1, 0});
  r.set_column(2, {s, 0, c});
  return r;
}

Camera cut_camera(int panorama_width) {
  const double per_radian = panorama_width / (2 * std::numbers::pi);
  const int side =
      std::max(kLeastSide, static_cast<int>(std::lround(per_radian * 35 / kFilmFocal)));
  Camera camera;
  camera.model = CameraModel::kSimplePinhole;
  camera.width = camera.height = side;
  camera.params = {side * double{kFilmFocal} / 35, 0.5 * side, 0.5 * side};
  return camera;
}

Image8 cut_panorama(const Image8& image, int k, ThreadPool& pool) {
  const Camera around = panorama(image.width, image.height), camera = cut_camera(image.width);
  const Mat3d rotation = cut_rotation(k);
  Image8 cut{camera.width, camera.height, image.channels, {}};
  const size_t row = static_cast<size_t>(cut.width) * static_cast<size_t>(cut.channels);
  cut.pixels.resize(row * static_cast<size_t>(cut.height));
  pool.parallel_for(cut.height, [&](int64_t y) {
    uint8_t* out = cut.pixels.data() + static_cast<size_t>(y) * row;
    for (int x = 0; x < cut.width; ++x, out += cut.channels) {
      const auto direction = unproject(camera, {x + 0.5, static_cast<double>(y) + 0.5});
      sample(image, project(around, rotation * direction.value()).value(), out);
    }
  });
  return cut;
}

void write_cut(const std::filesystem::path& path, const Image8& cut) {
  OIIO::ImageSpec spec(cut.width, cut.height, std::min(cut.channels, 3), OIIO::TypeDesc::UINT8);
  spec.attribute("Compression", "jpeg:95");
  spec.attribute("Exif:FocalLengthIn35mmFilm", kFilmFocal);
  const auto out = OIIO::ImageOutput::create(path.string());
  if (!out || !out->open(path.string(), spec) ||
      !out->write_image(OIIO::TypeDesc::UINT8, cut.pixels.data(), cut.channels) || !out->close())
    throw Error("cannot write: " + (out ? out->geterror() : OIIO::geterror()), path.string());
}

std::optional<Pose> pose_from_cuts(std::span<const PlacedCut> cuts) {
  std::vector<Mat3d> rotations;  // of the panorama, as each of the cuts says
  for (const PlacedCut& c : cuts)
    rotations.push_back(c.pose.rotation * cut_rotation(c.cut).transposed());
  const auto agreeing = [&](size_t i) {
    std::vector<size_t> with;
    for (size_t j = 0; j < cuts.size(); ++j)
      if (angle_between(rotations[i], rotations[j]) < kAgree) with.push_back(j);
    return with;
  };
  std::vector<size_t> most;
  for (size_t i = 0; i < cuts.size(); ++i)
    if (auto with = agreeing(i); with.size() > most.size()) most = std::move(with);
  // One cut alone may be wrong, and its picture would be all around.
  if (most.size() < 2 || 2 * most.size() <= cuts.size()) return std::nullopt;

  Pose pose;
  pose.rotation = {};
  for (auto& r : pose.rotation.m) r.fill(0);
  std::array<std::vector<double>, 3> centres;
  for (const size_t i : most) {
    for (size_t r = 0; r < 3; ++r)
      for (size_t c = 0; c < 3; ++c)
        pose.rotation.m[r][c] += rotations[i].m[r][c] / static_cast<double>(most.size());
    for (int k = 0; k < 3; ++k)
      centres[static_cast<size_t>(k)].push_back(cuts[i].pose.translation[k]);
  }
  pose.rotation = orthonormalized(pose.rotation);
  for (int k = 0; k < 3; ++k) pose.translation[k] = median(centres[static_cast<size_t>(k)]);
  return pose;
}

}  // namespace nerf::internal
