// How a paper method's scene moves: what leads points of a moment to the canonical scene.
#pragma once

#include <array>

#include "nerf/base/options.h"
#include "nerf/base/real.h"
#include "nerf/parts/warp.h"

namespace nerf {

// Coordinates beside the three of space, in which a moment's shape is a slice of one that does not
// change (Park et al. 2021b, section 4).
enum class Slice {
  kNone,
  kPlane,  // the same at every point of a moment
  kSheet,  // found from the point and the moment's numbers by a network
};
inline auto option_names(Slice) {
  return std::array{OptionName{Slice::kNone, "none"}, OptionName{Slice::kPlane, "plane"},
                    OptionName{Slice::kSheet, "sheet"}};
}

struct DeformOptions {
  WarpKind warp = WarpKind::kNone;
  int degrees = 8;  // frequencies of the position that the warp is found from
  int depth = 6, width = 128, skip = 5;
  int code = 8, time_degrees = 10;
  bool still_start = false;
  Slice slice = Slice::kNone;
  int ambient = 2, ambient_degrees = 1;
  int sheet_degrees = 6, sheet_depth = 6, sheet_width = 64;

  bool any() const { return warp != WarpKind::kNone || slice != Slice::kNone; }
  // Whether something is learnt of each moment.
  bool has_moments() const { return any() && (code > 0 || slice == Slice::kPlane); }
  bool has_sheet() const { return slice == Slice::kSheet; }

  template <class V>
  void visit_options(V& v) {
    v("warp", warp,
      "what leads a moment's points to one canonical scene: none, a translation of each, or se3, a "
      "rotation as well");
    v("degrees", degrees, "frequencies of the position that the warp is found from", at_least(0),
      at_most(24));
    v("depth", depth, "hidden layers of the warp", at_least(1), at_most(32));
    v("width", width, "of those layers", at_least(8), at_most(1024));
    v("skip", skip, "the hidden layer that the input is given again to, from 2 on; 0: none",
      at_least(0), at_most(32));
    v("code", code, "numbers learnt for each moment; 0: what moves is found from time itself",
      at_least(0), at_most(256));
    v("time_degrees", time_degrees, "frequencies of time, where no numbers of moments are learnt",
      at_least(0), at_most(24));
    v("still_start", still_start, "the canonical scene is that of time 0, exactly");
    v("slice", slice,
      "coordinates beside those of space: none, plane (the same everywhere at a moment) or sheet "
      "(found from the point too)");
    v("ambient", ambient, "how many of those coordinates", at_least(1), at_most(16));
    v("ambient_degrees", ambient_degrees, "frequencies of those coordinates", at_least(1),
      at_most(24));
    v("sheet_degrees", sheet_degrees, "frequencies of the position that a sheet is found from",
      at_least(1), at_most(24));
    v("sheet_depth", sheet_depth, "hidden layers of a sheet", at_least(1), at_most(32));
    v("sheet_width", sheet_width, "of those layers", at_least(8), at_most(1024));
  }
};

}  // namespace nerf
