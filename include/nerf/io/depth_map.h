// Depth of a photo that came with the capture: a LiDAR's, a stereo camera's, a renderer's.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace nerf {

// Rows from the top, of the same picture as the photo but of a size of its own.
struct DepthMap {
  int width = 0, height = 0;
  // Half floats (bits): along the optical axis (of panoramas along the ray), engine units; 0 where
  // unknown.
  std::vector<uint16_t> z;

  bool empty() const { return z.empty(); }
  double pixel(int x, int y) const;  // 0 where unknown
  // At a place of the picture, (0, 0) to (1, 1): between the four pixels round it in inverse depth,
  // which is exact on planes; 0 where one of them is unknown or they differ by more than
  // kDepthEdge, since a place beside an edge may lie on either side.
  double at(double u, double v) const;
};

// Relative difference of neighbours above which an edge lies between them.
inline constexpr double kDepthEdge = 0.05;

}  // namespace nerf
