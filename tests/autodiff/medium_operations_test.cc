// What is seen through a medium that is learnt.
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "autodiff/reference_ops.h"
#include "nerf/autodiff/operations.h"
#include "nerf/math/medium_numbers.h"

namespace nerf {
namespace {

template <class T>
struct MediumOf {
  std::array<T, 3> attenuation, backscatter, colour;
  MediumOf(const std::vector<T>& weights, const LinearWeights& w) {
    const bool fog = w.in == kFogNumbers;
    const auto number = [&](int i) { return weights[w.offset + static_cast<size_t>(i)]; };
    for (int k = 0; k < 3; ++k) {
      const size_t c = static_cast<size_t>(k);
      attenuation[c] = reference::softplus(number(fog ? 0 : k));
      backscatter[c] = reference::softplus(number(fog ? 0 : 3 + k));
      colour[c] = reference::sigmoid(number(fog ? 1 + k : 6 + k));
    }
  }
};

TEST(Gradient, SeeThrough) {
  for (const int numbers : {kFogNumbers, kWaterNumbers})
    for (int needs = 0; needs < 4; ++needs) {
      const LinearWeights w{0, numbers, 1};
      check_operation(
          {"see_through",
           {{3, kSamples, (needs & 1) != 0, 0, 1}, {1, kSamples, (needs & 2) != 0, 0, 3}},
           {w},
           [&](Tape& t, const Values& v) { return Values{see_through(t, v[0], v[1], w)}; },
           60},
          [&]<class T>(const Given<T>& v) -> Outputs<T> {
            using std::exp;
            const MediumOf<T> m(v.weights, w);
            Columns<T> out = v[0];
            for (size_t i = 0; i < out.size(); ++i)
              for (size_t k = 0; k < 3; ++k)
                out[i][k] = exp(-m.attenuation[k] * v[1][i][0]) * v[0][i][k] +
                            (T(1) - exp(-m.backscatter[k] * v[1][i][0])) * m.colour[k];
            return {out};
          });
    }
}

TEST(Gradient, OverMedium) {
  for (const int numbers : {kFogNumbers, kWaterNumbers})
    for (const bool needs : {false, true}) {
      const LinearWeights w{0, numbers, 1};
      check_operation({"over_medium",
                       {{4, kRays, needs, 0, 1}},
                       {w},
                       [&](Tape& t, const Values& v) { return Values{over_medium(t, v[0], w)}; },
                       40},
                      [&]<class T>(const Given<T>& v) -> Outputs<T> {
                        const MediumOf<T> m(v.weights, w);
                        Columns<T> out = v[0];
                        for (auto& p : out)
                          for (size_t k = 0; k < 3; ++k) p[k] = p[k] + (T(1) - p[3]) * m.colour[k];
                        return {out};
                      });
    }
}

TEST(Gradient, OverSky) {
  for (int needs = 1; needs < 4; ++needs)
    check_operation(
        {"over_sky",
         {{4, kRays, (needs & 1) != 0, 0, 1},
          {3, kRays, (needs & 2) != 0, 0, 1},
          {1, kRays, false, 0, 1}},
         {},
         [&](Tape& t, const Values& v) { return Values{over_sky(t, v[0], v[1], v[2])}; },
         40},
        [&]<class T>(const Given<T>& v) -> Outputs<T> {
          Columns<T> out = v[0];
          for (size_t i = 0; i < out.size(); ++i) {
            const T left = (T(1) - v[0][i][3]) * v[2][i][0];
            for (size_t k = 0; k < 3; ++k) out[i][k] = v[0][i][k] + left * v[1][i][k];
            out[i][3] = v[0][i][3] + left;
          }
          return {out};
        });
}

}  // namespace
}  // namespace nerf
