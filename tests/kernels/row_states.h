// The states of a table's rows that adam_rows() and hash_grid_backward() work on, part by part, and
// their list.
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
      : rows_(rows),
        features_(static_cast<size_t>(features)),
        data_(rows * kRowParts * features_),
        listed_(rows + 1),
        list{listed_.data()} {}
  RowStates(const RowStates&) = delete;  // the list is its own
  RowStates& operator=(const RowStates&) = delete;

  Real* data() { return data_.data(); }
  // The row's first number of a part.
  Real& at(size_t row, RowPart part, size_t number = 0) {
    return data_[(row * kRowParts + part) * features_ + number];
  }
  bool listed(size_t row) { return at(row, kRowSteps, 1) != 0; }
  void touch(size_t row) {
    list.rows[list.count++] = static_cast<uint32_t>(row);
    at(row, kRowSteps, 1) = 1;
  }
  std::span<const uint32_t> touched() const { return {list.rows, static_cast<size_t>(list.count)}; }

  // All rows' numbers of a part, `features` of each row; of the steps the first.
  std::vector<Real> part(RowPart part) {
    const size_t count = numbers(part);
    std::vector<Real> out(rows_ * count);
    for (size_t i = 0; i < out.size(); ++i) out[i] = at(i / count, part, i % count);
    return out;
  }
  void set(std::span<const Real> gradient, std::span<const Real> m, std::span<const Real> v,
           std::span<const Real> steps) {
    set(kRowGradient, gradient);
    set(kRowM, m);
    set(kRowV, v);
    set(kRowSteps, steps);
  }
  void take(std::span<Real> gradient, std::span<Real> m, std::span<Real> v, std::span<Real> steps) {
    std::ranges::copy(part(kRowGradient), gradient.begin());
    std::ranges::copy(part(kRowM), m.begin());
    std::ranges::copy(part(kRowV), v.begin());
    std::ranges::copy(part(kRowSteps), steps.begin());
  }
  void set(RowPart part, std::span<const Real> values) {
    const size_t count = numbers(part);
    for (size_t i = 0; i < values.size(); ++i) at(i / count, part, i % count) = values[i];
  }

 private:
  size_t numbers(RowPart part) const { return part == kRowSteps ? 1 : features_; }

  size_t rows_, features_;
  AlignedArray<Real> data_;
  std::vector<uint32_t> listed_;

 public:
  RowList list;
};

}  // namespace nerf
