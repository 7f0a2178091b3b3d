#include "train/lenses.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <numeric>
#include <set>

namespace nerf {

Lenses lenses_of(const Scene& scene) {
  constexpr double kApart = 1.1;  // of a focal length and the next longer one, as a ratio
  Lenses lenses;
  lenses.of_view.assign(scene.views.size(), -1);
  std::map<std::string, std::vector<size_t>> alike;
  const auto camera_of = [&](size_t v) -> const Camera& {
    return scene.cameras[static_cast<size_t>(scene.views[v].camera)];
  };
  for (size_t v = 0; v < scene.views.size(); ++v) {
    const Camera& c = camera_of(v);
    if (is_panorama(c)) continue;
    // Held upright or not.
    const auto [shorter, longer] = std::minmax(c.width, c.height);
    const std::string& said = scene.views[v].lens;
    alike[said.empty() ? fmt::format("lens of photos of {} x {} pixels", longer, shorter) : said]
        .push_back(v);
  }
  for (auto& [name, views] : alike) {
    const bool said = !scene.views[views.front()].lens.empty();
    std::ranges::stable_sort(views, {}, [&](size_t v) { return said ? 0 : camera_of(v).fx(); });
    double before = 0;
    for (const size_t v : views) {
      const double focal = camera_of(v).fx();
      if (before == 0 || (!said && focal > kApart * before)) {
        lenses.names.push_back(said ? name
                                    : fmt::format("{}, focal length {:.0f} pixels", name, focal));
      }
      before = focal;
      lenses.of_view[v] = static_cast<int>(lenses.names.size()) - 1;
    }
  }
  return lenses;
}

}  // namespace nerf
