// What the table's field has more where a scene moves:
//   time -> small MLP -> code of the moment
//   (position, code) -> warp -> canonical position, where the table is looked up
//   density = MLP(features, encoded position, code, ambient coordinates)
// The position before the warp and the code go to the density too (Fang et al. 2022, section 3.3):
// what a warp cannot say, such as matter that appears, they can. Ambient coordinates are found from
// position and code by a network of their own, the bendy sheet of Park et al. 2021b, section 4.
#pragma once

#include <memory>
#include <vector>

#include "nerf/autodiff/operations.h"
#include "nerf/base/aligned.h"
#include "nerf/kernels/hash_grid.h"
#include "nerf/parts/warp.h"

namespace nerf {

struct MotionShape {
  WarpShape warp;     // its code is time_code numbers
  int ambient = 0;    // coordinates; 0: none
  int time_code = 0;  // numbers of a moment's code
  int time_degrees = 0, time_width = 0;
  int point_degrees = 0;  // frequencies of the position that density is found from

  bool any() const { return warp.any(); }
};

// The networks' layers in a field's weights.
struct MotionNetworks {
  MotionShape shape;
  LinearWeights time_hidden, time_last;
  WarpNetwork warp;
  std::vector<LinearWeights> sheet;  // to the ambient coordinates; empty: none
  size_t begin = 0, end = 0;

  MotionNetworks() = default;
  MotionNetworks(const MotionShape& shape, size_t begin);
  bool empty() const { return !shape.any(); }
  // That density is found from, beside features.
  int rows() const;
  std::vector<LinearWeights*> layers();
  void initialise(uint64_t seed, uint64_t layer, Real* weights) const;
};

// Moments [1 x rays], [0, 1] -> codes [time_code x rays].
Value record_time_code(Tape& tape, const MotionNetworks& networks, Value time);
// Position [3 x samples], contracted engine coordinates, and the samples' codes -> what density is
// found from beside features [rows() x samples].
Value record_moment(Tape& tape, const MotionNetworks& networks, Value position, Value code);

struct GridField;

// The way of a chunk's samples from their moment to the canonical scene.
struct MotionTape {
  Tape tape;
  Value position = 0;   // in: [3 x samples], grid coordinates
  Value time = 0;       // in: [1 x rays]
  Value canonical = 0;  // out: [3 x samples], grid coordinates, perhaps outside [0, 1]
  Value gradient = -1;  // in between the passes, training: [3 x samples], by `canonical`

  MotionTape(const GridField& field, bool training);
};

// One thread's. The field and the packs must outlive it.
class MotionChunk {
 public:
  MotionChunk(const GridField& field, const LayerPacks* packs, bool training = false);

  // Of samples whose rays begin at ray_begin (rays + 1 offsets), read until the next forward().
  // x, y, z: read up to the next multiple of kLane. times: of the rays.
  void forward(const Real* x, const Real* y, const Real* z, int samples, int rays,
               const int32_t* ray_begin, const Real* times);
  // Rows of the canonical position, with values up to the next multiple of kLane.
  const Real* canonical(int axis) const;
  // From the gradient by `canonical` [3][ld] to that of the weights, which is added to, and that of
  // the position before the warp.
  void backward(const Real* d_canonical, int64_t ld, Real* weight_gradient);
  const Real* position_gradient(int axis) const;

 private:
  std::unique_ptr<MotionTape> tape_;
  Chunk chunk_;
};

}  // namespace nerf
