// How depth is shown in pictures and films.
#pragma once

#include <array>

#include "nerf/base/options.h"
#include "nerf/io/depth_image.h"
#include "nerf/io/image.h"
#include "nerf/math/vec.h"
#include "nerf/model/renderer.h"

namespace nerf::apps {

// What a film's frames show.
enum class FilmKind { kColour, kDepth, kSide, kWipe };
inline auto option_names(FilmKind) {
  return std::array{OptionName{FilmKind::kColour, "colour"}, OptionName{FilmKind::kDepth, "depth"},
                    OptionName{FilmKind::kSide, "side"}, OptionName{FilmKind::kWipe, "wipe"}};
}

struct LookOptions {
  DepthLook depth_map = DepthLook::kTurbo;
  bool depth_legend = false;
  FilmKind film = FilmKind::kColour;

  template <class V>
  void visit_options(V& v) {
    v("depth_map", depth_map,
      "what the pictures of depth are: turbo (near red, far blue), viridis (near yellow, far "
      "violet), disparity (near white, far black), between what 2 % and 98 % of the pixels of a "
      "few "
      "views have, the same for all; or normal: the way surfaces face the camera",
      brief("pictures of depth: turbo, viridis, disparity or normal"));
    v("depth_legend", depth_legend,
      "depths beside their colours, input unit, in pictures of depth");
    v("film", film,
      "what --mp4 shows: colour, depth, side (colour beside depth), or wipe (colour left of a line "
      "and depth right of it, which goes to and fro once)",
      brief("of --mp4: colour, depth, side by side, or wipe"));
  }
};

// A frame's picture of depth, without its legend. Of normals its layers must have them.
Image8 depth_picture(const LookOptions& look, const Frame& frame, const Pose& camera_to_world,
                     const DepthRange& range);

// A film's frame from pictures of one size, at `position` of the film, [0, 1].
Image8 film_picture(FilmKind film, const Image8& colour, const Image8& depth, double position);

// What the two ends of a map's colours are called, near and far.
std::array<const char*, 2> ends_of(DepthLook map);

}  // namespace nerf::apps
