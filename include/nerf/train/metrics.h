// How alike two pictures are, on 8-bit pixels scaled to [0, 1].
#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "nerf/base/threads.h"
#include "nerf/io/image.h"

namespace nerf {

// Pictures that agree in every pixel have no finite PSNR; this is reported in its place, and for
// any difference smaller still.
inline constexpr double kHighestPsnr = 100;

// `mask`: empty, or width * height, 0 = does not count. Both pictures must have the same size and
// number of channels (else a failed check).

// Peak signal-to-noise ratio in dB, -10 log10 of the mean squared difference over counted pixels
// and all channels. No value where no pixel counts.
std::optional<double> psnr(const Image8& a, const Image8& b, std::span<const uint8_t> mask = {});

// Structural similarity as mip-NeRF computes it: Gaussian window of 11 x 11 with sigma 1.5, k1
// 0.01, k2 0.03, windows that lie wholly in the picture, variances clipped at 0 and the covariance
// at their geometric mean; the mean over all windows whose centre counts and all channels. In a
// window only pixels that count have weight. No value
// where there is no such window (also in pictures below 11 x 11). The same bits for any number of
// threads.
std::optional<double> ssim(const Image8& a, const Image8& b, ThreadPool& pool,
                           std::span<const uint8_t> mask = {});

}  // namespace nerf
