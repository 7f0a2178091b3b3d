// A lattice around points: what changes slowly in space is found at its corners alone.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <unordered_map>
#include <vector>

#include "nerf/math/vec.h"

namespace nerf::internal {

class PointLattice {
 public:
  // Finds the corners of the cubes, `spacing` wide, that the points lie in. False where these are
  // not fewer than the points.
  bool surround(std::span<const Vec3d> points, Real spacing);
  const std::vector<Vec3d>& corners() const { return corners_; }
  // Of what each corner has: trilinear interpolation at point i.
  Vec3 at(size_t i, const std::vector<Vec3>& of_corners) const;

 private:
  struct Place {
    std::array<int32_t, 8> corner;
    Vec3 within;  // [0, 1], the point in its cube
  };
  int32_t corner(const std::array<int64_t, 3>& index, Real spacing);

  std::vector<Vec3d> corners_;
  std::vector<Place> places_;
  std::unordered_map<uint64_t, int32_t> known_;
};

}  // namespace nerf::internal
