#include "photo_rows.h"

#include <algorithm>
#include <vector>

#include "half.h"

namespace nerf {

void internal::unpremultiply(float* rgb, float alpha) {
  for (int c = 0; c < 3; ++c) rgb[c] = alpha > 0 ? rgb[c] / alpha : 0.0f;
}

void internal::store_row(Photo& photo, int y, std::span<const float> row) {
  const size_t at = static_cast<size_t>(y) * row.size();
  if (!photo.pixels8.empty()) {
    for (size_t i = 0; i < row.size(); ++i) {
      const float clamped = std::clamp(row[i], 0.0f, 1.0f);
      photo.pixels8[at + i] = static_cast<uint8_t>(clamped * 255.0f + 0.5f);
    }
  } else {
    for (size_t i = 0; i < row.size(); ++i) photo.pixels16[at + i] = float_to_half(row[i]);
  }
}

void internal::store_averaged_row(Photo& photo, int y, std::span<const float> row) {
  if (photo.channels != 4) return store_row(photo, y, row);
  std::vector<float> straight(row.begin(), row.end());
  for (size_t i = 0; i < straight.size(); i += 4) unpremultiply(&straight[i], straight[i + 3]);
  store_row(photo, y, straight);
}

}  // namespace nerf
