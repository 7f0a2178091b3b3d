#include <algorithm>
#include <cstring>

#include "nerf/autodiff/operations.h"
#include "nerf/base/error.h"
#include "nerf/kernels/elementwise.h"

namespace nerf {
namespace {

// Copies or adds rows; both strides equal.
void pass_rows(bool overwrite, int rows, int64_t n, int64_t ld, const float* from, float* to) {
  for (int r = 0; r < rows; ++r) {
    if (overwrite)
      std::memcpy(to + r * ld, from + r * ld,
                  static_cast<size_t>(round_up(n, kLane)) * sizeof(float));
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
    float* dx = c.gradient(inputs()[0]);
    if (overwrites(0))
      std::memset(
          dx, 0,
          static_cast<size_t>(c.tape->rows(inputs()[0])) * static_cast<size_t>(ld) * sizeof(float));
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
      Derived::apply(c.count(output()), c.data(inputs()[0]) + r * ld, c.data(output()) + r * ld);
  }
  void backward(Chunk& c) const override {
    const int64_t ld = c.stride(output()), n = c.count(output());
    float* scratch = c.arena.data() + c.tape->scratch_offset();
    for (int r = 0; r < c.tape->rows(output()); ++r) {
      float* dx = c.gradient(inputs()[0]) + r * ld;
      float* to = overwrites(0) ? dx : scratch;
      Derived::differentiate(n, c.data(inputs()[0]) + r * ld, c.data(output()) + r * ld,
                             c.gradient(output()) + r * ld, to);
      if (!overwrites(0)) add_to(n, scratch, dx);
    }
  }
};

class TruncatedExp : public Elementwise<TruncatedExp> {
 public:
  using Elementwise::Elementwise;
  static constexpr const char* kName = "truncated_exp";
  static void apply(int64_t n, const float* x, float* y) { truncated_exp_forward(n, x, y); }
  static void differentiate(int64_t n, const float* x, const float*, const float* dy, float* dx) {
    truncated_exp_backward(n, x, dy, dx);
  }
};

class Sigmoid : public Elementwise<Sigmoid> {
 public:
  using Elementwise::Elementwise;
  static constexpr const char* kName = "sigmoid";
  static void apply(int64_t n, const float* x, float* y) { sigmoid_forward(n, x, y); }
  static void differentiate(int64_t n, const float*, const float* y, const float* dy, float* dx) {
    sigmoid_backward(n, y, dy, dx);
  }
};

template <class Op>
Value elementwise(Tape& tape, Value x) {
  const Value y = tape.output(tape.rows(x), tape.domain(x), {&x, 1});
  tape.need_scratch(static_cast<size_t>(tape.capacity(tape.domain(x))));
  tape.record(std::make_unique<Op>(x, y));
  return y;
}

class ViewCode : public Operation {
 public:
  ViewCode(Value directions, Value y) : Operation({directions}, y) {}
  const char* name() const override { return "view_code"; }

  void forward(Chunk& c) const override {
    const float* d = c.data(inputs()[0]);
    const int64_t lr = c.stride(inputs()[0]), ls = c.stride(output());
    float* y = c.data(output());
    for (int r = 0; r < c.rays; ++r) {
      float code[kSphericalHarmonics];
      spherical_harmonics(d[r], d[lr + r], d[2 * lr + r], code);
      for (int k = 0; k < kSphericalHarmonics; ++k)
        std::fill(y + k * ls + c.ray_begin[r], y + k * ls + c.ray_begin[r + 1], code[k]);
    }
  }
  void backward(Chunk&) const override {}  // directions are not trained
};

}  // namespace

Value concat(Tape& tape, Value a, Value b) {
  NERF_CHECK(tape.domain(a) == tape.domain(b));
  const Value from[] = {a, b};
  const Value y = tape.output(tape.rows(a) + tape.rows(b), tape.domain(a), from);
  tape.record(std::make_unique<Concat>(a, b, y));
  return y;
}

Value slice(Tape& tape, Value x, int first, int rows) {
  NERF_CHECK_LE(first + rows, tape.rows(x));
  const Value y = tape.output(rows, tape.domain(x), {&x, 1});
  tape.record(std::make_unique<Slice>(x, y, first));
  return y;
}

Value truncated_exp(Tape& tape, Value x) { return elementwise<TruncatedExp>(tape, x); }
Value sigmoid(Tape& tape, Value x) { return elementwise<Sigmoid>(tape, x); }

Value view_code(Tape& tape, Value directions) {
  NERF_CHECK_EQ(tape.rows(directions), 3);
  NERF_CHECK(!tape.needs_gradient(directions));
  const Value y = tape.output(kSphericalHarmonics, Domain::kSamples, {&directions, 1});
  tape.record(std::make_unique<ViewCode>(directions, y));
  return y;
}

}  // namespace nerf
