// What a medium is learnt as (model/medium.h): a row of numbers, any of which may take any value.
#pragma once

#include "nerf/math/reference/activations.h"

namespace nerf {

//   fog:    softplus^-1 of the coefficient of all channels, sigmoid^-1 of the colour's three
//   water:  of three coefficients of attenuation, of three of backscatter, and of the colour
inline constexpr int kFogNumbers = 4, kWaterNumbers = 9;

// Which of so many numbers says what of channel k.
struct MediumNumbers {
  int count;

  bool fog() const { return count == kFogNumbers; }
  int attenuation(int k) const { return fog() ? 0 : k; }
  int backscatter(int k) const { return fog() ? 0 : 3 + k; }
  int colour(int k) const { return count - 3 + k; }
};

// Of one channel; `number(i)` is the i-th of them, a double.
struct MediumChannel {
  double attenuation, backscatter, colour;

  template <class Number>
  MediumChannel(const MediumNumbers& of, int k, const Number& number)
      : attenuation(reference::softplus(number(of.attenuation(k)))),
        backscatter(reference::softplus(number(of.backscatter(k)))),
        colour(reference::sigmoid(number(of.colour(k)))) {}
};

}  // namespace nerf
