// Every one of RenderOptions changes the work of a picture, as its counters tell, or the picture.
#include <gtest/gtest.h>

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "model/baked_occupancy.h"
#include "model/some_info.h"
#include "nerf/model/grid_field.h"
#include "nerf/model/network_field.h"
#include "nerf/model/radiance_field.h"
#include "nerf/model/renderer.h"
#include "support/cameras.h"
#include "support/network_options.h"
#include "support/tables.h"

namespace nerf {
namespace {

// A new option does not compile until it is named here, and given another value below.
auto fields(RenderOptions& o) {
  auto& [background, sky, unclipped, bbox, time, appearance, min_transmittance, stop_transmittance,
         unshaded, shared_colour, interpolated, precision, supersample, sample_factor, max_samples,
         uniform_share, layers, medium] = o;
  return std::tie(background, sky, unclipped, bbox, time, appearance, min_transmittance,
                  stop_transmittance, unshaded, shared_colour, interpolated, precision, supersample,
                  sample_factor, max_samples, uniform_share, layers, medium);
}
using Fields = decltype(fields(std::declval<RenderOptions&>()));

const std::tuple kOthers{Vec3{0.1_r, 0.9_r, 0.3_r},
                         false,
                         true,
                         std::optional(Box3{{-0.5, -0.5, -0.5}, {0.5, 0.5, 0.5}}),
                         0.5_r,
                         Appearance{{}, std::vector<Real>(kColourChange, -0.05_r)},
                         0.5_r,
                         0.9_r,
                         0.125_r,
                         0.5_r,
                         0.0_r,
                         Precision::kBf16,
                         2,
                         0.5_r,
                         64,
                         0.0_r,
                         std::optional(Layers{.samples = true}),
                         std::optional(Medium{.attenuation = {0.2, 0.2, 0.2}})};
constexpr size_t kCount = std::tuple_size_v<Fields>;
static_assert(std::tuple_size_v<decltype(kOthers)> == kCount);

struct About {
  const char* name;
  bool of_networks;     // whether it is the paper methods' too
  bool of_grid = true;  // a static field is the same at any time
};
constexpr std::array<About, kCount> kAbout{{{"background", true},
                                            {"sky", false, false},  // none is learnt
                                            {"unclipped", true},
                                            {"bbox", true},
                                            {"time", false, false},
                                            {"appearance", true},
                                            {"min_transmittance", false},
                                            {"stop_transmittance", false},
                                            {"unshaded", false},
                                            {"shared_colour", false},
                                            {"interpolated", false},
                                            {"precision", true},
                                            {"supersample", true},
                                            {"sample_factor", false},
                                            {"max_samples", false},
                                            {"uniform_share", false},
                                            {"layers", true},
                                            {"medium", true}}};

struct Outcome {
  std::array<int64_t, 4> work;
  std::vector<Real> rgb, alpha, depth, samples;
  bool operator==(const Outcome&) const = default;
};

Outcome outcome_of(const RadianceField& field, const RenderOptions& options, int threads = 2) {
  ThreadPool pool(threads);
  Pose pose;
  pose.translation = {0.1, -0.2, -2.5};
  const Frame f = render(field, test::pinhole(24, 20, 18), pose, options, pool);
  const RenderStatistics& s = f.statistics;
  return {{s.rays, s.segments, s.density_evaluations, s.colour_evaluations},
          f.rgb,
          f.alpha,
          f.depth_z,
          f.layers.samples};
}

template <size_t I>
void expect_changes_by(const RadianceField& field, const RenderOptions& usual,
                       const Outcome& before) {
  SCOPED_TRACE(kAbout[I].name);
  if (std::is_same_v<std::tuple_element_t<I, Fields>, Precision&> && bf16_unit() == Bf16Unit::kNone)
    return;  // has no other
  RenderOptions options = usual;
  std::get<I>(fields(options)) = std::get<I>(kOthers);
  EXPECT_EQ(outcome_of(field, options) != before,
            field.is_grid() ? kAbout[I].of_grid : kAbout[I].of_networks);
}

void expect_every_option_to_change(const RadianceField& field) {
  RenderOptions usual;
  usual.precision = Precision::kF32;
  usual.sample_factor = 100;  // so that max_samples is reached
  const Outcome before = outcome_of(field, usual);
  EXPECT_EQ(outcome_of(field, usual), before);
  EXPECT_EQ(outcome_of(field, usual, 1), before) << "threads change nothing";
  [&]<size_t... I>(std::index_sequence<I...>) {
    (expect_changes_by<I>(field, usual, before), ...);
  }(std::make_index_sequence<kCount>());
}

std::shared_ptr<GridField> some_grid() {
  GridOptions o;
  o.levels = 4;
  o.log2_entries = 12;
  o.occupancy_side = 64;
  o.hidden = 32;
  auto grid = std::make_shared<GridField>(o, /*unbounded=*/false, 1);
  grid->initialise(3);
  test::scale_table(*grid, 1e4_r);
  return grid;
}
std::shared_ptr<NetworkField> some_network() {
  auto network = std::make_shared<NetworkField>(test::small_network(test::nerf_options()), 0.5, 5);
  network->initialise(4);
  return network;
}

// The cache says that a cell stops 0.6 of the light: min_transmittance is reached.
TEST(RenderOptions, EveryOneChangesSomethingWithTheGrid) {
  auto grid = some_grid();
  grid->occupancy.set_levels(std::vector<uint8_t>(grid->occupancy.levels().size(), 200));
  expect_every_option_to_change(RadianceField(test::some_info(), grid));
}

// Where the model is known to be empty, all but unclipped pictures skip it.
TEST(RenderOptions, ThoseThatAreNotTheGridsAloneChangeSomethingWithAPapersMethod) {
  RadianceField field(test::some_info(), some_network());
  ThreadPool pool(2);
  ASSERT_TRUE(field.bake(uint64_t{1} << 40, pool));
  ASSERT_LT(field.baked()->occupied_fraction(), 1);
  expect_every_option_to_change(field);
}

TEST(RenderOptions, TheBackgroundIsSeenWhereTheModelSaysSo) {
  RenderOptions usual, other;
  other.background = {0.1_r, 0.9_r, 0.3_r};
  for (const bool alpha : {false, true}) {
    ModelInfo info = test::some_info();
    info.alpha = alpha;
    const RadianceField grid(info, some_grid()), network(info, some_network());
    for (const RadianceField* field : {&grid, &network})
      EXPECT_EQ(outcome_of(*field, usual) != outcome_of(*field, other), field->shows_background())
          << field->is_grid() << alpha;
    EXPECT_TRUE(grid.shows_background());
    EXPECT_EQ(network.shows_background(), alpha);
  }
}

// Of cells of which every second slice is empty: their places are sampled again.
TEST(RenderOptions, EmptyCellsMayBeTakenForMatter) {
  auto grid = some_grid();
  std::vector<uint8_t> levels(grid->occupancy.levels().size());
  for (size_t i = 0; i < levels.size(); ++i) levels[i] = i / 4 % 2 ? 200 : 0;
  grid->occupancy.set_levels(levels);
  const RadianceField field(test::some_info(), grid), all = field.without_empty_cells();
  RenderOptions options;
  options.skip_nothing();
  const auto samples = [&](const RadianceField& f) { return outcome_of(f, options).work[2]; };
  EXPECT_GT(samples(all), 1.5 * samples(field));
  EXPECT_EQ(all.grid().occupancy.occupied_fraction(), 1);
  EXPECT_LT(field.grid().occupancy.occupied_fraction(), 1) << "the copy alone has changed";

  RadianceField network(test::some_info(), some_network());
  ThreadPool pool(2);
  const Outcome asked_everywhere = outcome_of(network, {});
  ASSERT_TRUE(network.bake(uint64_t{1} << 40, pool));
  EXPECT_NE(outcome_of(network, {}), asked_everywhere);
  EXPECT_EQ(outcome_of(network.without_empty_cells(), {}), asked_everywhere);
}

}  // namespace
}  // namespace nerf
