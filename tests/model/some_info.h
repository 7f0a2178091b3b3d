// For tests: what is known of a capture with alpha around the origin.
#pragma once

#include "nerf/model/model_info.h"

namespace nerf::test {

inline ModelInfo some_info() {
  ModelInfo info;
  info.alpha = true;
  info.near = 0.5;
  info.far = 5;
  return info;
}

}  // namespace nerf::test
