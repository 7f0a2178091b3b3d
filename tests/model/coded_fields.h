// For tests: fields with a light for each photo.
#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "model/small_grid.h"
#include "model/some_info.h"
#include "nerf/math/random.h"
#include "nerf/model/grid_field.h"
#include "nerf/model/radiance_field.h"
#include "support/tables.h"

namespace nerf::test {

inline const std::vector<std::string> kPhotos{"dawn.jpg", "noon.jpg", "dusk.jpg"};

// Random numbers of every photo and lens.
template <class FieldType>
void fill_codes(FieldType& field) {
  Random random(5, 1, 0);
  for (Real& w : field.weights.span().subspan(field.network_size()))
    w = 0.6_r * (2 * random.uniform() - 1);
}

// Matter everywhere in the box, in a light that differs between kPhotos.
inline RadianceField grid_with_codes(bool sky = false) {
  GridOptions options = small_options(1, 1);
  options.log2_entries = 10;  // the least of a file
  CodeShape codes{6, true, kPhotos};
  codes.lenses = {"wide", "tele"};
  codes.photo_lenses = {0, 1, 0};
  auto grid = std::make_shared<GridField>(options, false, 1, GridParts{.codes = codes, .sky = sky});
  grid->initialise(3);
  scale_table(*grid, 1e4_r);
  fill_codes(*grid);
  for (int64_t i = 0; i < grid->occupancy.cells(); ++i) grid->occupancy.observe(0, i, 1);
  grid->occupancy.rebuild(0.01_r);
  return RadianceField(some_info(), std::move(grid));
}

}  // namespace nerf::test
