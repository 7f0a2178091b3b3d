#include "nerf/train/motion_recipe.h"

#include <algorithm>
#include <set>
#include <vector>

#include "nerf/base/error.h"
#include "nerf/io/scene.h"

namespace nerf {

MotionShape MotionRecipe::shape() const {
  MotionShape s;
  if (deform == Deform::kAuto || deform == Deform::kNone) return s;
  s.warp.kind = deform == Deform::kSe3 ? WarpKind::kSe3 : WarpKind::kTranslation;
  // Chosen on development views (docs/moving.md).
  s.warp.position_degrees = 3;
  s.warp.depth = 3;
  s.warp.width = width;
  s.ambient = ambient;
  s.time_code = 8;
  s.time_degrees = 4;
  s.time_width = width;
  s.point_degrees = 2;
  return s;
}

int count_moments(const Scene& scene) {
  std::set<double> times;
  for (const int view : scene.train) times.insert(scene.views[static_cast<size_t>(view)].time);
  return static_cast<int>(times.size());
}

bool filmed_on_the_way(const Scene& scene) {
  constexpr size_t kFewest = 8;
  constexpr double kSmall = 0.25;  // of the way to a photo of half the film later
  // Two steps in a line are twice one, and sqrt(2) times where the camera shakes; of cameras that
  // take turns every other photo is near.
  constexpr double kOnwards = 1.25;
  std::vector<int> order = scene.train;
  const size_t n = order.size();
  if (n < kFewest || count_moments(scene) != static_cast<int>(n)) return false;
  const auto view = [&](int v) -> const View& { return scene.views[static_cast<size_t>(v)]; };
  std::ranges::sort(order, {}, [&](int v) { return view(v).time; });
  const auto usual_distance = [&](size_t apart) {
    std::vector<double> all;
    for (size_t i = 0; i + apart < n; ++i)
      all.push_back(
          length(view(order[i + apart]).pose.translation - view(order[i]).pose.translation));
    std::ranges::nth_element(all, all.begin() + static_cast<int64_t>(all.size() / 2));
    return all[all.size() / 2];
  };
  const double step = usual_distance(1);
  return step < kSmall * usual_distance(n / 2) && usual_distance(2) > kOnwards * step;
}

double offset_weight(const MotionRecipe& recipe, const Scene& scene) {
  constexpr double kFilmed = 0.1;  // docs/moving.md
  if (!recipe.shape().any()) return 0;
  return recipe.offset.value_or(filmed_on_the_way(scene) ? kFilmed : 0.0);
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
