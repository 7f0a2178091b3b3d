// What everything above a field knows of it: it answers at points. A field is a composition: a
// space (identity, contraction, normalised device coordinates), an encoding (a table, frequencies),
// and a head (networks for density and colour). grid_field.h and network_field.h are the two that
// there are.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "nerf/autodiff/linear_weights.h"
#include "nerf/base/real.h"
#include "nerf/math/vec.h"
#include "nerf/parts/codes.h"

namespace nerf {

// Points to ask a field at. Engine coordinates.
struct FieldPoints {
  std::span<const Vec3d> positions = {};
  std::span<const Vec3d> directions = {};  // unit; as many where colours are wanted, else none
  Real time = 0;                           // [0, 1]; a static field is the same at any
  int photo = -1;                          // in whose light; below 0: the field's default
  // Above 0, motion is interpolated between the corners of a lattice so wide (engine units) where
  // the points are close enough together for these to be fewer; gradients are exact all the same.
  Real motion_spacing = 0;
};

// What is wanted of n points; an empty span is not computed.
struct FieldAnswers {
  std::span<Real> density = {};   // [n], 1 / engine unit
  std::span<Real> rgb = {};       // [n][3], sRGB in [0, 1]
  std::span<Real> gradient = {};  // [n][3], of density by position
};

// One thread's way to ask a field: the only one, for pictures of points, training's occupancy and
// programs alike. The field and the packs must outlive it.
class FieldQuery {
 public:
  virtual ~FieldQuery() = default;
  virtual void ask(const FieldPoints& points, const FieldAnswers& answers) = 0;
};

struct Field {
  virtual ~Field() = default;
  // `packs` of layers() make it faster; null: none.
  virtual std::unique_ptr<FieldQuery> query(const LayerPacks* packs) const = 0;
  // Whether there may be matter at a position, as pictures know: what they show is ask()'s density
  // there, and nothing elsewhere.
  virtual bool may_hold(const Vec3d& position) const = 0;
  virtual std::vector<LinearWeights> layers() const = 0;
  // Whether what it answers depends on the time that it is asked of.
  virtual bool moves() const { return false; }

  // What is learnt of each photo, and its tables' weights.
  virtual const CodeBooks& codes() const = 0;
  virtual std::span<const Real> all_weights() const = 0;
  // Of what is asked for without a photo: Appearance::code, where the field has one. camera: as the
  // capture numbers it; below 0: none.
  virtual std::vector<Real> default_code(Real time, int camera = -1) const = 0;
};

}  // namespace nerf
