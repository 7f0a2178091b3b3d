// Every prefix and every flipped byte of a small capture gives a scene or a clean Error, and never
// much memory. Under the address sanitizer this also shows that nothing is read out of bounds.
#include <gtest/gtest.h>

#include <fstream>
#include <functional>

#include "io/colmap.h"
#include "nerf/base/file.h"
#include "nerf/base/memory.h"
#include "nerf/io/scene.h"
#include "support/temp_folder.h"
#include "test_scenes.h"

namespace nerf {
namespace {

using namespace nerf::test;

constexpr uint64_t kMostMemory = uint64_t{1} << 30;

struct Outcome {
  int results = 0, errors = 0;
};

void put_byte(const std::filesystem::path& file, size_t at, uint8_t byte) {
  std::fstream out(file, std::ios::in | std::ios::out | std::ios::binary);
  out.seekp(static_cast<std::streamoff>(at));
  out.put(static_cast<char>(byte));
  ASSERT_TRUE(out.flush());
}

// Calls `load` for every damaged version of the file: changed in place and cut from the end, since
// rewriting a file ten thousand times waits for the disk.
Outcome damage(const std::filesystem::path& file, const std::vector<int>& flips,
               const std::function<void()>& load) {
  const std::vector<uint8_t> good = read_file(file);
  const std::string name = file.filename().string();
  Outcome outcome;
  const auto attempt = [&](const std::string& what) {
    try {
      load();
      ++outcome.results;
    } catch (const Error& error) {
      ++outcome.errors;
      EXPECT_FALSE(error.where().empty()) << what << ": " << error.what();
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos) << what;
    } catch (const std::exception& other) {
      ADD_FAILURE() << what << ": " << other.what();
    }
  };
  for (size_t at = 0; at < good.size(); ++at) {
    for (const int flip : flips) {
      put_byte(file, at, static_cast<uint8_t>(good[at] ^ flip));
      attempt(fmt::format("{} byte {} xor {}", name, at, flip));
    }
    put_byte(file, at, good[at]);
  }
  EXPECT_EQ(read_file(file), good);
  load();  // the undamaged file loads
  for (size_t size = good.size(); size-- > 0;) {
    std::filesystem::resize_file(file, size);
    attempt(fmt::format("{} cut to {}", name, size));
  }
  write_bytes(file, {good.begin(), good.end()});
  EXPECT_LT(peak_memory_bytes(), kMostMemory);
  return outcome;
}

const std::vector<int> kEveryBit{1, 2, 4, 8, 16, 32, 64, 128, 255};

TEST(ColmapDamage, BinaryModel) {
  TempFolder folder;
  write_binary(ring_model(3, 3), folder.path());
  for (const char* file : {"cameras.bin", "images.bin", "points3D.bin"}) {
    const Outcome outcome =
        damage(folder / file, kEveryBit, [&] { internal::read_colmap_model(folder.path()); });
    // Every prefix is an error, since the counts stand first; many flips change only a number.
    EXPECT_GE(outcome.errors, static_cast<int>(read_file(folder / file).size())) << file;
    EXPECT_GT(outcome.results, 0) << file;
  }
}

TEST(ColmapDamage, TextModel) {
  TempFolder folder;
  write_colmap_text(ring_model(3, 3), folder.path());
  for (const char* file : {"cameras.txt", "images.txt", "points3D.txt"}) {
    const Outcome outcome = damage(folder / file, {1, 64, 128, 255},
                                   [&] { internal::read_colmap_model(folder.path()); });
    EXPECT_GT(outcome.errors, 0) << file;
    EXPECT_GT(outcome.results, 0) << file;
  }
}

TEST(ColmapDamage, WholeScene) {
  TempFolder folder;
  write_capture(ring_model(3, 3), folder.path());
  for (const char* file : {"cameras.bin", "images.bin", "points3D.bin"}) {
    const Outcome outcome = damage(folder / "sparse" / "0" / file, {1, 128}, [&] {
      const Scene scene = load_scene(folder.path());
      EXPECT_TRUE(std::isfinite(scene.to_engine.scale) && scene.to_engine.scale > 0);
      EXPECT_TRUE(std::isfinite(scene.near) && std::isfinite(scene.far));
      EXPECT_GE(scene.near, 0);
      EXPECT_GT(scene.far, scene.near);
    });
    EXPECT_GT(outcome.errors, 0) << file;
    EXPECT_GT(outcome.results, 0) << file;
  }
}

TEST(ColmapDamage, TransformsFile) {
  TempFolder folder;
  for (int i = 0; i < 3; ++i) write_picture(folder / fmt::format("{}.png", i));
  write_text(folder / "transforms.json",
             transforms_text(3, "", ".png", R"("fl_x":50,"k1":0.01,"w":40,"h":30)"));
  const Outcome outcome = damage(folder / "transforms.json", {1, 4, 64, 128}, [&] {
    const Scene scene = load_scene(folder.path());
    EXPECT_TRUE(std::isfinite(scene.to_engine.scale) && scene.to_engine.scale > 0);
  });
  EXPECT_GT(outcome.errors, 0);
  EXPECT_GT(outcome.results, 0);
}

}  // namespace
}  // namespace nerf
