// The light of rendered pictures, from the command line.
#pragma once

#include <span>
#include <string>

#include "nerf/base/real.h"
#include "nerf/model/radiance_field.h"
#include "render_plan.h"

namespace nerf::apps {

// Gives every frame its light. `text`: empty or "mean", the model's own; "own", that of the photo
// of the same name, where the model has learnt it; a photo's name, or several with ".." between
// them, which follow each other along the frames at equal distances, blended in between. A name may
// leave out folders and extension as long as one photo fits. Throws Error for other names, and
// where the model has learnt no light.
void give_appearance(const std::string& text, const RadianceField& field, RenderPlan& plan);

// Multiplies linear light by 2^stops; colours are sRGB, clipped to [0, 1].
void change_exposure(double stops, std::span<Real> rgb);

}  // namespace nerf::apps
