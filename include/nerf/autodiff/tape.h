// Reverse-mode differentiation over chunks of rays.
//
// A value is a matrix [rows x samples], [rows x rays] or [rows x groups], a group being successive
// samples of a ray that an operation has put together; that operation (group_light()) says how many
// there are. Model code records operations on a Tape once; plan() then lays every value and
// gradient out in one arena. A Chunk is one thread's execution of that plan: its own arena, a view
// of the weights and an accumulator for their gradients. The tape itself is constant after plan(),
// so any number of chunks run on it at once, and nothing is allocated in a step.
//
// Rows have a stride of the chunk's capacity; columns beyond the count in use are padding up to a
// multiple of kLane (kernels/linear.h): finite in values, zero in gradients.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "nerf/base/aligned.h"
#include "nerf/base/real.h"
#include "nerf/kernels/linear.h"

namespace nerf {

enum class Domain { kSamples, kRays, kGroups };

using Value = int;  // index of a value on its tape

class Tape;
struct LayerPacks;  // autodiff/linear_weights.h

// What an operation keeps in a chunk from its forward pass to its backward pass, or exchanges with
// the chunk's user. Operations that have one give its type in operations.h.
struct OperationState {
  virtual ~OperationState() = default;
};

// One execution of a tape.
struct Chunk {
  explicit Chunk(const Tape& tape);

  const Tape* tape;
  AlignedArray<Real> arena;
  const Real* weights = nullptr;  // parameters of the model, read only
  // Packs of the linear layers' weights, or null: read as they stand, in f32.
  const LayerPacks* packs = nullptr;
  Real* weight_gradient = nullptr;        // same layout, accumulated into
  int samples = 0, rays = 0, groups = 0;  // columns in use
  // rays + 1 offsets: samples of ray r are [begin[r], begin[r + 1]); likewise its groups.
  const int32_t *ray_begin = nullptr, *group_begin = nullptr;
  double loss = 0;  // added to by loss operations
  struct Bound {
    Real *data = nullptr, *gradient = nullptr;
  };
  std::vector<Bound> bound;  // of each value, see bind()

  // Not for a value that stands as pairs.
  Real* data(Value v);
  const Real* data(Value v) const;
  // Whether the value stands as pairs in this chunk (kernels/linear_bf16.h): between two layers, in
  // bf16. They are in the memory of its rows.
  bool has_pairs(Value v) const;
  uint16_t* pairs(Value v);
  Real* gradient(Value v);
  // Puts the value, and the gradient of an input that has one, into memory of the caller's [rows x
  // stride(v)], aligned to 64 bytes; null for the chunk's own. This spares a copy, or lets values
  // outlive the chunk's next samples.
  void bind(Value v, Real* data, Real* gradient);
  int64_t stride(Value v) const;  // floats between rows
  int64_t count(Value v) const;   // columns in use
  // Of the operation whose output v is.
  template <class State>
  State& state(Value v) {
    return dynamic_cast<State&>(*states_.at(static_cast<size_t>(v)));
  }

 private:
  const Real* memory(Value v) const;

  std::vector<std::unique_ptr<OperationState>> states_;  // of each value, null where there is none
};

// Forward and backward side by side. backward() finds the gradient of the output and must write the
// gradient of every input i that needs one: overwrite it where overwrites(i), else add to it.
class Operation {
 public:
  Operation(std::vector<Value> inputs, Value output)
      : inputs_(std::move(inputs)), output_(output), overwrites_(inputs_.size(), true) {}
  virtual ~Operation() = default;
  virtual const char* name() const = 0;
  virtual void forward(Chunk& chunk) const = 0;
  virtual void backward(Chunk& chunk) const = 0;
  // A chunk's own; null: it needs none.
  virtual std::unique_ptr<OperationState> make_state(const Tape&) const { return nullptr; }
  // Whether it could leave its output, and take its inputs, as pairs.
  virtual bool writes_pairs() const { return false; }
  virtual bool reads_pairs() const { return false; }

  const std::vector<Value>& inputs() const { return inputs_; }
  Value output() const { return output_; }
  bool overwrites(size_t i) const { return overwrites_[i]; }

 private:
  friend class Tape;
  std::vector<Value> inputs_;
  Value output_;
  std::vector<bool> overwrites_;
};

class Tape {
 public:
  // Capacities are rounded up to kLane.
  Tape(int sample_capacity, int ray_capacity);
  // Between the rows of values of so many samples, or rays: of samples an odd number of cache
  // lines, or each row would begin in the same few sets of a cache.
  static constexpr int sample_stride(int capacity) {
    return static_cast<int>((round_up(capacity, kLane) / kLane | 1) * kLane);
  }
  static constexpr int ray_stride(int capacity) {
    return static_cast<int>(round_up(capacity, kLane));
  }

  // A value that the caller fills before forward(). With `gradient`, backward() leaves its
  // gradient.
  Value input(int rows, Domain domain, bool gradient = false);
  // A value that an operation fills; it needs a gradient where any of `from` does, or `trained`.
  Value output(int rows, Domain domain, std::span<const Value> from, bool trained = false);
  // Scratch memory of an operation, in floats; contents do not survive the operation.
  void need_scratch(size_t floats);
  void record(std::unique_ptr<Operation> operation);
  // Before plan(): v stays rows, for a reader that does not have it among its inputs.
  void keep_rows(Value v);
  void plan();

  void forward(Chunk& chunk) const { forward(chunk, 0, operations()); }
  // Only the operations [first, last): what was recorded while operations() grew from one to the
  // other.
  void forward(Chunk& chunk, size_t first, size_t last) const;
  void backward(Chunk& chunk) const;

  size_t operations() const { return operations_.size(); }
  int rows(Value v) const { return values_[v].rows; }
  Domain domain(Value v) const { return values_[v].domain; }
  bool needs_gradient(Value v) const { return values_[v].gradient; }
  int capacity(Domain d) const { return d == Domain::kRays ? rays_ : samples_; }
  // The only operation that reads v, or null where there are none or several.
  const Operation* only_consumer(Value v) const;
  const Operation* producer(Value v) const;
  size_t arena_floats() const { return arena_floats_; }
  size_t scratch_offset() const { return 0; }

 private:
  friend struct Chunk;
  struct Info {
    int rows;
    Domain domain;
    bool gradient;
    size_t data = 0, grad = 0;
    bool only_rows = false, pairs = false;
  };
  int samples_, rays_;
  std::vector<Info> values_;
  std::vector<std::unique_ptr<Operation>> operations_;
  size_t scratch_floats_ = 0, arena_floats_ = 0;
};

}  // namespace nerf
