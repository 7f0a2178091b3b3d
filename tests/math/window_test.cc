#include "nerf/math/window.h"

#include <gtest/gtest.h>

#include <array>

#include "nerf/math/reference/encoding.h"

namespace nerf {
namespace {

// By hand: closed, open, half way, and a quarter of the way, (1 - cos 45 degrees) / 2.
TEST(Window, OpensOneFrequencyAfterTheOther) {
  std::array<Real, 4> w{};
  window_weights(0, w);
  EXPECT_EQ(w, (std::array<Real, 4>{0, 0, 0, 0}));
  window_weights(4, w);
  EXPECT_EQ(w, (std::array<Real, 4>{1, 1, 1, 1}));
  window_weights(2.5, w);
  EXPECT_EQ(w[0], 1);
  EXPECT_EQ(w[1], 1);
  EXPECT_NEAR(w[2], 0.5, 1e-7);
  EXPECT_EQ(w[3], 0);
  window_weights(1.25, w);
  EXPECT_NEAR(w[1], 0.14644660940672624, 1e-7);
  window_weights(-3, w);
  EXPECT_EQ(w[0], 0);
  window_weights(99, w);
  EXPECT_EQ(w[3], 1);
}

TEST(Window, IsThatOfTheScalarTemplate) {
  std::array<Real, 6> w{};
  for (double alpha = -0.5; alpha < 7; alpha += 0.03) {
    window_weights(alpha, w);
    for (int k = 0; k < 6; ++k)
      EXPECT_NEAR(w[static_cast<size_t>(k)], reference::window_weight(alpha, k), 1e-7);
  }
}

}  // namespace
}  // namespace nerf
