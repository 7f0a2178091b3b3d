// The light of a photo that a field has not learnt.
#pragma once

#include "nerf/base/cancel.h"
#include "nerf/base/threads.h"
#include "nerf/io/photos.h"
#include "nerf/model/radiance_field.h"
#include "nerf/model/renderer.h"

namespace nerf {

// Columns [0, width / 2) of a photo are for fitting, the others for comparing (Martin-Brualla et
// al. 2021, section 5).
inline int fitted_columns(int width) { return width / 2; }

// What of the codes that the field keeps explains the left half of the photo best, by a robust sum
// of squares over a lattice of pixels and a prior: the spread of the codes that were learnt. Empty
// parts where the field has none. camera_to_world: input coordinates. `options` has everything else
// of the picture. Throws Cancelled.
Appearance fit_appearance(const RadianceField& field, const Camera& camera,
                          const Pose& camera_to_world, const Photo& photo,
                          const RenderOptions& options, ThreadPool& pool,
                          const Cancel* cancel = nullptr);

}  // namespace nerf
