#include "io/cameras/global_descriptor.h"

#include <algorithm>
#include <cmath>

#include "nerf/kernels/descriptors.h"

namespace nerf::internal {

namespace {

constexpr int kRounds = 8;
constexpr float kLength = 512;  // of a descriptor

std::vector<NearestTwo> nearest_words(std::span<const uint8_t> descriptors,
                                      const std::vector<uint8_t>& words) {
  std::vector<NearestTwo> nearest(descriptors.size() / kDescriptorBytes);
  std::vector<NearestTwo> unused(words.size() / kDescriptorBytes);
  nearest_descriptors(static_cast<int64_t>(nearest.size()), descriptors.data(),
                      static_cast<int64_t>(unused.size()), words.data(), nearest.data(),
                      unused.data());
  return nearest;
}

void normalise(std::span<float> v, float length) {
  double squares = 0;
  for (const float x : v) squares += static_cast<double>(x) * static_cast<double>(x);
  if (squares == 0) return;
  const float scale = length / static_cast<float>(std::sqrt(squares));
  for (float& x : v) x *= scale;
}

// Sums of the descriptors of each word.
std::vector<float> word_sums(std::span<const uint8_t> descriptors,
                             const std::vector<NearestTwo>& nearest, size_t words,
                             std::vector<int>& counts) {
  std::vector<float> sums(words * kDescriptorBytes);
  counts.assign(words, 0);
  for (size_t i = 0; i < nearest.size(); ++i) {
    if (nearest[i].index < 0) continue;
    const auto word = static_cast<size_t>(nearest[i].index);
    ++counts[word];
    for (size_t k = 0; k < kDescriptorBytes; ++k)
      sums[word * kDescriptorBytes + k] += descriptors[i * kDescriptorBytes + k];
  }
  return sums;
}

}  // namespace

GlobalDescriptor::GlobalDescriptor(std::span<const uint8_t> sample)
    : words_(static_cast<size_t>(kWords) * kDescriptorBytes) {
  const size_t count = sample.size() / kDescriptorBytes;
  for (size_t w = 0; count > 0 && w < kWords; ++w) {
    const auto from = sample.subspan(w * count / kWords * kDescriptorBytes, kDescriptorBytes);
    std::ranges::copy(from, words_.begin() + static_cast<std::ptrdiff_t>(w * kDescriptorBytes));
  }
  for (int round = 0; round < kRounds; ++round) {
    std::vector<int> counts;
    std::vector<float> sums = word_sums(sample, nearest_words(sample, words_), kWords, counts);
    for (size_t w = 0; w < kWords; ++w) {
      if (counts[w] == 0) continue;  // stays what it was
      const auto word = std::span(sums).subspan(w * kDescriptorBytes, kDescriptorBytes);
      normalise(word, kLength);
      for (size_t k = 0; k < kDescriptorBytes; ++k)
        words_[w * kDescriptorBytes + k] =
            static_cast<uint8_t>(std::min(255.0f, std::round(word[k])));
    }
  }
}

std::vector<float> GlobalDescriptor::of(std::span<const uint8_t> descriptors) const {
  if (descriptors.empty()) return {};
  std::vector<int> counts;
  std::vector<float> v = word_sums(descriptors, nearest_words(descriptors, words_), kWords, counts);
  for (size_t w = 0; w < kWords; ++w) {
    const auto part = std::span(v).subspan(w * kDescriptorBytes, kDescriptorBytes);
    for (size_t k = 0; k < kDescriptorBytes; ++k) {
      const float x = part[k] - static_cast<float>(counts[w]) * words_[w * kDescriptorBytes + k];
      part[k] = std::copysign(std::sqrt(std::abs(x)), x);
    }
    normalise(part, 1);
  }
  normalise(v, 1);
  return v;
}

}  // namespace nerf::internal
