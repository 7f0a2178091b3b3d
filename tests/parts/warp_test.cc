// Warps and sheets through the generic gradient test, with their Jacobians; their first weights.
#include "nerf/parts/warp.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "autodiff/reference_ops.h"
#include "autodiff/tangent_check.h"
#include "nerf/math/window.h"
#include "parts/warp_columns.h"

namespace nerf {
namespace {

using on_columns::point_outputs, on_columns::warped;

constexpr double kOpen = 1.5;

WarpShape shape_of(WarpKind kind, bool skip_position) {
  WarpShape s;
  s.kind = kind;
  s.position_degrees = 2;
  s.code = 4;
  s.depth = 3;
  s.width = 7;
  s.skip = 2;
  s.skip_position = skip_position;
  return s;
}

FrequencyWeights window_of(const PointShape& s) {
  std::vector<Real> open(static_cast<size_t>(s.position_degrees));
  window_weights(kOpen, open);
  return std::make_shared<const std::vector<Real>>(open);
}

std::vector<LinearWeights> layers_of(PointNetwork& n) {
  std::vector<LinearWeights> out;
  for (const LinearWeights* w : n.layers()) out.push_back(*w);
  return out;
}

// Gradients of weights, code and position through the value and through two derivatives, as the
// elastic loss asks for them.
TEST(Warp, GradientsThroughItsJacobian) {
  for (const WarpKind kind : {WarpKind::kTranslation, WarpKind::kSe3})
    for (const bool skip_position : {false, true}) {
      SCOPED_TRACE(std::string(kind == WarpKind::kSe3 ? "se3" : "translation") +
                   (skip_position ? ", position" : ", all") + " again");
      static WarpNetwork network;
      network = WarpNetwork(shape_of(kind, skip_position), 0);
      const FrequencyWeights window = window_of(network.shape);
      check_operation(
          {"warp_jacobian",
           {{3, kSamples, true}, {4, kRays, true}, {3, kSamples, false}, {3, kSamples, false}},
           layers_of(network),
           [=](Tape& t, const Values& v) {
             const Value code = repeat_for_samples(t, v[1]);
             const WithTangents y =
                 record_warp(t, network, WithTangents{v[0], {v[2], v[3]}}, code, window);
             return Values{y.value, y.tangents[0], y.tangents[1],
                           record_warp(t, network, v[0], code, window)};
           },
           160,
           0,
           0.5},
          []<class T>(const Given<T>& v) -> Outputs<T> {
            const Columns<T> code = on_columns::repeat_for_samples(v[1], v.rays);
            const Columns<T> none(code.size(), std::vector<T>(4, T(0)));
            const std::vector<TDual<T>> w = constants(v.weights);
            Outputs<T> out;
            for (const size_t i : {size_t{2}, size_t{3}}) {
              const auto y = warped(network, dual(v[0], v[i]), dual(code, none), w, kOpen);
              if (out.empty()) out.push_back(part(y, &TDual<T>::value));
              out.push_back(part(y, &TDual<T>::derivative));
            }
            out.push_back(warped(network, v[0], code, v.weights, kOpen));
            return out;
          },
          {{0}, {0, 1, 3, 3, 6}});
    }
}

// What does not move has neither a motion nor a gradient of one.
TEST(Warp, StandsStillWhereItIsTold) {
  static WarpNetwork network(shape_of(WarpKind::kTranslation, true), 0);
  const FrequencyWeights window = window_of(network.shape);
  check_operation({"warp_moving",
                   {{3, kSamples, true}, {4, kSamples, true}, {3, kSamples, false, 0, 2}},
                   layers_of(network),
                   [=](Tape& t, const Values& v) {
                     const Value y = record_warp(t, network, v[0], v[1], window, v[2]);
                     const WithTangents z =
                         record_warp(t, network, WithTangents{v[0], {v[2]}}, v[1], window, v[2]);
                     return Values{y, z.value, z.tangents[0]};
                   },
                   160,
                   0,
                   0.5},
                  []<class T>(const Given<T>& v) -> Outputs<T> {
                    const Columns<T> none3(v[1].size(), std::vector<T>(3, T(0))),
                        none4(v[1].size(), std::vector<T>(4, T(0)));
                    const auto x = dual(v[0], v[2]);
                    const auto motion = on_columns::multiply(
                        point_outputs(network, x, dual(v[1], none4), constants(v.weights), kOpen),
                        dual(v[2], none3));
                    const auto y = on_columns::add(x, motion);
                    const auto value = part(y, &TDual<T>::value);
                    return {value, value, part(y, &TDual<T>::derivative)};
                  },
                  {{0}, {0, 1, 3, 3, 6}});
}

TEST(Sheet, GradientsOfItsCoordinates) {
  PointShape shape = shape_of(WarpKind::kNone, false);
  shape.identity = false;
  static PointNetwork network;
  network = PointNetwork(shape, 2, 0);
  EXPECT_EQ(network.hidden[0].in, 2 * 3 * 2 + 4);
  const FrequencyWeights window = window_of(network.shape);
  check_operation({"sheet",
                   {{3, kSamples, true}, {4, kSamples, true}},
                   layers_of(network),
                   [=](Tape& t, const Values& v) {
                     return Values{record_sheet(t, network, v[0], v[1], window)};
                   },
                   120,
                   0,
                   0.5},
                  []<class T>(const Given<T>& v) -> Outputs<T> {
                    return {point_outputs(network, v[0], v[1], v.weights, kOpen)};
                  },
                  {{0}, {0, 1, 3, 3, 6}});
}

// The last layer's first weights are next to nothing, so that everything begins where it is.
TEST(Warp, BeginsNextToTheIdentity) {
  for (const WarpKind kind : {WarpKind::kTranslation, WarpKind::kSe3}) {
    const WarpNetwork network(shape_of(kind, false), 8);
    AlignedArray<Real> weights(network.end);
    network.initialise(1, 5, weights.data());
    Tape tape(kLane, kLane);
    const Value x = tape.input(3, kSamples), code = tape.input(4, kSamples);
    const Value y = record_warp(tape, network, x, code, window_of(network.shape));
    tape.plan();
    Chunk c(tape);
    c.weights = weights.data();
    c.samples = 1;
    for (int k = 0; k < 3; ++k) c.data(x)[k * c.stride(x)] = 0.5_r;
    for (int k = 0; k < 4; ++k) c.data(code)[k * c.stride(code)] = 1;
    tape.forward(c);
    for (int k = 0; k < 3; ++k) {
      EXPECT_NEAR(c.data(y)[k * c.stride(y)], 0.5, 0.01);
      EXPECT_NE(c.data(y)[k * c.stride(y)], 0.5_r);
    }
  }
}

}  // namespace
}  // namespace nerf
