// A chunk's rays and their values as the volume rendering kernels take them.
#pragma once

#include <algorithm>

#include "nerf/autodiff/tape.h"
#include "nerf/kernels/linear.h"
#include "nerf/kernels/volume_rendering.h"

namespace nerf::internal {

// The columns of v that belong to each ray.
inline RayRanges rays_of(const Chunk& c, Value v) {
  return {c.tape->domain(v) == Domain::kGroups ? c.group_begin : c.ray_begin, c.rays};
}
inline ColourRows<const Real> data_rows(Chunk& c, Value v) { return {c.data(v), c.stride(v)}; }
inline ColourRows<Real> gradient_rows(Chunk& c, Value v) { return {c.gradient(v), c.stride(v)}; }

// Columns that belong to no ray take no part.
inline void clear_padding(const Chunk& c, Value v, Real* gradient_row) {
  const RayRanges rays = rays_of(c, v);
  std::fill(gradient_row + rays.begin[rays.count], gradient_row + round_up(c.count(v), kLane),
            0.0_r);
}

}  // namespace nerf::internal
