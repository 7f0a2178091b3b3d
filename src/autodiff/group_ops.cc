// Successive samples of a ray that share what is dear to find: groups by their light.
#include <algorithm>

#include "autodiff/ray_rows.h"
#include "nerf/autodiff/operations.h"
#include "nerf/base/error.h"
#include "nerf/kernels/sample_groups.h"
#include "nerf/math/reference/volume_rendering.h"

namespace nerf {
namespace {

class GroupLight : public Operation {
 public:
  GroupLight(Value weights, Value light, Real most, Real stop)
      : Operation({weights}, light), most_(most), stop_(stop) {}
  const char* name() const override { return "group_light"; }

  void forward(Chunk& c) const override {
    const Real* w = c.data(inputs()[0]);
    const double most = static_cast<double>(most_), stop = static_cast<double>(stop_);
    GroupState& groups = c.state<GroupState>(output());
    int count = 0;
    const auto belongs_to_none = [&](int from, int to) {
      const int last = std::max(count - 1, 0);
      std::fill(groups.of.begin() + from, groups.of.begin() + to, last);
      std::fill(groups.share.begin() + from, groups.share.begin() + to, 0.0_r);
      std::fill(groups.per_light.begin() + from, groups.per_light.begin() + to, 0.0_r);
    };
    const auto close = [&](int begin, int end, double light) {
      const double inverse = 1 / (light + reference::kLeastLight * (end - begin));
      for (int i = begin; i < end; ++i) {
        const size_t s = static_cast<size_t>(i);
        groups.of[s] = count;
        groups.share[s] =
            static_cast<Real>((static_cast<double>(w[i]) + reference::kLeastLight) * inverse);
        groups.per_light[s] = static_cast<Real>(inverse);
      }
      c.data(output())[count++] = static_cast<Real>(light);
    };
    belongs_to_none(0, c.ray_begin[0]);
    for (int r = 0; r < c.rays; ++r) {
      groups.begin[static_cast<size_t>(r)] = count;
      const int end = c.ray_begin[r + 1];
      int begin = c.ray_begin[r], i = begin;
      double light = 0, left = 1;
      for (; i < end && left >= stop; ++i) {
        const double weight = static_cast<double>(w[i]);
        if (i > begin && light + weight > most) {
          close(begin, i, light);
          begin = i;
          light = 0;
        }
        light += weight;
        left -= weight;
      }
      if (i > begin) close(begin, i, light);
      belongs_to_none(i, end);
    }
    groups.begin[static_cast<size_t>(c.rays)] = count;
    belongs_to_none(c.ray_begin[c.rays], static_cast<int>(round_up(c.samples, kLane)));
    std::fill(c.data(output()) + count, c.data(output()) + round_up(count, kLane), 0.0_r);
    c.groups = count;
    c.group_begin = groups.begin.data();
  }

  std::unique_ptr<OperationState> make_state(const Tape& tape) const override {
    auto state = std::make_unique<GroupState>();
    const size_t samples = static_cast<size_t>(tape.capacity(Domain::kSamples));
    state->of.resize(samples);
    state->share.resize(samples);
    state->per_light.resize(samples);
    state->begin.resize(static_cast<size_t>(tape.capacity(Domain::kRays)) + 1);
    return state;
  }

  void backward(Chunk& c) const override {
    const GroupState& groups = c.state<GroupState>(output());
    const Real* d_light = c.gradient(output());
    Real* dw = c.gradient(inputs()[0]);
    if (overwrites(0)) std::fill(dw, dw + round_up(c.samples, kLane), 0.0_r);
    for (size_t i = 0; i < static_cast<size_t>(c.samples); ++i)
      if (groups.per_light[i] > 0) dw[i] += d_light[groups.of[i]];
  }

 private:
  Real most_, stop_;
};

class MeanOfGroups : public Operation {
 public:
  MeanOfGroups(Value light, Value weights, Value x, Value y)
      : Operation({weights, x}, y), light_(light) {}
  const char* name() const override { return "mean_of_groups"; }

  void forward(Chunk& c) const override {
    mean_of_groups_forward(groups_of(c), c.tape->rows(output()), c.data(inputs()[1]),
                           c.stride(inputs()[1]), c.data(output()), c.stride(output()));
  }

  void backward(Chunk& c) const override {
    const int rows = c.tape->rows(output());
    const int64_t ldx = c.stride(inputs()[1]), padded = round_up(c.samples, kLane);
    Real* dw = c.tape->needs_gradient(inputs()[0]) ? c.gradient(inputs()[0]) : nullptr;
    Real* dx = c.tape->needs_gradient(inputs()[1]) ? c.gradient(inputs()[1]) : nullptr;
    if (dw && overwrites(0)) std::fill(dw, dw + padded, 0.0_r);
    for (int k = 0; k < rows && dx && overwrites(1); ++k)
      std::fill(dx + k * ldx, dx + k * ldx + padded, 0.0_r);
    mean_of_groups_backward(groups_of(c), rows, c.data(inputs()[1]), ldx, c.data(output()),
                            c.gradient(output()), c.stride(output()), dw, dx);
  }

 private:
  SampleGroups groups_of(Chunk& c) const {
    const GroupState& groups = c.state<GroupState>(light_);
    return {c.samples, c.groups, groups.of.data(), groups.share.data(), groups.per_light.data()};
  }

  Value light_;
};

}  // namespace

Value group_light(Tape& tape, Value weights, Real most, Real stop) {
  NERF_CHECK_EQ(tape.rows(weights), 1);
  NERF_CHECK(tape.domain(weights) == Domain::kSamples);
  const Value light = tape.output(1, Domain::kGroups, {&weights, 1});
  tape.record(std::make_unique<GroupLight>(weights, light, most, stop));
  return light;
}

Value mean_of_groups(Tape& tape, Value light, Value x) {
  const auto* groups = dynamic_cast<const GroupLight*>(tape.producer(light));
  NERF_CHECK(groups && tape.domain(x) == Domain::kSamples);
  const Value weights = groups->inputs()[0];
  const Value from[] = {weights, x};
  const Value y = tape.output(tape.rows(x), Domain::kGroups, from);
  tape.record(std::make_unique<MeanOfGroups>(light, weights, x, y));
  return y;
}

}  // namespace nerf
