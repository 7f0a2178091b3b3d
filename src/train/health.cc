// Signs of a training gone wrong. A step whose loss or gradient is infinite or not a number is
// stopped before it reaches the weights.
#include <cmath>
#include <string>

#include "train/grid_trainer.h"

namespace nerf {

void TrainerImpl::check_loss(double loss) const {
  if (std::isfinite(loss)) return;
  throw NonFiniteError("the loss of step " + std::to_string(done + 1) + " is not finite");
}

void GridTrainer::check_gradient() const {
  const Real* gradient = optimiser.network_gradient.data();
  const auto check = [&](const char* network, const std::vector<LinearWeights>& layers) {
    for (size_t l = 0; l < layers.size(); ++l)
      for (size_t i = layers[l].offset; i < layers[l].offset + layers[l].size(); ++i)
        if (!std::isfinite(gradient[i]))
          throw NonFiniteError("the gradient of layer " + std::to_string(l + 1) + " of the " +
                               network + " network at step " + std::to_string(done + 1) +
                               " is not finite");
  };
  check("density", field.density_layers);
  check("colour", field.colour_layers);
}

double Trainer::photo_opacity() const {
  constexpr uint64_t kDraws = 16384;
  double sum = 0;
  int64_t count = 0;
  for (uint64_t i = 0; i < kDraws; ++i) {
    Random random(0, 0, i);
    PixelSource::Pixel pixel;
    if (!impl_->source.draw(random, pixel)) continue;
    sum += static_cast<double>(pixel.alpha);
    ++count;
  }
  return count ? sum / static_cast<double>(count) : 0;
}

}  // namespace nerf
