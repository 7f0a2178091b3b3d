// The `grid` method's field: multiresolution hash grid, two small MLPs, occupancy.
//
//   position -> [contract] -> hash grid (F L features) -> MLP -> h (16)
//   density = exp(h_0);   colour = sigmoid(MLP(h, spherical harmonics of the view direction, code))
//   sky = sigmoid(MLP(spherical harmonics of the direction, code)), behind all matter
// Where the scene moves, positions are first led to the canonical scene (grid_motion.h).
// (Mueller et al. 2022, section 5.4.) The code is the photo's, where light differs between photos
// (Martin-Brualla et al. 2021, section 4.1).
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "nerf/autodiff/operations.h"
#include "nerf/base/aligned.h"
#include "nerf/base/options.h"
#include "nerf/base/real.h"
#include "nerf/kernels/elementwise.h"
#include "nerf/kernels/hash_grid.h"
#include "nerf/math/contraction.h"
#include "nerf/model/field.h"
#include "nerf/model/grid_motion.h"
#include "nerf/model/medium.h"
#include "nerf/model/pixel_loss.h"
#include "nerf/parts/occupancy.h"
#include "nerf/parts/ray_sampler.h"

namespace nerf {

struct GridOptions {
  int levels = 10;
  int log2_entries = 19;
  int features = 4;
  int base_resolution = 16;
  int finest_resolution = 0;
  // Of an unbounded scene, and without a scene, where finest_resolution is 0.
  static constexpr int kFinestUnbounded = 2048;
  int hidden = 64;
  int density_layers = 1;
  int colour_layers = 2;
  int geometry_features = 16;
  int occupancy_side = 0;
  // Of a feature in the tables that are looked up: 16 (half floats, rounded from weights of 32) or,
  // for tests, 32. No option.
  int table_bits = 16;
  SamplerOptions sampler;

  template <class V>
  void visit_options(V& v) {
    v("levels", levels, "resolutions of the hash grid", at_least(1), at_most(16));
    v("log2_entries", log2_entries, "binary logarithm of the entries of each resolution's table",
      at_least(10), at_most(24));
    v("features", features, "features of an entry, 2 or 4", at_least(2), at_most(4));
    v("base_resolution", base_resolution, "coarsest resolution, cells across the region",
      at_least(2), at_most(512));
    v("finest_resolution", finest_resolution,
      "finest resolution, cells across the region; 0: cells a pixel wide where the scene has "
      "bounds, else 2048",
      at_least(0), at_most(1 << 20));
    v("hidden", hidden, "width of the networks", at_least(16), at_most(1024));
    v("density_layers", density_layers, "hidden layers of the density network", at_least(1),
      at_most(8));
    v("colour_layers", colour_layers, "hidden layers of the colour network", at_least(1),
      at_most(8));
    v("geometry_features", geometry_features, "features handed from density to colour", at_least(2),
      at_most(256));
    v("occupancy_side", occupancy_side,
      "cells across each cascade of the occupancy grid, a multiple of 16; 0: 256 where the scene "
      "has "
      "bounds, else 128",
      at_least(0), at_most(OccupancyGrid::kMostSide));
    v("max_samples", sampler.max_samples, "most network samples of a ray", at_least(2),
      at_most(240));
    v("min_samples", sampler.min_samples, "fewest network samples of a ray that meets matter",
      at_least(1), at_most(240));
    v("samples_per_cell", sampler.samples_per_cell,
      "network samples per effective cell that a ray's light comes from", above(0));
    v("uniform_share", sampler.uniform_share,
      "weight of samples spread over all matter on the ray, against 1 of those that follow the "
      "light which the cached density predicts: 1 spreads half of them",
      above(0), at_most(10));
    v("min_transmittance", sampler.min_transmittance,
      "a ray's march stops where the cached density lets less light through (0: never)",
      at_least(0), at_most(1));
    v.retired("table_bits", int64_t{16});
    v.retired("antialias", false);
    v.retired("cone_points", int64_t{1});
    v.retired("colour_per_ray", false);
  }
  // Throws Error for combinations that cannot be.
  void check_options() const;
};
extern template CollectedOptions collect_options(GridOptions&);

// Cells across each cascade of the occupancy grid: what the options say, or the default.
int occupancy_side(const GridOptions& options, bool unbounded);
// Of the table that the options ask for.
HashGridShape hash_grid_shape(const GridOptions& options);

// What only some captures need.
struct GridParts {
  CodeShape codes{};
  MotionShape motion{};
  LearntMedium medium = LearntMedium::kNone;
  bool sky = false;
};

// Everything that rendering needs. Plain data: the trainer writes it between steps.
struct GridField final : Field {
  GridField(const GridOptions& options, bool unbounded, int cascades, const GridParts& parts = {});
  // Estimates: of a field, and of the weights of its networks.
  static uint64_t memory_bytes(const GridOptions& options, bool unbounded, int cascades);
  static uint64_t network_weights(const GridOptions& options);

