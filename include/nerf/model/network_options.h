// What makes a paper method's model: choices from the parts that all of them share.
#pragma once

#include <array>

#include "nerf/base/options.h"
#include "nerf/base/real.h"
#include "nerf/model/deform_options.h"
#include "nerf/parts/interval_sampler.h"

namespace nerf {

enum class Cast { kPoint, kCone };
enum class Space {
  kIdentity,
  kContract,  // mip-NeRF 360: unbounded scenes
  kNdc,       // normalised device coordinates: forward-facing captures
};
enum class Encoding {
  kFrequency,   // NeRF: the position itself and sines and cosines of it
  kIntegrated,  // mip-NeRF: expected sines and cosines, along the axes
  kOffAxis,     // mip-NeRF 360: the same along 21 directions
};
enum class DensityActivation { kRelu, kSoftplus };
enum class Initialisation { kGlorot, kHe };

inline auto option_names(Cast) {
  return std::array{OptionName{Cast::kPoint, "point"}, OptionName{Cast::kCone, "cone"}};
}
inline auto option_names(Space) {
  return std::array{OptionName{Space::kIdentity, "identity"},
                    OptionName{Space::kContract, "contract"}, OptionName{Space::kNdc, "ndc"}};
}
inline auto option_names(Encoding) {
  return std::array{OptionName{Encoding::kFrequency, "frequency"},
                    OptionName{Encoding::kIntegrated, "integrated"},
                    OptionName{Encoding::kOffAxis, "off-axis"}};
}
inline auto option_names(DensityActivation) {
  return std::array{OptionName{DensityActivation::kRelu, "relu"},
                    OptionName{DensityActivation::kSoftplus, "softplus"}};
}
inline auto option_names(Initialisation) {
  return std::array{OptionName{Initialisation::kGlorot, "glorot"},
                    OptionName{Initialisation::kHe, "he"}};
}

struct NetworkOptions {
  Cast cast = Cast::kPoint;
  Space space = Space::kIdentity;
  Encoding encoding = Encoding::kFrequency;
  int position_degrees = 10;  // frequencies 2^0 .. 2^(n-1)
  int direction_degrees = 4;
  bool view_dependence = true;
  IntervalOptions sampling;
  bool shared = false;  // one network for all levels, else one for the last and one for the others
  int depth = 8, width = 256;
  int skip = 4;          // the input is given again behind every skip-th layer
  int bottleneck = 256;  // features handed from density to colour
  int view_width = 128;
  int image_code = 0;   // numbers learnt for each photo, which its colours depend on
  int camera_code = 0;  // the same of each camera, where a capture numbers several
  // Numbers learnt for each photo of what it alone shows; 0: nothing is transient. Layers of the
  // last level between them and its density, colour and uncertainty (Martin-Brualla et al. 2021).
  int transient_code = 0, transient_depth = 4, transient_width = 128;
  Real code_spread = 0;  // standard deviation of the first codes; 0: 1 / sqrt(numbers)
  int proposal_depth = 8, proposal_width = 256;  // of the levels before the last
  bool proposal_colour = true;                   // those levels render pixels too
  DeformOptions deform;
  DensityActivation density = DensityActivation::kRelu;
  Real density_bias = 0;
  Real colour_padding = 0;      // colours reach this far beyond [0, 1]
  bool opaque_end = false;      // the last interval lets nothing through
  Real last_interval = 1e10_r;  // length behind the last of positions, which have no intervals
  Initialisation initialisation = Initialisation::kGlorot;

  template <class V>
  void visit_options(V& v) {
    v("cast", cast, "what a pixel casts: a line, or a cone as wide as the pixel");
    v("space", space, "warp of space before the encoding");
    v("encoding", encoding, "of positions");
    v("position_degrees", position_degrees, "frequencies of the position; 0: the position alone",
      at_least(0), at_most(24));
    v("direction_degrees", direction_degrees, "frequencies of the view direction", at_least(0),
      at_most(24));
    v("view_dependence", view_dependence, "whether colour depends on the view direction");
    v("sampling", sampling, "samples on a ray");
    v("shared", shared, "one network for all levels");
    v("depth", depth, "hidden layers", at_least(1), at_most(32));
    v("width", width, "of the hidden layers", at_least(16), at_most(kMostWidth));
    v("skip", skip,
      "the input is given again behind every N-th hidden layer, counted from 0, except the first "
      "and the last; 0: never",
      at_least(0), at_most(32));
    v("bottleneck", bottleneck, "features handed from density to colour", at_least(1),
      at_most(kMostWidth));
    v("view_width", view_width, "width of the layer that sees the view direction", at_least(1),
      at_most(kMostWidth));
    v("image_code", image_code,
      "numbers learnt for each photo that its colours may depend on (exposure, weather); 0 in "
      "other "
      "views",
      at_least(0), at_most(256));
    v("camera_code", camera_code,
      "numbers learnt for each camera of a capture that numbers several, in place of the photos'",
      at_least(0), at_most(256));
    v("transient_code", transient_code,
      "numbers learnt for each photo of what it alone shows (people, cars), which pictures leave "
      "out; 0: nothing is transient",
      at_least(0), at_most(256));
    v("transient_depth", transient_depth, "hidden layers between those and what they show",
      at_least(1), at_most(32));
    v("transient_width", transient_width, "of those layers", at_least(1), at_most(kMostWidth));
    v("code_spread", code_spread,
      "standard deviation of the photos' first numbers; 0: one over the root of how many they are",
      at_least(0), at_most(100));
    v("proposal_depth", proposal_depth, "hidden layers of the levels before the last", at_least(1),
      at_most(32));
    v("proposal_width", proposal_width, "width of the levels before the last", at_least(16),
      at_most(kMostWidth));
    v("proposal_colour", proposal_colour,
      "whether the levels before the last learn colours of their own, or only where matter is");
    v("deform", deform, "how a scene moves");
    v("density", density, "activation of the density");
    v("density_bias", density_bias, "added before the density's activation", at_least(-100),
      at_most(100));
    v("colour_padding", colour_padding, "how far colours reach beyond [0, 1] before clipping",
      at_least(0), at_most(1));
    v("opaque_end", opaque_end, "the last interval of a ray lets nothing through");
    v("last_interval", last_interval,
      "length behind the last sample of coarse+fine resampling, engine units; 0 where masked "
      "pixels are drawn as transparent ones",
      at_least(0), at_most(1e10));
    v("initialisation", initialisation, "distribution of the first weights");
  }
  // Throws Error for combinations that cannot be.
  void check_options() const;
  static constexpr int kMostWidth = 2048;

  // Numbers that colours depend on beside the view.
  int light() const { return image_code + camera_code; }
  bool integrated() const { return encoding != Encoding::kFrequency; }
};
extern template CollectedOptions collect_options(NetworkOptions&);

}  // namespace nerf
