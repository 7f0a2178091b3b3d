// Which pixels cast rays, of pictures that are known: each pixel's ray sees what a function says.
#include "model/pixel_lattice.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <vector>

#include "model/homogeneous_field.h"
#include "support/cameras.h"

namespace nerf {
namespace {

using internal::LatticeOptions;
using internal::PixelLattice;

struct Seen {
  Real grey, depth;
};
using Picture = std::function<Seen(int x, int y)>;

struct Drawn {
  Frame frame;
  int rays = 0;
};

// Draws as the renderer does, tile by tile within a pass.
Drawn draw(const Picture& picture, int width, int height, const LatticeOptions& options = {},
           int side = 32) {
  const size_t pixels = static_cast<size_t>(width) * static_cast<size_t>(height);
  Drawn out{{width, height, std::vector<Real>(3 * pixels, -1.0_r), std::vector<Real>(pixels, 1.0_r),
             std::vector<Real>(pixels, -1.0_r)}};
  PixelLattice lattice(options, width, height);
  std::vector<int> cast(pixels);
  for (int pass = 0; pass < lattice.passes(); ++pass)
    for (int y0 = 0; y0 < height; y0 += side)
      for (int x0 = 0; x0 < width; x0 += side) {
        const int x1 = std::min(x0 + side, width), y1 = std::min(y0 + side, height);
        const int rays = lattice.choose(pass, x0, y0, x1, y1, out.frame);
        int marked = 0;
        for (int y = y0; y < y1; ++y)
          for (int x = x0; x < x1; ++x) {
            const size_t p = static_cast<size_t>(y * width + x);
            if (!lattice.wanted()[p]) continue;
            const Seen seen = picture(x, y);
            for (size_t k = 0; k < 3; ++k) out.frame.rgb[3 * p + k] = seen.grey;
            out.frame.depth_z[p] = seen.depth;
            ++cast[p];
            ++marked;
          }
        EXPECT_EQ(rays, marked);
        out.rays += marked;
        lattice.learn(pass, x0, y0, x1, y1, out.frame);
      }
  for (size_t p = 0; p < pixels; ++p) {
    EXPECT_LE(cast[p], 1);
    EXPECT_GE(out.frame.rgb[3 * p], 0) << "pixel " << p << " was never drawn";
  }
  return out;
}

double most_error(const Drawn& drawn, const Picture& picture) {
  double most = 0;
  for (int y = 0; y < drawn.frame.height; ++y)
    for (int x = 0; x < drawn.frame.width; ++x)
      most =
          std::max(most, std::abs(static_cast<double>(
                             drawn.frame.rgb[static_cast<size_t>(3 * (y * drawn.frame.width + x))] -
                             picture(x, y).grey)));
  return most;
}

// Of sizes that are no multiples of anything, and of pictures smaller than the lattice.
TEST(PixelLattice, OneColourNeedsItsCoarsestPixelsAlone) {
  const Picture flat = [](int, int) { return Seen{0.5_r, 2}; };
  for (const auto& [w, h] : std::vector<std::array<int, 2>>{{1, 1}, {2, 1}, {3, 5}, {37, 50}}) {
    const Drawn drawn = draw(flat, w, h);
    EXPECT_EQ(most_error(drawn, flat), 0);
    if (w > 8) {
      const int squares = ((w + 1) / 4) * ((h + 1) / 4);  // whose middles are in the picture
      EXPECT_EQ(drawn.rays, ((w + 3) / 4) * ((h + 3) / 4) + squares);
    }
  }
}

// Where nothing is seen every pixel has its ray, but for a sky; what stands before it is met.
TEST(PixelLattice, ASkyIsAsOneDepth) {
  LatticeOptions sky;
  sky.sky = true;
  const Picture empty = [](int, int) { return Seen{0.5_r, 0}; };
  const Picture wall = [](int, int) { return Seen{0.5_r, 2}; };
  EXPECT_EQ(draw(empty, 37, 50).rays, 37 * 50);
  EXPECT_EQ(draw(empty, 37, 50, sky).rays, draw(wall, 37, 50).rays);
  const Picture pole = [](int x, int) {
    return x == 17 || x == 18 ? Seen{0.1_r, 2} : Seen{0.5_r, 0};
  };
  const Drawn drawn = draw(pole, 37, 50, sky);
  EXPECT_EQ(most_error(drawn, pole), 0);
  EXPECT_LT(drawn.rays, 37 * 50 / 2);
}

// What the neighbours of a pixel enclose is that pixel's, where the picture is linear, away from
// its border.
TEST(PixelLattice, SlowSlopesAreFoundFromFewRays) {
  const Picture slope = [](int x, int y) {
    return Seen{0.1_r + 0.002_r * static_cast<Real>(x) + 0.001_r * static_cast<Real>(y), 3};
  };
  const Drawn drawn = draw(slope, 65, 65);  // its border is the lattice's
  EXPECT_LT(drawn.rays, 65 * 65 / 7);
  EXPECT_LT(most_error(drawn, slope), 0.0041);  // of the border, where one side stands for both
}

// Of the pixels [from, to) along both axes.
double most_error_within(const Drawn& drawn, const Picture& picture, int from, int to) {
  double most = 0;
  for (int y = from; y < to; ++y)
    for (int x = from; x < to; ++x) {
      const size_t p = static_cast<size_t>(y * drawn.frame.width + x);
      most = std::max(most,
                      std::abs(static_cast<double>(drawn.frame.rgb[3 * p] - picture(x, y).grey)));
    }
  return most;
}

// Shading that bends, as that of something round does, is met by the cubic, but for its very
// bottom, which is not below the nearest pixels there. Their mean would be 4e-4 off where they are
// closest.
TEST(PixelLattice, BentShadingIsForetold) {
  const Picture bowl = [](int x, int y) {
    const Real u = static_cast<Real>(x - 32), v = static_cast<Real>(y - 32);
    return Seen{0.3_r + 2e-4_r * (u * u + v * v), 3};
  };
  const Drawn drawn = draw(bowl, 65, 65);
  EXPECT_LT(drawn.rays, 65 * 65 / 2);
  // Away from the border, where the outer neighbours are not in line.
  EXPECT_LT(most_error_within(drawn, bowl, 8, 57), 1e-4);
}

// The outer neighbours have no say where they are at another depth: a bright thing behind a dark
// one leaves no rim on it.
TEST(PixelLattice, OtherDepthsDoNotReachIn) {
  const Picture step = [](int x, int) {
    return x < 30 ? Seen{0.3_r + 0.002_r * static_cast<Real>(x), 2} : Seen{0.9_r, 9};
  };
  const Drawn drawn = draw(step, 64, 64);
  EXPECT_LT(most_error_within(drawn, step, 8, 56), 1e-4);  // a slope's step is 2e-3
  EXPECT_LT(drawn.rays, 64 * 64 / 2);
}

// The tolerance is of the error, whatever the pattern's size.
TEST(PixelLattice, ErrorsFollowTheTolerance) {
  const Picture waves = [](int x, int y) {
    return Seen{0.5_r + 0.15_r * std::sin(0.35_r * static_cast<Real>(x)) *
                            std::cos(0.3_r * static_cast<Real>(y)),
                2};
  };
  int rays = 96 * 96 + 1;
  for (const Real tolerance : {1.0_r / 255, 4.0_r / 255, 16.0_r / 255}) {
    LatticeOptions options;
    options.tolerance = tolerance;
    const Drawn drawn = draw(waves, 96, 96, options);
    EXPECT_LT(most_error(drawn, waves), 2 * static_cast<double>(tolerance));
    EXPECT_LT(drawn.rays, rays);
    rays = drawn.rays;
  }
}

// A line two pixels wide is complete wherever it stands, and so is the edge of a large thing.
TEST(PixelLattice, LinesAndEdgesAreComplete) {
  for (int offset = 0; offset < 8; ++offset) {
    const Picture vertical = [=](int x, int) {
      return Seen{x == 20 + offset || x == 21 + offset ? 0.9_r : 0.4_r, 2};
    };
    const Picture horizontal = [=](int x, int y) { return vertical(y, x); };
    const Picture edge = [=](int x, int y) {
      return Seen{3 * x + y < 90 + offset ? 0.2_r : 0.7_r, 2};
    };
    for (const Picture& picture : {vertical, horizontal, edge}) {
      const Drawn drawn = draw(picture, 64, 64);
      EXPECT_LT(most_error(drawn, picture), 1e-6) << offset;
      EXPECT_LT(drawn.rays, 64 * 64 / 2);
    }
  }
}

// Things of one colour at two depths keep them.
TEST(PixelLattice, DepthsAreNotMixed) {
  const Picture step = [](int x, int y) { return Seen{0.5_r, x + y < 61 ? 2.0_r : 3.0_r}; };
  const Drawn drawn = draw(step, 64, 64);
  for (int y = 0; y < 64; ++y)
    for (int x = 0; x < 64; ++x)
      EXPECT_EQ(drawn.frame.depth_z[static_cast<size_t>(y * 64 + x)], step(x, y).depth);
  EXPECT_LT(drawn.rays, 64 * 64 / 2);
}

// Where nothing is seen, anything thin may stand in between.
TEST(PixelLattice, EmptySpaceIsNotInterpolated) {
  const Picture nothing = [](int, int) { return Seen{1, 0}; };
  EXPECT_EQ(draw(nothing, 30, 20).rays, 30 * 20);
}

TEST(PixelLattice, TilesChangeNothing) {
  const Picture waves = [](int x, int y) {
    const Real fx = static_cast<Real>(x), fy = static_cast<Real>(y);
    return Seen{0.5_r + 0.1_r * std::sin(0.002_r * fx * fx) * std::cos(0.2_r * fy),
                2 + 0.01_r * fx};
  };
  for (const int spacing : {2, 4, 8}) {
    LatticeOptions options;
    options.spacing = spacing;
    const Drawn a = draw(waves, 90, 70, options, 32), b = draw(waves, 90, 70, options, 90);
    EXPECT_EQ(a.frame.rgb, b.frame.rgb);
    EXPECT_EQ(a.frame.depth_z, b.frame.depth_z);
    EXPECT_EQ(a.rays, b.rays);
    EXPECT_LT(a.rays, 90 * 70);
    EXPECT_LT(most_error(a, waves), 3 * 8.0 / 255);
  }
}

// A picture of a whole field: rays are saved, and no pixel is further off than its neighbours may
// differ. The same bits from any number of threads.
TEST(PixelLattice, PicturesOfFieldsNeedFewerRays) {
  const RadianceField field = test::homogeneous_field(Similarity());
  const Camera camera = test::pinhole(60, 60, 70);
  Pose pose;
  pose.translation = {0.1, -0.2, -3};
  ThreadPool one(1), two(2);
  for (const int n : {1, 3}) {
    RenderOptions part, whole;
    part.background = whole.background = {0.2, 0.9, 0.4};
    part.supersample = whole.supersample = n;
    whole.interpolated = 0;
    const Frame a = render(field, camera, pose, part, two);
    const Frame b = render(field, camera, pose, whole, two);
    const Frame again = render(field, camera, pose, part, one);
    EXPECT_EQ(a.rgb, again.rgb);
    EXPECT_EQ(a.alpha, again.alpha);
    EXPECT_EQ(a.depth_z, again.depth_z);
    EXPECT_EQ(a.statistics.rays, again.statistics.rays);
    EXPECT_EQ(b.statistics.rays, 60 * 60 * n * n);
    EXPECT_LT(a.statistics.rays, b.statistics.rays * 3 / 4);
    Real most = 0;
    for (size_t i = 0; i < a.rgb.size(); ++i) most = std::max(most, std::abs(a.rgb[i] - b.rgb[i]));
    EXPECT_LT(most, 3 * part.interpolated);
    EXPECT_GT(most, 0);
  }
}

}  // namespace
}  // namespace nerf
