// Encodings of positions and directions, and what spreads a ray's values over its samples.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <memory>
#include <vector>

#include "autodiff/ray_rows.h"
#include "nerf/autodiff/operations.h"
#include "nerf/base/error.h"
#include "nerf/kernels/elementwise.h"
#include "nerf/kernels/encoding.h"

namespace nerf {
namespace {

// Rows of the features of coordinate i at frequency k.
struct FeatureRows {
  int sine, cosine;
};

// Both encodings: they differ in the order of their features, in identity and in the variance.
class SineCosine : public Operation {
 public:
  SineCosine(std::vector<Value> inputs, Value y, int coordinates, FrequencyWeights weights,
             bool identity, bool sines_first)
      : Operation(std::move(inputs), y),
        coordinates_(coordinates),
        weights_(std::move(weights)),
        identity_(identity),
        sines_first_(sines_first) {}
  const char* name() const override { return "sine_cosine"; }

  void forward(Chunk& c) const override {
    const int64_t ld = c.stride(output()), n = c.count(output());
    const Real* x = c.data(inputs()[0]);
    const Real* variance = integrated() ? c.data(inputs()[1]) : nullptr;
    Real* y = c.data(output());
    if (identity_)
      for (int i = 0; i < coordinates_; ++i)
        std::memcpy(y + i * ld, x + i * ld, static_cast<size_t>(round_up(n, kLane)) * sizeof(Real));
    each_feature([&](int i, int k, FeatureRows rows) {
      sine_cosine_forward(n, x + i * ld, variance ? variance + i * ld : nullptr, frequency(k),
                          (*weights_)[static_cast<size_t>(k)], y + rows.sine * ld,
                          y + rows.cosine * ld);
    });
  }

  void backward(Chunk& c) const override {
    const int64_t ld = c.stride(output()), n = c.count(output());
    const Real* y = c.data(output());
    const Real* dy = c.gradient(output());
    const bool of_variance = integrated() && c.tape->needs_gradient(inputs()[1]);
    Real* d_variance = of_variance ? cleared(c, 1) : nullptr;
    // The variance may be trained where the mean is not; the kernel gives both.
    Real* dx = c.tape->needs_gradient(inputs()[0]) ? cleared(c, 0)
                                                   : c.arena.data() + c.tape->scratch_offset();
    if (identity_)
      for (int i = 0; i < coordinates_; ++i) add_to(n, dy + i * ld, dx + i * ld);
    each_feature([&](int i, int k, FeatureRows rows) {
      sine_cosine_backward(n, y + rows.sine * ld, y + rows.cosine * ld, dy + rows.sine * ld,
                           dy + rows.cosine * ld, frequency(k), dx + i * ld,
                           d_variance ? d_variance + i * ld : nullptr);
    });
  }

 private:
  bool integrated() const { return inputs().size() == 2; }
  static Real frequency(int k) { return std::ldexp(1.0_r, k); }

  Real* cleared(Chunk& c, size_t input) const {
    Real* gradient = c.gradient(inputs()[input]);
    if (overwrites(input))
      for (int i = 0; i < coordinates_; ++i)
        std::fill_n(gradient + i * c.stride(output()), round_up(c.count(output()), kLane), 0.0_r);
    return gradient;
  }

  template <class F>
  void each_feature(const F& f) const {
    const int frequencies = static_cast<int>(weights_->size());
    const int first = identity_ ? coordinates_ : 0;
    for (int k = 0; k < frequencies; ++k)
      for (int i = 0; i < coordinates_; ++i) {
        if (sines_first_)
          f(i, k, {first + k * coordinates_ + i, first + (frequencies + k) * coordinates_ + i});
        else
          f(i, k, {first + 2 * k * coordinates_ + i, first + (2 * k + 1) * coordinates_ + i});
      }
  }

  int coordinates_;
  FrequencyWeights weights_;
  bool identity_, sines_first_;
};

class ViewCode : public Operation {
 public:
  ViewCode(Value directions, Value y) : Operation({directions}, y) {}
  const char* name() const override { return "view_code"; }

  void forward(Chunk& c) const override {
    const Real* d = c.data(inputs()[0]);
    const int64_t lr = c.stride(inputs()[0]), ls = c.stride(output());
    Real* y = c.data(output());
    if (c.tape->domain(output()) == Domain::kRays) {
      spherical_harmonics(c.rays, d, lr, y, ls);
      for (int k = 0; k < kSphericalHarmonics; ++k)
        std::fill(y + k * ls + c.rays, y + k * ls + round_up(c.rays, kLane), 0.0_r);
      return;
    }
    const RayRanges columns = internal::rays_of(c, output());
    constexpr int kAtOnce = 64;
    alignas(64) Real code[kSphericalHarmonics * kAtOnce];
    for (int first = 0; first < c.rays; first += kAtOnce) {
      const int n = std::min(kAtOnce, c.rays - first);
      spherical_harmonics(n, d + first, lr, code, kAtOnce);
      for (int k = 0; k < kSphericalHarmonics; ++k)
        for (int r = 0; r < n; ++r)
          std::fill(y + k * ls + columns.begin[first + r],
                    y + k * ls + columns.begin[first + r + 1], code[k * kAtOnce + r]);
    }
  }
  void backward(Chunk&) const override {}  // directions are not trained
};

class RepeatForSamples : public Operation {
 public:
  RepeatForSamples(Value x, Value y) : Operation({x}, y) {}
  const char* name() const override { return "repeat_for_samples"; }

