// Pictures of held-out views for a report: the parts of what nerf_train wrote side by side, their
// difference, as JPEG of a size that a page can hold.
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "nerf/io/image.h"

namespace nerf::apps {

// Where the colours of an error picture end: a mean difference of a pixel's channels, of [0, 1].
inline constexpr double kLargestError = 0.2;

// Absolute difference of two pictures of equal size and 3 channels, mean over the channels, in
// turbo from 0 (dark blue) to kLargestError and more (dark red). Where `mask`, empty or a value per
// pixel, is 0 the picture is grey.
Image8 error_picture(const Image8& truth, const Image8& rendering,
                     const std::vector<uint8_t>& mask);

// Means of blocks of factor x factor pixels; what is left at the right and below is cut off. The
// picture is at least `factor` pixels wide and high.
Image8 reduced(const Image8& image, int factor);

struct ViewPictures {
  int width = 0, height = 0;                            // of the photo
  int factor = 1;                                       // by which the pictures are reduced
  std::vector<uint8_t> photo, rendering, error, depth;  // JPEG
};

// Of `file`, which holds photo, rendering and depth in a row (side_by_side() of evaluation.h), and
// the mask where that file exists. At most kMostPictureWidth wide, and reduced further until the
// JPEGs take at most `bytes` together or are small. Throws Error where a file is no such picture.
ViewPictures view_pictures(const std::filesystem::path& file, const std::filesystem::path& mask,
                           uint64_t bytes);

inline constexpr int kMostPictureWidth = 960;  // pixels

}  // namespace nerf::apps
