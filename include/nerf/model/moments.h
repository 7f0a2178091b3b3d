// What a ray's time, photo and camera say to a network field's tape.
#pragma once

#include <vector>

#include "nerf/base/real.h"
#include "nerf/model/network_field.h"

namespace nerf {

class Moments {
 public:
  // The field must outlive this.
  explicit Moments(const NetworkField& field) : field_(field) {}
  // Before the first ray behind a change of the field's weights.
  void begin() { known_ = -1; }

  // The inputs of column `ray` that say where its points stand. row: of the books; below 0, or
  // where the tape is not one of training: as of its time.
  void place(const NetworkTape& tape, Chunk& chunk, int ray, Real time, int row);
  // The light of its time, of no photo.
  const std::vector<Real>& light(Real time);

 private:
  void find(Real time);

  const NetworkField& field_;
  Real known_ = -1;  // the time that these are of
  std::vector<Real> code_, plane_, light_;
};

}  // namespace nerf