  void forward(Chunk& c) const override {
    const int64_t lr = c.stride(inputs()[0]), ls = c.stride(output()), n = c.count(output());
    const RayRanges columns = internal::rays_of(c, output());
    const Real* x = c.data(inputs()[0]);
    Real* y = c.data(output());
    for (int k = 0; k < c.tape->rows(output()); ++k) {
      for (int r = 0; r < c.rays; ++r)
        std::fill(y + k * ls + columns.begin[r], y + k * ls + columns.begin[r + 1], x[k * lr + r]);
      std::fill(y + k * ls + n, y + k * ls + round_up(n, kLane), 0.0_r);
    }
  }
  void backward(Chunk& c) const override {
    const int64_t lr = c.stride(inputs()[0]), ls = c.stride(output());
    const RayRanges columns = internal::rays_of(c, output());
    const Real* dy = c.gradient(output());
    Real* dx = c.gradient(inputs()[0]);
    for (int k = 0; k < c.tape->rows(output()); ++k) {
      for (int r = 0; r < c.rays; ++r) {
        double sum = overwrites(0) ? 0 : double{dx[k * lr + r]};  // however long the ray is
        for (int s = columns.begin[r]; s < columns.begin[r + 1]; ++s) sum += double{dy[k * ls + s]};
        dx[k * lr + r] = static_cast<Real>(sum);
      }
      if (overwrites(0))
        std::fill(dx + k * lr + c.rays, dx + k * lr + round_up(c.rays, kLane), 0.0_r);
    }
  }
};

class TableRows : public Operation {
 public:
  TableRows(Value index, Value y, const LinearWeights& w) : Operation({index}, y), w_(w) {}
  const char* name() const override { return "table_rows"; }

  void forward(Chunk& c) const override {
    const int64_t ld = c.stride(output()), n = c.count(output());
    Real* y = c.data(output());
    for (int64_t i = 0; i < round_up(n, kLane); ++i) {
      const Real* row = i < n && row_of(c, i) >= 0 ? c.weights + at(row_of(c, i)) : nullptr;
      for (int k = 0; k < w_.in; ++k) y[k * ld + i] = row ? row[k] : 0.0_r;
    }
  }
  void backward(Chunk& c) const override {
    const int64_t ld = c.stride(output()), n = c.count(output());
    const Real* dy = c.gradient(output());
    for (int64_t i = 0; i < n; ++i) {
      if (row_of(c, i) < 0) continue;
      Real* row = c.weight_gradient + at(row_of(c, i));
      for (int k = 0; k < w_.in; ++k) row[k] += dy[k * ld + i];
    }
  }

 private:
  int row_of(const Chunk& c, int64_t i) const {
    const int row = static_cast<int>(std::floor(c.data(inputs()[0])[i]));
    NERF_CHECK_LT(row, w_.out);
    return row;
  }
  size_t at(int row) const {
    return w_.offset + static_cast<size_t>(row) * static_cast<size_t>(weight_stride(w_.in));
  }

  LinearWeights w_;
};

}  // namespace

Value frequency_encoding(Tape& tape, Value x, std::span<const Real> weights, bool identity) {
  return frequency_encoding(
      tape, x, std::make_shared<const std::vector<Real>>(weights.begin(), weights.end()), identity);
}

FrequencyWeights open_window(int degrees) {
  return std::make_shared<const std::vector<Real>>(static_cast<size_t>(degrees), 1.0_r);
}

Value frequency_encoding(Tape& tape, Value x, const FrequencyWeights& weights, bool identity) {
  const int d = tape.rows(x), frequencies = static_cast<int>(weights->size());
  const Value y = tape.output((identity ? d : 0) + 2 * d * frequencies, tape.domain(x), {&x, 1});
  tape.record(std::make_unique<SineCosine>(std::vector<Value>{x}, y, d, weights, identity,
                                           /*sines_first=*/false));
  return y;
}

Value integrated_encoding(Tape& tape, Value mean, Value variance, int degrees) {
  const int d = tape.rows(mean);
  NERF_CHECK_EQ(tape.rows(variance), d);
  NERF_CHECK(tape.domain(mean) == tape.domain(variance));
  const Value from[] = {mean, variance};
  const Value y = tape.output(2 * d * degrees, tape.domain(mean), from);
  tape.need_scratch(static_cast<size_t>(d) * static_cast<size_t>(tape.capacity(tape.domain(mean))));
  tape.record(std::make_unique<SineCosine>(
      std::vector<Value>{mean, variance}, y, d,
      std::make_shared<const std::vector<Real>>(static_cast<size_t>(degrees), 1.0_r),
      /*identity=*/false, /*sines_first=*/true));
  return y;
}

Value repeat_for_samples(Tape& tape, Value x) { return repeat_for(tape, x, Domain::kSamples); }

Value repeat_for(Tape& tape, Value x, Domain domain) {
  NERF_CHECK(tape.domain(x) == Domain::kRays && domain != Domain::kRays);
  const Value y = tape.output(tape.rows(x), domain, {&x, 1});
  tape.record(std::make_unique<RepeatForSamples>(x, y));
  return y;
}

Value table_rows(Tape& tape, Value index, const LinearWeights& w) {
  NERF_CHECK_EQ(tape.rows(index), 1);
  NERF_CHECK(!tape.needs_gradient(index) && !w.bias);
  const Value y = tape.output(w.in, tape.domain(index), {&index, 1}, /*trained=*/w.out > 0);
  tape.record(std::make_unique<TableRows>(index, y, w));
  return y;
}

Value view_code(Tape& tape, Value directions, Domain domain) {
  NERF_CHECK_EQ(tape.rows(directions), 3);
  NERF_CHECK(!tape.needs_gradient(directions));
  const Value y = tape.output(kSphericalHarmonics, domain, {&directions, 1});
  tape.record(std::make_unique<ViewCode>(directions, y));
  return y;
}

}  // namespace nerf
