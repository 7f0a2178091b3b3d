// Which pixels of a picture need a ray of their own.
//
// Pixels of a coarse square lattice come first, then the middles of its squares, then those of its
// edges, which is a lattice half as wide, and so on (the order of the diamond-square algorithm,
// Fournier, Fussell and Carpenter 1982). A pixel has four nearest neighbours among those before it,
// and four more in line with them three times as far away, which foretell its colour together. How
// far that will be off is guessed from how the neighbours differ and how far off their own colours
// were; where the guess is small and their depths agree, the pixel is what they foretell; else a
// ray is cast. With a lattice of 4 the first two passes meet every straight line two pixels wide.
#pragma once

#include <cstdint>
#include <vector>

#include "model/object_pixels.h"
#include "nerf/base/real.h"
#include "nerf/model/renderer.h"

namespace nerf::internal {

struct LatticeOptions {
  int spacing = 4;  // of the first pass, a power of two, at least 2
  // sRGB, [0, 1]: how far a colour may be off, by the guess, in the last two passes. Those before,
  // from which more follows, take 0.6 of it.
  Real tolerance = 4.0_r / 255;
  Real depth_ratio = 1.1_r;  // of the farthest to the nearest of the neighbours
  bool sure = true;          // the second pass casts all its rays too
  bool sky = false;          // what is without depth is a sky, as smooth as matter at one depth
};

class PixelLattice {
 public:
  // objects: pixels that see one, and those beside them, have rays of their own. They must outlive
  // this; null: none.
  PixelLattice(const LatticeOptions& options, int width, int height,
               const ObjectPixels* objects = nullptr);

  int passes() const { return static_cast<int>(passes_.size()); }
  // Of all pixels, about; for progress.
  double share(int pass) const { return passes_[static_cast<size_t>(pass)].share; }

  // Within columns [x0, x1) and rows [y0, y1) gives the pass's pixels that need no ray their means
  // in `frame` and marks the others in wanted(). Returns how many those are. Reads pixels of
  // earlier passes anywhere, so that all of these must be there.
  int choose(int pass, int x0, int y0, int x1, int y1, Frame& frame);
  // Takes in what their rays saw, and clears their marks.
  void learn(int pass, int x0, int y0, int x1, int y1, const Frame& frame);

  // Of each pixel of the picture, row by row: 1 where a ray is to be cast.
  const std::vector<uint8_t>& wanted() const { return wanted_; }

 private:
  struct Pass {
    int step = 1;  // between its pixels along a row; at first the lattice's spacing
    int half = 0;  // distance to the neighbours, along the axes or the diagonals; 0: none
    bool diagonal = false;
    Real tolerance = 0;  // of the guess, up to which a pixel needs no ray
    double share = 1;
  };
  // The four neighbours of a pixel, `reach` times as far away as its nearest, in opposite pairs:
  // the first and the last, and the other two. False where the picture has not as many.
  bool find_neighbours(const Pass& pass, int reach, int x, int y, size_t out[4]) const;
  // Gives pixel p at (x, y) what its neighbours foretell where they agree, else returns false.
  bool interpolate(const Pass& pass, int x, int y, size_t p, const size_t from[4],
                   Frame& frame) const;
  template <class Body>
  void each_pixel(const Pass& pass, int x0, int y0, int x1, int y1, const Body& body) const;

  LatticeOptions options_;
  int width_, height_;
  const ObjectPixels* objects_;
  std::vector<Pass> passes_;
  std::vector<uint8_t> wanted_;
  // Largest difference of a colour from its neighbours' mean; half of theirs where no ray was cast.
  std::vector<Real> surprise_;
};

}  // namespace nerf::internal
