// One vector for a photo, so that photos of the same things have near vectors.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

namespace nerf::internal {

// VLAD (Jegou et al. 2010, "Aggregating local descriptors into a compact image representation")
// over square-rooted SIFT (COLMAP's are), with the residuals of each word normalised by themselves
// (Arandjelovic and Zisserman 2013, "All about VLAD") after the signed square root.
class GlobalDescriptor {
 public:
  static constexpr int kWords = 64;

  // Words from `sample`, [features x kDescriptorBytes]: k-means by angle, begun with features taken
  // at even steps, so that the same sample gives the same words.
  explicit GlobalDescriptor(std::span<const uint8_t> sample);

  // A vector of length 1, [kWords x kDescriptorBytes] values; empty for a photo without features.
  std::vector<float> of(std::span<const uint8_t> descriptors) const;

 private:
  std::vector<uint8_t> words_;  // [kWords x kDescriptorBytes], as long as descriptors are
};

}  // namespace nerf::internal
