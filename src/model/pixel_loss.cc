#include "nerf/model/pixel_loss.h"

namespace nerf {

PixelLossInputs record_pixel_loss(Tape& tape, Value pixel, const PixelLoss& loss) {
  PixelLossInputs in;
  if (loss.kind == PixelLoss::Kind::kGiven) {
    in.gradient = tape.input(tape.rows(pixel), Domain::kRays);
    add_gradient(tape, pixel, in.gradient);
    return in;
  }
  in.target = tape.input(3, Domain::kRays);
  in.scale = tape.input(1, Domain::kRays);
  switch (loss.kind) {
    case PixelLoss::Kind::kHuber:
      huber_loss(tape, pixel, in.target, in.scale, loss.parameter);
      break;
    case PixelLoss::Kind::kCharbonnier:
      charbonnier_loss(tape, pixel, in.target, in.scale, loss.parameter);
      break;
    default:
      squared_loss(tape, pixel, in.target, in.scale);
  }
  return in;
}

}  // namespace nerf
