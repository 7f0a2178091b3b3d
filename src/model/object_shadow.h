// What inserted objects do to the picture of the field before and around them.
#pragma once

#include <optional>

#include "model/medium_ray.h"
#include "model/object_light.h"
#include "model/object_pixels.h"
#include "nerf/base/threads.h"
#include "nerf/geometry/object.h"
#include "nerf/geometry/triangle_bvh.h"
#include "nerf/model/insertion.h"

namespace nerf::internal {

struct ShadowCaster {
  const SceneObject& object;
  const TriangleBvh& bvh;
  Vec3d centre;  // of a ball around the object
  double radius;
  const Environment& around;
  const InsertionOptions& options;
  Vec3 background;  // of the picture, sRGB
  std::optional<EngineMedium> medium;
};

// Darkens the field where it stops half of a pixel's light near the object: by the share of the
// light there that the object takes, from around and from the lights, less what it sends back
// itself. Pixels that lose nothing keep their bits. unit: engine units of an input unit.
void cast_shadows(const ShadowCaster& caster, const ObjectPixels& pixels, const Camera& camera,
                  const Pose& camera_to_engine, double unit, ThreadPool& pool, Frame& frame);

// What a pixel's depth and layers say, with the object in it; its opacity is still the field's.
// depth, distance: input units of an engine unit along the ray.
void count_in(const ObjectPixels& pixels, size_t pixel, double depth, double distance,
              const Similarity& to_engine, Frame& frame);

}  // namespace nerf::internal
