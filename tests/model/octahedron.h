// A network field that a formula gives.
#pragma once

#include <memory>

#include "nerf/model/network_field.h"

namespace nerf::test {

// Matter in the middle only. Of points raw density = 40 (1 - |x| - |y| - |z|), by units that are
// |x| = relu(x) + relu(-x); of cones the same of the sines' means, which come first in their
// encoding as the coordinates do in that of points.
inline std::shared_ptr<NetworkField> octahedron(NetworkOptions o) {
  o.sampling.coarse = o.sampling.fine = 64;
  o.depth = o.proposal_depth = 1;
  auto field = std::make_shared<NetworkField>(o, 0.5, 4);
  for (const RadianceNetwork& n : field->networks) {
    const LinearWeights& in = n.trunk[0];
    for (int axis = 0; axis < 3; ++axis)
      for (int sign = 0; sign < 2; ++sign) {
        const int unit = 2 * axis + sign;
        field->weights[in.offset + static_cast<size_t>(unit * weight_stride(in.in) + axis)] =
            sign ? -1.0_r : 1.0_r;
        field->weights[n.density.offset + static_cast<size_t>(unit)] = -40;
      }
    field->weights[n.density.bias_offset()] = 40;
  }
  return field;
}

}  // namespace nerf::test
