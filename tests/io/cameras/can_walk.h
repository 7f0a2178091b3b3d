// A walk around a can, whose print may repeat on its other side: colmap's database and models.
#pragma once

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <numbers>
#include <string>
#include <vector>

#include "io/cameras/made_database.h"
#include "io/test_scenes.h"

namespace nerf::test {

// Photos "00.jpg", "01.jpg", .. have the ids 1, 2, ..
struct CanWalk {
  static constexpr int kPhotos = 40, kHalf = kPhotos / 2;
  static constexpr double kFocal = 350;

  // A point of the scene and the feature that it gives: twins on the can have the same one.
  struct Landmark {
    Vec3d position, normal;
    int feature;
  };

  static std::vector<Landmark> landmarks(bool repeats) {
    std::vector<Landmark> out;
    int feature = 0;
    // The can's print: halfway round it comes again.
    for (int i = 0; i < 200; ++i, ++feature)
      for (const int half : {0, 1}) {
        const double a = std::numbers::pi * (std::fmod(i * 0.618, 1.0) + half);
        const Vec3d normal{std::cos(a), std::sin(a), 0};
        out.push_back(
            {normal * 0.8 + Vec3d{0, 0, std::fmod(i * 0.754, 1.0) - 0.5}, normal, feature});
        if (!repeats && half == 0) ++feature;
      }
    for (int i = 0; i < 600; ++i, ++feature) {  // walls
      const double a = 2 * std::numbers::pi * std::fmod(i * 0.618, 1.0);
      const Vec3d normal{-std::cos(a), -std::sin(a), 0};
      out.push_back(
          {normal * -9 + Vec3d{0, 0, 6 * std::fmod(i * 0.754, 1.0) - 3}, normal, feature});
    }
    return out;
  }

  static Pose place(int photo) {
    const double a = 2 * std::numbers::pi * photo / kPhotos;
    return look_at(Vec3d{std::cos(a), std::sin(a), 0.3} * 4, {0, 0, 0});
  }
  static std::string name(int photo) { return fmt::format("{:02}.jpg", photo); }

  static int as_numbered(int photo) { return photo; }

  // Photo i is called name_of(i) and was taken where photo `stands_at(i)` stands.
  static void write_database(const std::filesystem::path& file, bool repeats,
                             std::string (*name_of)(int) = name,
                             int (*stands_at)(int) = as_numbered) {
    const std::vector<Landmark> scene = landmarks(repeats);
    MadeDatabase made(file);
    made.run("BEGIN");  // all at once, or each row waits for the disk
    std::vector<std::map<int, uint32_t>> seen(kPhotos);  // feature: its place among keypoints
    for (int i = 0; i < kPhotos; ++i) {
      const int64_t id = made.add_image(name_of(i), {});
      EXPECT_EQ(id, i + 1);
      const Pose pose = place(stands_at(i));
      std::vector<std::array<float, 4>> keypoints;
      for (const Landmark& landmark : scene) {
        const Vec3d d = pose.inverse() * landmark.position;
        const Vec3d back = normalized(pose.translation - landmark.position);
        const double x = kFocal * d.x / d.z + 200, y = kFocal * d.y / d.z + 150;
        if (d.z <= 0 || dot(back, landmark.normal) < 0.3 || x < 0 || y < 0 || x >= 400 || y >= 300)
          continue;
        seen[static_cast<size_t>(i)][landmark.feature] = static_cast<uint32_t>(keypoints.size());
        keypoints.push_back({static_cast<float>(x), static_cast<float>(y), 1, 0});
      }
      made.add_keypoints(id, keypoints);
    }
    for (int i = 0; i < kPhotos; ++i)
      for (int j = i + 1; j < kPhotos; ++j) {
        std::vector<std::array<uint32_t, 2>> matches;
        for (const auto& [feature, at] : seen[static_cast<size_t>(i)])
          if (const auto other = seen[static_cast<size_t>(j)].find(feature);
              other != seen[static_cast<size_t>(j)].end())
            matches.push_back({at, other->second});
        // Between the two kinds of pairs lie those whose geometry mixes both.
        const int steps = std::abs(stands_at(j) - stands_at(i));
        const int apart = std::min(steps, kPhotos - steps);
        const bool kept = apart <= kHalf / 3 || (repeats && apart >= kHalf - kHalf / 3);
        if (kept && matches.size() >= 15) made.add_verified(i + 1, j + 1, matches);
      }
    made.run("COMMIT");
  }

  // The model puts photo i where photo `stands_at(i)` stands.
  static void write_model(const std::filesystem::path& folder, int (*stands_at)(int),
                          std::string (*name_of)(int) = name) {
    TestModel model;
    model.cameras.push_back({1, 1, 400, 300, {kFocal, kFocal, 200, 150}});
    for (int i = 0; i < kPhotos; ++i) {
      TestImage image;
      image.id = static_cast<uint32_t>(i) + 1;
      image.name = name_of(i);
      image.pose = colmap_pose(place(stands_at(i)));
      image.points2d.clear();
      model.images.push_back(image);
    }
    write_binary(model, folder);
  }
};

}  // namespace nerf::test
