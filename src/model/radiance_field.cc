#include "nerf/model/radiance_field.h"

#include <algorithm>
#include <vector>

#include "model/appearance.h"
#include "model/baked_occupancy.h"
#include "model/network_renderer.h"
#include "nerf/base/error.h"
#include "nerf/model/grid_field.h"
#include "nerf/model/network_field.h"

namespace nerf {

RadianceField::RadianceField(ModelInfo info, std::shared_ptr<const GridField> grid)
    : info_(std::move(info)), grid_(std::move(grid)) {}

RadianceField::RadianceField(ModelInfo info, std::shared_ptr<const NetworkField> network)
    : info_(std::move(info)), network_(std::move(network)) {}

const Field& RadianceField::field() const {
  if (grid_) return *grid_;
  return *network_;
}

bool RadianceField::moves() const { return field().moves(); }

std::optional<Medium> RadianceField::medium() const {
  if (!grid_ || grid_->learnt_medium() == LearntMedium::kNone) return std::nullopt;
  Medium medium = grid_->medium();
  medium.attenuation = medium.attenuation * info_.to_engine.scale;
  medium.backscatter = medium.backscatter * info_.to_engine.scale;
  return medium;
}

RadianceField RadianceField::without_empty_cells() const {
  RadianceField all = *this;
  all.baked_.reset();
  if (!grid_) return all;
  auto grid = std::make_shared<GridField>(*grid_);
  const std::span<const uint8_t> known = grid->occupancy.levels();
  std::vector<uint8_t> levels(known.begin(), known.end());
  for (uint8_t& level : levels) level = std::max<uint8_t>(level, 1);
  grid->occupancy.set_levels(levels);
  all.grid_ = std::move(grid);
  return all;
}

bool RadianceField::bake(uint64_t pixels, ThreadPool& pool, const Cancel* cancel) {
  using internal::MatterCells;
  if (!network_ || !internal::can_bake(*network_, info_)) return false;
  if (!baked_ && internal::baking_pays(*network_, pixels, internal::kBakedSide))
    baked_ =
        std::make_shared<MatterCells>(internal::bake_occupancy(*network_, info_, pool, cancel));
  return baked_ != nullptr;
}

void RadianceField::query(std::span<const Vec3d> points, std::span<const Vec3d> directions,
                          std::span<Real> density, std::span<Real> rgb, ThreadPool& pool,
                          Real time) const {
  NERF_CHECK_EQ(directions.size(), points.size());
  NERF_CHECK_EQ(density.size(), points.size());
  NERF_CHECK_EQ(rgb.size(), 3 * points.size());
  internal::check_time(time, "RadianceField::query");
  std::vector<std::unique_ptr<FieldQuery>> queries(static_cast<size_t>(pool.size()));
  constexpr size_t kBlock = kChunkSamples;
  const size_t n = points.size();
  pool.parallel_for_thread(static_cast<int64_t>((n + kBlock - 1) / kBlock), [&](int64_t block,
                                                                                int thread) {
    auto& query = queries[static_cast<size_t>(thread)];
    if (!query) query = field().query(nullptr);
    const size_t begin = static_cast<size_t>(block) * kBlock, count = std::min(kBlock, n - begin);
    Vec3d at[kBlock], along[kBlock];
    for (size_t i = 0; i < count; ++i) {
      at[i] = info_.to_engine.apply(points[begin + i]);
      along[i] = info_.to_engine.rotation * normalized(directions[begin + i]);
    }
    const auto out = density.subspan(begin, count);
    query->ask({std::span(at, count), std::span(along, count), time},
               {out, rgb.subspan(3 * begin, 3 * count), {}});
    for (size_t i = 0; i < count; ++i)
      out[i] = field().may_hold(at[i])
                   ? static_cast<Real>(static_cast<double>(out[i]) * info_.to_engine.scale)
                   : 0.0_r;
  });
}

}  // namespace nerf
