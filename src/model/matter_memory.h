// Where the samples of a training found matter lately, so that its later steps leave out the rest.
#pragma once

#include <atomic>
#include <cstdint>
#include <span>
#include <vector>

#include "model/matter_cells.h"
#include "nerf/base/threads.h"

namespace nerf::internal {

// A cell holds matter while it, or one of its 26 neighbours, had a sample that mattered to its ray
// in the last steps. Some rays of every step ask for all of their samples, so that matter which
// appears in an empty cell is found (NetworkRay::everywhere).
class MatterMemory {
 public:
  static constexpr int kSide = 64;

  // steps (at least 1): after which a cell that nothing was found in is empty, or up to a sixteenth
  // later; at first none is.
  explicit MatterMemory(int steps);
  static uint64_t memory_bytes() { return 4 * size(); }

  const MatterCells& cells() const { return cells_; }  // as of the last look
  static int64_t cell_of(const Vec3& p) { return MatterCells::cell_of(kSide, p); }

  // Of a cell that cell_of() gave, by any thread of a step.
  void mark(int64_t cell) {
    if (cell < 0) return;
    const std::atomic_ref<uint8_t> age(ages_[static_cast<size_t>(cell)]);
    if (!(age.load(std::memory_order_relaxed) & kMarked))
      age.fetch_or(kMarked, std::memory_order_relaxed);
  }

  // After step `done`.
  void advance(int64_t done, ThreadPool& pool);
  void forget();

  // For a checkpoint, which may be made between two looks: marks are apart from ages in them.
  std::span<const uint8_t> state() const { return ages_; }
  std::span<uint8_t> state() { return ages_; }
  void look(ThreadPool& pool);  // at a state that was read

 private:
  static constexpr uint8_t kMarked = 0x80;
  static constexpr size_t size() {
    return static_cast<size_t>(MatterCells::kCascades * MatterCells::cells_of(kSide));
  }
  int every_;                  // steps between two looks
  uint8_t longest_;            // looks until a cell that was marked just now is empty
  std::vector<uint8_t> ages_;  // looks until each cell is, and whether it was marked since the last
  MatterCells cells_;
};

}  // namespace nerf::internal
