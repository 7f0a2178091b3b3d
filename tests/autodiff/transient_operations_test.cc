// Gradients of what NeRF-W adds: two kinds of matter on a ray, and the losses of their pixels.
#include <gtest/gtest.h>

#include <vector>

#include "autodiff/reference_ops.h"
#include "nerf/autodiff/operations.h"

namespace nerf {
namespace {

// Either kind thin or opaque, before a bright background, with and without a closed end.
TEST(Gradient, CompositeTransient) {
  for (bool opaque_end : {false, true})
    for (double stays : {0.01, 8.0, 1e4})
      for (double passes : {0.01, 8.0})
        check_operation(
            {"composite_transient",
             {{1, kSamples, true, 0, stays},
              {3, kSamples, true, 0, 1},
              {1, kSamples, true, 0, passes},
              {3, kSamples, true, 0, 1},
              {1, kSamples, true, 0, 1},
              {1, kSamples, false, 0.01, 0.3},
              {3, kRays, false, 0, 1}},
             {},
             [=](Tape& t, const Values& v) {
               const auto c =
                   composite_transient(t, {v[0], v[1], v[2], v[3], v[4]}, v[5], v[6], opaque_end);
               // Its values have another reader each, and its weights are the static
               // matter's.
               return Values{c.pixel, v[0], v[1], v[2], v[3], v[4]};
             },
             300,
             /*shared=*/1},
            [=]<class T>(const Given<T>& v) -> Outputs<T> {
              return {on_columns::composite_transient<T>({v[0], v[1], v[2], v[3], v[4]}, v[5], v[6],
                                                         v.rays, opaque_end),
                      v[0],
                      v[1],
                      v[2],
                      v[3],
                      v[4]};
            });
}

// Alone it overwrites gradients; the weights are those of the static matter without the other.
TEST(Gradient, CompositeTransientAlone) {
  check_operation({"composite_transient_alone",
                   {{1, kSamples, true, 0, 8},
                    {3, kSamples, true, 0, 1},
                    {1, kSamples, true, 0, 8},
                    {3, kSamples, true, 0, 1},
                    {1, kSamples, true, 0, 1},
                    {1, kSamples, false, 0.01, 0.3},
                    {3, kRays, false, 0, 1}},
                   {},
                   [](Tape& t, const Values& v) {
                     const auto c =
                         composite_transient(t, {v[0], v[1], v[2], v[3], v[4]}, v[5], v[6], false);
                     return Values{c.pixel, c.weights};
                   },
                   300,
                   /*shared=*/1},
                  []<class T>(const Given<T>& v) -> Outputs<T> {
                    using reference::stop_gradient;
                    Columns<T> weights = on_columns::render_weights(v[0], v[5], v.rays, false);
                    for (auto& w : weights) w[0] = stop_gradient(w[0]);
                    return {on_columns::composite_transient<T>({v[0], v[1], v[2], v[3], v[4]}, v[5],
                                                               v[6], v.rays, false),
                            weights};
                  });
}

TEST(Gradient, UncertainLoss) {
  for (double least : {0.03, 0.5})
    check_operation(
        {"uncertain_loss",
         {{5, kRays, true, 0, 1.2}, {3, kRays, false, 0, 1}, {1, kRays, false, 0.01, 1}},
         {},
         [=](Tape& t, const Values& v) {
           uncertain_loss(t, v[0], v[1], v[2], static_cast<Real>(least));
           return Values{};
         },
         60},
        [=]<class T>(const Given<T>& v) -> Outputs<T> {
          return {on_columns::uncertain_loss(v[0], v[1], v[2],
                                             static_cast<double>(static_cast<Real>(least)))};
        });
}

// Beside another reader, and alone.
TEST(Gradient, MeanLoss) {
  for (bool shared : {false, true})
    check_operation({"mean_loss",
                     {{1, kSamples, true, 0, 3}, {1, kRays, false, 0.01, 1}},
                     {},
                     [=](Tape& t, const Values& v) {
                       mean_loss(t, v[0], v[1], 0.25_r);
                       if (shared) mean_loss(t, v[0], v[1], 0.5_r);
                       return Values{};
                     },
                     60},
                    [=]<class T>(const Given<T>& v) -> Outputs<T> {
                      Outputs<T> out{on_columns::mean_loss(v[0], v[1], v.rays, 0.25)};
                      if (shared) out.push_back(on_columns::mean_loss(v[0], v[1], v.rays, 0.5));
                      return out;
                    });
}

}  // namespace
}  // namespace nerf
