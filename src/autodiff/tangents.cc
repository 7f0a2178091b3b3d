#include "nerf/autodiff/tangents.h"

#include <algorithm>
#include <cmath>
#include <memory>

#include "nerf/base/error.h"
#include "nerf/kernels/elementwise.h"

namespace nerf {
namespace {

// The tangent behind a ReLU: that before it where the ReLU's output is above 0.
class Gate : public Operation {
 public:
  // `relu_output` gets no gradient: a step has none.
  Gate(Value tangent, Value relu_output, Value y) : Operation({tangent}, y), open_(relu_output) {}
  const char* name() const override { return "gate"; }

  void forward(Chunk& c) const override {
    const int64_t ld = c.stride(output()), n = round_up(c.count(output()), kLane);
    for (int r = 0; r < c.tape->rows(output()); ++r) {
      const Real *x = c.data(inputs()[0]) + r * ld, *open = c.data(open_) + r * ld;
      Real* y = c.data(output()) + r * ld;
      for (int64_t i = 0; i < n; ++i) y[i] = open[i] > 0 ? x[i] : 0;
    }
  }
  void backward(Chunk& c) const override {
    const int64_t ld = c.stride(output()), n = round_up(c.count(output()), kLane);
    const bool overwrite = overwrites(0);
    for (int r = 0; r < c.tape->rows(output()); ++r) {
      const Real *dy = c.gradient(output()) + r * ld, *open = c.data(open_) + r * ld;
      Real* dx = c.gradient(inputs()[0]) + r * ld;
      for (int64_t i = 0; i < n; ++i) dx[i] = (overwrite ? 0 : dx[i]) + (open[i] > 0 ? dy[i] : 0);
    }
  }

 private:
  Value open_;
};

// The tangent of frequency features, from the features and the coordinates' tangent.
class EncodingTangent : public Operation {
 public:
  EncodingTangent(Value features, Value tangent, Value y, int frequencies, bool identity)
      : Operation({features, tangent}, y), frequencies_(frequencies), identity_(identity) {}
  const char* name() const override { return "encoding_tangent"; }

  void forward(Chunk& c) const override {
    const int64_t ld = c.stride(output()), n = round_up(c.count(output()), kLane);
    const Real *features = c.data(inputs()[0]), *tangent = c.data(inputs()[1]);
    Real* y = c.data(output());
    const int coordinates = c.tape->rows(inputs()[1]);
    if (identity_)
      for (int k = 0; k < coordinates; ++k) std::copy_n(tangent + k * ld, n, y + k * ld);
    each_pair(coordinates, [&](int k, Real frequency, int sine, int cosine) {
      const Real* t = tangent + k * ld;
      const Real *s = features + sine * ld, *co = features + cosine * ld;
      for (int64_t i = 0; i < n; ++i) {
        y[sine * ld + i] = frequency * co[i] * t[i];
        y[cosine * ld + i] = -frequency * s[i] * t[i];
      }
    });
  }

  void backward(Chunk& c) const override {
    const int64_t ld = c.stride(output()), n = round_up(c.count(output()), kLane);
    const Real *features = c.data(inputs()[0]), *tangent = c.data(inputs()[1]);
    const Real* dy = c.gradient(output());
    Real* d_features = cleared(c, 0);
    Real* d_tangent = cleared(c, 1);
    const int coordinates = c.tape->rows(inputs()[1]);
    if (identity_ && d_tangent)
      for (int k = 0; k < coordinates; ++k) add_to(n, dy + k * ld, d_tangent + k * ld);
    each_pair(coordinates, [&](int k, Real frequency, int sine, int cosine) {
      const Real* t = tangent + k * ld;
      const Real *s = features + sine * ld, *co = features + cosine * ld;
      const Real *ds = dy + sine * ld, *dc = dy + cosine * ld;
      for (int64_t i = 0; d_tangent && i < n; ++i)
        d_tangent[k * ld + i] += frequency * (co[i] * ds[i] - s[i] * dc[i]);
      for (int64_t i = 0; d_features && i < n; ++i) {
        d_features[cosine * ld + i] += frequency * t[i] * ds[i];
        d_features[sine * ld + i] -= frequency * t[i] * dc[i];
      }
    });
  }

