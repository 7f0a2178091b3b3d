// Photos to a model with the installed colmap.
#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "nerf/base/process.h"
#include "nerf/io/capture_tools.h"
#include "test_images.h"

namespace nerf {
namespace {

namespace fs = std::filesystem;
using test::contains;
using test::make_image;
using test::TempFolder;

// A room's corner with paint on its walls, seen from a row of places.
float corner(double camera_x, int px, int py, int c) {
  const double dx = (px - 159.5) / 280, dy = (py - 119.5) / 280;
  // Walls x = 3, y = 1 (floor), z = 4 of camera axes moved along x; the nearest that is hit.
  double t = 4;
  if (dx > 0) t = std::min(t, (3 - camera_x) / dx);
  if (dy > 0) t = std::min(t, 1 / dy);
  const double x = camera_x + t * dx, y = t * dy, z = t;
  const auto cell = [&](double scale) {
    auto h = static_cast<uint32_t>(std::floor(x * scale) * 73856093 + 4e8) ^
             static_cast<uint32_t>(std::floor(y * scale) * 19349663 + 4e8) ^
             static_cast<uint32_t>(std::floor(z * scale) * 83492791);
    h = (h ^ h >> 15) * 2246822519u + static_cast<uint32_t>(c) * 17;
    return static_cast<double>((h ^ h >> 13) & 255) / 255;
  };
  return static_cast<float>(0.6 * cell(6.01) + 0.4 * cell(17.03));
}

TEST(RealColmap, PlacesPhotosOfAMadeUpRoom) {
  ASSERT_TRUE(find_program("colmap")) << "scripts/install-deps installs it";
  const TempFolder folder;
  fs::create_directory(folder / "photos");
  for (int i = 0; i < 6; ++i) {
    make_image(folder / "photos" / ("v" + std::to_string(i) + ".png"),
               {320, 240, 3, OIIO::TypeDesc::UINT8, {}},
               [&](int x, int y, int c) { return corner(-1 + 0.4 * i, x, y, c); });
  }
  std::vector<std::string> lines;
  const fs::path model =
      run_colmap_on_photos(folder / "photos", {folder / "work", {}}, "SIMPLE_PINHOLE",
                           [&](const std::string& line) { lines.push_back(line); });
  for (const char* file : {"cameras.bin", "images.bin", "points3D.bin"}) {
    EXPECT_TRUE(fs::is_regular_file(model / "sparse" / "0" / file)) << file;
  }
  // Lines of each step: the stand-in of capture_tools_test.cc speaks as the real one does.
  std::string all;
  for (const std::string& line : lines) all += line + "\n";
  EXPECT_TRUE(contains(all, "looked for features in 1 of 6 photos"));
  EXPECT_TRUE(contains(all, "matched 15 of 15 pairs"));
  EXPECT_TRUE(contains(all, "verified matches, 1 of 1 blocks"));
  EXPECT_TRUE(contains(all, "colmap: placed 6 of 6 photos"));
}

}  // namespace
}  // namespace nerf
