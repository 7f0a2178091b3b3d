// Objects of triangles that stand in a field's pictures, inside the integral along each ray: matter
// before them hides them and shades through where it is thin, they hide what is behind them, and
// where they let light through the integral goes on. They are lit by the field or by given lights,
// and cast shadows on its surface.
//
//   ray, up to the first surface at t:  integral of T density colour dt + T(t) B
//   B = alpha shaded + (1 - alpha) (the same from t on)
//
// Shading is glTF's (base colour, metallic, roughness, emissive): diffuse light by the irradiance
// of the field around the object in nine spherical harmonics (Ramamoorthi and Hanrahan 2001),
// reflections by its radiance along the mirrored ray, blurred by roughness. Light is linear;
// compositing is in sRGB, as the field's own.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "nerf/base/cancel.h"
#include "nerf/base/threads.h"
#include "nerf/geometry/object.h"
#include "nerf/model/renderer.h"

namespace nerf {

// From far away.
struct DistantLight {
  Vec3d towards;         // unit, to the light, engine coordinates
  Vec3d light{1, 1, 1};  // linear: what a white surface that faces it shows
};

struct InsertionOptions {
  bool field_light = true;  // else only the lights below shine on the object
  std::vector<DistantLight> lights;
  bool shadows = true;      // on the field's surface
  int shadow_rays = 24;     // for each pixel near the object
  bool reflections = true;  // rays of their own where the object is smooth; else blurred light
  bool moves = false;       // it may have no triangle with an area for a while
};

namespace internal {
struct ObjectPixels;
}

class Insertion {
 public:
  // `object` in engine coordinates (place_mesh()). Looks at the field's light around it with the
  // options of the pictures to come.
  Insertion(const RadianceField& field, SceneObject object, const InsertionOptions& insertion,
            const RenderOptions& options, ThreadPool& pool);
  ~Insertion();
  Insertion(const Insertion&) = delete;
  Insertion& operator=(const Insertion&) = delete;

  // The object's positions, normals and triangles become these, as many as they were, in engine
  // coordinates. Its light is that of its new place.
  void move(TriangleMesh mesh, const RenderOptions& options, ThreadPool& pool);

  // What render() asks. The camera is in engine units. What is seen of the objects in a picture:
  internal::ObjectPixels look(const Camera& camera, const Pose& camera_to_engine,
                              const RenderOptions& options, ThreadPool& pool,
                              const Cancel* cancel) const;
  // The picture of the field before them gets shadows, and what it says of opacity and depth counts
  // them in.
  void finish(const internal::ObjectPixels& pixels, const Camera& camera,
              const Pose& camera_to_engine, const RenderOptions& options, ThreadPool& pool,
              Frame& frame) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// An object's coordinates become the engine's.
void place_mesh(const Similarity& to_engine, TriangleMesh& mesh);

}  // namespace nerf
