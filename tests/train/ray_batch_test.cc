#include "train/ray_batch.h"

#include <gtest/gtest.h>

#include <vector>

namespace nerf {
namespace {

// Which chunk, point and sample a number stands for.
Real label(int array, int chunk, int point, int sample) {
  return static_cast<Real>(((array * 4 + chunk) * 8 + point) * kChunkSamples + sample);
}

TEST(RayBatch, KeepsEveryPointOfTheSamplesThatLearn) {
  const std::vector<int32_t> kept{0, 3, 15, 16, 17, 100, 238, 239};
  constexpr int kChunks = 3, kChanged = 1;
  for (const int points : {1, 6}) {
    RayBatch batch(kChunks, points);
    AlignedArray<Real>* arrays[] = {&batch.x, &batch.y, &batch.z, &batch.spread};
    const auto at = [&](int a, int c, int j, int s) -> Real& {
      return (*arrays[a])[static_cast<size_t>((c * points + j) * kChunkSamples + s)];
    };
    const auto each = [&](const auto& body) {
      for (int a = 0; a < 4; ++a)
        for (int c = 0; c < kChunks; ++c)
          for (int j = 0; j < points; ++j) body(a, c, j);
    };
    each([&](int a, int c, int j) {
      for (int s = 0; s < kChunkSamples; ++s) at(a, c, j, s) = label(a, c, j, s);
    });
    batch.keep_points(kChanged, kept.data(), static_cast<int64_t>(kept.size()));
    each([&](int a, int c, int j) {
      const int count = c == kChanged ? static_cast<int>(kept.size()) : kChunkSamples;
      for (int s = 0; s < count; ++s)
        ASSERT_EQ(at(a, c, j, s), label(a, c, j, c == kChanged ? kept[static_cast<size_t>(s)] : s))
            << "array " << a << " chunk " << c << " point " << j << " sample " << s;
    });
  }
}

}  // namespace
}  // namespace nerf
