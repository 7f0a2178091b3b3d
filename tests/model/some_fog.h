// A medium to look through in tests.
#pragma once

#include "nerf/model/medium.h"

namespace nerf::test {

// Unlike in every channel.
inline Medium some_fog() {
  Medium m;
  m.attenuation = m.backscatter = {0.3, 0.7, 1.1};
  m.colour = {0.9_r, 0.6_r, 0.2_r};
  return m;
}

}  // namespace nerf::test
