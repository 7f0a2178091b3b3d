#include <algorithm>

#include "nerf/model/layers.h"

namespace nerf {

void PictureLayers::resize(size_t n, const Layers& layers) {
  *this = {};
  rgb.resize(3 * n);
  distance.resize(n);
  if (layers.moments) {
    mean.resize(n);
    variance.resize(n);
  }
  if (layers.percentiles) {
    near.resize(n);
    far.resize(n);
  }
  if (layers.samples) samples.resize(n);
  if (layers.normal) normal.resize(3 * n);
  if (layers.deep) deep.resize(n);
  if (layers.apart) {
    field.resize(4 * n);
    cover.resize(n);
    shadow.assign(3 * n, 1);
  }
}

void join_deep_samples(std::vector<DeepSample>& samples) {
  size_t to = 0;
  bool open = false;  // whether samples[to - 1] may take more
  for (const DeepSample& s : samples) {
    if (!open) {
      const Real from = to > 0 ? std::max(s.front, samples[to - 1].back) : s.front;
      samples[to] = s;
      samples[to].front = from;
      samples[to].back = std::max(s.back, from);
      ++to;
    } else {
      DeepSample& last = samples[to - 1];
      last.front = std::min(last.front, to > 1 ? std::max(s.front, samples[to - 2].back) : s.front);
      last.back = std::max(last.back, s.back);
      last.weight += s.weight;
      for (int k = 0; k < 3; ++k) last.rgb[k] += s.rgb[k];
    }
    open = samples[to - 1].weight < kDeepWeight;
  }
  samples.resize(to);
}

}  // namespace nerf
