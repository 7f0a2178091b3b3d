#include "nerf/train/motion_recipe.h"

#include <set>

#include "nerf/base/error.h"
#include "nerf/io/scene.h"

namespace nerf {

MotionShape MotionRecipe::shape() const {
  MotionShape s;
  if (deform == Deform::kAuto || deform == Deform::kNone) return s;
  s.warp.kind = deform == Deform::kSe3 ? WarpKind::kSe3 : WarpKind::kTranslation;
  // Chosen on development views of `orbit` (docs/moving.md).
  s.warp.position_degrees = 4;
  s.warp.depth = 3;
  s.warp.width = width;
  s.ambient = ambient;
  s.time_code = 8;
  s.time_degrees = 6;
  s.time_width = width;
  s.point_degrees = 3;
  return s;
}

int count_moments(const Scene& scene) {
  std::set<double> times;
  for (const int view : scene.train) times.insert(scene.views[static_cast<size_t>(view)].time);
  return static_cast<int>(times.size());
}

void resolve_motion(const Scene& scene, MotionRecipe& recipe) {
  const bool moves = count_moments(scene) > 1;
  if (recipe.deform == Deform::kAuto)
    recipe.deform = moves ? Deform::kTranslation : Deform::kNone;
  else if (recipe.deform != Deform::kNone && !moves)
    throw Error("all its photos are of one moment", scene.root.string(),
                "leave out --deform, or say the photos' times with --times");
}

}  // namespace nerf
