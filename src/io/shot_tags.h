// What a camera writes beside the pixels (EXIF) of how much light it let in, and by which lens.
#pragma once

#include <OpenImageIO/imageio.h>

#include <string>
#include <vector>

#include "nerf/io/image.h"
#include "nerf/io/scene.h"

namespace nerf::internal {

// Times, apertures and sensitivities that no camera has count as not said, and are named. The
// exposure bias is not read: it is what a person asked the camera for, and the three say already
// what the camera made of it.
ShotTags shot_tags(const OIIO::ImageSpec& spec);

// View::exposure and View::lens of the views, by their photos' tags: see View. What is not used is
// said in the report.
void find_exposures(const std::vector<ShotTags>& tags, std::vector<View>& views,
                    SceneReport& report);

}  // namespace nerf::internal
