// Points moved by screws: values, gradients and tangents against the template (gradient_check.h)
// and against numbers from the matrix exponential (golden/rigid_motion.py).
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "autodiff/reference_ops.h"
#include "autodiff/tangent_check.h"
#include "golden/golden.h"
#include "nerf/autodiff/operations.h"

namespace nerf {
namespace {

using Doubles = std::vector<double>;

// Largest coordinates of the rotation vector: none, and angles on both sides of where the series
// ends.
constexpr double kTurns[] = {0, 1e-8, 1e-3, 0.5, 4};

TEST(Gradient, RigidMotion) {
  for (const double turn : kTurns)
    for (int needs = 1; needs < 4; ++needs)  // which of the screw and the point
      check_operation({"rigid_motion",
                       {{3, kSamples, (needs & 1) != 0, -turn, turn},
                        {3, kSamples, (needs & 1) != 0},
                        {3, kSamples, (needs & 2) != 0}},
                       {},
                       [](Tape& t, const Values& v) {
                         const Value y = rigid_motion(t, concat(t, v[0], v[1]), v[2]);
                         // Alone, and beside other readers of its inputs.
                         return Values{y, rigid_motion(t, concat(t, v[0], v[1]), y), v[2]};
                       },
                       6},
                      []<class T>(const Given<T>& v) -> Outputs<T> {
                        const auto screw = on_columns::concat(v[0], v[1]);
                        const auto y = on_columns::rigid_motion(screw, v[2]);
                        return {y, on_columns::rigid_motion(screw, y), v[2]};
                      },
                      {{0}, {0, 1, 17, 17, 20}});
}

// Second derivatives: the gradient of the derivative along a direction.
TEST(Tangents, OfRigidMotion) {
  for (const double turn : kTurns)
    for (int needs = 1; needs < 4; ++needs) {  // which of the parts and the directions
      const bool part = (needs & 1) != 0, direction = (needs & 2) != 0;
      check_operation(
          {"tangent_rigid_motion",
           {{3, kSamples, part, -turn, turn},
            {6, kSamples, part},
            {3, kSamples, direction},
            {6, kSamples, direction}},
           {},
           [](Tape& t, const Values& v) {
             const WithTangents w{v[0], {v[2]}}, rest{v[1], {v[3]}};
             const WithTangents y =
                 rigid_motion(t, concat(t, w, slice(t, rest, 0, 3)), slice(t, rest, 3, 3));
             return Values{y.value, y.tangents[0]};
           },
           60},
          []<class T>(const Given<T>& v) -> Outputs<T> {
            const auto w = dual(v[0], v[2]), rest = dual(v[1], v[3]);
            const auto y =
                on_columns::rigid_motion(on_columns::concat(w, on_columns::slice(rest, 0, 3)),
                                         on_columns::slice(rest, 3, 3));
            return {nerf::part(y, &TDual<T>::value), nerf::part(y, &TDual<T>::derivative)};
          },
          {{0}, {0, 1, 17, 17, 20}});
    }
}

// A motion on a tape of one sample, or its derivative along a direction, with their gradients.
struct Alone {
  explicit Alone(bool tangent) : tape(kLane, kLane) {
    for (int i = 0; i < (tangent ? 2 : 1); ++i) {
      screw.push_back(tape.input(6, kSamples, true));
      point.push_back(tape.input(3, kSamples, true));
    }
    y = tangent ? rigid_motion(tape, WithTangents{screw[0], {screw[1]}},
                               WithTangents{point[0], {point[1]}})
                      .tangents[0]
                : rigid_motion(tape, screw[0], point[0]);
    g = tape.input(3, kSamples);
    add_gradient(tape, y, g);
    tape.plan();
  }
  // numbers: w, v, x; their directions; the output's gradient, as far as they go.
  Doubles forward(Chunk& c, const Doubles& numbers) const {
    c.samples = 1;
    std::vector<Value> to;
    for (size_t i = 0; i < screw.size(); ++i) to.insert(to.end(), {screw[i], point[i]});
    to.push_back(g);
    size_t at = 0;
    for (const Value v : to)
      for (int r = 0; r < tape.rows(v) && at < numbers.size(); ++r)
        c.data(v)[r * c.stride(v)] = static_cast<Real>(numbers[at++]);
    tape.forward(c);
    return rows(c, c.data(y), y);
  }
  Doubles gradient(Chunk& c) const {
    tape.backward(c);
    Doubles out = rows(c, c.gradient(screw[0]), screw[0]);
    for (const double d : rows(c, c.gradient(point[0]), point[0])) out.push_back(d);
    return out;
  }
  Doubles rows(const Chunk& c, const Real* from, Value v) const {
    Doubles out;
    for (int r = 0; r < tape.rows(v); ++r) out.push_back(from[r * c.stride(v)]);
    return out;
  }

  Tape tape;
  Values screw, point;
  Value y, g;
};

// Truth has 17 digits of what the floats are; a result is rounded once or twice, however large the
// terms that it is a sum of.
void compare(const std::string& name, const Doubles& line, size_t given, const Doubles& got) {
  ASSERT_EQ(line.size(), given + got.size());
  double largest = 1;
  for (size_t i = given; i < line.size(); ++i) largest = std::max(largest, std::fabs(line[i]));
  for (size_t i = 0; i < got.size(); ++i)
    EXPECT_NEAR(got[i], line[given + i], 4 * kRoundoff * largest)
        << name << " row " << i << " of " << line[0] << " " << line[1] << " " << line[2];
}

TEST(RigidMotion, IsTheMatrixExponential) {
  const Alone motion(false), along(true);
  Chunk c(motion.tape), d(along.tape);
  const std::string file = "rigid_motion.txt";
  for (const Doubles& line : golden_lines(file, "motion"))
    compare("motion", line, 9, motion.forward(c, {line.begin(), line.begin() + 9}));
  for (const Doubles& line : golden_lines(file, "gradient")) {
    motion.forward(c, {line.begin(), line.begin() + 12});
    compare("gradient", line, 12, motion.gradient(c));
  }
  for (const Doubles& line : golden_lines(file, "along"))
    compare("along", line, 18, along.forward(d, {line.begin(), line.begin() + 18}));
  for (const Doubles& line : golden_lines(file, "second")) {
    along.forward(d, {line.begin(), line.begin() + 21});
    compare("second", line, 21, along.gradient(d));
  }
}

// A rotation vector of a whole turn brings a point back, moved along the axis alone; distances
// stay.
TEST(RigidMotion, KeepsDistances) {
  const Alone motion(false);
  Chunk c(motion.tape);
  const Doubles screw{0.3, -2, 1.1, 0.4, 0.2, -0.7};
  Doubles a = screw, b = screw;
  a.insert(a.end(), {0.1, 0.2, 0.3});
  b.insert(b.end(), {-0.5, 0.9, 0.0});
  const Doubles y = motion.forward(c, a), z = motion.forward(c, b);
  EXPECT_NEAR(std::hypot(y[0] - z[0], y[1] - z[1], y[2] - z[2]), std::hypot(0.6, 0.7, 0.3),
              8 * kRoundoff);
}

}  // namespace
}  // namespace nerf
