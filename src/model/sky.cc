#include "model/sky.h"

namespace nerf::internal {

namespace {

constexpr int kRays = kChunkRays;

}  // namespace

SkyLight::SkyLight(const GridField& field, const LayerPacks& packs)
    : tape_(kRays, kRays), directions_(tape_.input(3, Domain::kRays)) {
  if (const int numbers = field.books.appearance.in; field.books.appearance.out > 0) {
    code_rows_ = tape_.input(numbers, Domain::kRays);
    code_ = field.default_code(0);
  }
  sky_ = record_sky(tape_, field, directions_, code_rows_);
  tape_.plan();
  chunk_ = std::make_unique<Chunk>(tape_);
  chunk_->weights = field.weights.data();
  chunk_->packs = &packs;
}

void SkyLight::set_code(const std::vector<Real>& code) {
  if (!code.empty()) code_ = code;
}

void SkyLight::add(const Vec3& direction, const Vec3& share, Real* rgb) {
  Real* const to = chunk_->data(directions_) + waiting_.size();
  for (int k = 0; k < 3; ++k) to[k * chunk_->stride(directions_)] = direction[k];
  waiting_.push_back({rgb, share});
  if (waiting_.size() == static_cast<size_t>(kRays)) finish();
}

void SkyLight::finish() {
  if (waiting_.empty()) return;
  Chunk& c = *chunk_;
  c.rays = static_cast<int>(waiting_.size());
  if (code_rows_ >= 0) fill_rows(code_, c.rays, code_rows_, c);
  tape_.forward(c);
  const Real* const sky = c.data(sky_);
  for (size_t i = 0; i < waiting_.size(); ++i)
    for (int k = 0; k < 3; ++k)
      waiting_[i].rgb[k] +=
          waiting_[i].share[k] * sky[k * c.stride(sky_) + static_cast<int64_t>(i)];
  waiting_.clear();
}

}  // namespace nerf::internal
