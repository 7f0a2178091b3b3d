#include "model/motion_lattice.h"

#include <algorithm>
#include <cmath>
#include <thread>

namespace nerf::internal {

namespace {

constexpr int kCells = 2;  // of the finest cascade, between two corners

int corners_along(const GridField& field) {
  const Real spacing = kCells * field.occupancy.cell_width(0) / (2 * field.extent());
  return static_cast<int>(std::lround(1 / spacing)) + 1;
}

// The cube and the place within it, [0, 1], of a coordinate. Beyond the lattice its last cube
// counts on.
int cube_of(Real x, int side, Real& within) {
  const Real scaled = x * static_cast<Real>(side - 1);
  const Real cube = std::clamp(std::floor(scaled), 0.0_r, static_cast<Real>(side - 2));
  within = scaled - cube;
  return static_cast<int>(cube);
}

}  // namespace

MotionLattice::MotionLattice(const GridField& field, Real time)
    : time_(time), side_(corners_along(field)) {
  const size_t n = static_cast<size_t>(side_);
  offsets_.reset(new Real[kStride * n * n * n]);
  states_ = std::make_unique<std::atomic<uint8_t>[]>(n * n * n);
}

int64_t MotionLattice::found() const {
  const int64_t n = int64_t{side_} * side_ * side_;
  return std::count_if(states_.get(), states_.get() + n, [](const auto& s) { return s == kKnown; });
}

LatticeMotion::LatticeMotion(MotionLattice& lattice, const GridField& field,
                             const LayerPacks* packs)
    : lattice_(lattice), motion_(field, packs) {
  const int side = lattice.side_;
  for (int c = 0; c < 8; ++c) steps_[c] = (c & 1) + side * ((c >> 1 & 1) + side * (c >> 2));
}

void LatticeMotion::forward(const Real* x, const Real* y, const Real* z, int samples) {
  const int side = lattice_.side_;
  alignas(64) Real within[3][kChunkSamples];
  missing_.clear();
  for (int i = 0; i < samples; ++i) {
    const int cx = cube_of(x[i], side, within[0][i]), cy = cube_of(y[i], side, within[1][i]),
              cz = cube_of(z[i], side, within[2][i]);
    cubes_[i] = cx + side * (cy + side * cz);
    if (i > 0 && cubes_[i] == cubes_[i - 1]) continue;
    for (const int32_t step : steps_) {
      const int32_t corner = cubes_[i] + step;
      if (lattice_.states_[corner].load(std::memory_order_acquire) != MotionLattice::kKnown)
        missing_.push_back(corner);
    }
  }
  if (!missing_.empty()) find_missing();
  constexpr size_t kStride = MotionLattice::kStride;
  for (int i = 0; i < samples; ++i) {
    const Real u = within[0][i], v = within[1][i], w = within[2][i];
    Real sum[kStride] = {};
    for (int c = 0; c < 8; ++c) {
      const Real weight = (c & 1 ? u : 1 - u) * (c >> 1 & 1 ? v : 1 - v) * (c >> 2 ? w : 1 - w);
      const Real* const offset =
          lattice_.offsets_.get() + kStride * static_cast<size_t>(cubes_[i] + steps_[c]);
      for (size_t k = 0; k < kStride; ++k) sum[k] += offset[k] * weight;
    }
    canonical_[0][i] = x[i] + sum[0];
    canonical_[1][i] = y[i] + sum[1];
    canonical_[2][i] = z[i] + sum[2];
  }
  for (auto& row : canonical_) std::fill(row + samples, row + round_up(samples, kLane), 0.5_r);
}

void LatticeMotion::find_missing() {
  std::sort(missing_.begin(), missing_.end());
  missing_.erase(std::unique(missing_.begin(), missing_.end()), missing_.end());
  constexpr size_t kStride = MotionLattice::kStride;
  own_offsets_.assign(kStride * missing_.size(), 0.0_r);
  const int side = lattice_.side_;
  const Real width = 1 / static_cast<Real>(side - 1);
  for (size_t first = 0; first < missing_.size(); first += kChunkSamples) {
    const int n = static_cast<int>(std::min(missing_.size() - first, size_t{kChunkSamples}));
    for (int i = 0; i < n; ++i) {
      const int32_t corner = missing_[first + static_cast<size_t>(i)];
      const int at[] = {corner % side, corner / side % side, corner / (side * side)};
      for (int k = 0; k < 3; ++k) corner_[k][i] = static_cast<Real>(at[k]) * width;
    }
    for (auto& row : corner_) std::fill(row + n, row + round_up(n, kLane), 0.5_r);
    const int32_t ray_begin[] = {0, n};
    motion_.forward(corner_[0], corner_[1], corner_[2], n, 1, ray_begin, &lattice_.time_);
    for (int i = 0; i < n; ++i) {
      Real* const own = own_offsets_.data() + kStride * (first + static_cast<size_t>(i));
      for (int k = 0; k < 3; ++k) own[k] = motion_.canonical(k)[i] - corner_[k][i];
    }
  }
  for (size_t i = 0; i < missing_.size(); ++i) {
    std::atomic<uint8_t>& state = lattice_.states_[missing_[i]];
    uint8_t unknown = MotionLattice::kUnknown;
    if (!state.compare_exchange_strong(unknown, MotionLattice::kClaimed, std::memory_order_relaxed))
      continue;
    std::copy_n(own_offsets_.data() + kStride * i, kStride,
                lattice_.offsets_.get() + kStride * static_cast<size_t>(missing_[i]));
    state.store(MotionLattice::kKnown, std::memory_order_release);
  }
  // Of what another thread has claimed, until that one has written the same numbers.
  for (const int32_t corner : missing_)
    while (lattice_.states_[corner].load(std::memory_order_acquire) != MotionLattice::kKnown)
      std::this_thread::yield();
}

}  // namespace nerf::internal
