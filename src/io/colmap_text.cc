// COLMAP's .txt files: one line per camera or point, two per image (its pose, then its 2D points,
// a line that may be empty). Lines that start with # are comments.
#include <fmt/format.h>

#include "colmap.h"
#include "nerf/base/file.h"

namespace nerf::internal {
namespace {

// COLMAP's comments say how many records follow ("# Number of images: 50, mean ..."): a file cut at
// the end of a line is told by nothing else. Edited by hand the comment may be old, so only warn.
class CountComment {
 public:
  void operator()(std::string_view comment) {
    const size_t start = comment.find("Number of ");
    const size_t colon = comment.find(": ");
    if (start == comment.npos || colon == comment.npos) return;
    const std::string_view digits = comment.substr(colon + 2);
    uint64_t value = 0;
    const auto result = std::from_chars(digits.data(), digits.data() + digits.size(), value);
    if (result.ec == std::errc()) expected_ = value, known_ = true;
  }
  void check(uint64_t found, const std::filesystem::path& file, ColmapBuilder& builder) const {
    if (!known_ || expected_ == found) return;
    builder.warn(fmt::format("{} announces {} records and has {}: it may be cut off", file.string(),
                             expected_, found));
  }

 private:
  uint64_t expected_ = 0;
  bool known_ = false;
};

}  // namespace

void read_colmap_cameras_text(const std::filesystem::path& file, ColmapBuilder& builder) {
  const std::string text = read_text_file(file);
  LineCursor in(file, text);
  CountComment comment;
  uint64_t count = 0;
  for (; in.next_data_line(comment); ++count) {
    const auto id = in.number<uint32_t>("a camera id");
    const std::string_view name = in.word("a camera model");
    const auto model = camera_model_from_name(name);
    if (!model) {
      in.fail("camera model " + printable(name) + " is not supported",
              "undistort the images with `colmap image_undistorter` of the COLMAP that wrote this "
              "model, and use its output");
    }
    const auto width = in.number<uint64_t>("an image width");
    const auto height = in.number<uint64_t>("an image height");
    std::array<double, kMaxCameraParams> params{};
    for (int p = 0; p < colmap_camera_params(*model); ++p) {
      params[static_cast<size_t>(p)] = in.number<double>("a camera parameter");
    }
    if (!in.at_line_end()) {
      in.fail(fmt::format("{} has {} parameters, the line has more", name,
                          colmap_camera_params(*model)));
    }
    builder.add_camera(in, id, *model, width, height, params);
  }
  comment.check(count, file, builder);
}

void read_colmap_images_text(const std::filesystem::path& file, ColmapBuilder& builder) {
  const std::string text = read_text_file(file);
  LineCursor in(file, text);
  CountComment comment;
  uint64_t count = 0;
  for (; in.next_data_line(comment); ++count) {
    const auto id = in.number<uint32_t>("an image id");
    std::array<double, 7> pose;
    for (double& value : pose) value = in.number<double>("a value of a pose");
    const auto camera = in.number<uint32_t>("a camera id");
    const std::string_view name = in.rest_of_line();
    if (name.empty()) in.fail("the line ends where an image name should be");
    builder.add_image(in, id, pose, camera, std::string(name));

    if (!in.next_line()) break;  // COLMAP's own reader takes a last image without 2D points
    uint64_t words = 0;
    for (LineCursor ahead = in; !ahead.at_line_end(); ++words) ahead.word("a 2D point");
    if (words % 3 != 0) {
      in.fail(fmt::format("{} values of 2D points, not a multiple of 3 (x, y, point id)", words),
              "every image has two lines, the second one may be empty");
    }
    for (uint64_t k = 0; k < words / 3; ++k) {
      const double x = in.number<double>("a 2D point's x");
      const double y = in.number<double>("a 2D point's y");
      const std::string_view id = in.word("a 2D point's id");  // -1: none
      uint64_t point = 0;
      const auto read = std::from_chars(id.data(), id.data() + id.size(), point);
      builder.add_keypoint({x, y}, read.ec == std::errc() ? point : ColmapBuilder::kNoPoint);
    }
  }
  comment.check(count, file, builder);
}

void read_colmap_points_text(const std::filesystem::path& file, ColmapBuilder& builder) {
  const std::string text = read_text_file(file);
  LineCursor in(file, text);
  CountComment comment;
  uint64_t count = 0;
  for (; in.next_data_line(comment); ++count) {
    const auto id = in.number<uint64_t>("a point id");
    Vec3d position;
    for (int k = 0; k < 3; ++k) position[k] = in.number<double>("a coordinate");
    for (int k = 0; k < 3; ++k) in.number<int>("a colour");
    builder.add_point(id, position, in.number<double>("a reprojection error"));
    while (!in.at_line_end()) {
      const auto image = in.number<uint32_t>("an image id of the track");
      builder.add_track(image, in.number<uint32_t>("a 2D point index of the track"));
    }
  }
  comment.check(count, file, builder);
}

}  // namespace nerf::internal
