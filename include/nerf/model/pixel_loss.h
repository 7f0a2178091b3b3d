// How the pixels of rays are compared with what they should be, on a tape.
#pragma once

#include "nerf/autodiff/operations.h"
#include "nerf/base/real.h"

namespace nerf {

// Sums over channels and rays, each ray with a scale of its own.
struct PixelLoss {
  enum class Kind {
    kSquared,
    kHuber,        // squared up to an error of `parameter`, linear beyond
    kCharbonnier,  // sqrt(e^2 + parameter^2) (Barron et al. 2022, section 5)
    kGiven,        // no loss: the caller hands in the gradient of the pixels
  };
  Kind kind = Kind::kSquared;
  Real parameter = 0;

  static PixelLoss huber(Real delta) { return {Kind::kHuber, delta}; }
  static PixelLoss charbonnier(Real epsilon) { return {Kind::kCharbonnier, epsilon}; }
};

// Inputs of the tape that the loss reads; those that it does not are below 0.
struct PixelLossInputs {
  Value target = -1, scale = -1;  // [3 x rays], [1 x rays]
  Value gradient = -1;            // kGiven: [4 x rays], by colour and opacity
};

// pixel: [4 x rays], colour and opacity.
PixelLossInputs record_pixel_loss(Tape& tape, Value pixel, const PixelLoss& loss);

}  // namespace nerf
