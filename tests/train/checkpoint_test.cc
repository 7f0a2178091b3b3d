#include <gtest/gtest.h>
#include <zlib.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <string>
#include <type_traits>
#include <vector>

#include "nerf/base/file.h"
#include "nerf/train/trainer.h"
#include "support/synthetic_scene.h"
#include "support/temp_folder.h"
#include "support/tiny_options.h"

namespace nerf {
namespace {

using test::bits_of;
using test::contains;
using test::error_of;
using test::sphere_capture;
using test::tiny_options;

constexpr int64_t kHalf = 40;  // passes the refreshes of all cells at steps 32 and 64

TrainOptions both_halves(int table_bits) {
  TrainOptions options = tiny_options(2 * kHalf);
  options.grid.table_bits = table_bits;
  return options;
}

std::vector<uint8_t> bits_after(const test::SyntheticCapture& c, int threads, int64_t steps,
                                int table_bits = 16) {
  ThreadPool pool(threads);
  Trainer trainer(c.scene, c.photos, both_halves(table_bits), pool);
  for (int64_t i = 0; i < steps; ++i) trainer.step();
  return bits_of(trainer);
}

TEST(Checkpoint, TrainingGoesOnBitForBit) {
  const auto c = sphere_capture();
  test::TempFolder folder;
  ThreadPool pool(2);
  for (const int table_bits : {16, 32}) {
    {
      Trainer first(c.scene, c.photos, both_halves(table_bits), pool);
      for (int64_t i = 0; i < kHalf; ++i) first.step();
      first.save_checkpoint(folder / "c", "a word of the caller's");
    }
    Trainer second(c.scene, c.photos, both_halves(table_bits), pool);
    second.step();  // what was there before must not matter
    EXPECT_EQ(second.load_checkpoint(folder / "c"), "a word of the caller's");
    EXPECT_EQ(second.steps_done(), kHalf);
    for (int64_t i = 0; i < kHalf; ++i) second.step();
    EXPECT_EQ(bits_of(second), bits_after(c, 2, 2 * kHalf, table_bits)) << table_bits;
  }
}

template <class T>
T number_at(const std::vector<uint8_t>& bytes, size_t at) {
  T value{};
  EXPECT_LE(at + sizeof value, bytes.size());
  if (at + sizeof value <= bytes.size()) std::memcpy(&value, bytes.data() + at, sizeof value);
  return value;
}

// Read as docs/model_file.md says: its version, and sections that the page names.
TEST(Checkpoint, IsAsDocumented) {
  const std::string page =
      read_text_file(std::filesystem::path(NERF_SOURCE_DIR) / "docs" / "model_file.md");
  const auto c = sphere_capture();
  ThreadPool pool(2);
  Trainer trainer(c.scene, c.photos, tiny_options(10), pool);
  trainer.step();
  const std::vector<uint8_t> bytes = bits_of(trainer);
  ASSERT_GT(bytes.size(), 36u);
  EXPECT_EQ(std::string(bytes.begin(), bytes.begin() + 8), "NERFCKPT");
  const auto version = std::to_string(number_at<uint32_t>(bytes, 8));
  EXPECT_TRUE(contains(page, "1 of a model, " + version + " of a checkpoint")) << version;
  EXPECT_EQ(number_at<uint64_t>(bytes, 16), bytes.size());
  const auto sections = number_at<uint32_t>(bytes, 12);
  EXPECT_EQ(sections, 9u);
  const std::string of_checkpoints = page.substr(page.find("## Checkpoint"));
  size_t at = 32 + number_at<uint64_t>(bytes, 24);
  for (uint32_t i = 0; i < sections && at + 40 < bytes.size(); ++i) {
    const std::string name(reinterpret_cast<const char*>(bytes.data()) + at);
    EXPECT_TRUE(contains(of_checkpoints, "`" + name + "`")) << name;
    at += 40 + number_at<uint64_t>(bytes, at + 24);
  }
  EXPECT_EQ(at + 4, bytes.size());
}

TEST(Checkpoint, ThreadsChangeNothing) {
  const auto c = sphere_capture();
  const auto one = bits_after(c, 1, kHalf);
  EXPECT_EQ(one, bits_after(c, 2, kHalf));
  EXPECT_EQ(one, bits_after(c, 3, kHalf));
  EXPECT_EQ(one, bits_after(c, 8, kHalf));  // more threads than levels to share
}

TEST(Checkpoint, SeedAndSaltChangeTheBits) {
  const auto c = sphere_capture();
  ThreadPool pool(1);
  const auto after = [&](uint64_t seed, uint64_t salt) {
    TrainOptions options = tiny_options(10);
    options.seed = seed;
    Trainer trainer(c.scene, c.photos, options, pool);
    if (salt) trainer.vary(salt, 1);
    trainer.step();
    return trainer.snapshot().grid().half_table;
  };
  const auto a = after(1, 0), b = after(2, 0), d = after(1, 7);
  EXPECT_TRUE(std::equal(a.begin(), a.end(), after(1, 0).begin()));
  EXPECT_FALSE(std::equal(a.begin(), a.end(), b.begin()));
  EXPECT_FALSE(std::equal(a.begin(), a.end(), d.begin()));
}

// A budget of time fixes the plan while it runs: what was done by then must not depend on it.
TEST(Checkpoint, StepsBeforeTheHoldDoNotDependOnThePlan) {
  const auto c = sphere_capture();
  ThreadPool pool(1);
  Trainer known(c.scene, c.photos, tiny_options(100), pool);
  Trainer planned(c.scene, c.photos, tiny_options(1 << 30), pool);
  for (int i = 0; i < 10; ++i) {
    known.step();
    planned.step();
  }
  planned.set_planned_steps(100);
  double rate = 0;
  for (int i = 0; i < 6; ++i) {
    rate = known.step().rate;
    EXPECT_EQ(rate, planned.step().rate);
  }
  EXPECT_LT(rate, 0.99 * 0.01 * 16 / 64);  // it does fall afterwards
  EXPECT_EQ(bits_of(known), bits_of(planned));
}

// One trainer for all of them: a load that fails must leave it as it was.
class CheckpointErrors : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { state = new State; }
  static void TearDownTestSuite() { delete state; }
  void TearDown() override { EXPECT_EQ(loading(), ""); }

