// What photos show of the light that each was taken in, by the sparse points that several of them
// have: the same matter, brighter in one than in another.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "nerf/io/photos.h"
#include "nerf/io/scene.h"

namespace nerf {

struct ShownLight {
  struct Lens {
    std::string name;
    int photos = 0;  // for training
    // How much darker a corner is than the middle, stops of linear light, by a falloff that grows
    // with r^2 alone, and its standard error. No value where there are too few photos, or they see
    // too few points.
    std::optional<double> corner_stops = {};
    double error = 0;
  };
  // Of each of Scene::views: stops of linear light against the median of them; none of photos that
  // are held out or that show too few points.
  std::vector<std::optional<double>> exposure = {};
  std::vector<Lens> lenses = {};
  // How View::exposure explains these: stops shown for each that EXIF says more, and the share of
  // their variance that it explains. No value where too few photos have both, or EXIF's are alike.
  std::optional<double> exif_factor = {};
  double exif_explained = 0;

  // The factor where EXIF explains what photos show: at least half of the variance, with a factor
  // that a camera's rendering may have; else no value. Cameras render sRGB by curves of their own,
  // and photos of different days have exposures that took the difference of the light out again.
  std::optional<double> trusted_factor() const;
};

// Alternating weighted means over points, photos and lenses (Goldman 2010, section 4, with weights
// that leave outliers out), in one thread, well below a second for a million observations.
ShownLight shown_light(const Scene& scene, const PhotoSet& photos);

}  // namespace nerf
