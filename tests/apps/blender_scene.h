// For tests: the sphere of support/synthetic_scene.h as a Blender capture on disk.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "nerf/base/file.h"
#include "nerf/io/image.h"
#include "support/synthetic_scene.h"

namespace nerf::test {

// `views` photos of `size` pixels, every 4th in the test file.
inline void write_blender_scene(const std::filesystem::path& folder, int views = 8, int size = 32) {
  const SyntheticCapture capture = sphere_capture(views, size);
  for (const bool test : {false, true}) {
    const std::string split = test ? "test" : "train";
    std::filesystem::create_directories(folder / split);
    nlohmann::json frames = nlohmann::json::array();
    for (const int v : test ? capture.scene.test : capture.scene.train) {
      const View& view = capture.scene.views[static_cast<size_t>(v)];
      const Photo& photo = capture.photos.photos[static_cast<size_t>(v)];
      write_image(folder / split / (view.name + ".png"),
                  {photo.width, photo.height, photo.channels, photo.pixels8});
      nlohmann::json matrix = nlohmann::json::array();
      for (int r = 0; r < 3; ++r) {
        const auto& row = view.pose.rotation.m[static_cast<size_t>(r)];
        // OpenGL's axes: y up, z backwards.
        matrix.push_back({row[0], -row[1], -row[2], view.pose.translation[r]});
      }
      matrix.push_back({0, 0, 0, 1});
      frames.push_back(
          {{"file_path", "./" + split + "/" + view.name}, {"transform_matrix", matrix}});
    }
    const nlohmann::json file = {{"camera_angle_x", kFieldOfView}, {"frames", frames}};
    write_file_atomically(folder / ("transforms_" + split + ".json"), file.dump());
  }
}

}  // namespace nerf::test
