// Density, colour and slope of fields at points (model/field.h).
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "math/worst_error.h"
#include "model/small_grid.h"
#include "nerf/model/grid_field.h"
#include "nerf/model/network_field.h"

namespace nerf {
namespace {

using test::small_options;

struct Named {
  std::string name;
  std::unique_ptr<Field> field;
};

// Tables of features of any size, so that densities differ from place to place.
std::unique_ptr<Field> some_grid(bool unbounded, int table_bits, const MotionShape& motion = {}) {
  GridOptions options = small_options(1, 1);
  options.levels = 2;
  options.finest_resolution = 16;
  options.table_bits = table_bits;
  auto field = std::make_unique<GridField>(options, unbounded, 1, GridParts{.motion = motion});
  field->initialise(3);
  Random random(7, 0, 0);
  for (Real& v : field->table) v = 2 * random.uniform() - 1;
  // Half floats of 1/16 to 1, of either sign.
  for (uint16_t& v : field->half_table)
    v = static_cast<uint16_t>(0x2c00 + random.below(0x1000) + (random.below(2) << 15));
  return field;
}

// Moves by a tenth or so.
MotionShape some_motion(WarpKind kind) {
  MotionShape motion;
  motion.warp.kind = kind;
  motion.warp.position_degrees = motion.warp.depth = 2;
  motion.warp.width = 16;
  motion.warp.last_bound = 0.1_r;
  motion.ambient = 1;
  motion.time_code = 4;
  motion.time_degrees = 2;
  motion.time_width = 16;
  motion.point_degrees = 1;
  return motion;
}

std::unique_ptr<Field> some_network(Space space, Encoding encoding) {
  NetworkOptions options;
  options.space = space;
  options.encoding = encoding;
  options.depth = options.proposal_depth = 3;
  options.width = options.proposal_width = options.bottleneck = options.view_width = 16;
  options.position_degrees = 2;
  options.direction_degrees = 1;
  options.density = DensityActivation::kSoftplus;
  auto field = std::make_unique<NetworkField>(options, 0.1, 4);
  field->initialise(5);
  field->ndc.scale_x = 1.1;
  field->ndc.scale_y = 0.9;
  field->ndc.near = 0.5;
  field->ndc.reference.translation = {0.1, -0.2, -3};
  return field;
}

std::vector<Named> fields() {
  std::vector<Named> all;
  for (const bool unbounded : {false, true})
    for (const int bits : {16, 32})
      all.push_back({std::string(unbounded ? "unbounded" : "bounded") + std::to_string(bits),
                     some_grid(unbounded, bits)});
  for (const WarpKind kind : {WarpKind::kTranslation, WarpKind::kSe3})
    for (const bool unbounded : {false, true})
      all.push_back({std::string(unbounded ? "unbounded" : "bounded") + " that moves",
                     some_grid(unbounded, 32, some_motion(kind))});
  all.push_back({"points", some_network(Space::kIdentity, Encoding::kFrequency)});
  all.push_back({"contracted", some_network(Space::kContract, Encoding::kFrequency)});
  all.push_back({"off-axis", some_network(Space::kContract, Encoding::kOffAxis)});
  all.push_back({"ndc", some_network(Space::kNdc, Encoding::kFrequency)});
  return all;
}

std::vector<Vec3d> some_points(size_t n, double reach, uint64_t seed) {
  std::vector<Vec3d> points(n);
  for (size_t i = 0; i < n; ++i) {
    Random random(seed, 0, i);
    for (int k = 0; k < 3; ++k)
      points[i][k] = reach * (2 * static_cast<double>(random.uniform()) - 1);
  }
  return points;
}

// More than a block of either kind, and no multiple of anything.
constexpr size_t kPoints = 531;

TEST(FieldQuery, ManyPointsAreAnsweredAsOne) {
  for (const Named& f : fields()) {
    SCOPED_TRACE(f.name);
    const auto at = some_points(kPoints, 0.9, 11);
    std::vector<Vec3d> along = some_points(kPoints, 1, 12);
    for (Vec3d& d : along) d = normalized(d);
    std::vector<Real> density(kPoints), rgb(3 * kPoints), alone(kPoints), slope(3 * kPoints);
    const auto query = f.field->query(nullptr);
    query->ask({at, along}, {density, rgb, {}});
    query->ask({at, along}, {alone, {}, slope});
    EXPECT_EQ(alone, density);
    EXPECT_GT(*std::ranges::max_element(density), 1.2_r * *std::ranges::min_element(density));
    for (const size_t i : {size_t{0}, kPoints / 2, kPoints - 1}) {
      std::vector<Real> one(1), colour(3), gradient(3);
      query->ask({std::span(at).subspan(i, 1), std::span(along).subspan(i, 1)},
                 {one, colour, gradient});
      EXPECT_EQ(one[0], density[i]);
      for (size_t k = 0; k < 3; ++k) {
        EXPECT_EQ(colour[k], rgb[3 * i + k]);
        EXPECT_EQ(gradient[k], slope[3 * i + k]);
        EXPECT_TRUE(colour[k] >= 0 && colour[k] <= 1);
      }
    }
  }
}

// Between corners of a lattice the error of what is smooth falls with the square of its width, to a
// quarter at half the width; where a ReLU bends in between, to a half.
TEST(FieldQuery, InterpolatedMotionComesNearTheFieldsOwn) {
  for (const WarpKind kind : {WarpKind::kTranslation, WarpKind::kSe3})
    for (const bool unbounded : {false, true}) {
      SCOPED_TRACE(unbounded);
      const auto field = some_grid(unbounded, 32, some_motion(kind));
      auto at = some_points(kPoints, 0.05, 31);
      for (Vec3d& p : at) p = p + Vec3d{0.31, -0.2, 0.13};
      const auto query = field->query(nullptr);
      const auto ask = [&](Real spacing) {
        std::vector<Real> density(kPoints);
        query->ask({at, {}, 0.4_r, -1, spacing}, {density, {}, {}});
        return density;
      };
      const std::vector<Real> truth = ask(0);
      const auto error = [&](Real spacing) {
        const std::vector<Real> density = ask(spacing);
        double sum = 0;
        for (size_t i = 0; i < kPoints; ++i)
          sum += std::fabs(static_cast<double>(density[i] - truth[i]));
        return sum / static_cast<double>(kPoints);
      };
      double scale = 0;
      for (const Real d : truth) scale += static_cast<double>(d) / static_cast<double>(kPoints);
      const double wide = error(0.1_r), half = error(0.05_r);
      EXPECT_GT(wide, 0);
      EXPECT_LT(wide, 0.01 * scale);
      EXPECT_LT(half, 0.45 * wide);
      // Too far apart for a lattice; and slopes are the field's own.
      EXPECT_EQ(ask(0.002_r), truth);
      std::vector<Real> slope(3 * kPoints), same(3 * kPoints);
      query->ask({at, {}, 0.4_r, -1, 0}, {{}, {}, slope});
      query->ask({at, {}, 0.4_r, -1, 0.1_r}, {{}, {}, same});
      EXPECT_EQ(slope, same);
    }
}

// Beside the differences of densities on either side. Where these differ from each other by more
// than rounding there is an edge of a cell or of a ReLU in between, and no slope.
TEST(FieldQuery, SlopesAreThoseOfTheDensity) {
  for (const Named& f : fields()) {
    SCOPED_TRACE(f.name);
    const bool far = f.name.starts_with("unbounded") || f.name == "contracted";
    const auto at = some_points(kPoints, far ? 2.5 : 0.95, 21);
    const std::vector<Vec3d> along(kPoints, Vec3d{0, 0, 1});
    std::vector<Real> density(kPoints), gradient(3 * kPoints);
    const auto query = f.field->query(nullptr);
    query->ask({at, along}, {density, {}, gradient});
    const double h = std::cbrt(kRoundoff) / 8;
    double largest = 0;
    for (const Real g : gradient) largest = std::max(largest, std::fabs(static_cast<double>(g)));
    size_t compared = 0;
    for (int k = 0; k < 3; ++k) {
      std::vector<Vec3d> left = at, right = at;
      std::vector<Real> below(kPoints), above(kPoints);
      for (size_t i = 0; i < kPoints; ++i) {
        left[i][k] -= h;
        right[i][k] += h;
      }
      query->ask({left, along}, {below, {}, {}});
      query->ask({right, along}, {above, {}, {}});
      for (size_t i = 0; i < kPoints; ++i) {
        const double before = static_cast<double>(density[i] - below[i]) / h;
        const double behind = static_cast<double>(above[i] - density[i]) / h;
        // Of a density a network's rounding, some 100 of its operations', and the steps' curvature.
        const double bound = 200 * kRoundoff * static_cast<double>(density[i]) / h + 0.02 * largest;
        if (std::fabs(before - behind) > bound) continue;
        ++compared;
        ASSERT_NEAR(gradient[3 * i + static_cast<size_t>(k)], 0.5 * (before + behind), bound)
            << "point " << i << " axis " << k;
      }
    }
    EXPECT_GT(compared, 3 * kPoints * 3 / 4);
    EXPECT_GT(largest, 0.05);
  }
}

// A warp that moves everything alike: the density of a place is that of the still field elsewhere.
TEST(FieldQuery, ATranslationLeadsToThePlaceOfAStillField) {
  GridOptions options = small_options(1, 1);
  MotionShape motion = some_motion(WarpKind::kTranslation);
  motion.ambient = 0;
  GridField moving(options, false, 1, GridParts{.motion = motion}), still(options, false, 1);
  moving.initialise(3);
  still.initialise(3);
  Random random(7, 0, 0);
  for (size_t i = 0; i < still.table.size(); ++i)
    moving.table[i] = still.table[i] = 2 * random.uniform() - 1;
  // The same density but for its further inputs, which count nothing.
  const LinearWeights &to = moving.density_layers[0], &from = still.density_layers[0];
  for (int j = 0; j < to.out; ++j)
    for (int k = 0; k < to.in; ++k)
      moving.weights[to.offset + static_cast<size_t>(j * weight_stride(to.in) + k)] =
          k < from.in
              ? still.weights[from.offset + static_cast<size_t>(j * weight_stride(from.in) + k)]
              : 0.0_r;
  const auto copy = [&](const LinearWeights& a, const LinearWeights& b) {
    std::copy_n(still.weights.data() + b.offset, b.size(), moving.weights.data() + a.offset);
  };
  copy(moving.density_layers[1], still.density_layers[1]);
  const LinearWeights& last = moving.motion.warp.last;
  std::fill_n(moving.weights.data() + last.offset, last.size(), 0.0_r);
  const Vec3d shift{0.125, -0.25, 0.0625};
  for (int k = 0; k < 3; ++k)
    moving.weights[last.bias_offset() + static_cast<size_t>(k)] = static_cast<Real>(shift[k]);

  const auto at = some_points(kPoints, 0.7, 31);
  std::vector<Vec3d> moved = at;
  for (Vec3d& p : moved) p = p + shift;
  std::vector<Real> seen(kPoints), expected(kPoints);
  moving.query(nullptr)->ask({at, {}, 0.3_r}, {seen, {}, {}});
  still.query(nullptr)->ask({moved, {}}, {expected, {}, {}});
  // A place is rounded twice more, to the density's slope times so much.
  for (size_t i = 0; i < kPoints; ++i)
    EXPECT_NEAR(seen[i], expected[i], 2e3 * kRoundoff * static_cast<double>(expected[i])) << i;
}

TEST(FieldQuery, AMovingFieldDependsOnTime) {
  const auto field = some_grid(true, 16, some_motion(WarpKind::kSe3));
  EXPECT_TRUE(field->moves());
  EXPECT_FALSE(some_grid(true, 16)->moves());
  EXPECT_FALSE(some_network(Space::kIdentity, Encoding::kFrequency)->moves());
  NetworkOptions moving;
  moving.deform.warp = WarpKind::kTranslation;
  moving.deform.code = 0;  // by time itself
  EXPECT_TRUE(NetworkField(moving, 0.1, 4).moves());
  const auto at = some_points(8, 0.9, 11);
  std::vector<Real> early(8), late(8);
  const auto query = field->query(nullptr);
  query->ask({at, {}, 0.0_r}, {early, {}, {}});
  query->ask({at, {}, 1.0_r}, {late, {}, {}});
  for (size_t i = 0; i < 8; ++i) EXPECT_NE(early[i], late[i]);
}

TEST(FieldQuery, KnowsWhereMatterMayBe) {
  GridField field(small_options(1, 1), false, 1);
  field.clip = {{-0.5, -0.5, -0.5}, {0.5, 0.5, 0.5}};
  EXPECT_FALSE(field.may_hold({0.6, 0, 0}));
  EXPECT_EQ(field.may_hold({0.1, 0, 0}), field.occupancy.occupied({0.1_r, 0, 0}));
  EXPECT_TRUE(some_network(Space::kContract, Encoding::kFrequency)->may_hold({50, 0, 0}));
}

}  // namespace
}  // namespace nerf
