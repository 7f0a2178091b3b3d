// Where points of one moment stand in the canonical scene, for pictures: found where it is needed,
// at the corners of a lattice, and interpolated between them. A warp bends space slowly, and its
// networks cost several times what the rest of a sample does.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <vector>

#include "nerf/model/grid_field.h"
#include "nerf/model/grid_motion.h"

namespace nerf::internal {

// Shared by all threads of a picture. Corners stand two of the finest cascade's cells apart, in
// grid coordinates. The field must outlive it.
class MotionLattice {
 public:
  MotionLattice(const GridField& field, Real time);

  Real time() const { return time_; }
  int side() const { return side_; }  // corners along each axis
  int64_t found() const;              // corners that were needed so far

 private:
  friend class LatticeMotion;
  enum State : uint8_t { kUnknown, kClaimed, kKnown };

  Real time_;
  int side_;
  // canonical - grid position of each corner, as four numbers, a register's, of which the last is
  // 0; written by the thread that claims it: pages of the memory that no sample is near are never
  // touched
  static constexpr size_t kStride = 4;
  std::unique_ptr<Real[]> offsets_;
  std::unique_ptr<std::atomic<uint8_t>[]> states_;
};

// One thread's way from positions to canonical ones. The field, the packs and the lattice must
// outlive it.
class LatticeMotion {
 public:
  LatticeMotion(MotionLattice& lattice, const GridField& field, const LayerPacks* packs);

  // Of `samples` (at most kChunkSamples) points in grid coordinates; the same bits whatever other
  // threads ask for meanwhile.
  void forward(const Real* x, const Real* y, const Real* z, int samples);
  // Rows of the canonical position, with values up to the next multiple of kLane.
  const Real* canonical(int axis) const { return canonical_[axis]; }

 private:
  // Finds the corners in missing_.
  void find_missing();

  MotionLattice& lattice_;
  MotionChunk motion_;
  int32_t steps_[8];               // from the least corner of a cube to each
  int32_t cubes_[kChunkSamples];   // the least corner of each sample's cube
  std::vector<int32_t> missing_;   // corners that no thread had found
  std::vector<Real> own_offsets_;  // of missing_, as the lattice has them
  alignas(64) Real canonical_[3][kChunkSamples];
  alignas(64) Real corner_[3][kChunkSamples];
};

}  // namespace nerf::internal
