// The generic test of tangents (autodiff/tangents.h): values and derivatives along directions on a
// tape against dual numbers, and their gradients by complex step on those.
#pragma once

#include <string>
#include <vector>

#include "autodiff/gradient_check.h"
#include "nerf/autodiff/tangents.h"
#include "nerf/math/reference/scalar.h"

namespace nerf {

template <class T>
using TDual = reference::TDual<T>;

// The columns with a derivative along one direction.
template <class T>
Columns<TDual<T>> dual(const Columns<T>& x, const Columns<T>& tangent) {
  Columns<TDual<T>> out;
  for (size_t s = 0; s < x.size(); ++s) {
    out.emplace_back();
    for (size_t r = 0; r < x[s].size(); ++r) out.back().push_back({x[s][r], tangent[s][r]});
  }
  return out;
}

template <class T>
Columns<T> part(const Columns<TDual<T>>& x, T TDual<T>::* which) {
  Columns<T> out;
  for (const auto& column : x) {
    out.emplace_back();
    for (const TDual<T>& v : column) out.back().push_back(v.*which);
  }
  return out;
}

template <class T>
std::vector<TDual<T>> constants(const std::vector<T>& weights) {
  return {weights.begin(), weights.end()};
}

// `record` and `f` are the same function of x (the first input) on a tape and on dual numbers; the
// other inputs are the directions. Outputs: the value, then its tangents. What inputs may need a
// gradient is the test's to choose.
template <class Record, class F>
void check_tangents(const std::string& name, const TestInput& x, const TestInput& direction,
                    const std::vector<LinearWeights>& layers, const Record& record, const F& f,
                    double roundings, const std::vector<Rays>& layouts = ray_layouts(),
                    bool norms = true) {
  using Values = std::vector<Value>;
  for (const int directions : {1, 3})
    for (int needs = 1; needs < 4; ++needs) {  // which of x and the directions need a gradient
      std::vector<TestInput> inputs = {x};
      inputs[0].gradient = (needs & 1) != 0;
      for (int i = 0; i < directions; ++i) {
        inputs.push_back(direction);
        inputs.back().gradient = (needs & 2) != 0;
      }
      check_operation(
          {name, inputs, layers,
           [=](Tape& t, const Values& v) {
             const WithTangents y = record(t, WithTangents{v[0], Values(v.begin() + 1, v.end())});
             Values out{y.value};
             out.insert(out.end(), y.tangents.begin(), y.tangents.end());
             // Where nothing leads to a gradient there is none to ask for.
             return out;
           },
           roundings, /*shared=*/0, /*weight_range=*/1, norms},
          [=]<class T>(const Given<T>& v) -> Outputs<T> {
            Outputs<T> out;
            for (int i = 0; i < directions; ++i) {
              const auto y = f(dual(v[0], v[1 + static_cast<size_t>(i)]), constants(v.weights));
              if (i == 0) out.push_back(part(y, &TDual<T>::value));
              out.push_back(part(y, &TDual<T>::derivative));
            }
            return out;
          },
          layouts);
    }
}

// Of numbers in [-range, range], along directions in [-1, 1].
template <class Record, class F>
void check_tangents(const std::string& name, int rows, double range,
                    const std::vector<LinearWeights>& layers, const Record& record, const F& f,
                    double roundings) {
  check_tangents(name, {rows, Domain::kSamples, true, -range, range},
                 {rows, Domain::kSamples, true}, layers, record, f, roundings);
}

// Products and sums of the halves of four rows, on a tape and on its columns.
inline WithTangents products_and_sums(Tape& t, const WithTangents& x) {
  const WithTangents a = slice(t, x, 0, 2), b = slice(t, x, 2, 2);
  return concat(t, multiply(t, a, b), add(t, scale_shift(t, a, -1.5_r, 0.25_r), b));
}
template <class D>
Columns<D> products_and_sums_of(const Columns<D>& x) {
  Columns<D> out;
  for (const auto& c : x)
    out.push_back({c[0] * c[2], c[1] * c[3], D(-1.5) * c[0] + D(0.25) + c[2],
                   D(-1.5) * c[1] + D(0.25) + c[3]});
  return out;
}

}  // namespace nerf
