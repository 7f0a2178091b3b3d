// Losses on warps (math/reference/warp_losses.h is the specification).
#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <utility>

#include "autodiff/ray_rows.h"
#include "nerf/autodiff/operations.h"
#include "nerf/base/error.h"

namespace nerf {
namespace {

// Geman and McClure's penalty of a squared residual, as the authors' code scales it.
struct Penalty {
  double scale;
  double value(double square) const {
    const double u = square / (scale * scale);
    return 2 * scale * u / (u + 4);
  }
  double slope(double square) const {
    const double u = square / (scale * scale);
    return 8 / (scale * (u + 4) * (u + 4));
  }
};

struct Matrix {
  double at[3][3];
};

// Eigenvalues of a symmetric matrix and their vectors, columns of `vectors`: Jacobi's rotations,
// which keep the digits of small eigenvalues.
struct SymmetricEigen {
  explicit SymmetricEigen(Matrix m) : vectors{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}} {
    for (int sweep = 0; sweep < 12; ++sweep) {
      double off = 0, all = 0;
      for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) (i == j ? all : off) += m.at[i][j] * m.at[i][j];
      if (!(off > 1e-34 * (all + off))) break;
      for (const auto& [p, q] : {std::pair{0, 1}, {0, 2}, {1, 2}}) rotate(m, p, q);
    }
    for (int i = 0; i < 3; ++i) values[i] = m.at[i][i];
  }

  double values[3];
  Matrix vectors;

 private:
  void rotate(Matrix& m, int p, int q) {
    if (m.at[p][q] == 0) return;
    const double theta = (m.at[q][q] - m.at[p][p]) / (2 * m.at[p][q]);
    const double t = std::copysign(1.0, theta) / (std::fabs(theta) + std::hypot(theta, 1.0));
    const double c = 1 / std::sqrt(t * t + 1), s = t * c;
    for (int k = 0; k < 3; ++k) turn(m.at[k][p], m.at[k][q], c, s);
    for (int k = 0; k < 3; ++k) turn(m.at[p][k], m.at[q][k], c, s);
    for (int k = 0; k < 3; ++k) turn(vectors.at[k][p], vectors.at[k][q], c, s);
  }
  static void turn(double& a, double& b, double c, double s) {
    const double x = a, y = b;
    a = c * x - s * y;
    b = s * x + c * y;
  }
};

constexpr double kLeastSingularValue = 1e-6;

// The gradient of the loss by the Jacobian is found on the way forward, and kept.
class ElasticLoss : public Operation {
 public:
  ElasticLoss(const std::array<Value, 3>& columns, Value weights, Value scale, Value kept,
              Value out, double penalty)
      : Operation({columns[0], columns[1], columns[2]}, out),
        weights_(weights),
        scale_(scale),
        kept_(kept),
        penalty_{penalty} {}
  const char* name() const override { return "elastic_loss"; }

  void forward(Chunk& c) const override {
    const Real* const weights = c.data(weights_);
    const Real* const scale = c.data(scale_);
    Real* const out = c.data(output());
    for (int r = 0; r < c.rays; ++r) {
      double sum = 0;
      for (int i = c.ray_begin[r]; i < c.ray_begin[r + 1]; ++i)
        sum += of_sample(c, i, static_cast<double>(weights[i]) * static_cast<double>(scale[r]));
      out[r] = static_cast<Real>(sum);
      c.loss += sum;
    }
  }

  void backward(Chunk& c) const override {
    const int64_t lk = c.stride(kept_), n = c.count(kept_);
    const Real* const kept = std::as_const(c).data(kept_);
    for (int column = 0; column < 3; ++column) {
      const size_t input = static_cast<size_t>(column);
      if (!c.tape->needs_gradient(inputs()[input])) continue;
      const int64_t ld = c.stride(inputs()[input]);
      for (int row = 0; row < 3; ++row) {
        const Real* const from = kept + (3 * column + row) * lk;
        Real* const to = c.gradient(inputs()[input]) + row * ld;
        for (int64_t i = 0; i < n; ++i) to[i] = (overwrites(input) ? 0 : to[i]) + from[i];
        if (overwrites(input)) internal::clear_padding(c, inputs()[input], to);
      }
    }
  }

