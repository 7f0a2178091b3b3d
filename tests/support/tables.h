// Tables of grid fields, whatever they hold their features in.
#pragma once

#include "base/half.h"
#include "nerf/model/grid_field.h"

namespace nerf::test {

inline void scale_table(GridField& field, Real factor) {
  for (Real& v : field.table) v *= factor;
  for (uint16_t& h : field.half_table)
    h = internal::float_to_half(
        static_cast<float>(static_cast<Real>(internal::half_to_float(h)) * factor));
}

}  // namespace nerf::test
