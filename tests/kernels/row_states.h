// What adam_rows() and hash_grid_backward() work on beside a table: gradients and marks of its
// rows, their states part by part, and the list of those to step.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "nerf/base/aligned.h"
#include "nerf/kernels/adam.h"

namespace nerf {

class RowStates {
 public:
  RowStates(size_t rows, int features)
      : gradient(rows * static_cast<size_t>(features)),
        marks(rows),
        rows_(rows),
        features_(static_cast<size_t>(features)),
        states_(rows * kRowParts * features_),
        listed_(rows) {}

  Real* data() { return states_.data(); }
  const uint32_t* list() const { return listed_.data(); }
  int64_t count() const { return count_; }
  // Takes the rows that are marked.
  void take_marked() {
    count_ = list_rows(static_cast<int64_t>(rows_), marks.data(), listed_.data());
  }

  // All rows' numbers of a part, `features` of each row; of the steps the first.
  std::vector<Real> part(RowPart part) {
    const size_t count = numbers(part);
    std::vector<Real> out(rows_ * count);
    for (size_t i = 0; i < out.size(); ++i) out[i] = at(i / count, part, i % count);
    return out;
  }
  void set(std::span<const Real> of_gradient, std::span<const Real> m, std::span<const Real> v,
           std::span<const Real> steps) {
    std::ranges::copy(of_gradient, gradient.begin());
    set(kRowM, m);
    set(kRowV, v);
    set(kRowSteps, steps);
  }
  void set(RowPart part, std::span<const Real> values) {
    const size_t count = numbers(part);
    for (size_t i = 0; i < values.size(); ++i) at(i / count, part, i % count) = values[i];
  }
  void take(std::span<Real> of_gradient, std::span<Real> m, std::span<Real> v,
            std::span<Real> steps) {
    std::ranges::copy(gradient, of_gradient.begin());
    std::ranges::copy(part(kRowM), m.begin());
    std::ranges::copy(part(kRowV), v.begin());
    std::ranges::copy(part(kRowSteps), steps.begin());
  }

  AlignedArray<Real> gradient;
  AlignedArray<uint8_t> marks;

 private:
  size_t numbers(RowPart part) const { return part == kRowSteps ? 1 : features_; }
  Real& at(size_t row, RowPart part, size_t number) {
    return states_[(row * kRowParts + part) * features_ + number];
  }

  size_t rows_, features_;
  AlignedArray<Real> states_;
  std::vector<uint32_t> listed_;
  int64_t count_ = 0;
};

}  // namespace nerf
