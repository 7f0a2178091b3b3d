#include "nerf/train/medium_recipe.h"

#include "nerf/base/error.h"
#include "nerf/io/scene.h"

namespace nerf {

void check_medium(const Scene& scene, const MediumRecipe& recipe) {
  if (recipe.medium != LearntMedium::kNone && scene.alpha)
    throw Error("its photos have alpha: nothing was before or behind what they show",
                scene.root.string(), "leave out --medium, or give photos without alpha");
}

}  // namespace nerf
