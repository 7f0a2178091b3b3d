#include "nerf/train/motion_recipe.h"

#include <set>

#include "nerf/base/error.h"
#include "nerf/io/scene.h"

namespace nerf {

MotionShape MotionRecipe::shape() const {
  MotionShape s;
  if (deform == Deform::kAuto || deform == Deform::kNone) return s;
  s.warp.kind = deform == Deform::kSe3 ? WarpKind::kSe3 : WarpKind::kTranslation;
  s.warp.position_degrees = degrees;
  s.warp.depth = depth;
  s.warp.width = width;
  s.ambient = ambient;
  s.time_code = time_code;
  s.time_degrees = time_degrees;
  s.time_width = width;
  s.point_degrees = point_degrees;
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
