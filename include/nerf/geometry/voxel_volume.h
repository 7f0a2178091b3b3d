// Numbers on a regular lattice, in memory only where a surface may be: blocks of 8^3 samples.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "nerf/math/vec.h"

namespace nerf {

// Where the samples stand: at origin + spacing * (i, j, k).
struct VoxelLattice {
  Vec3d origin;
  double spacing = 1;
  std::array<int, 3> samples{};  // along each axis

  // Around a box, with `resolution` cells along its longest side and one more all around.
  static VoxelLattice around(const Box3& box, int resolution);
  Vec3d position(int i, int j, int k) const {
    return origin + Vec3d{double(i), double(j), double(k)} * spacing;
  }
};

class VoxelVolume {
 public:
  static constexpr int kSide = 8;
  static constexpr int kSamples = kSide * kSide * kSide;

  // Samples in the order of x, then y, then z. A sample of weight 0 is not known.
  struct Block {
    std::array<int, 3> at{};  // its place among the blocks
    std::array<float, kSamples> value{}, weight{};
  };

  explicit VoxelVolume(const VoxelLattice& lattice);

  const VoxelLattice& lattice() const { return lattice_; }
  const std::array<int, 3>& blocks_along() const { return along_; }
  int64_t block_count() const { return int64_t{along_[0]} * along_[1] * along_[2]; }
  int64_t block_index(int x, int y, int z) const {
    return (int64_t{z} * along_[1] + y) * along_[0] + x;
  }
  // Of a block's first sample.
  Vec3d corner(const Block& block) const {
    return lattice_.position(block.at[0] * kSide, block.at[1] * kSide, block.at[2] * kSide);
  }

  // Makes room for the blocks that are marked, in place of all that was there. A byte for each.
  void allocate(std::span<const uint8_t> wanted);
  // Those that there is room for, in the order of their indices.
  std::vector<Block>& blocks() { return blocks_; }
  const std::vector<Block>& blocks() const { return blocks_; }
  // Its place in blocks(), or -1; also outside the lattice.
  int32_t slot(int x, int y, int z) const {
    if (x < 0 || y < 0 || z < 0 || x >= along_[0] || y >= along_[1] || z >= along_[2]) return -1;
    return slots_[static_cast<size_t>(block_index(x, y, z))];
  }
  static uint64_t bytes_of(int64_t blocks) { return static_cast<uint64_t>(blocks) * sizeof(Block); }

 private:
  VoxelLattice lattice_;
  std::array<int, 3> along_;
  std::vector<int32_t> slots_;
  std::vector<Block> blocks_;
};

}  // namespace nerf
