// The surface of a trained field as triangles or points: from depth as its training cameras see it,
// or from its density.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "nerf/base/cancel.h"
#include "nerf/base/real.h"
#include "nerf/base/threads.h"
#include "nerf/geometry/depth_fusion.h"
#include "nerf/geometry/triangle_mesh.h"
#include "nerf/math/vec.h"
#include "nerf/model/renderer.h"

namespace nerf {

class RadianceField;

// Where a surface is looked for. Its coordinates are the engine's, turned: unit and origin stay.
struct SurfaceRegion {
  Mat3d from_engine;  // rotation
  Box3 box;
  Vec3d to_engine(const Vec3d& p) const { return from_engine.transposed() * p; }
};

// A box of input coordinates, whose axes stay theirs.
SurfaceRegion region_of(const RadianceField& field, const Box3& bbox);

// What the model is asked with.
struct SurfaceOptions {
  // Appearance, time, precision; no supersampling. What photos were taken through is left out.
  RenderOptions render = [] {
    RenderOptions clear;
    clear.medium.emplace();
    return clear;
  }();
  int resolution = 512;  // voxels along the region's longest side
  // Rays at most that look for depth; pictures are as fine as voxels where that takes fewer.
  int64_t most_rays = 20'000'000;
  // A pixel says where matter is where it stops so much light, and that there is none where it
  // stops so little; what lies between says nothing.
  double opaque = 0.9, clear = 0.1;
  // Nor does a pixel whose light is stopped over so much of its distance to the camera and over
  // more than the truncation, from 5 % to 95 %.
  double most_spread = 0.1;
  double truncation = 4;  // voxels, or the pixels' usual spread where that is more
  // The density at which the surface is, 1 / engine unit; 0: where half of the light is stopped
  // within `density_voxels`.
  double density = 0;
  double density_voxels = 2;
};

struct SurfaceWork {
  ThreadPool& pool;
  uint64_t memory_bytes = uint64_t{1} << 62;
  std::function<void(double)> progress = {};  // [0, 1]
  const Cancel* cancel = nullptr;
};

// The part of the scene that the training cameras have in common: around the surface that half as
// many of them see as see what most see; of captures with alpha around everything. Throws Error
// where they see no surface.
SurfaceRegion find_region(const RadianceField& field, const SurfaceOptions& options,
                          const SurfaceWork& work);

// Depth as the training cameras see it: pictures by pinholes in the region's coordinates, several
// for a camera that looks all around.
std::vector<DepthView> depth_views(const RadianceField& field, const SurfaceRegion& region,
                                   const SurfaceOptions& options, const SurfaceWork& work);

// In the region's coordinates, with normals and without colours.
TriangleMesh mesh_from_depth(const SurfaceRegion& region, std::span<const DepthView> views,
                             const SurfaceOptions& options, const SurfaceWork& work);
// `views`: matter deeper than any of them sees is left out; empty: all stays.
TriangleMesh mesh_from_density(const RadianceField& field, const SurfaceRegion& region,
                               std::span<const DepthView> views, const SurfaceOptions& options,
                               const SurfaceWork& work);

// Gives points on the surface the colour that the field has there, by a short ray through each
// along the mean direction of the views that see it, or against its normal where none does.
// `width`: of the surface, region's unit. [n] of sRGB.
std::vector<Vec3> surface_colours(const RadianceField& field, const SurfaceRegion& region,
                                  std::span<const DepthView> views, std::span<const Vec3> positions,
                                  std::span<const Vec3> normals, double width,
                                  const SurfaceOptions& options, const SurfaceWork& work);

}  // namespace nerf
