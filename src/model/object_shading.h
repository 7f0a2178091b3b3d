// How glTF's surfaces send light on (glTF 2.0, appendix B).
#pragma once

#include "nerf/geometry/object.h"
#include "nerf/math/vec.h"

namespace nerf::internal {

// Scale and offset, at this angle, of an environment's colour that a surface with the colour
// `facing` at normal incidence mirrors (Karis 2014's fit).
Vec3d reflectance(const Vec3d& facing, double roughness, double cosine);

// Linear light that a surface sends against `direction` of a light of 1 from far away in the
// direction `towards`: Lambert's albedo / pi and GGX, times pi and the cosine of the light's angle.
// normal: towards the viewer; nothing where the light is behind it.
Vec3d sent_of_distant(const Vec3d& towards, const SurfacePoint& s, const Vec3d& normal,
                      const Vec3d& albedo, const Vec3d& facing, const Vec3d& direction);

}  // namespace nerf::internal
