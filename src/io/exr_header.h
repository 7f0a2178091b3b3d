// Headers of OpenEXR files.
#pragma once

#include <OpenEXR/ImfHeader.h>

#include "nerf/io/exr.h"

namespace nerf::internal {

// Of a picture of that size, without channels: what write_exr() says.
Imf::Header exr_header(int width, int height, const ExrHeader& header);

}  // namespace nerf::internal
