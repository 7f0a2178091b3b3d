#include "model/matter_memory.h"

#include <algorithm>

namespace nerf::internal {

MatterMemory::MatterMemory(int steps)
    : every_(std::max(steps / 16, 1)),
      longest_(static_cast<uint8_t>((steps + every_ - 1) / every_)),
      ages_(size(), longest_),
      cells_(kSide, std::vector<uint8_t>(size(), 1), {}) {}

void MatterMemory::forget() { *this = MatterMemory(every_ * longest_); }

void MatterMemory::look(ThreadPool& pool) {
  std::vector<uint8_t> held(size());
  for (size_t i = 0; i < held.size(); ++i) held[i] = (ages_[i] & ~kMarked) > 0;
  for (int64_t c = 0; c < MatterCells::kCascades; ++c)
    MatterCells::grow(held, kSide, c * MatterCells::cells_of(kSide), pool);
  cells_ = MatterCells(kSide, std::move(held), {});
}

void MatterMemory::advance(int64_t done, ThreadPool& pool) {
  if (done % every_ != 0) return;
  for (uint8_t& age : ages_)
    age = (age & kMarked) ? longest_ : static_cast<uint8_t>(std::max(age - 1, 0));
  look(pool);
}

}  // namespace nerf::internal
