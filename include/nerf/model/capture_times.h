// When the photos of a capture were taken.
#pragma once

#include <string>

namespace nerf {

// Where a capture numbers what its photos share (Nerfies' metadata.json); -1: it does not.
struct ViewIds {
  int moment = -1;  // photos of one moment show the same shapes (warp_id)
  int appearance = -1;
  int camera = -1;
  bool operator==(const ViewIds&) const = default;
};

// View::time and Ray::time run from 0 to 1; what a person reads and writes is in the capture's
// unit.
struct CaptureTimes {
  // Times of 0 and 1 in the capture's unit: its first moment and its last. Where its files say
  // times from 0 to 1 already these are theirs.
  double first = 0, last = 1;
  bool seconds = false;  // the unit is seconds: of a video
  std::string source;    // what said the times: "time in transforms.json"; empty: nothing

  double to_unit(double time) const { return first + time * (last - first); }
  double from_unit(double time) const { return last > first ? (time - first) / (last - first) : 0; }
};

}  // namespace nerf