  GridOptions options;
  bool unbounded;
  HashGridShape shape;
  // Features of the hash grid, [shape.rows][shape.features_per_entry()]: half floats where
  // options.table_bits is 16, else numbers. The other is empty.
  AlignedArray<Real> table;
  AlignedArray<uint16_t> half_table;
  std::vector<LinearWeights> density_layers, colour_layers;
  MotionNetworks motion;         // empty: the scene stands still
  LinearWeights medium_numbers;  // see_through(); none: photos were not taken through a medium
  std::vector<LinearWeights> sky_layers;  // none: behind matter is Ray::background
  CodeBooks books;
  // Of both networks, those of motion, the medium, the sky, then the books.
  AlignedArray<Real> weights;
  size_t network_size() const { return weights.size() - books.size(); }
  std::vector<LinearWeights> layers() const override;
  std::unique_ptr<FieldQuery> query(const LayerPacks* packs) const override;
  bool may_hold(const Vec3d& position) const override;
  bool moves() const override { return !motion.empty(); }
  const CodeBooks& codes() const override { return books; }
  std::span<const Real> all_weights() const override { return weights.span(); }
  // The mean over the photos.
  std::vector<Real> default_code(Real, int = -1) const override {
    return mean_appearance(books, weights.span()).code;
  }
  bool has_sky() const { return !sky_layers.empty(); }
  LearntMedium learnt_medium() const;
  // In engine units; without one a field has nothing of it.
  Medium medium() const;
  OccupancyGrid occupancy;
  Box3 clip;  // engine coordinates; no matter outside

  // How rays are sampled. Where the scene moves the cached density is a mean over moments, by which
  // no ray may end.
  SamplerOptions sampler() const {
    SamplerOptions s = options.sampler;
    if (!motion.empty()) s.min_transmittance = 0;
    return s;
  }

  // Small random weights (tables U(-1e-4, 1e-4), networks Xavier-uniform), keyed by the seed.
  void initialise(uint64_t seed);

  // Half the width of what the hash grid covers, engine units, contracted where unbounded.
  Real extent() const { return unbounded ? 2 : 1; }
  // Position of p (engine coordinates) on the hash grid, [0, 1]^3: the box [-1, 1]^3, or contracted
  // space's [-2, 2]^3 where the scene is unbounded.
  Vec3 grid_position(const Vec3& p) const {
    constexpr Vec3 kMiddle{0.5_r, 0.5_r, 0.5_r};
    return unbounded ? contract(p) * 0.25_r + kMiddle : p * 0.5_r + kMiddle;
  }
};

// A chunk of samples of one network call.
inline constexpr int kChunkSamples = 240;
inline constexpr int kChunkRays = 240;
// Arrays of a whole batch keep the tape's rows, so that chunks are bound to them and copied whole.
static_assert(Tape::sample_stride(kChunkSamples) == kChunkSamples);
static_assert(Tape::ray_stride(kChunkRays) == kChunkRays);

// What a training tape ends in.
struct GridLosses {
  PixelLoss pixel = PixelLoss::huber(0.5_r);
  bool on_weights = false;  // the caller adds gradients to the weights along the rays
  bool on_density = false;  // likewise to the samples' densities
  // Light that samples of one colour have together at most; 0: each has its own. See group_light().
  Real shared_colour = 0;
  Real stop_transmittance = 0;        // what gets less light learns nothing (shared colours only)
  std::optional<Real> roulette = {};  // see roulette(); without: every sample goes back
  bool on_position = false;           // whether the caller asks for the gradient of `position`
};

// The sky that rays of these directions [3 x rays] end in: [3 x rays]. code: [numbers x rays], or
// below 0 where photos have none.
Value record_sky(Tape& tape, const GridField& field, Value directions, Value code);

// The field on a tape, with the values that a caller fills and reads.
struct GridTape {
  enum class Purpose {
    kTrain,     // with losses
    kPictures,  // density and colour
    kGradient,  // density, and its gradient by the features
  };

