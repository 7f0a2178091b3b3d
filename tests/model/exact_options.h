// Pictures whose error is that of the sampling alone.
#pragma once

#include "nerf/model/renderer.h"

namespace nerf::test {

// Every ray cast, one a pixel, and nothing skipped.
inline RenderOptions exact_options() {
  RenderOptions options;
  options.skip_nothing();
  options.precision = Precision::kF32;
  options.supersample = 1;
  return options;
}

}  // namespace nerf::test
