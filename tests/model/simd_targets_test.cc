// The same pictures on every SIMD target, of fields of random weights; tests/train has trained
// ones.
#include <gtest/gtest.h>

#include <memory>

#include "model/some_info.h"
#include "nerf/model/grid_field.h"
#include "nerf/model/network_field.h"
#include "support/cameras.h"
#include "support/network_options.h"
#include "support/same_pictures.h"
#include "support/tables.h"

namespace nerf {
namespace {

void expect_same_pictures(const RadianceField& field) {
  Pose pose;
  pose.translation = {0.1, -0.2, -2.5};
  test::expect_same_pictures(field, test::pinhole(24, 20, 18), pose);
}

TEST(SimdTargets, PicturesOfTheGrid) {
  for (const bool unbounded : {false, true}) {
    GridOptions o;
    o.table_bits = unbounded ? 16 : 32;
    o.levels = 4;
    o.log2_entries = 12;
    o.occupancy_side = 64;
    o.hidden = 32;
    auto grid = std::make_shared<GridField>(o, unbounded, unbounded ? 2 : 1);
    grid->initialise(3);
    test::scale_table(*grid, 1e4_r);
    grid->occupancy.set_levels(std::vector<uint8_t>(grid->occupancy.levels().size(), 20));
    expect_same_pictures(RadianceField(test::some_info(), grid));
  }
}

TEST(SimdTargets, PicturesOfThePapersMethods) {
  for (const NetworkOptions& o :
       {test::nerf_options(), test::mipnerf_options(), test::mipnerf360_options()}) {
    auto field = std::make_shared<NetworkField>(test::small_network(o), 0.5, 5);
    field->initialise(4);
    expect_same_pictures(RadianceField(test::some_info(), field));
  }
}

}  // namespace
}  // namespace nerf
