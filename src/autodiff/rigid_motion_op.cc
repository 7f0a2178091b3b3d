// Points moved by a screw of their own (math/reference/rigid_motion.h is the specification).
#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <type_traits>

#include "nerf/autodiff/operations.h"
#include "nerf/autodiff/tangents.h"
#include "nerf/base/error.h"
#include "nerf/math/reference/scalar.h"

namespace nerf {
namespace {

using reference::Dual;

template <class S>
using Three = std::array<S, 3>;

template <class S>
Three<S> cross(const Three<S>& a, const Three<S>& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
template <class S>
S dot(const Three<S>& a, const Three<S>& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
template <class S>
void add_scaled(Three<S>& a, S f, const Three<S>& b) {
  for (size_t i = 0; i < 3; ++i) a[i] += f * b[i];
}

// Stumpff's functions c_n(s) = sum over k of (-s)^k / (2 k + n)!, of s = angle^2: c_2 is
// (1 - cos) / angle^2, c_3 is (angle - sin) / angle^3. They are smooth at 0, and their derivatives
// need no division: c_n' = (n c_(n+2) - c_(n+1)) / 2.
class Stumpff {
 public:
  // Steps by c_n + s c_(n+2) = 1 / n!, whichever way does not cancel.
  explicit Stumpff(double s) {
    if (s < 1) {
      for (int n = 6; n < 8; ++n) {
        double term = 1 / kFactorial[n];
        c_[n] = term;
        for (int k = 1; k < 8; ++k) c_[n] += term *= -s / ((2 * k + n - 1) * (2 * k + n));
      }
      for (int n = 5; n >= 2; --n) c_[n] = 1 / kFactorial[n] - s * c_[n + 2];
    } else {
      const double angle = std::sqrt(s);
      c_[2] = (1 - std::cos(angle)) / s;
      c_[3] = (1 - std::sin(angle) / angle) / s;
      for (int n = 4; n < 8; ++n) c_[n] = (1 / kFactorial[n - 2] - c_[n - 2]) / s;
    }
  }
  double value(int n) const { return c_[n]; }                              // n from 2 to 7
  double slope(int n) const { return 0.5 * (n * c_[n + 2] - c_[n + 1]); }  // n from 2 to 5

 private:
  static constexpr double kFactorial[] = {1, 1, 2, 6, 24, 120, 720, 5040};
  double c_[8];
};

// The functions of s, and their slopes, as the scalar has them.
struct Of {
  Of(double s) : c(s) {}  // NOLINT: of a scalar
  double value(int n) const { return c.value(n); }
  double slope(int n) const { return c.slope(n); }
  Stumpff c;
};
struct OfDual {
  OfDual(Dual s) : c(s.value), along(s.derivative) {}  // NOLINT: likewise
  Dual value(int n) const { return {c.value(n), c.slope(n) * along}; }
  Dual slope(int n) const {
    return {c.slope(n), 0.5 * (n * c.slope(n + 2) - c.slope(n + 1)) * along};
  }
  Stumpff c;
  double along;
};

// x' = x + u + c_2 w x u + c_3 w x (w x u), u = v + w x x: Rodrigues' formula for R x and that for
// G v, put together. On dual numbers it gives the derivative along a direction, and its gradient()
// that derivative's gradient.
template <class S>
class Motion {
 public:
  struct Parts {
    Three<S> w, v, x;
  };
  explicit Motion(const Parts& of) : in_(of), c_(dot(of.w, of.w)), u_(of.v) {
    add_scaled(u_, S(1), cross(in_.w, in_.x));
    wu_ = cross(in_.w, u_);
    wwu_ = cross(in_.w, wu_);
  }
  Three<S> moved() const {
    Three<S> y = in_.x;
    add_scaled(y, S(1), u_);
    add_scaled(y, c_.value(2), wu_);
    add_scaled(y, c_.value(3), wwu_);
    return y;
  }
  Parts gradient(const Three<S>& g) const {
    Three<S> d_wu{}, d_wwu{};
    add_scaled(d_wu, c_.value(2), g);
    add_scaled(d_wwu, c_.value(3), g);
    Parts d{cross(wu_, d_wwu), g, g};
    add_scaled(d_wu, S(1), cross(d_wwu, in_.w));
    add_scaled(d.w, S(1), cross(u_, d_wu));
    add_scaled(d.v, S(1), cross(d_wu, in_.w));  // the gradient of u
    add_scaled(d.w, S(1), cross(in_.x, d.v));
    add_scaled(d.x, S(1), cross(d.v, in_.w));
    add_scaled(d.w, S(2) * (dot(g, wu_) * c_.slope(2) + dot(g, wwu_) * c_.slope(3)), in_.w);
    return d;
  }

 private:
  Parts in_;
  std::conditional_t<std::is_same_v<S, Dual>, OfDual, Of> c_;
  Three<S> u_, wu_, wwu_;
};

// What both operations share: columns of screws, points and their gradients.
class OfScrews : public Operation {
 public:
  using Operation::Operation;

 protected:
  static Three<double> column(const Real* rows, int64_t stride, int64_t i) {
    return {static_cast<double>(rows[i]), static_cast<double>(rows[stride + i]),
            static_cast<double>(rows[2 * stride + i])};
  }
  static Three<Dual> column(const Real* rows, const Real* along, int64_t stride, int64_t i) {
    Three<Dual> out;
    for (size_t k = 0; k < 3; ++k)
      out[k] = {column(rows, stride, i)[k], column(along, stride, i)[k]};
    return out;
  }
  void put(Chunk& c, int64_t i, const Three<double>& y) const {
    for (int k = 0; k < 3; ++k)
      c.data(output())[k * c.stride(output()) + i] = static_cast<Real>(y[static_cast<size_t>(k)]);
  }
  void clear_padding(Chunk& c) const {
    const int64_t n = c.count(output());
    for (int k = 0; k < 3; ++k)
      std::fill_n(c.data(output()) + k * c.stride(output()) + n, round_up(n, kLane) - n, 0.0_r);
  }
  // The gradient of an input, 0 where this operation is the first to add to it; null where it needs
  // none.
  Real* cleared(Chunk& c, size_t input) const {
    if (!c.tape->needs_gradient(inputs()[input])) return nullptr;
    Real* gradient = c.gradient(inputs()[input]);
    if (overwrites(input))
      for (int r = 0; r < c.tape->rows(inputs()[input]); ++r)
        std::fill_n(gradient + r * c.stride(output()), round_up(c.count(output()), kLane), 0.0_r);
    return gradient;
  }
  // part(k) is added to rows first + k of a gradient that is asked for.
  template <class Part>
  void add(Real* gradient, int first, int64_t stride, int64_t i, const Part& part) const {
    for (int k = 0; gradient && k < 3; ++k)
      gradient[(first + k) * stride + i] += static_cast<Real>(part(static_cast<size_t>(k)));
  }
};

class RigidMotion : public OfScrews {
 public:
  RigidMotion(Value screw, Value x, Value y) : OfScrews({screw, x}, y) {}
  const char* name() const override { return "rigid_motion"; }

  void forward(Chunk& c) const override {
    for (int64_t i = 0; i < c.count(output()); ++i) put(c, i, motion(c, i).moved());
    clear_padding(c);
  }
  void backward(Chunk& c) const override {
    const int64_t ld = c.stride(output());
    Real* const d_screw = cleared(c, 0);
    Real* const dx = cleared(c, 1);
    for (int64_t i = 0; i < c.count(output()); ++i) {
      const auto d = motion(c, i).gradient(column(c.gradient(output()), ld, i));
      add(d_screw, 0, ld, i, [&](size_t k) { return d.w[k]; });
      add(d_screw, 3, ld, i, [&](size_t k) { return d.v[k]; });
      add(dx, 0, ld, i, [&](size_t k) { return d.x[k]; });
    }
  }

 private:
  Motion<double> motion(Chunk& c, int64_t i) const {
    const int64_t ld = c.stride(output());
    const Real* const screw = c.data(inputs()[0]);
    return Motion<double>(
        {column(screw, ld, i), column(screw + 3 * ld, ld, i), column(c.data(inputs()[1]), ld, i)});
  }
};

// Its derivative along tangents of the screw and of the point.
class RigidMotionTangent : public OfScrews {
 public:
  RigidMotionTangent(Value screw, Value x, Value along_screw, Value along_x, Value y)
      : OfScrews({screw, x, along_screw, along_x}, y) {}
  const char* name() const override { return "rigid_motion_tangent"; }

  void forward(Chunk& c) const override {
    for (int64_t i = 0; i < c.count(output()); ++i) {
      const Three<Dual> y = motion(c, i).moved();
      put(c, i, {y[0].derivative, y[1].derivative, y[2].derivative});
    }
    clear_padding(c);
  }
  // With J the motion's Jacobian, which depends on what is moved, the output is J along: its
  // gradient by the direction is J^T g, and that by what is moved the derivative of J^T g along it.
  void backward(Chunk& c) const override {
    const int64_t ld = c.stride(output());
    Real* d[4];
    for (size_t input = 0; input < 4; ++input) d[input] = cleared(c, input);
    for (int64_t i = 0; i < c.count(output()); ++i) {
      const Three<double> g = column(c.gradient(output()), ld, i);
      const auto by = motion(c, i).gradient({g[0], g[1], g[2]});
      const auto put_both = [&](size_t value, int first, const Three<Dual>& of) {
        add(d[value], first, ld, i, [&](size_t k) { return of[k].derivative; });
        add(d[value + 2], first, ld, i, [&](size_t k) { return of[k].value; });
      };
      put_both(0, 0, by.w);
      put_both(0, 3, by.v);
      put_both(1, 0, by.x);
    }
  }

 private:
  Motion<Dual> motion(Chunk& c, int64_t i) const {
    const int64_t ld = c.stride(output());
    const Real* const screw = c.data(inputs()[0]);
    const Real* const along = c.data(inputs()[2]);
    return Motion<Dual>({column(screw, along, ld, i), column(screw + 3 * ld, along + 3 * ld, ld, i),
                         column(c.data(inputs()[1]), c.data(inputs()[3]), ld, i)});
  }
};

}  // namespace

Value rigid_motion(Tape& tape, Value screw, Value x) {
  NERF_CHECK_EQ(tape.rows(screw), 6);
  NERF_CHECK_EQ(tape.rows(x), 3);
  NERF_CHECK(tape.domain(screw) == tape.domain(x));
  const Value from[] = {screw, x};
  const Value y = tape.output(3, tape.domain(x), from);
  tape.record(std::make_unique<RigidMotion>(screw, x, y));
  return y;
}

WithTangents rigid_motion(Tape& tape, const WithTangents& screw, const WithTangents& x) {
  NERF_CHECK_EQ(screw.tangents.size(), x.tangents.size());
  WithTangents y{rigid_motion(tape, screw.value, x.value), {}};
  for (size_t i = 0; i < x.tangents.size(); ++i) {
    const Value from[] = {screw.value, x.value, screw.tangents[i], x.tangents[i]};
    y.tangents.push_back(tape.output(3, tape.domain(x.value), from));
    tape.record(std::make_unique<RigidMotionTangent>(from[0], from[1], from[2], from[3],
                                                     y.tangents.back()));
  }
  return y;
}

}  // namespace nerf
