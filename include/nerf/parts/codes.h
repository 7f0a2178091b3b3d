// Numbers that are learnt for each photo: the light that it was taken in, as far as it differs from
// the others', and where things stood at its moment. A field keeps them with its weights and in its
// model file, so that pictures can be made in the light of any photo and of any moment.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "nerf/autodiff/linear_weights.h"
#include "nerf/autodiff/tape.h"
#include "nerf/base/real.h"
#include "nerf/math/vec.h"
#include "nerf/math/vignetting.h"

namespace nerf {

// An affine change of colour: rgb' = (I + A) rgb + b, as A by rows, then b.
inline constexpr int kColourChange = 12;

struct CodeShape {
  int appearance = 0;               // numbers that a photo's colours depend on; 0: none
  bool colours = false;             // whether each photo has a change of colour
  std::vector<std::string> photos;  // as ModelView::name, in the order of Ray::photo
  int transient = 0;  // numbers of what a photo alone shows, which training reads; 0: none
  // Of scenes that move: numbers of each moment that its warp depends on, and coordinates that it
  // has beside those of space. Photos of one moment share them.
  int deformation = 0, plane = 0;
  std::vector<double> moments = {};     // their times, [0, 1], ascending
  std::vector<int> photo_moments = {};  // of each photo; empty: light does not follow time
  // Numbers of each camera that colours depend on beside the photo's.
  int camera = 0;
  std::vector<int> cameras = {};        // as the capture numbers them
  std::vector<int> photo_cameras = {};  // of each photo, an index into these
  // Lenses whose falloff is learnt, and of each photo an index into these. Training alone reads
  // them: pictures are without.
  std::vector<std::string> lenses = {};
  std::vector<int> photo_lenses = {};

  bool any() const {
    return !lenses.empty() || (!photos.empty() && (appearance > 0 || colours || transient > 0)) ||
           (!moments.empty() && (deformation > 0 || plane > 0)) || (!cameras.empty() && camera > 0);
  }
};

// Tables in a field's weights, a row for each photo, moment or camera. Of size 0: none.
struct CodeBooks {
  std::vector<std::string> photos;
  std::vector<double> moments;
  std::vector<int> photo_moments, cameras, photo_cameras, photo_lenses;
  std::vector<std::string> lenses;
  LinearWeights appearance;          // [photos x numbers]
  LinearWeights colours;             // [photos x kColourChange]
  LinearWeights transient;           // [photos x numbers]
  LinearWeights deformation, plane;  // [moments x numbers]
  LinearWeights camera;              // [cameras x numbers]
  LinearWeights falloff;             // [lenses x kFalloff]

  CodeBooks() = default;
  // Behind the weights before `begin`.
  CodeBooks(const CodeShape& shape, size_t begin);
  CodeShape shape() const;
  size_t size() const;
  bool empty() const { return size() == 0; }
  int rows() const { return static_cast<int>(photos.size()); }
  // Of Appearance::code: the photo's numbers, then its camera's.
  int light() const {
    return (appearance.out > 0 ? appearance.in : 0) + (camera.out > 0 ? camera.in : 0);
  }
  // Whether photos' light differs in a way that time does not say.
  bool has_own_light() const {
    return photo_moments.empty() && appearance.size() + colours.size() + transient.size() > 0;
  }
};

// Numbers of a table of moments at a time: a moment's own, or a blend of those before and behind
// it; the first's before it, the last's behind it.
std::vector<Real> numbers_at(const LinearWeights& table, std::span<const double> moments,
                             std::span<const Real> weights, double time);

// The light of a picture: that of a photo, or a blend.
struct Appearance {
  std::vector<Real> code;     // CodeBooks::light() numbers; empty: the field's default
  std::vector<Real> colours;  // kColourChange numbers; empty: no change

  // Its change of a pixel's colour (sRGB, over the background), of what stands before the
  // background. Not clipped.
  std::array<Real, 3> changed(const Real rgb[3], Real opacity, const Vec3& background) const;
};

// The change of colour that so many stops more of linear light make (kColourChange numbers). Of
// sRGB values above 0.04 it is one: where L = ((c + 0.055) / 1.055)^2.4, a gain g of L is
// c' = m c + 0.055 (m - 1) with m = g^(1 / 2.4).
std::array<Real, kColourChange> change_of_exposure(double stops);
// How many stops more of linear light a mid-grey (0.5) has by a change.
double exposure_of_change(std::span<const Real> change);

// Of a row of the books in `weights`; of those where a part is missing it is empty.
Appearance appearance_of(const CodeBooks& books, std::span<const Real> weights, int photo);
// The mean over all photos; no change of colour.
Appearance mean_appearance(const CodeBooks& books, std::span<const Real> weights);
// Of a time, where light follows it: of the moment's photos, blended as numbers_at() does; the
// numbers of one of CodeBooks::cameras, or with -1 their mean.
Appearance appearance_at(const CodeBooks& books, std::span<const Real> weights, double time,
                         int camera);
// share = 0 gives a, 1 gives b. An empty part of one counts as zeros.
Appearance blend(const Appearance& a, const Appearance& b, Real share);

// Of a lens of the books, by name; none where they do not know it.
Falloff falloff_of(const CodeBooks& books, std::span<const Real> weights, const std::string& lens);

// Gives n columns of an input the same numbers.
void fill_rows(std::span<const Real> numbers, int n, Value input, Chunk& chunk);

}  // namespace nerf
