// From what the grid method's integral has found along rays to their colours: features that share
// one are shaded, and what is behind matter is added.
#include <algorithm>

#include "model/grid_integrator.h"
#include "nerf/kernels/elementwise.h"

namespace nerf::internal {

void GridIntegrator::add_shaded(size_t w, Real shared, double transmittance) {
  Way& way = ways_[w];
  if (has_deep_) close_stretch(way, transmittance);
  if (!(shared > 0)) return;
  if (shaded_ == kChunkSamples) shade();
  const bool same_ray =
      shaded_rays_ > 0 && shaded_place_[static_cast<size_t>(shaded_ - 1)] == way.place;
  if (!same_ray) {
    const int64_t lr = shading_.stride(tape_.directions);
    for (int k = 0; k < 3; ++k)
      shading_.data(tape_.directions)[k * lr + shaded_rays_] = way.direction[k];
    shaded_begin_[static_cast<size_t>(shaded_rays_++)] = shaded_;
  }
  const Real scale = 1 / shared;
  Real* to = shaded_geometry_.data() + static_cast<size_t>(shaded_) * geometry_features();
  Real* sums = geometry_sums_.data() + w * geometry_features();
  for (size_t f = 0; f < geometry_features(); ++f) {
    to[f] = sums[f] * scale;
    sums[f] = 0;
  }
  shaded_place_[static_cast<size_t>(shaded_)] = way.place;
  shaded_weight_[static_cast<size_t>(shaded_)] = shared;
  if (medium_) {
    shaded_through_[shaded_] = std::exchange(seen_[w].through, Vec3d()).cast<Real>();
    shaded_haze_[shaded_] = std::exchange(seen_[w].haze, Vec3d()).cast<Real>();
  }
  if (has_deep_) shaded_stretch_[static_cast<size_t>(shaded_)] = sink_.deep[way.place].size() - 1;
  ++shaded_;
}

void GridIntegrator::shade() {
  if (shaded_ == 0) return;
  shaded_begin_[static_cast<size_t>(shaded_rays_)] = shaded_;
  statistics_.colour_evaluations += shaded_;
  shading_.samples = shaded_;
  shading_.rays = shaded_rays_;
  shading_.ray_begin = shaded_begin_.data();
  const int64_t features = static_cast<int64_t>(geometry_features());
  if (SharedSamples* const to = sink_.shared) {
    to->places.insert(to->places.end(), shaded_place_, shaded_place_ + shaded_);
    to->weights.insert(to->weights.end(), shaded_weight_, shaded_weight_ + shaded_);
    to->geometry.insert(to->geometry.end(), shaded_geometry_.data(),
                        shaded_geometry_.data() + shaded_ * features);
  }
  transpose(features, shaded_, shaded_geometry_.data(), features, shading_.data(tape_.geometry),
            shading_.stride(tape_.geometry));
  if (tape_.code >= 0) fill_rows(code_, shaded_rays_, tape_.code, shading_);
  tape_.forward_colour(shading_);
  const Real* colour = shading_.data(tape_.colour);
  const int64_t lc = shading_.stride(tape_.colour);
  for (int i = 0; i < shaded_; ++i) {
    const size_t place = static_cast<size_t>(shaded_place_[static_cast<size_t>(i)]);
    const Real weight = shaded_weight_[static_cast<size_t>(i)];
    const Vec3 through = medium_ ? shaded_through_[i] : Vec3{weight, weight, weight};
    for (int k = 0; k < 3; ++k)
      sink_.rgb[3 * place + static_cast<size_t>(k)] += through[k] * colour[k * lc + i];
    if (!has_deep_) continue;
    DeepSample& stretch = sink_.deep[place][shaded_stretch_[static_cast<size_t>(i)]];
    for (int k = 0; k < 3; ++k)
      stretch.rgb[k] = through[k] * colour[k * lc + i] + (medium_ ? shaded_haze_[i][k] : 0);
  }
  shaded_ = shaded_rays_ = 0;
}

void GridIntegrator::add_behind(const Way& way, const SeenLight* seen) {
  const size_t place = static_cast<size_t>(way.place);
  Real* const rgb = sink_.rgb + 3 * place;
  const bool in_sky = sky_ && !way.ends;
  const Vec3 behind = in_sky ? Vec3{} : way.background;
  const Real left = static_cast<Real>(way.transmittance);
  Vec3 through{1, 1, 1};
  if (seen) {
    const Veil veil = seen->medium.behind();
    for (int k = 0; k < 3; ++k)
      rgb[k] += static_cast<Real>(seen->light[k] + way.transmittance * veil.over(k, behind[k]));
    sink_.opacity[place] = static_cast<Real>(1 - way.transmittance * veil.mean_through());
    through = veil.through.cast<Real>();
  } else {
    for (int k = 0; k < 3; ++k) rgb[k] += static_cast<Real>(way.transmittance * behind[k]);
    sink_.opacity[place] = static_cast<Real>(1 - way.transmittance);
  }
  if (!in_sky) return;
  sink_.opacity[place] = 1;
  sky_->add(way.direction, through * left, rgb);
  if (!sink_.shared) return;
  sink_.shared->sky_places.push_back(way.place);
  sink_.shared->sky_shares.push_back(left);
}

void GridIntegrator::close(Way& way, const SeenLight* seen) {
  add_behind(way, seen);
  const size_t place = static_cast<size_t>(way.place);
  if (sink_.median) sink_.median[place] = way.median < 0 ? 0 : way.start + way.median;
  const auto distance = [&](Real t) { return t < 0 ? 0.0_r : static_cast<Real>(way.start + t); };
  if (sink_.near) sink_.near[place] = distance(way.near);
  if (sink_.far) sink_.far[place] = distance(way.far);
  if (has_moments_ && way.light > 0) {
    const double mean = way.first_moment / way.light;
    if (sink_.mean) sink_.mean[place] = static_cast<Real>(mean);
    if (sink_.variance)
      sink_.variance[place] =
          static_cast<Real>(std::max(0.0, way.second_moment / way.light - mean * mean));
  }
  if (sink_.samples) sink_.samples[place] = static_cast<int32_t>(way.next - way.begin);
  way.finished = true;
}

}  // namespace nerf::internal
