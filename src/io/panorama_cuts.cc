#include "panorama_cuts.h"

#include <OpenImageIO/imageio.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "nerf/base/error.h"
#include "nerf/math/camera_paths.h"

namespace nerf::internal {
namespace {

constexpr int kLevelFocal = 17, kPoleFocal = 9;        // mm of film: 92 and 126 degrees across
constexpr int kLeastSide = 320;                        // smaller ones hold few features
constexpr double kAgree = 2 * std::numbers::pi / 180;  // between two cuts' rotations
constexpr double kTurn = 2 * std::numbers::pi / kLevelCuts;  // from cut to cut
constexpr int kPointsOfOne = 60;  // so many are not seen together by chance

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

// Weights of the samples at -1, 0, 1 and 2 for a place t in [0, 1): Catmull and Rom's cubic, which
// keeps what is linear, and detail better than linear interpolation where a picture is enlarged.
std::array<double, 4> cubic(double t) {
  return {0.5 * t * (-1 + t * (2 - t)), 0.5 * (2 + t * t * (-5 + 3 * t)),
          0.5 * t * (1 + t * (4 - 3 * t)), 0.5 * t * t * (-1 + t)};
}

// Round the seam, and no further than the poles.
void sample(const Image8& image, const Vec2d& at, uint8_t* out) {
  const double x = at.x - 0.5, y = at.y - 0.5;
  const int x0 = static_cast<int>(std::floor(x)), y0 = static_cast<int>(std::floor(y));
  const std::array<double, 4> wx = cubic(x - x0), wy = cubic(y - y0);
  std::array<double, 4> sum{};
  for (int j = 0; j < 4; ++j) {
    const int v = std::clamp(y0 + j - 1, 0, image.height - 1);
    for (int i = 0; i < 4; ++i) {
      const int u = (x0 + i - 1 + image.width) % image.width;
      const uint8_t* pixel =
          image.pixels.data() +
          (static_cast<size_t>(v) * static_cast<size_t>(image.width) + static_cast<size_t>(u)) *
              static_cast<size_t>(image.channels);
      const double weight = wx[static_cast<size_t>(i)] * wy[static_cast<size_t>(j)];
      for (int c = 0; c < image.channels; ++c) sum[static_cast<size_t>(c)] += weight * pixel[c];
    }
  }
  for (int c = 0; c < image.channels; ++c)
    out[c] = static_cast<uint8_t>(std::lround(std::clamp(sum[static_cast<size_t>(c)], 0.0, 255.0)));
}

}  // namespace

Mat3d cut_rotation(int k) {
  Mat3d r;
  if (k >= kLevelCuts) {
    const double down = k == kLevelCuts ? 1 : -1;  // y points down
    r.set_column(0, {1, 0, 0});
    r.set_column(1, {0, 0, -down});
    r.set_column(2, {0, down, 0});
    return r;
  }
  const double turn = kTurn * k, c = std::cos(turn), s = std::sin(turn);
  r.set_column(0, {c, 0, -s});
  r.set_column(1, {0, 1, 0});
  r.set_column(2, {s, 0, c});
  return r;
}

int cut_film_focal(int k) { return k < kLevelCuts ? kLevelFocal : kPoleFocal; }

Camera cut_camera(int panorama_width, int k) {
  const double per_radian = panorama_width / (2 * std::numbers::pi);
  const int focal = cut_film_focal(k);
  const int side = std::max(kLeastSide, static_cast<int>(std::lround(per_radian * 35 / focal)));
  Camera camera;
  camera.model = CameraModel::kSimplePinhole;
  camera.width = camera.height = side;
  camera.params = {side * double(focal) / 35, 0.5 * side, 0.5 * side};
  return camera;
}

Image8 cut_panorama(const Image8& image, int k, ThreadPool& pool) {
  const Camera around = panorama(image.width, image.height), camera = cut_camera(image.width, k);
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

void write_cut(const std::filesystem::path& path, int k, const Image8& cut) {
  OIIO::ImageSpec spec(cut.width, cut.height, std::min(cut.channels, 3), OIIO::TypeDesc::UINT8);
  spec.attribute("Compression", "jpeg:95");
  spec.attribute("Exif:FocalLengthIn35mmFilm", cut_film_focal(k));
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
  // One cut alone that sees little may be wrong, and its picture would be all around.
  if (cuts.empty() || 2 * most.size() <= cuts.size()) return std::nullopt;
  if (most.size() < 2 && cuts[most[0]].points < kPointsOfOne) return std::nullopt;

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