  static std::string loading() {
    return error_of([] { state->trainer.load_checkpoint(state->path); });
  }
  // Loads with another trainer.
  static std::string loading(const test::SyntheticCapture& c, const TrainOptions& options) {
    Trainer trainer(c.scene, c.photos, options, state->pool);
    return error_of([&] { trainer.load_checkpoint(state->path); });
  }
  // Loads a copy of the file after a change of its bytes.
  static std::string loading_changed(const std::function<void(std::vector<uint8_t>&)>& change) {
    auto bytes = read_file(state->path);
    change(bytes);
    write_file_atomically(state->folder / "changed", bytes);
    return error_of([] { state->trainer.load_checkpoint(state->folder / "changed"); });
  }

  struct State {
    ThreadPool pool{1};
    test::TempFolder folder;
    const std::filesystem::path path = folder / "checkpoint.nerf";
    test::SyntheticCapture capture = sphere_capture();
    Trainer trainer{capture.scene, capture.photos, tiny_options(10), pool};
    State() {
      trainer.step();
      trainer.save_checkpoint(path);
    }
  };
  static inline State* state = nullptr;
};

TEST_F(CheckpointErrors, AnotherSceneIsNamed) {
  auto other = sphere_capture();
  other.scene.views[3].name = "other";
  EXPECT_TRUE(contains(loading(other, tiny_options(10)), "names of the images"));
  EXPECT_TRUE(contains(loading(sphere_capture(6, 24), tiny_options(10)), "sizes of the photos"));
  other = sphere_capture();
  std::swap(other.scene.train[0], other.scene.test[0]);
  EXPECT_TRUE(contains(loading(other, tiny_options(10)), "split"));
  other = sphere_capture();
  other.scene.views[1].pose.translation.x += 1e-9;
  EXPECT_TRUE(contains(loading(other, tiny_options(10)), "poses"));
}

TEST_F(CheckpointErrors, OtherOptionsAreNamedButThePlanComesFromTheFile) {
  TrainOptions options = tiny_options(77);
  options.rate = 0.02;
  EXPECT_TRUE(contains(loading(state->capture, options), "--rate 0.01, not 0.02"));
  options = tiny_options(77);
  options.grid.levels = 3;
  EXPECT_TRUE(contains(loading(state->capture, options), "--grid-levels 4, not 3"));
  Trainer trainer(state->capture.scene, state->capture.photos, tiny_options(77), state->pool);
  trainer.load_checkpoint(state->path);
  EXPECT_EQ(trainer.options().steps, 10);
}

// Of a program that computes in double where this one does in float, or the other way round. Files
// from before there were two are of float.
TEST_F(CheckpointErrors, AnotherRealIsNamed) {
  const bool single = std::is_same_v<Real, float>;
  const auto loading_with = [&](const std::string& from, const std::string& to) {
    return loading_changed([&](std::vector<uint8_t>& b) {
      const auto at = std::search(b.begin(), b.end(), from.begin(), from.end());
      ASSERT_NE(at, b.end()) << from;
      std::copy(to.begin(), to.end(), at);
      const auto crc = static_cast<uint32_t>(::crc32_z(0, b.data(), b.size() - 4));
      std::memcpy(b.data() + b.size() - 4, &crc, 4);
    });
  };
  const std::string error = single ? loading_with("\"real\":\"float\"", "\"real\":\"other\"")
                                   : loading_with("\"real\":\"double\"", "\"real\":\"others\"");
  for (const char* part : {"changed", "computes in other", "NERF_DOUBLE"})
    EXPECT_TRUE(contains(error, part)) << error;
  EXPECT_EQ(loading_with("\"real\"", "\"rael\"").empty(), single);
}

TEST_F(CheckpointErrors, AnotherVersionHasItsOwnMessage) {
  EXPECT_TRUE(contains(loading_changed([](auto& b) { b[8] = 9; }),
                       "checkpoint of version 9; this program reads version 6"));
}

TEST_F(CheckpointErrors, DamageIsFound) {
  const auto good = read_file(state->path);
  for (const size_t at : {size_t{0}, size_t{13}, size_t{40}, good.size() / 2, good.size() - 1})
    EXPECT_NE(loading_changed([&](auto& b) { b = good, b[at] ^= 0x10; }), "") << at;
  for (const size_t size : {size_t{0}, size_t{7}, size_t{31}, size_t{200}, good.size() - 1})
    EXPECT_NE(loading_changed([&](auto& b) { b.assign(good.begin(), good.begin() + size); }), "")
        << size;
  EXPECT_TRUE(contains(loading_changed([&](auto& b) { b.assign(good.begin(), good.end() - 9); }),
                       "truncated"));
}

TEST_F(CheckpointErrors, AModelFileIsNoCheckpoint) {
  const auto model = state->folder / "model";
  state->trainer.snapshot().save(model);
  EXPECT_TRUE(
      contains(error_of([&] { state->trainer.load_checkpoint(model); }), "is not a checkpoint"));
}

}  // namespace
}  // namespace nerf
