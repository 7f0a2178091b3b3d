// What was found of the light in a capture's photos, for a person to read.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "nerf/model/radiance_field.h"
#include "nerf/train/shown_light.h"

namespace nerf {

struct LightReport {
  // Stops of linear light, each against the median of its kind; positive is brighter.
  struct PhotoLight {
    std::string name;
    std::optional<double> shown;   // at sparse points, see ShownLight
    std::optional<double> learnt;  // by the photo's colour correction, of a mid-grey
    std::optional<double> exif;    // View::exposure
  };
  struct LensLight {
    std::string name;
    int photos = 0;
    double corner_stops = 0;           // how much darker a corner is than the middle
    std::optional<double> error = {};  // standard error of what sparse points show; none: learnt
  };
  std::vector<PhotoLight> photos;  // for training
  std::vector<LensLight> lenses;
  std::optional<double> exif_factor;  // see ShownLight
  double exif_explained = 0;

  bool empty() const { return photos.empty() && lenses.empty(); }
};

// Of a model and the capture that it was trained on. Empty where neither it nor sparse points say
// anything.
LightReport light_report(const RadianceField& model, const Scene& scene, const PhotoSet& photos);

// "corners 0.4 stops darker than the middle".
std::string corner_text(double stops);

}  // namespace nerf