  Tape tape{kChunkSamples, kChunkRays};
  Value features = 0;    // in: [F L x samples]
  Value directions = 0;  // in: [3 x rays]
  Value delta = 0;       // in: [1 x samples]
  Value distance = -1;   // in, training with a medium: [1 x samples], engine units
  Value position = -1;   // in, with motion: [3 x samples], grid coordinates, not canonical
  Value time = -1;       // in, with motion: [1 x rays]
  Value background = 0;  // in: [3 x rays]; black where a medium is learnt or a ray ends in the sky
  Value photo = -1;      // in, training with codes: [1 x rays], Ray::photo
  Value code = -1;       // in, else, with an appearance code: [numbers x rays]
  Value cover = -1;      // in, training with a sky: [1 x rays], 1 where a ray ends in it, else 0
  // In, training where the books know lenses: [1 x rays], its row of them, and corner_square().
  Value lens = -1, corner = -1;
  PixelLossInputs pixel_loss;  // in, training only
  Value geometry = 0;          // between: [geometry_features x samples]
  Value density = 0;           // out: [1 x samples]
  Value colour = 0;            // out: [3 x samples], or [3 x groups] where training shares colours
  Composite image{};           // out
  Value matter = -1;           // out: [4 x rays], the pixel before the sky, or without one
  Value weight_gradient = -1;  // between, GridLosses::on_weights only: [1 x samples]
  Value gradient_roulette = -1;  // GridLosses::roulette only: has RouletteState

  Value density_gradient = -1;  // in, kGradient and GridLosses::on_density only: [1 x samples]

  GridTape(const GridField& field, Purpose purpose, const GridLosses& losses = {});
  GridTape(const GridField& field, bool training, const GridLosses& losses = {})
      : GridTape(field, training ? Purpose::kTrain : Purpose::kPictures, losses) {}
  // Of the values and gradients of a chunk in training: an estimate.
  static uint64_t memory_bytes(const GridOptions& options);

  // Only what density needs.
  void forward_density(Chunk& chunk) const { tape.forward(chunk, 0, density_operations_); }
  // Colour of samples whose `geometry` is there.
  void forward_colour(Chunk& chunk) const {
    tape.forward(chunk, density_operations_, field_operations_);
  }
  // Density and colour, not composited.
  void forward_field(Chunk& chunk) const { tape.forward(chunk, 0, field_operations_); }

 private:
  size_t density_operations_ = 0, field_operations_ = 0;
};

// Grid coordinates of n samples of a ray, at entry + t direction each (engine coordinates).
void place_samples(const GridField& field, const Vec3& entry, const Vec3& direction, const Real* t,
                   int64_t n, Real* x, Real* y, Real* z);

// Grid coordinates of a chunk's samples, read up to the next multiple of kLane.
struct GridPoints {
  const Real *x, *y, *z;
};

// Features [F x ld] of one level at n points.
void encode_level(const GridField& field, size_t level, const GridPoints& points, int64_t n,
                  Real* features, int64_t ld);
// All levels: features [F L x ld].
void encode(const GridField& field, const GridPoints& points, int64_t n, Real* features,
            int64_t ld);

}  // namespace nerf