 private:
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

  // body(coordinate, frequency, rows of its sine and its cosine), in frequency_encoding()'s order.
  template <class Body>
  void each_pair(int coordinates, const Body& body) const {
    const int first = identity_ ? coordinates : 0;
    for (int f = 0; f < frequencies_; ++f)
      for (int k = 0; k < coordinates; ++k)
        body(k, std::ldexp(1.0_r, f), first + 2 * f * coordinates + k,
             first + (2 * f + 1) * coordinates + k);
  }

  int frequencies_;
  bool identity_;
};

// A tangent's rows from `first` on, zeros above and below them.
class BetweenZeros : public Operation {
 public:
  BetweenZeros(Value tangent, Value y, int first) : Operation({tangent}, y), first_(first) {}
  const char* name() const override { return "between_zeros"; }

  void forward(Chunk& c) const override {
    const int64_t ld = c.stride(output()), n = round_up(c.count(output()), kLane);
    const Real* x = c.data(inputs()[0]);
    Real* y = c.data(output());
    const int rows = c.tape->rows(inputs()[0]);
    for (int r = 0; r < c.tape->rows(output()); ++r) {
      if (r >= first_ && r < first_ + rows)
        std::copy_n(x + (r - first_) * ld, n, y + r * ld);
      else
        std::fill_n(y + r * ld, n, 0.0_r);
    }
  }
  void backward(Chunk& c) const override {
    const int64_t ld = c.stride(output()), n = round_up(c.count(output()), kLane);
    for (int r = 0; r < c.tape->rows(inputs()[0]); ++r) {
      const Real* dy = c.gradient(output()) + (first_ + r) * ld;
      Real* dx = c.gradient(inputs()[0]) + r * ld;
      if (overwrites(0))
        std::copy_n(dy, n, dx);
      else
        add_to(n, dy, dx);
    }
  }

