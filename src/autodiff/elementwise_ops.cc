#include <algorithm>
#include <cstring>

#include "nerf/autodiff/operations.h"
#include "nerf/base/error.h"
#include "nerf/kernels/elementwise.h"

namespace nerf {
namespace {

// Copies or adds rows; both strides equal.
void pass_rows(bool overwrite, int rows, int64_t n, int64_t ld, const Real* from, Real* to) {
  for (int r = 0; r < rows; ++r) {
    if (overwrite)
      std::memcpy(to + r * ld, from + r * ld,
                  static_cast<size_t>(round_up(n, kLane)) * sizeof(Real));
    else
      add_to(n, from + r * ld, to + r * ld);
  }
}

class Concat : public Operation {
 public:
  Concat(Value a, Value b, Value y) : Operation({a, b}, y) {}
  const char* name() const override { return "concat"; }

  void forward(Chunk& c) const override {
    each_part(c, [&](size_t i, int rows, int64_t at) {
      pass_rows(true, rows, c.count(output()), c.stride(output()), c.data(inputs()[i]),
                c.data(output()) + at);
    });
  }
  void backward(Chunk& c) const override {
    each_part(c, [&](size_t i, int rows, int64_t at) {
      if (c.tape->needs_gradient(inputs()[i]))
        pass_rows(overwrites(i), rows, c.count(output()), c.stride(output()),
                  c.gradient(output()) + at, c.gradient(inputs()[i]));
    });
  }

 private:
  template <class F>
  void each_part(const Chunk& c, const F& f) const {
    int64_t at = 0;
    for (size_t i = 0; i < inputs().size(); ++i) {
      const int rows = c.tape->rows(inputs()[i]);
      f(i, rows, at);
      at += rows * c.stride(output());
    }
  }
};

class Add : public Operation {
 public:
  Add(Value a, Value b, Value y) : Operation({a, b}, y) {}
  const char* name() const override { return "add"; }

  void forward(Chunk& c) const override {
    const int rows = c.tape->rows(output());
    const int64_t n = c.count(output()), ld = c.stride(output());
    pass_rows(true, rows, n, ld, c.data(inputs()[0]), c.data(output()));
    pass_rows(false, rows, n, ld, c.data(inputs()[1]), c.data(output()));
  }
  void backward(Chunk& c) const override {
    for (size_t i = 0; i < 2; ++i)
      if (c.tape->needs_gradient(inputs()[i]))
        pass_rows(overwrites(i), c.tape->rows(output()), c.count(output()), c.stride(output()),
                  c.gradient(output()), c.gradient(inputs()[i]));
  }
};

class Multiply : public Operation {
 public:
  Multiply(Value a, Value b, Value y) : Operation({a, b}, y) {}
  const char* name() const override { return "multiply"; }

  void forward(Chunk& c) const override {
    each_row(c, [&](int64_t at, int64_t n) {
      const Real *a = c.data(inputs()[0]) + at, *b = c.data(inputs()[1]) + at;
      Real* y = c.data(output()) + at;
      for (int64_t i = 0; i < n; ++i) y[i] = a[i] * b[i];
    });
  }
  void backward(Chunk& c) const override {
    for (size_t k = 0; k < 2; ++k) {
      if (!c.tape->needs_gradient(inputs()[k])) continue;
      each_row(c, [&](int64_t at, int64_t n) {
        const Real *other = c.data(inputs()[1 - k]) + at, *dy = c.gradient(output()) + at;
        Real* dx = c.gradient(inputs()[k]) + at;
        for (int64_t i = 0; i < n; ++i) dx[i] = (overwrites(k) ? 0 : dx[i]) + other[i] * dy[i];
      });
    }
  }

 private:
  template <class Body>
  void each_row(const Chunk& c, const Body& body) const {
    for (int r = 0; r < c.tape->rows(output()); ++r)
      body(r * c.stride(output()), round_up(c.count(output()), kLane));
  }
};

class Slice : public Operation {
 public:
  Slice(Value x, Value y, int first) : Operation({x}, y), first_(first) {}
  const char* name() const override { return "slice"; }

  void forward(Chunk& c) const override {
    pass_rows(true, c.tape->rows(output()), c.count(output()), c.stride(output()),
              c.data(inputs()[0]) + first_ * c.stride(output()), c.data(output()));
  }
  void backward(Chunk& c) const override {
    const int64_t ld = c.stride(output());
    Real* dx = c.gradient(inputs()[0]);
    if (overwrites(0))
      std::memset(
          dx, 0,
          static_cast<size_t>(c.tape->rows(inputs()[0])) * static_cast<size_t>(ld) * sizeof(Real));
    pass_rows(false, c.tape->rows(output()), c.count(output()), ld, c.gradient(output()),
              dx + first_ * ld);
  }

 private:
  int64_t first_;
};

// y = f(x) row by row; the gradient goes through scratch where it must be added.
template <class Derived>
class Elementwise : public Operation {
 public:
  Elementwise(Value x, Value y) : Operation({x}, y) {}
  const char* name() const override { return Derived::kName; }

