// Whether the photos show anything: what a training that stays empty is measured by.
#include "train/trainer_impl.h"

namespace nerf {

double Trainer::photo_opacity() const {
  constexpr uint64_t kDraws = 16384;
  double sum = 0;
  int64_t count = 0;
  for (uint64_t i = 0; i < kDraws; ++i) {
    Random random(0, 0, i);
    PixelSource::Pixel pixel;
    if (!impl_->source.draw(random, pixel) || pixel.masked) continue;
    sum += static_cast<double>(pixel.alpha);
    ++count;
  }
  return count ? sum / static_cast<double>(count) : 0;
}

}  // namespace nerf
