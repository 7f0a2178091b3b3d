// Parameters that every step moves all of: the networks' weights, the photos' codes.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "nerf/autodiff/operations.h"
#include "nerf/base/aligned.h"
#include "nerf/base/threads.h"
#include "nerf/kernels/adam.h"
#include "nerf/kernels/bf16.h"

namespace nerf {

// A range of them that is checked, and clipped, by itself.
struct ParameterSection {
  std::string name;  // for messages: "network 1"
  size_t begin = 0, end = 0;
  double clip = 0;  // largest norm of its gradient; 0: any
  double rate = 1;  // of the step size
  // Of the numbers themselves, to `centre`: share of the step size (Loshchilov and Hutter 2019).
  double decay = 0;
  std::vector<Real> centre = {};  // one for each of them; empty: zeros
};

// Gradient and moments of one array of weights, which belongs to a field. Chunks of a step add to a
// fixed number of accumulators that are summed in order, so that the sum does not depend on the
// number of threads.
class DenseParameters {
 public:
  DenseParameters(std::span<Real> weights, std::vector<LinearWeights> layers,
                  std::vector<ParameterSection> sections, int accumulators);

  // Of so many weights, with the packs of their layers: rows and columns, in whole blocks.
  static uint64_t memory_bytes(uint64_t weights, uint64_t accumulators) {
    return sizeof(Real) * weights * (kArrays + accumulators + 2);
  }

  int accumulators() const { return static_cast<int>(accumulators_.size()); }
  // An accumulator, set to zero.
  Real* begin_sum(int64_t a);
  // The same, as it is.
  Real* sum(int64_t a) { return accumulators_[static_cast<size_t>(a)].data(); }

  // After every change of the weights.
  void pack(Precision precision, ThreadPool& pool);
  const LayerPacks& packs() const { return packs_; }

  // The sum of all accumulators, checked and clipped. Throws NonFiniteError naming the section and
  // `step`, which counts from 1.
  void reduce(int64_t step, ThreadPool& pool);
  // One step of Adam by the reduced gradient, and new packs.
  void update(const AdamStep& adam, int64_t step, Precision precision, ThreadPool& pool);
  void forget();  // moments

  std::span<Real> weights() const { return weights_; }
  static constexpr uint64_t kArrays = 3;
  AlignedArray<Real> gradient, m, v;

 private:
  std::span<Real> weights_;
  std::vector<LinearWeights> layers_;
  std::vector<ParameterSection> sections_;
  std::vector<AlignedArray<Real>> accumulators_;
  LayerPacks packs_;
};

}  // namespace nerf