  void forward(Chunk& c) const override {
    const int64_t ld = c.stride(output());
    for (int r = 0; r < c.tape->rows(output()); ++r)
      self().apply(c.count(output()), c.data(inputs()[0]) + r * ld, c.data(output()) + r * ld);
  }
  void backward(Chunk& c) const override {
    const int64_t ld = c.stride(output()), n = c.count(output());
    Real* scratch = c.arena.data() + c.tape->scratch_offset();
    for (int r = 0; r < c.tape->rows(output()); ++r) {
      Real* dx = c.gradient(inputs()[0]) + r * ld;
      Real* to = overwrites(0) ? dx : scratch;
      self().differentiate(n, c.data(inputs()[0]) + r * ld, c.data(output()) + r * ld,
                           c.gradient(output()) + r * ld, to);
      if (!overwrites(0)) add_to(n, scratch, dx);
    }
  }

 private:
  const Derived& self() const { return static_cast<const Derived&>(*this); }
};

class TruncatedExp : public Elementwise<TruncatedExp> {
 public:
  using Elementwise::Elementwise;
  static constexpr const char* kName = "truncated_exp";
  static void apply(int64_t n, const Real* x, Real* y) { truncated_exp_forward(n, x, y); }
  static void differentiate(int64_t n, const Real* x, const Real*, const Real* dy, Real* dx) {
    truncated_exp_backward(n, x, dy, dx);
  }
};

class Sigmoid : public Elementwise<Sigmoid> {
 public:
  using Elementwise::Elementwise;
  static constexpr const char* kName = "sigmoid";
  static void apply(int64_t n, const Real* x, Real* y) { sigmoid_forward(n, x, y); }
  static void differentiate(int64_t n, const Real*, const Real* y, const Real* dy, Real* dx) {
    sigmoid_backward(n, y, dy, dx);
  }
};

class Softplus : public Elementwise<Softplus> {
 public:
  Softplus(Value x, Value y, Real shift) : Elementwise(x, y), shift_(shift) {}
  static constexpr const char* kName = "softplus";
  void apply(int64_t n, const Real* x, Real* y) const { softplus_forward(n, shift_, x, y); }
  void differentiate(int64_t n, const Real* x, const Real*, const Real* dy, Real* dx) const {
    softplus_backward(n, shift_, x, dy, dx);
  }

 private:
  Real shift_;
};

class Relu : public Elementwise<Relu> {
 public:
  using Elementwise::Elementwise;
  static constexpr const char* kName = "relu";
  static void apply(int64_t n, const Real* x, Real* y) { relu_forward(n, x, y); }
  static void differentiate(int64_t n, const Real*, const Real* y, const Real* dy, Real* dx) {
    if (dx != dy) std::memcpy(dx, dy, static_cast<size_t>(round_up(n, kLane)) * sizeof(Real));
    relu_backward(1, y, dx, 0, n);
  }
};

class ScaleShift : public Elementwise<ScaleShift> {
 public:
  ScaleShift(Value x, Value y, Real factor, Real shift)
      : Elementwise(x, y), factor_(factor), shift_(shift) {}
  static constexpr const char* kName = "scale_shift";
  void apply(int64_t n, const Real* x, Real* y) const {
    for (int64_t i = 0; i < round_up(n, kLane); ++i) y[i] = factor_ * x[i] + shift_;
  }
  void differentiate(int64_t n, const Real*, const Real*, const Real* dy, Real* dx) const {
    for (int64_t i = 0; i < round_up(n, kLane); ++i) dx[i] = factor_ * dy[i];
  }

 private:
  Real factor_, shift_;
};

template <class Op, class... Parameters>
Value elementwise(Tape& tape, Value x, Parameters... parameters) {
  const Value y = tape.output(tape.rows(x), tape.domain(x), {&x, 1});
  tape.need_scratch(static_cast<size_t>(tape.capacity(tape.domain(x))));
  tape.record(std::make_unique<Op>(x, y, parameters...));
  return y;
}

template <class Op>
Value binary(Tape& tape, Value a, Value b) {
  NERF_CHECK_EQ(tape.rows(a), tape.rows(b));
  NERF_CHECK(tape.domain(a) == tape.domain(b));
  const Value from[] = {a, b};
  const Value y = tape.output(tape.rows(a), tape.domain(a), from);
  tape.record(std::make_unique<Op>(a, b, y));
  return y;
}

}  // namespace

Value concat(Tape& tape, Value a, Value b) {
  NERF_CHECK(tape.domain(a) == tape.domain(b));
  const Value from[] = {a, b};
  const Value y = tape.output(tape.rows(a) + tape.rows(b), tape.domain(a), from);
  tape.record(std::make_unique<Concat>(a, b, y));
  return y;
}

Value add(Tape& tape, Value a, Value b) { return binary<Add>(tape, a, b); }
Value multiply(Tape& tape, Value a, Value b) { return binary<Multiply>(tape, a, b); }

Value slice(Tape& tape, Value x, int first, int rows) {
  NERF_CHECK_LE(first + rows, tape.rows(x));
  const Value y = tape.output(rows, tape.domain(x), {&x, 1});
  tape.record(std::make_unique<Slice>(x, y, first));
  return y;
}

Value truncated_exp(Tape& tape, Value x) { return elementwise<TruncatedExp>(tape, x); }
Value sigmoid(Tape& tape, Value x) { return elementwise<Sigmoid>(tape, x); }
Value softplus(Tape& tape, Value x, Real shift) { return elementwise<Softplus>(tape, x, shift); }
Value relu(Tape& tape, Value x) { return elementwise<Relu>(tape, x); }
Value scale_shift(Tape& tape, Value x, Real factor, Real shift) {
  return elementwise<ScaleShift>(tape, x, factor, shift);
}

}  // namespace nerf
