// Numbers that are learnt for each photo: the light that it was taken in, as far as it differs from
// the others'. A field keeps them with its weights and in its model file, so that pictures can be
// made in the light of any photo.
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

namespace nerf {

// An affine change of colour: rgb' = (I + A) rgb + b, as A by rows, then b.
inline constexpr int kColourChange = 12;

struct CodeShape {
  int appearance = 0;               // numbers that a photo's colours depend on; 0: none
  bool colours = false;             // whether each photo has a change of colour
  std::vector<std::string> photos;  // as ModelView::name, in the order of Ray::photo
  int transient = 0;  // numbers of what a photo alone shows, which training reads; 0: none

  bool any() const { return !photos.empty() && (appearance > 0 || colours || transient > 0); }
};

// Tables in a field's weights, a row for each photo.
struct CodeBooks {
  std::vector<std::string> photos;
  LinearWeights appearance;  // [photos x numbers]; of size 0: none
  LinearWeights colours;     // [photos x kColourChange]; likewise
  LinearWeights transient;   // [photos x numbers]; likewise

  CodeBooks() = default;
  // Behind the weights before `begin`.
  CodeBooks(const CodeShape& shape, size_t begin);
  CodeShape shape() const;
  size_t size() const { return appearance.size() + colours.size() + transient.size(); }
  bool empty() const { return size() == 0; }
  int rows() const { return static_cast<int>(photos.size()); }
};

// The light of a picture: that of a photo, or a blend.
struct Appearance {
  std::vector<Real> code;  // as many numbers as CodeShape::appearance; empty: the field's default
  std::vector<Real> colours;  // kColourChange numbers; empty: no change

  // Its change of a pixel's colour (sRGB, over the background), of what stands before the
  // background. Not clipped.
  std::array<Real, 3> changed(const Real rgb[3], Real opacity, const Vec3& background) const;
};

// Of a row of the books in `weights`; of those where a part is missing it is empty.
Appearance appearance_of(const CodeBooks& books, std::span<const Real> weights, int photo);
// The mean over all photos; no change of colour.
Appearance mean_appearance(const CodeBooks& books, std::span<const Real> weights);
// share = 0 gives a, 1 gives b. An empty part of one counts as zeros.
Appearance blend(const Appearance& a, const Appearance& b, Real share);

// Gives n columns of an input the same numbers.
void fill_rows(std::span<const Real> numbers, int n, Value input, Chunk& chunk);

}  // namespace nerf
