// COLMAP's .bin files. All values little-endian:
//   cameras   u64 n, n x (u32 id, i32 model, u64 width, u64 height, f64 params[])
//   images    u64 n, n x (u32 id, f64 qw qx qy qz tx ty tz, u32 camera, name \0,
//                         u64 m, m x (f64 x y, u64 point))
//   points3D  u64 n, n x (u64 id, f64 x y z, u8 r g b, f64 error,
//                         u64 m, m x (u32 image, u32 index))
#include "colmap.h"
#include "nerf/base/file.h"

namespace nerf::internal {

void read_colmap_cameras_binary(const std::filesystem::path& file, ColmapBuilder& builder) {
  const auto bytes = read_file(file);
  ByteCursor in(file, bytes);
  const uint64_t count = in.read_count("the number of cameras", 4 + 4 + 8 + 8 + 2 * 8);
  for (uint64_t i = 0; i < count; ++i) {
    in.begin_record();
    const auto id = in.read<uint32_t>("a camera");
    const CameraModel model = colmap_camera_model(in, in.read<int32_t>("a camera"));
    const auto width = in.read<uint64_t>("a camera");
    const auto height = in.read<uint64_t>("a camera");
    std::array<double, kMaxCameraParams> params{};
    for (int p = 0; p < colmap_camera_params(model); ++p) {
      params[static_cast<size_t>(p)] = in.read<double>("a camera's parameters");
    }
    builder.add_camera(in, id, model, width, height, params);
  }
  in.expect_end();
}

void read_colmap_images_binary(const std::filesystem::path& file, ColmapBuilder& builder) {
  const auto bytes = read_file(file);
  ByteCursor in(file, bytes);
  const uint64_t count = in.read_count("the number of images", 4 + 7 * 8 + 4 + 1 + 8);
  for (uint64_t i = 0; i < count; ++i) {
    in.begin_record();
    const auto id = in.read<uint32_t>("an image");
    std::array<double, 7> pose;
    for (double& value : pose) value = in.read<double>("an image's pose");
    const auto camera = in.read<uint32_t>("an image");
    builder.add_image(in, id, pose, camera, in.read_text("an image's name"));
    const uint64_t points = in.read_count("the number of 2D points", 3 * 8);
    for (uint64_t k = 0; k < points; ++k) {
      const auto x = in.read<double>("an image's 2D points");
      const auto y = in.read<double>("an image's 2D points");
      builder.add_keypoint({x, y}, in.read<uint64_t>("an image's 2D points"));
    }
  }
  in.expect_end();
}

void read_colmap_points_binary(const std::filesystem::path& file, ColmapBuilder& builder) {
  const auto bytes = read_file(file);
  ByteCursor in(file, bytes);
  const uint64_t count = in.read_count("the number of points", 8 + 3 * 8 + 3 + 8 + 8);
  for (uint64_t i = 0; i < count; ++i) {
    in.begin_record();
    const auto id = in.read<uint64_t>("a point");
    Vec3d position;
    for (int k = 0; k < 3; ++k) position[k] = in.read<double>("a point");
    in.skip(3, "a point's colour");
    builder.add_point(id, position, in.read<double>("a point"));
    const uint64_t track = in.read_count("the length of a point's track", 8);
    for (uint64_t k = 0; k < track; ++k) {
      const auto image = in.read<uint32_t>("a point's track");
      builder.add_track(image, in.read<uint32_t>("a point's track"));
    }
  }
  in.expect_end();
}

}  // namespace nerf::internal
