#include "nerf/autodiff/tape.h"

#include <algorithm>
#include <cstring>
#include <utility>

#include "nerf/autodiff/linear_weights.h"
#include "nerf/base/error.h"
#include "nerf/kernels/linear.h"

namespace nerf {

namespace {

// First-fit allocation of the gradients' memory: a gradient lives from the backward pass of the
// last operation that reads its value to that of the one that makes it.
class Arena {
 public:
  explicit Arena(size_t begin) : end_(begin) {}

  size_t allocate(size_t size) {
    for (size_t i = 0; i < free_.size(); ++i) {
      if (free_[i].size < size) continue;
      const size_t at = free_[i].at;
      free_[i].at += size;
      free_[i].size -= size;
      if (free_[i].size == 0) free_.erase(free_.begin() + static_cast<ptrdiff_t>(i));
      return at;
    }
    const size_t at = end_;
    end_ += size;
    return at;
  }

  void release(size_t at, size_t size) {
    free_.push_back({at, size});
    std::sort(free_.begin(), free_.end(), [](auto& a, auto& b) { return a.at < b.at; });
    for (size_t i = 0; i + 1 < free_.size();) {
      if (free_[i].at + free_[i].size == free_[i + 1].at) {
        free_[i].size += free_[i + 1].size;
        free_.erase(free_.begin() + static_cast<ptrdiff_t>(i) + 1);
      } else {
        ++i;
      }
    }
  }

  size_t end() const { return end_; }

 private:
  struct Block {
    size_t at, size;
  };
  std::vector<Block> free_;
  size_t end_;
};

}  // namespace

Chunk::Chunk(const Tape& t)
    : tape(&t), arena(t.arena_floats()), bound(t.values_.size()), states_(t.values_.size()) {
  for (const auto& operation : t.operations_)
    states_[static_cast<size_t>(operation->output())] = operation->make_state(t);
}

void Chunk::bind(Value v, Real* data, Real* gradient) {
  NERF_CHECK(!gradient || (tape->producer(v) == nullptr && tape->needs_gradient(v)));
  bound[static_cast<size_t>(v)] = {data, gradient};
}

const Real* Chunk::data(Value v) const {
  NERF_CHECK(!has_pairs(v));
  return memory(v);
}
const Real* Chunk::memory(Value v) const {
  const size_t i = static_cast<size_t>(v);
  return bound[i].data ? bound[i].data : arena.data() + tape->values_[i].data;
}
Real* Chunk::data(Value v) { return const_cast<Real*>(std::as_const(*this).data(v)); }
bool Chunk::has_pairs(Value v) const {
  return tape->values_[static_cast<size_t>(v)].pairs && packs && packs->bf16.size() > 0;
}
uint16_t* Chunk::pairs(Value v) {
  NERF_CHECK(has_pairs(v));
  return reinterpret_cast<uint16_t*>(const_cast<Real*>(memory(v)));
}
Real* Chunk::gradient(Value v) {
  const size_t i = static_cast<size_t>(v);
  NERF_CHECK(tape->values_[i].gradient);
  return bound[i].gradient ? bound[i].gradient : arena.data() + tape->values_[i].grad;
}
int64_t Chunk::stride(Value v) const { return tape->capacity(tape->domain(v)); }
int64_t Chunk::count(Value v) const {
  switch (tape->domain(v)) {
    case Domain::kSamples:
      return samples;
    case Domain::kRays:
      return rays;
    case Domain::kGroups:
      return groups;
  }
  return 0;
}

// Rows an even number of cache lines apart would share a few of a cache's sets, where those of one
// strip of samples drive each other out.
Tape::Tape(int sample_capacity, int ray_capacity)
    : samples_(sample_stride(sample_capacity)), rays_(ray_stride(ray_capacity)) {}

Value Tape::input(int rows, Domain domain, bool gradient) {
  values_.push_back({rows, domain, gradient});
  return static_cast<Value>(values_.size()) - 1;
}

Value Tape::output(int rows, Domain domain, std::span<const Value> from, bool trained) {
  bool gradient = trained;
  for (Value v : from) gradient |= values_[static_cast<size_t>(v)].gradient;
  return input(rows, domain, gradient);
}

void Tape::need_scratch(size_t floats) { scratch_floats_ = std::max(scratch_floats_, floats); }

void Tape::record(std::unique_ptr<Operation> operation) {
  operations_.push_back(std::move(operation));
}

void Tape::keep_rows(Value v) {
  NERF_CHECK_EQ(arena_floats_, size_t{0});
  values_[static_cast<size_t>(v)].only_rows = true;
}

const Operation* Tape::only_consumer(Value v) const {
  const Operation* found = nullptr;
  for (const auto& op : operations_)
    for (Value in : op->inputs())
      if (in == v) {
        if (found) return nullptr;
        found = op.get();
      }
  return found;
}

const Operation* Tape::producer(Value v) const {
  for (const auto& op : operations_)
    if (op->output() == v) return op.get();
  return nullptr;
}

void Tape::plan() {
  for (const auto& op : operations_) {
    const Operation* reader = only_consumer(op->output());
    Info& out = values_[static_cast<size_t>(op->output())];
    out.pairs = !out.only_rows && op->writes_pairs() && reader && reader->reads_pairs();
  }
  size_t at = static_cast<size_t>(round_up(static_cast<int64_t>(scratch_floats_), kLane));
  const auto size = [&](const Info& i) {
    return static_cast<size_t>(i.rows) * static_cast<size_t>(capacity(i.domain));
  };
  for (Info& v : values_) {
    v.data = at;
    at += size(v);
  }
  Arena arena(at);
  std::vector<bool> placed(values_.size(), false), read(values_.size(), false);
  for (const auto& op : operations_)
    for (const Value v : op->inputs()) read[static_cast<size_t>(v)] = true;
  // Results of the tape are read by no operation: the caller fills the gradients of all of them
  // before the first one is used up.
  for (size_t i = operations_.size(); i-- > 0;) {
    const size_t v = static_cast<size_t>(operations_[i]->output());
    if (!values_[v].gradient || read[v]) continue;
    values_[v].grad = arena.allocate(size(values_[v]));
    placed[v] = true;
  }
  for (size_t i = operations_.size(); i-- > 0;) {
    Operation& op = *operations_[i];
    Info& out = values_[static_cast<size_t>(op.output())];
    for (size_t k = 0; k < op.inputs_.size(); ++k) {
      const size_t v = static_cast<size_t>(op.inputs_[k]);
      if (!values_[v].gradient) continue;
      op.overwrites_[k] = !placed[v];
      if (!placed[v]) values_[v].grad = arena.allocate(size(values_[v]));
      placed[v] = true;
    }
    if (out.gradient) arena.release(out.grad, size(out));
  }
  arena_floats_ = arena.end();
}

void Tape::forward(Chunk& chunk, size_t first, size_t last) const {
  for (size_t i = first; i < last; ++i) operations_[i]->forward(chunk);
}

void Tape::backward(Chunk& chunk) const {
  for (size_t i = operations_.size(); i-- > 0;)
    if (values_[static_cast<size_t>(operations_[i]->output())].gradient)
      operations_[i]->backward(chunk);
}

}  // namespace nerf
