// For tests: a small frame with all layers, as a renderer would give it.
#pragma once

#include <cmath>

#include "nerf/model/renderer.h"

namespace nerf::test {

// Some pixels are empty, some opaque; deep samples of several colours add up to the pixel's.
inline Frame layer_frame(int width, int height) {
  Frame f;
  f.width = width;
  f.height = height;
  const size_t n = static_cast<size_t>(width) * static_cast<size_t>(height);
  f.rgb.resize(3 * n);
  f.alpha.resize(n);
  f.depth_z.resize(n);
  f.layers.resize(n, {.moments = true,
                      .percentiles = true,
                      .samples = true,
                      .normal = true,
                      .deep = true,
                      .apart = true});
  for (size_t i = 0; i < n; ++i) {
    const size_t stretches = i % 5;
    double left = 1;
    for (size_t s = 0; s < stretches; ++s) {
      DeepSample d;
      d.front = static_cast<Real>(2 + 0.5 * static_cast<double>(s) + 0.01 * static_cast<double>(i));
      d.back = d.front + 0.25_r;
      const double alpha = i % 5 == 4 && s == 3 ? 1 : 0.2 + 0.1 * static_cast<double>((i + s) % 4);
      d.weight = static_cast<Real>(left * alpha);
      left *= 1 - alpha;
      for (size_t k = 0; k < 3; ++k) {
        d.rgb[k] = d.weight * static_cast<Real>((i * 7 + s * 5 + k * 3) % 11) / 10;
        f.layers.rgb[3 * i + k] += d.rgb[k];
      }
      f.layers.deep[i].push_back(d);
    }
    if (stretches == 0) continue;
    // An object that is coloured like the field takes a share of the light of two pixels in three.
    f.layers.cover[i] = 0.3_r * static_cast<Real>(i % 3);
    for (size_t k = 0; k < 3; ++k) {
      f.layers.field[4 * i + k] = f.layers.rgb[3 * i + k];
      if (i % 3 == 0) f.layers.shadow[3 * i + k] = 0.9_r;
    }
    f.layers.field[4 * i + 3] = static_cast<Real>(1 - left);
    f.alpha[i] = static_cast<Real>(1 - left);
    f.depth_z[i] = static_cast<Real>(2.5 + 0.01 * static_cast<double>(i));
    f.layers.distance[i] = 1.1_r * f.depth_z[i];
    f.layers.mean[i] = 1.2_r * f.depth_z[i];
    f.layers.near[i] = f.depth_z[i];
    f.layers.far[i] = 1.5_r * f.depth_z[i];
    f.layers.variance[i] = 0.25_r;
    f.layers.samples[i] = static_cast<Real>(10 + i);
    const double a = 0.1 * static_cast<double>(i);
    f.layers.normal[3 * i] = static_cast<Real>(std::cos(a));
    f.layers.normal[3 * i + 2] = static_cast<Real>(std::sin(a));
  }
  f.rgb = f.layers.rgb;
  return f;
}

}  // namespace nerf::test
