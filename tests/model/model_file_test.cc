#include "model/model_file.h"

#include <gtest/gtest.h>
#include <zlib.h>

#include <cstring>

#include "nerf/base/file.h"
#include "nerf/math/random.h"
#include "nerf/model/grid_field.h"
#include "nerf/model/options_json.h"
#include "nerf/model/renderer.h"
#include "support/tables.h"
#include "support/temp_folder.h"

namespace nerf {
namespace {

using test::contains;
using test::error_of;

ModelInfo sample_info() {
  ModelInfo info;
  info.to_engine.scale = 0.1 + 0.2;  // digits that a short print would lose
  info.to_engine.center = {1e-9, -3.25, 1.0 / 3};
  info.to_engine.rotation.m = {{{0, -1, 0}, {1, 0, 0}, {0, 0, 1}}};
  info.alpha = true;
  info.background = {0, 0.25_r, 1};
  info.near = 0.01;
  info.far = 7.5;
  info.times = {-2.5, 0.1 + 0.2, true, "a film"};
  for (int i = 0; i < 2; ++i) {
    ModelView view;
    view.name = i ? "b/\xc3\xa4 2.png" : "a.png";
    view.camera.model = CameraModel::kRadial;
    view.camera.width = 33 + i;
    view.camera.height = 21;
    view.camera.params = {40.5, 16.5, 10.5, -0.01 / 3, 1e-5};
    view.pose.translation = {0.1 * i, 2, -3};
    view.held_out = i == 1;
    view.time = i / 3.0;
    if (i == 1) view.ids = {7, -1, 2};
    if (i == 1) view.motion = {{{0.1, -1.0 / 3, 2e-9}, {4, 0, 0.7}}, {-1, 0}, -0.5};
    info.views.push_back(view);
  }
  return info;
}

RadianceField sample_field(bool unbounded = false, int cascades = 1, int features = 4,
                           int table_bits = 32) {
  GridOptions options;
  options.table_bits = table_bits;
  options.features = features;
  options.levels = 2;
  options.log2_entries = 10;
  options.occupancy_side = 64;
  options.base_resolution = 4;
  options.finest_resolution = 32;
  options.hidden = 16;
  options.sampler.uniform_share = 0.1_r;
  auto grid = std::make_shared<GridField>(options, unbounded, cascades);
  grid->initialise(3);
  test::scale_table(*grid, 1e4_r);
  std::vector<uint8_t> levels(grid->occupancy.levels().size());
  for (size_t i = 0; i < levels.size(); ++i) levels[i] = (i >> 6) % 5 == 0 ? i % 7 : 0;
  grid->occupancy.set_levels(levels);
  grid->clip.max.x = 0.625;
  ModelInfo info = sample_info();
  info.unbounded = unbounded;
  return RadianceField(std::move(info), std::move(grid));
}

std::vector<uint8_t> file_of(const RadianceField& field) {
  test::TempFolder folder;
  field.save(folder / "m");
  return read_file(folder / "m");
}

// The error of reading these bytes; empty where they are read.
std::string reading(std::vector<uint8_t> bytes) {
  return error_of([&] { internal::parse_model(std::move(bytes), "m"); });
}

void set_checksum(std::vector<uint8_t>& bytes) {
  const auto crc = static_cast<uint32_t>(::crc32_z(0, bytes.data(), bytes.size() - 4));
  std::memcpy(bytes.data() + bytes.size() - 4, &crc, 4);
}

// What is looked up in half floats is saved as it is, and read as it was.
TEST(ModelFile, KeepsEveryBitOfATableOfHalfFloats) {
  const RadianceField saved = sample_field(false, 1, 4, 16);
  test::TempFolder folder;
  saved.save(folder / "m");
  const RadianceField loaded = RadianceField::load(folder / "m");
  const auto bits = [](const RadianceField& f) {
    return std::vector<uint16_t>(f.grid().half_table.begin(), f.grid().half_table.end());
  };
  EXPECT_EQ(bits(saved), bits(loaded));
  EXPECT_EQ(saved.grid().table.size(), 0u);
  EXPECT_GT(loaded.grid().half_table.size(), 0u);
  EXPECT_EQ(file_of(saved), file_of(loaded));
}

TEST(ModelFile, KeepsEverything) {
  for (const bool unbounded : {false, true}) {
    const RadianceField saved = unbounded ? sample_field(true, 3, 2) : sample_field();
    test::TempFolder folder;
    saved.save(folder / "m");
    const RadianceField loaded = RadianceField::load(folder / "m");
    const ModelInfo &a = saved.info(), &b = loaded.info();
    EXPECT_EQ(b.method, "grid");
    EXPECT_EQ(a.unbounded, b.unbounded);
    EXPECT_EQ(a.alpha, b.alpha);
    EXPECT_EQ(a.background, b.background);
    EXPECT_EQ(a.near, b.near);
    EXPECT_EQ(a.far, b.far);
    EXPECT_EQ(a.to_engine.scale, b.to_engine.scale);
    EXPECT_EQ(a.to_engine.center, b.to_engine.center);
    EXPECT_EQ(a.to_engine.rotation.m, b.to_engine.rotation.m);
    EXPECT_EQ(a.times.first, b.times.first);
    EXPECT_EQ(a.times.last, b.times.last);
    EXPECT_EQ(a.times.seconds, b.times.seconds);
    EXPECT_EQ(a.times.source, b.times.source);
    ASSERT_EQ(a.views.size(), b.views.size());
    for (size_t i = 0; i < a.views.size(); ++i) {
      EXPECT_EQ(a.views[i].name, b.views[i].name);
      EXPECT_EQ(a.views[i].camera.model, b.views[i].camera.model);
      EXPECT_EQ(a.views[i].camera.width, b.views[i].camera.width);
      EXPECT_EQ(a.views[i].camera.height, b.views[i].camera.height);
      EXPECT_EQ(a.views[i].camera.params, b.views[i].camera.params);
      EXPECT_EQ(a.views[i].pose.rotation.m, b.views[i].pose.rotation.m);
      EXPECT_EQ(a.views[i].motion.twist, b.views[i].motion.twist);
      EXPECT_EQ(a.views[i].motion.along, b.views[i].motion.along);
      EXPECT_EQ(a.views[i].motion.middle, b.views[i].motion.middle);
      EXPECT_EQ(a.views[i].pose.translation, b.views[i].pose.translation);
      EXPECT_EQ(a.views[i].held_out, b.views[i].held_out);
      EXPECT_EQ(a.views[i].time, b.views[i].time);
      EXPECT_EQ(a.views[i].ids, b.views[i].ids);
    }
    const GridField &f = saved.grid(), &g = loaded.grid();
    GridOptions options = f.options;
    options.table_bits = 16;  // as the file is
    EXPECT_EQ(options_to_json(options), options_to_json(g.options));
    EXPECT_EQ(f.clip.min, g.clip.min);
    EXPECT_EQ(f.clip.max, g.clip.max);
    EXPECT_TRUE(std::equal(f.weights.begin(), f.weights.end(), g.weights.begin(),
                           [](Real a, Real b) { return static_cast<float>(a) == b; }));
    ASSERT_EQ(f.table.size(), g.half_table.size());
    for (size_t i = 0; i < f.table.size(); ++i)
      ASSERT_NEAR(f.table[i], static_cast<Real>(internal::half_to_float(g.half_table[i])),
                  std::fabs(f.table[i]) / 2048)
          << i;
    ASSERT_EQ(f.occupancy.cascades(), g.occupancy.cascades());
    const auto p = f.occupancy.levels(), q = g.occupancy.levels();
    EXPECT_TRUE(std::equal(p.begin(), p.end(), q.begin(), q.end()));
    EXPECT_EQ(f.occupancy.occupied_fraction(), g.occupancy.occupied_fraction());
  }
}

TEST(ModelFile, SavedAgainIsTheSameFile) {
  const auto bytes = file_of(sample_field());
  EXPECT_EQ(bytes, file_of(internal::parse_model(bytes, "m")));
}

TEST(ModelFile, EveryPrefixIsAnError) {
  const auto bytes = file_of(sample_field());
  ASSERT_EQ(reading(bytes), "");
  for (size_t size = 0; size < bytes.size(); ++size)
    ASSERT_NE(reading({bytes.begin(), bytes.begin() + static_cast<ptrdiff_t>(size)}), "") << size;
  auto longer = bytes;
  longer.push_back(0);
  EXPECT_TRUE(contains(reading(longer), "too long"));
  EXPECT_TRUE(contains(reading({bytes.begin(), bytes.end() - 1}), "truncated"));
}

TEST(ModelFile, EveryFlippedByteIsAnError) {
  const auto bytes = file_of(sample_field());
  for (size_t i = 0; i < bytes.size(); ++i) {
    auto changed = bytes;
    changed[i] ^= static_cast<uint8_t>(1 + mix64(i) % 255);
    ASSERT_NE(reading(std::move(changed)), "") << i;
  }
}

// Behind a right checksum (a file made by somebody else) nothing may crash or ask for much memory.
TEST(ModelFile, WrongContentWithARightChecksumIsAnErrorOrAModel) {
  const auto bytes = file_of(sample_field());
  uint64_t header_bytes;
  std::memcpy(&header_bytes, bytes.data() + 24, 8);
  const size_t dense = 32 + header_bytes + 64;  // head, header and the first section's head
  int errors = 0;
  for (size_t i = 0; i < bytes.size() - 4; i += i < dense ? 1 : 997) {
    auto changed = bytes;
    changed[i] ^= static_cast<uint8_t>(1 + mix64(i) % 255);
    set_checksum(changed);
    try {
      internal::parse_model(std::move(changed), "m");
    } catch (const Error&) {
      ++errors;
    }
  }
  EXPECT_GT(errors, 1000);
}

std::vector<uint8_t> with_header(const std::function<void(std::string&)>& change) {
  const auto bytes = file_of(sample_field());
  uint64_t size;
  std::memcpy(&size, bytes.data() + 24, 8);
  std::string file(bytes.begin(), bytes.end());
  std::string header = file.substr(32, size);
  change(header);
  file.replace(32, size, header);
  std::vector<uint8_t> out(file.size());
  std::memcpy(out.data(), file.data(), file.size());
  const uint64_t header_size = header.size(), file_size = out.size();
  std::memcpy(out.data() + 24, &header_size, 8);
  std::memcpy(out.data() + 16, &file_size, 8);
  set_checksum(out);
  return out;
}

std::string reading_with(const std::string& from, const std::string& to) {
  return reading(with_header([&](std::string& header) {
    const size_t at = header.find(from);
    ASSERT_NE(at, std::string::npos) << from;
    header.replace(at, from.size(), to);
  }));
}

TEST(ModelFile, HeadersOfOtherProgramsAreChecked) {
  EXPECT_EQ(reading_with("\"alpha\":true", "\"alpha\":false"), "");
  EXPECT_TRUE(
      contains(reading_with("\"alpha\":true", "\"alpha\":1"), "alpha: expected true or false"));
  EXPECT_EQ(reading_with("\"background\":[0.0,0.25,1.0],", ""), "");
  EXPECT_TRUE(contains(reading_with("[0.0,0.25,1.0]", "[0.0,0.25,2.0]"), "background"));
  EXPECT_TRUE(contains(reading_with("[0.0,0.25,1.0]", "[0.0,0.25]"), "a list of 3 numbers"));
  EXPECT_TRUE(contains(reading_with("\"near\":0.01", "\"near\":null"), "near: expected a number"));
  EXPECT_TRUE(contains(reading_with("\"near\":0.01", "\"near\":1e999"), "not valid JSON"));
  EXPECT_TRUE(contains(reading_with("\"method\":\"grid\"", "\"method\":\"nerf\""),
                       "unknown option (known: cast"));
  EXPECT_TRUE(contains(reading_with("\"RADIAL\"", "\"RADIO\""), "views[0]: camera: model"));
  EXPECT_TRUE(contains(reading_with("\"width\":34", "\"width\":0"), "views[1]: camera: width"));
  EXPECT_TRUE(contains(reading_with("[0.0,-1.0,0.0,", "[0.0,-1.5,0.0,"), "is not a rotation"));
  EXPECT_TRUE(contains(reading_with("\"cascades\":1", "\"cascades\":40"), "from 1 to 16"));
  // More occupancy or a larger table than the file holds.
  EXPECT_TRUE(contains(reading_with("\"cascades\":1", "\"cascades\":2"), "its occupancy"));
  EXPECT_TRUE(
      contains(reading_with("\"occupancy_side\":64", "\"occupancy_side\":512"), "its occupancy"));
  EXPECT_TRUE(
      contains(reading_with("\"occupancy_side\":64", "\"occupancy_side\":65"), "multiple of 16"));
  EXPECT_TRUE(contains(reading_with("\"log2_entries\":10", "\"log2_entries\":24"), "its table"));
  EXPECT_TRUE(contains(reading_with("\"log2_entries\":10", "\"log2_entries\":99"), "log2_entries"));
  EXPECT_TRUE(contains(reading_with("\"features\":4", "\"features\":2"), "its table"));
  EXPECT_TRUE(contains(reading_with("\"features\":4", "\"features\":3"), "neither 2 nor 4"));
  EXPECT_EQ(reading_with("\"features\":4,", ""), "") << "files older than the option have 4";
  EXPECT_TRUE(contains(reading_with("\"hidden\":16", "\"hidden\":1024"), "section 'networks'"));
  EXPECT_TRUE(contains(reading_with("{", "["), "not valid JSON"));
}

// A few kilobytes that claim to hold gigabytes are refused before anything is allocated for them.
TEST(ModelFile, ASectionCannotStateMoreThanDeflateCanHold) {
  auto bytes = with_header([](std::string& header) {
    const std::string from = "\"occupancy_side\":64";
    header.replace(header.find(from), from.size(), "\"occupancy_side\":512");
  });
  char name[16] = "occupancy";  // the section's head: name, encoding, reserved, stored, decoded
  const auto at = std::search(bytes.begin(), bytes.end(), std::begin(name), std::end(name));
  ASSERT_NE(at, bytes.end());
  const uint64_t claimed = uint64_t{512} * 512 * 512;
  std::memcpy(&*at + 32, &claimed, sizeof(claimed));
  set_checksum(bytes);
  EXPECT_TRUE(contains(reading(bytes), "section 'occupancy' states more than it can hold"));
}

TEST(ModelFile, VersionAndKindHaveTheirOwnMessages) {
  auto bytes = file_of(sample_field());
  bytes[8] = 2;
  EXPECT_TRUE(contains(reading(bytes), "model file of version 2; this program reads version 1"));
  EXPECT_TRUE(contains(reading({'P', 'K', 3, 4}), "is not a model file"));
  EXPECT_TRUE(contains(reading({}), "is not a model file"));
  EXPECT_TRUE(contains(error_of([] { RadianceField::load("/nonexistent/model.nerf"); }),
                       "/nonexistent/model.nerf: cannot open"));
}

TEST(ModelFile, AFailedSaveLeavesWhatWasThere) {
  test::TempFolder folder;
  sample_field().save(folder / "m");
  const auto before = read_file(folder / "m");
  EXPECT_TRUE(
      contains(error_of([&] { sample_field().save(folder / "none" / "m"); }), "cannot write"));
  std::filesystem::create_directory(folder / "d");
  EXPECT_NE(error_of([&] { sample_field().save(folder / "d"); }), "");
  EXPECT_EQ(before, read_file(folder / "m"));
  EXPECT_EQ(folder.files(), 2);
}

}  // namespace
}  // namespace nerf
