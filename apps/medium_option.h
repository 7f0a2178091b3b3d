// A medium in nerf_render's pictures, from the command line.
#pragma once

#include <string>

#include "nerf/model/medium.h"
#include "nerf/model/model_info.h"

namespace nerf::apps {

// KIND[,sigma=N|R,G,B][,backscatter=N|R,G,B][,colour=R,G,B][,height=H,falloff=L][,box=x,y,z,x,y,z],
// KIND being fog, smoke or water, which say what is left out; or off, which is an empty medium.
// Without sigma the medium is as dense as its kind is in a scene of this size, and without
// backscatter that is sigma. Throws Error naming --medium.
Medium parse_medium(const std::string& text, const ModelInfo& info);

// The text that parse_medium() reads, in six digits.
std::string medium_text(const Medium& medium);

}  // namespace nerf::apps
