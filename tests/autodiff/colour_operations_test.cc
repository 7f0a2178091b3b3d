// What depends on the photo a ray comes from: changes of colour, and codes for groups of samples.
#include <gtest/gtest.h>

#include <vector>

#include "autodiff/reference_ops.h"
#include "nerf/autodiff/operations.h"

namespace nerf {
namespace {

// rgb' = background (1 - opacity) + (I + A) foreground + opacity b.
TEST(Gradient, ChangeColours) {
  for (int needs = 1; needs < 4; ++needs)
    check_operation({"change_colours",
                     {{4, kRays, (needs & 1) != 0, 0, 1},
                      {3, kRays, false, 0, 1},
                      {12, kRays, (needs & 2) != 0, -0.5, 0.5}},
                     {},
                     [](Tape& t, const Values& v) {
                       return Values{change_colours(t, v[0], v[1], v[2]), v[0], v[2]};
                     },
                     40},
                    []<class T>(const Given<T>& v) -> Outputs<T> {
                      Columns<T> out = v[0];
                      for (size_t r = 0; r < out.size(); ++r) {
                        const std::vector<T>&p = v[0][r], &behind = v[1][r], &change = v[2][r];
                        for (size_t i = 0; i < 3; ++i) {
                          out[r][i] = p[i] + change[9 + i] * p[3];
                          for (size_t k = 0; k < 3; ++k)
                            out[r][i] =
                                out[r][i] + change[3 * i + k] * (p[k] - (T(1) - p[3]) * behind[k]);
                        }
                      }
                      return {out, v[0], v[2]};
                    });
}

// A ray's column for each of its groups, as many as group_light() makes of its samples.
TEST(Gradient, RepeatForGroups) {
  constexpr double kMost = 0.125, kStop = 0.25;
  check_operation({"repeat_for_groups",
                   {{1, kSamples, true, 1e-3, 0.1}, {3, kRays, true}},
                   {},
                   [](Tape& t, const Values& v) {
                     const Value light = group_light(t, v[0], kMost, kStop);
                     return Values{light, repeat_for(t, v[1], kGroups)};
                   },
                   140},
                  []<class T>(const Given<T>& v) -> Outputs<T> {
                    Columns<T> repeated;
                    for (size_t r = 0; r + 1 < v.rays.size(); ++r) {
                      const Columns<T> own(v[0].begin() + v.rays[r], v[0].begin() + v.rays[r + 1]);
                      const Rays one{0, static_cast<int32_t>(own.size())};
                      const size_t groups = on_columns::group_light(own, one, kMost, kStop).size();
                      repeated.insert(repeated.end(), groups, v[1][r]);
                    }
                    return {on_columns::group_light(v[0], v.rays, kMost, kStop), repeated};
                  });
}

}  // namespace
}  // namespace nerf