 private:
  int first_;
};

Value gate(Tape& tape, Value tangent, Value relu_output) {
  const Value y = tape.output(tape.rows(tangent), tape.domain(tangent), {&tangent, 1});
  tape.keep_rows(relu_output);
  tape.record(std::make_unique<Gate>(tangent, relu_output, y));
  return y;
}

Value between_zeros(Tape& tape, Value tangent, int first, int rows) {
  const Value y = tape.output(rows, tape.domain(tangent), {&tangent, 1});
  tape.record(std::make_unique<BetweenZeros>(tangent, y, first));
  return y;
}

// f of each tangent.
template <class F>
std::vector<Value> of_each(const WithTangents& x, const F& f) {
  std::vector<Value> out;
  for (const Value t : x.tangents) out.push_back(f(t));
  return out;
}

// f of the values and of each pair of tangents: a function linear in both.
template <class F>
WithTangents of_both(const WithTangents& a, const WithTangents& b, const F& f) {
  NERF_CHECK_EQ(a.tangents.size(), b.tangents.size());
  WithTangents y{f(a.value, b.value), {}};
  for (size_t i = 0; i < a.tangents.size(); ++i)
    y.tangents.push_back(f(a.tangents[i], b.tangents[i]));
  return y;
}

}  // namespace

WithTangents linear(Tape& tape, const WithTangents& x, const LinearWeights& w,
                    LinearActivation activation) {
  LinearWeights product = w;
  product.bias = false;
  const Value y = linear(tape, x.value, w, activation);
  return {y, of_each(x, [&](Value t) {
            const Value along = linear(tape, t, product, LinearActivation::kNone);
            return activation == LinearActivation::kRelu ? gate(tape, along, y) : along;
          })};
}

WithTangents mlp(Tape& tape, WithTangents x, std::span<const LinearWeights> layers) {
  for (size_t i = 0; i < layers.size(); ++i)
    x = linear(tape, x, layers[i],
               i + 1 < layers.size() ? LinearActivation::kRelu : LinearActivation::kNone);
  return x;
}

WithTangents concat(Tape& tape, const WithTangents& a, const WithTangents& b) {
  return of_both(a, b, [&](Value x, Value y) { return concat(tape, x, y); });
}

WithTangents concat(Tape& tape, const WithTangents& a, Value constant) {
  NERF_CHECK(tape.domain(a.value) == tape.domain(constant));
  const Value y = concat(tape, a.value, constant);
  return {y, of_each(a, [&](Value t) { return between_zeros(tape, t, 0, tape.rows(y)); })};
}

WithTangents concat(Tape& tape, Value constant, const WithTangents& b) {
  NERF_CHECK(tape.domain(constant) == tape.domain(b.value));
  const Value y = concat(tape, constant, b.value);
  const int first = tape.rows(constant);
  return {y, of_each(b, [&](Value t) { return between_zeros(tape, t, first, tape.rows(y)); })};
}

WithTangents slice(Tape& tape, const WithTangents& x, int first, int rows) {
  return {slice(tape, x.value, first, rows),
          of_each(x, [&](Value t) { return slice(tape, t, first, rows); })};
}

WithTangents truncated_exp(Tape& tape, const WithTangents& x) {
  const Value y = truncated_exp(tape, x.value);
  return {y, of_each(x, [&](Value t) { return multiply(tape, y, t); })};
}

WithTangents sigmoid(Tape& tape, const WithTangents& x) {
  const Value y = sigmoid(tape, x.value);
  const Value slope = multiply(tape, y, scale_shift(tape, y, -1, 1));
  return {y, of_each(x, [&](Value t) { return multiply(tape, slope, t); })};
}

WithTangents softplus(Tape& tape, const WithTangents& x, Real shift) {
  const Value slope = sigmoid(tape, scale_shift(tape, x.value, 1, shift));
  return {softplus(tape, x.value, shift),
          of_each(x, [&](Value t) { return multiply(tape, slope, t); })};
}

WithTangents relu(Tape& tape, const WithTangents& x) {
  const Value y = relu(tape, x.value);
  return {y, of_each(x, [&](Value t) { return gate(tape, t, y); })};
}

WithTangents add(Tape& tape, const WithTangents& a, const WithTangents& b) {
  return of_both(a, b, [&](Value x, Value y) { return add(tape, x, y); });
}

WithTangents multiply(Tape& tape, const WithTangents& a, const WithTangents& b) {
  NERF_CHECK_EQ(a.tangents.size(), b.tangents.size());
  WithTangents y{multiply(tape, a.value, b.value), {}};
  for (size_t i = 0; i < a.tangents.size(); ++i)
    y.tangents.push_back(
        add(tape, multiply(tape, a.tangents[i], b.value), multiply(tape, a.value, b.tangents[i])));
  return y;
}

WithTangents multiply(Tape& tape, const WithTangents& a, Value constant) {
  return {multiply(tape, a.value, constant),
          of_each(a, [&](Value t) { return multiply(tape, t, constant); })};
}

WithTangents scale_shift(Tape& tape, const WithTangents& x, Real factor, Real shift) {
  return {scale_shift(tape, x.value, factor, shift),
          of_each(x, [&](Value t) { return scale_shift(tape, t, factor, 0); })};
}

WithTangents frequency_encoding(Tape& tape, const WithTangents& x, std::span<const Real> weights,
                                bool identity) {
  return frequency_encoding(
      tape, x, std::make_shared<const std::vector<Real>>(weights.begin(), weights.end()), identity);
}

// The features have the weights in them already.
WithTangents frequency_encoding(Tape& tape, const WithTangents& x, const FrequencyWeights& weights,
                                bool identity) {
  const Value y = frequency_encoding(tape, x.value, weights, identity);
  const int frequencies = static_cast<int>(weights->size());
  return {y, of_each(x, [&](Value t) {
            const Value from[] = {y, t};
            const Value out = tape.output(tape.rows(y), tape.domain(y), from);
            tape.record(std::make_unique<EncodingTangent>(y, t, out, frequencies, identity));
            return out;
          })};
}

WithTangents repeat_for_samples(Tape& tape, const WithTangents& x) {
  return {repeat_for_samples(tape, x.value),
          of_each(x, [&](Value t) { return repeat_for_samples(tape, t); })};
}

}  // namespace nerf
