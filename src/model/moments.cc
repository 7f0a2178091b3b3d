#include "nerf/model/moments.h"

#include <span>

namespace nerf {

namespace {

void put(std::span<const Real> numbers, Value to, Chunk& chunk, int ray) {
  for (size_t k = 0; k < numbers.size(); ++k)
    chunk.data(to)[static_cast<int64_t>(k) * chunk.stride(to) + ray] = numbers[k];
}

std::span<const Real> row_of(const LinearWeights& table, std::span<const Real> weights, int row) {
  return weights.subspan(
      table.offset + static_cast<size_t>(row) * static_cast<size_t>(weight_stride(table.in)),
      static_cast<size_t>(table.in));
}

}  // namespace

void Moments::find(Real time) {
  if (time == known_) return;
  known_ = time;
  const CodeBooks& books = field_.books;
  const auto of = [&](const LinearWeights& table) {
    if (table.out == 0) return std::vector<Real>(static_cast<size_t>(table.in), 0.0_r);
    return numbers_at(table, books.moments, field_.weights.span(), static_cast<double>(time));
  };
  code_ = of(books.deformation);
  plane_ = of(books.plane);
  light_ = field_.default_code(time);
}

const std::vector<Real>& Moments::light(Real time) {
  find(time);
  return light_;
}

void Moments::place(const NetworkTape& tape, Chunk& c, int ray, Real time, int row) {
  const DeformInputs& in = tape.deform;
  if (in.time >= 0) c.data(in.time)[ray] = time;
  if (in.moment >= 0) c.data(in.moment)[ray] = static_cast<Real>(row);
  for (int k = 0; in.moving >= 0 && k < 3; ++k)
    c.data(in.moving)[k * c.stride(in.moving) + ray] = time == 0 ? 0.0_r : 1.0_r;
  if (in.code < 0 && in.plane < 0) return;
  const std::span<const Real> weights = field_.weights.span();
  if (row < 0) find(time);
  if (in.code >= 0)
    put(row < 0 ? std::span<const Real>(code_) : row_of(field_.books.deformation, weights, row),
        in.code, c, ray);
  if (in.plane >= 0)
    put(row < 0 ? std::span<const Real>(plane_) : row_of(field_.books.plane, weights, row),
        in.plane, c, ray);
}

}  // namespace nerf
