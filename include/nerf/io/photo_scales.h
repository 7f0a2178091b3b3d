// Photos at several scales (Barron et al. 2021, section 4.1: the multiscale dataset).
#pragma once

#include "nerf/base/threads.h"
#include "nerf/io/photos.h"
#include "nerf/io/scene.h"

namespace nerf {

// Adds to every held-out view, and with `training` to every view that is trained on, the same view
// at 1/2, 1/4, ... of its photo, `scales` sizes in all, as further views of the same split: named
// scale2/NAME and so on, with View::scale, cameras scaled alike. A pixel is the mean of those that
// it covers, colours weighted by alpha; it is masked out where more than half of them are. 1
// changes nothing. Throws Error where a photo would have a side below kLeastScaledSide pixels.
inline constexpr int kLeastScaledSide = 11;  // what SSIM needs
void add_photo_scales(Scene& scene, PhotoSet& photos, int scales, bool training, ThreadPool& pool);

// The photos of every view in `scene.train`, reduced by a whole number so that no side is above
// `longest_side`; the others are empty. Pixels as above.
PhotoSet reduced_photos(const Scene& scene, const PhotoSet& photos, int longest_side,
                        ThreadPool& pool);

}  // namespace nerf
