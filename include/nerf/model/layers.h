// What a picture or a ray may give besides colour, opacity and median depth.
#pragma once

#include <cstddef>
#include <vector>

#include "nerf/base/real.h"

namespace nerf {

// What is wanted; what is not costs nothing.
struct Layers {
  bool moments = false;      // mean distance of what stops the light, and its variance
  bool percentiles = false;  // distances at which 5 % and 95 % of the light are stopped
  bool samples = false;      // network samples asked for
  bool normal = false;       // against the gradient of density where half of the light is stopped
  bool deep = false;         // the light stopped on the way, stretch by stretch
  // Of pictures: the field without its inserted objects, what these hide and their shadow. Costs a
  // second picture.
  bool apart = false;
  bool operator==(const Layers&) const = default;
};

// A stretch of a ray that has one colour; those of a ray follow each other and do not overlap.
struct DeepSample {
  Real front = 0, back = 0;  // where it begins and ends
  Real weight = 0;           // share of all light that it stops
  Real rgb[3] = {0, 0, 0};   // sRGB, times the weight
};

// Successive samples of a paper method or of several rays become one DeepSample until they stop
// this share of all light.
inline constexpr Real kDeepWeight = 1.0_r / 16;

// Joins neighbours, ordered by where they end, until each but the last stops kDeepWeight.
void join_deep_samples(std::vector<DeepSample>& samples);

// Of a picture, row by row from the top; empty where not wanted. Lengths in input units, 0 where
// the pixel does not stop so much light.
struct PictureLayers {
  std::vector<Real> rgb;             // [n][3], sRGB times opacity, before any background
  std::vector<Real> distance;        // along the ray, where half of the light is stopped
  std::vector<Real> mean, variance;  // of the distances at which light is stopped
  std::vector<Real> near, far;       // 5 % and 95 %; of several rays to a pixel the outermost
  std::vector<Real> samples;         // of all of the pixel's rays
  std::vector<Real> normal;          // [n][3], unit, input coordinates; 0 where there is none
  std::vector<Real> field;           // [n][4], without objects: sRGB times opacity, and opacity
  std::vector<Real> cover;           // share of all light that surfaces of objects take
  std::vector<Real> shadow;          // [n][3], share of the field's linear light that objects leave
  // Front to back; `front` and `back` along the optical axis (of panoramas: along the ray).
  std::vector<std::vector<DeepSample>> deep;

  bool empty() const { return rgb.empty(); }
  // Zeros for n pixels; `rgb` and `distance` are always wanted.
  void resize(size_t n, const Layers& layers);
};

// The arrays above but `deep`, and how many numbers of each a pixel has.
struct LayerArray {
  std::vector<Real> PictureLayers::* values;
  size_t per_pixel;
};
inline constexpr LayerArray kLayerArrays[] = {
    {&PictureLayers::rgb, 3},      {&PictureLayers::distance, 1}, {&PictureLayers::mean, 1},
    {&PictureLayers::variance, 1}, {&PictureLayers::near, 1},     {&PictureLayers::far, 1},
    {&PictureLayers::samples, 1},  {&PictureLayers::normal, 3},   {&PictureLayers::field, 4},
    {&PictureLayers::cover, 1},    {&PictureLayers::shadow, 3}};

}  // namespace nerf