 private:
  // The sample's part of the loss.
  double of_sample(Chunk& c, int i, double factor) const {
    const int64_t lk = c.stride(kept_);
    Real* const kept = c.data(kept_) + i;
    if (factor == 0) {
      for (int k = 0; k < 9; ++k) kept[k * lk] = 0;
      return 0;
    }
    Matrix columns{}, apart{};  // J's columns as rows; J^T J - 1
    for (int a = 0; a < 3; ++a) {
      const Value v = inputs()[static_cast<size_t>(a)];
      for (int k = 0; k < 3; ++k)
        columns.at[a][k] = static_cast<double>(c.data(v)[k * c.stride(v) + i]);
    }
    for (int a = 0; a < 3; ++a)
      for (int b = 0; b < 3; ++b) {
        for (int k = 0; k < 3; ++k) apart.at[a][b] += columns.at[a][k] * columns.at[b][k];
        apart.at[a][b] -= a == b ? 1 : 0;
      }
    const SymmetricEigen eigen(apart);
    constexpr double kLeast = kLeastSingularValue * kLeastSingularValue;
    double square = 0, slopes[3];  // of log(lambda)^2 / 4 by lambda, twice
    for (int a = 0; a < 3; ++a) {
      const double lambda = 1 + eigen.values[a];
      const bool counts = lambda > kLeast;
      const double log = counts ? std::log1p(eigen.values[a]) : std::log(kLeast);
      square += 0.25 * log * log;
      slopes[a] = counts ? log / lambda : 0;
    }
    // By J: J V diag(slopes) V^T.
    const double by = factor * penalty_.slope(square);
    for (int b = 0; b < 3; ++b)
      for (int k = 0; k < 3; ++k) {
        double sum = 0;
        for (int a = 0; a < 3; ++a) {
          double entry = 0;
          for (int e = 0; e < 3; ++e)
            entry += eigen.vectors.at[a][e] * slopes[e] * eigen.vectors.at[b][e];
          sum += columns.at[a][k] * entry;
        }
        kept[(3 * b + k) * lk] = static_cast<Real>(by * sum);
      }
    return factor * penalty_.value(square);
  }

  Value weights_, scale_, kept_;
  Penalty penalty_;
};

class StillLoss : public Operation {
 public:
  StillLoss(Value moved, Value point, Value scale, Value out, double penalty)
      : Operation({moved, point, scale}, out), penalty_{penalty} {}
  const char* name() const override { return "still_loss"; }

  void forward(Chunk& c) const override {
    const Real* const scale = c.data(inputs()[2]);
    for (int r = 0; r < c.rays; ++r) {
      double sum = 0;
      for (int i = c.ray_begin[r]; i < c.ray_begin[r + 1]; ++i)
        sum += penalty_.value(square(c, i)) * static_cast<double>(scale[r]);
      c.data(output())[r] = static_cast<Real>(sum);
      c.loss += sum;
    }
  }

  void backward(Chunk& c) const override {
    const Real* const scale = c.data(inputs()[2]);
    for (size_t input = 0; input < 2; ++input) {
      if (!c.tape->needs_gradient(inputs()[input])) continue;
      const int64_t ld = c.stride(inputs()[input]);
      Real* const to = c.gradient(inputs()[input]);
      const double sign = input == 0 ? 2 : -2;
      for (int r = 0; r < c.rays; ++r)
        for (int i = c.ray_begin[r]; i < c.ray_begin[r + 1]; ++i) {
          const double by = sign * penalty_.slope(square(c, i)) * static_cast<double>(scale[r]);
          for (int k = 0; k < 3; ++k)
            to[k * ld + i] =
                (overwrites(input) ? 0 : to[k * ld + i]) + static_cast<Real>(by * apart(c, k, i));
        }
      for (int k = 0; k < 3 && overwrites(input); ++k)
        internal::clear_padding(c, inputs()[input], to + k * ld);
    }
  }

 private:
  double apart(Chunk& c, int k, int i) const {
    const int64_t ld = c.stride(inputs()[0]);
    return static_cast<double>(c.data(inputs()[0])[k * ld + i]) -
           static_cast<double>(c.data(inputs()[1])[k * ld + i]);
  }
  double square(Chunk& c, int i) const {
    double sum = 0;
    for (int k = 0; k < 3; ++k) sum += apart(c, k, i) * apart(c, k, i);
    return sum;
  }
  Penalty penalty_;
};

}  // namespace

Value elastic_loss(Tape& tape, const std::array<Value, 3>& columns, Value weights, Value scale,
                   Real penalty) {
  for (const Value v : columns) {
    NERF_CHECK_EQ(tape.rows(v), 3);
    NERF_CHECK(tape.domain(v) == Domain::kSamples);
  }
  NERF_CHECK_EQ(tape.rows(weights), 1);
  NERF_CHECK(tape.domain(weights) == Domain::kSamples && tape.domain(scale) == Domain::kRays);
  NERF_CHECK(!tape.needs_gradient(scale) && penalty > 0);
  tape.keep_rows(weights);
  const Value kept = tape.output(9, Domain::kSamples, {});
  const Value out = tape.output(1, Domain::kRays, columns);
  tape.record(std::make_unique<ElasticLoss>(columns, weights, scale, kept, out,
                                            static_cast<double>(penalty)));
  return out;
}

Value still_loss(Tape& tape, Value moved, Value point, Value scale, Real penalty) {
  for (const Value v : {moved, point}) {
    NERF_CHECK_EQ(tape.rows(v), 3);
    NERF_CHECK(tape.domain(v) == Domain::kSamples);
  }
  NERF_CHECK(tape.domain(scale) == Domain::kRays && !tape.needs_gradient(scale) && penalty > 0);
  const Value from[] = {moved, point};
  const Value out = tape.output(1, Domain::kRays, from);
  tape.record(std::make_unique<StillLoss>(moved, point, scale, out, static_cast<double>(penalty)));
  return out;
}

}  // namespace nerf
