#include "nerf/model/grid_field.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "base/half.h"
#include "nerf/base/error.h"
#include "nerf/kernels/encoding.h"
#include "nerf/kernels/simd.h"
#include "nerf/math/contraction.h"
#include "nerf/math/medium_numbers.h"
#include "nerf/math/random.h"

namespace nerf {

template CollectedOptions collect_options(GridOptions&);

namespace {

// Of a learnt medium: softplus of it is 0.1 per engine unit.
constexpr Real kFirstCoefficient = -2.25_r;
// Hidden layers of the sky's network, and their width.
constexpr int kSkyLayers = 2, kSkyWidth = 32;

// Layers in -> hidden x n -> out, placed one after the other in the parameter array.
std::vector<LinearWeights> place_layers(int in, int hidden, int hidden_layers, int out,
                                        size_t& offset) {
  std::vector<LinearWeights> layers;
  for (int i = 0; i <= hidden_layers; ++i) {
    LinearWeights w{offset, i == 0 ? in : hidden, i == hidden_layers ? out : hidden};
    offset += w.size();
    layers.push_back(w);
  }
  return layers;
}

// Numbers of a network without padding, and of the values on the way through it: its input, before
// and after each activation, its output.
uint64_t weights_between(int in, int hidden, int hidden_layers, int out) {
  return static_cast<uint64_t>(in) * static_cast<uint64_t>(hidden) +
         static_cast<uint64_t>(hidden_layers - 1) * static_cast<uint64_t>(hidden) *
             static_cast<uint64_t>(hidden) +
         static_cast<uint64_t>(hidden) * static_cast<uint64_t>(out);
}
uint64_t values_between(int in, int hidden, int hidden_layers, int out) {
  return static_cast<uint64_t>(in + 2 * hidden_layers * hidden + out);
}

}  // namespace

// Finer cells place the samples of a thin surface better, but one in an unbounded scene has too
// many of them to learn each (docs/architecture.md).
int occupancy_side(const GridOptions& o, bool unbounded) {
  if (o.occupancy_side == 0) return unbounded ? 128 : 256;
  return o.occupancy_side;
}

HashGridShape hash_grid_shape(const GridOptions& o) {
  const int finest = o.finest_resolution != 0 ? o.finest_resolution : GridOptions::kFinestUnbounded;
  return hash_grid_shape(o.levels, o.log2_entries, o.base_resolution, finest, o.features);
}

void GridOptions::check_options() const {
  if (features != 2 && features != 4)
    throw Error(std::to_string(features) + " is neither 2 nor 4", "--grid-features",
                "give one of them");
  if (sampler.min_samples > sampler.max_samples)
    throw Error(std::to_string(sampler.min_samples) + " is more than --grid-max-samples " +
                    std::to_string(sampler.max_samples),
                "--grid-min-samples", "give at most as many");
  if (occupancy_side % 16 != 0)
    throw Error(std::to_string(occupancy_side) + " is no multiple of 16", "--grid-occupancy-side",
                "for example 128 or 256");
  if (finest_resolution != 0 && finest_resolution < base_resolution)
    throw Error(std::to_string(finest_resolution) + " is less than --grid-base-resolution " +
                    std::to_string(base_resolution),
                "--grid-finest-resolution", "give at least as many cells");
}

GridField::GridField(const GridOptions& o, bool is_unbounded, int cascades, const GridParts& parts)
    : options(o),
      unbounded(is_unbounded),
      shape(hash_grid_shape(o)),
      table(o.table_bits == 16 ? 0 : shape.size()),
      half_table(o.table_bits == 16 ? shape.size() : 0),
      occupancy(cascades, occupancy_side(o, is_unbounded)),
      clip{{-1e30, -1e30, -1e30}, {1e30, 1e30, 1e30}} {
  simd_target();  // chosen, or found missing, before any kernel runs
  size_t size = 0;
  motion = MotionNetworks(parts.motion, 0);  // placed below
  density_layers = place_layers(shape.features() + motion.rows(), o.hidden, o.density_layers,
                                o.geometry_features, size);
  const int code = parts.codes.any() ? parts.codes.appearance : 0;
  const int direction = parts.medium == LearntMedium::kNone ? kSphericalHarmonics : 0;
  colour_layers =
      place_layers(o.geometry_features + direction + code, o.hidden, o.colour_layers, 3, size);
  motion = MotionNetworks(parts.motion, size);
  size = motion.end;
  if (parts.medium != LearntMedium::kNone) {
    medium_numbers = {size, parts.medium == LearntMedium::kFog ? kFogNumbers : kWaterNumbers, 1};
    size += medium_numbers.size();
  }
  if (parts.sky)
    sky_layers = place_layers(kSphericalHarmonics + code, kSkyWidth, kSkyLayers, 3, size);
  books = CodeBooks(parts.codes, size);
  weights = AlignedArray<Real>(size + books.size());
  std::vector<LinearWeights*> all;
  for (auto* layers : {&density_layers, &colour_layers, &sky_layers})
    for (LinearWeights& w : *layers) all.push_back(&w);
  for (LinearWeights* w : motion.layers()) all.push_back(w);
  place_packs(all);
}

uint64_t GridField::network_weights(const GridOptions& o) {
  return weights_between(hash_grid_shape(o).features(), o.hidden, o.density_layers,
                         o.geometry_features) +
         weights_between(o.geometry_features + kSphericalHarmonics, o.hidden, o.colour_layers, 3);
}

uint64_t GridField::memory_bytes(const GridOptions& o, bool unbounded, int cascades) {
  return hash_grid_shape(o).size() * (o.table_bits == 16 ? sizeof(uint16_t) : sizeof(Real)) +
         network_weights(o) * sizeof(Real) +
         OccupancyGrid::memory_bytes(cascades, occupancy_side(o, unbounded));
}

std::vector<LinearWeights> GridField::layers() const {
  std::vector<LinearWeights> all = density_layers;
  all.insert(all.end(), colour_layers.begin(), colour_layers.end());
  MotionNetworks networks = motion;
  for (const LinearWeights* w : networks.layers()) all.push_back(*w);
  all.insert(all.end(), sky_layers.begin(), sky_layers.end());
  return all;
}

void GridField::initialise(uint64_t seed) {
  const size_t features = static_cast<size_t>(shape.features_per_entry());
  for (uint64_t r = 0; r < shape.rows; ++r) {
    Random random(seed, random_key(RandomStream::kFirstTable), r);
    for (size_t i = r * features; i < (r + 1) * features; ++i) {
      const Real feature = 1e-4_r * (2 * random.uniform() - 1);
      if (table.size() > 0)
        table[i] = feature;
      else
        half_table[i] = internal::float_to_half(static_cast<float>(feature));
    }
  }
  std::fill(weights.begin(), weights.end(), 0.0_r);
  uint64_t layer = 0;
  for (const auto* layers : {&density_layers, &colour_layers, &sky_layers})
    for (const LinearWeights& w : *layers)
      draw_weights(w, xavier_bound(w),
                   Random(seed, random_key(RandomStream::kFirstNetworks), layer++), weights.data());
  motion.initialise(seed, layer, weights.data());
  // A clear medium of mid-grey.
  const int coefficients = std::max(0, medium_numbers.in - 3);
  for (int i = 0; medium_numbers.out > 0 && i < coefficients; ++i)
    weights[medium_numbers.offset + static_cast<size_t>(i)] = kFirstCoefficient;
}

LearntMedium GridField::learnt_medium() const {
  if (medium_numbers.out == 0) return LearntMedium::kNone;
  return medium_numbers.in == kFogNumbers ? LearntMedium::kFog : LearntMedium::kWater;
}

Medium GridField::medium() const {
  Medium m;
  for (int k = 0; medium_numbers.out > 0 && k < 3; ++k) {
    const MediumChannel channel({medium_numbers.in}, k, [&](int i) {
      return static_cast<double>(weights[medium_numbers.offset + static_cast<size_t>(i)]);
    });
    m.attenuation[k] = channel.attenuation;
    m.backscatter[k] = channel.backscatter;
    m.colour[k] = static_cast<Real>(channel.colour);
  }
  return m;
}

uint64_t GridTape::memory_bytes(const GridOptions& o) {
  constexpr uint64_t kOthers = 32;  // density, pixels, directions
  const uint64_t values =
      values_between(hash_grid_shape(o).features(), o.hidden, o.density_layers,
                     o.geometry_features) +
      values_between(o.geometry_features + kSphericalHarmonics, o.hidden, o.colour_layers, 3) +
      kOthers;
  return 2 * kChunkSamples * sizeof(Real) * values;
}

GridTape::GridTape(const GridField& field, Purpose purpose, const GridLosses& losses) {
  const bool training = purpose == Purpose::kTrain, sloped = purpose == Purpose::kGradient;
  features = tape.input(field.shape.features(), Domain::kSamples, training || sloped);
  directions = tape.input(3, Domain::kRays);
  delta = tape.input(1, Domain::kSamples);
  background = tape.input(3, Domain::kRays);

  const LinearWeights &codes = field.books.appearance, &changes = field.books.colours;
  if (training && !field.books.empty()) photo = tape.input(1, Domain::kRays);
  if (training && field.books.falloff.out > 0) {
    lens = tape.input(1, Domain::kRays);
    corner = tape.input(1, Domain::kRays);
  }
  if (!training && codes.out > 0) code = tape.input(codes.in, Domain::kRays);

  Value seen_by_density = features;
  if (!field.motion.empty()) {
    position = tape.input(3, Domain::kSamples, sloped || losses.on_position);
    time = tape.input(1, Domain::kRays);
    const Value code = repeat_for_samples(tape, record_time_code(tape, field.motion, time));
    const Value contracted = scale_shift(tape, position, 2 * field.extent(), -field.extent());
    seen_by_density = concat(tape, features, record_moment(tape, field.motion, contracted, code));
  }
  geometry = mlp(tape, seen_by_density, field.density_layers);
  if (training && losses.roulette) gradient_roulette = roulette(tape, geometry, *losses.roulette);
  density = truncated_exp(tape, slice(tape, geometry, 0, 1));
  density_operations_ = tape.operations();
  if (sloped || losses.on_density) {
    density_gradient = tape.input(1, Domain::kSamples);
    add_gradient(tape, density, density_gradient);
  }
  if (sloped) {
    tape.plan();
    return;
  }
  Value of_rays = -1;  // the photo's numbers
  if (codes.out > 0) of_rays = training ? table_rows(tape, photo, codes) : code;
  const auto colour_of = [&](Value geometry_features, Domain domain) {
    // A colour that may depend on the direction would explain the medium between as well.
    Value seen = field.medium_numbers.out > 0
                     ? geometry_features
                     : concat(tape, geometry_features, view_code(tape, directions, domain));
    if (of_rays >= 0) seen = concat(tape, seen, repeat_for(tape, of_rays, domain));
    return sigmoid(tape, mlp(tape, seen, field.colour_layers));
  };
  const bool grouped = training && losses.shared_colour > 0;
  const bool seen_through = training && field.medium_numbers.out > 0;
  if (seen_through) distance = tape.input(1, Domain::kSamples);
  // With groups at the mean distance of each.
  const auto seen = [&](Value own, Value light = -1) {
    if (!seen_through) return own;
    const Value at = grouped ? mean_of_groups(tape, light, distance) : distance;
    return see_through(tape, own, at, field.medium_numbers);
  };
  if (!grouped) colour = colour_of(geometry, Domain::kSamples);
  field_operations_ = tape.operations();
  if (grouped || (training && losses.on_weights))
    image.weights = render_weights(tape, density, delta, /*opaque_end=*/false);
  if (grouped) {
    const Value light =
        group_light(tape, image.weights, losses.shared_colour, losses.stop_transmittance);
    colour = colour_of(mean_of_groups(tape, light, geometry), Domain::kGroups);
    image.pixel = accumulate(tape, light, seen(colour, light), background);
  } else if (training && losses.on_weights) {
    image.pixel = accumulate(tape, image.weights, seen(colour), background);
  } else {
    image = composite(tape, density, seen(colour), delta, background);
  }
  if (training && losses.on_weights) {
    weight_gradient = tape.input(1, Domain::kSamples);
    add_gradient(tape, image.weights, weight_gradient);
  }
  if (seen_through) image.pixel = over_medium(tape, image.pixel, field.medium_numbers);
  matter = image.pixel;
  if (training && field.has_sky()) {
    cover = tape.input(1, Domain::kRays);
    image.pixel = over_sky(tape, image.pixel, record_sky(tape, field, directions, of_rays), cover);
  }
  if (training && changes.out > 0)
    image.pixel = change_colours(tape, image.pixel, background, table_rows(tape, photo, changes));
  if (lens >= 0)
    image.pixel = vignette(tape, image.pixel, background,
                           table_rows(tape, lens, field.books.falloff), corner);
  if (training) pixel_loss = record_pixel_loss(tape, image.pixel, losses.pixel);
  tape.plan();
}

Value record_sky(Tape& tape, const GridField& field, Value directions, Value code) {
  Value seen = view_code(tape, directions, Domain::kRays);
  if (code >= 0) seen = concat(tape, seen, code);
  return sigmoid(tape, mlp(tape, seen, field.sky_layers));
}

void place_samples(const GridField& field, const Vec3& entry, const Vec3& direction, const Real* t,
                   int64_t n, Real* x, Real* y, Real* z) {
  for (int64_t i = 0; i < n; ++i) {
    const Vec3 g = field.grid_position(entry + direction * t[i]);
    x[i] = g.x;
    y[i] = g.y;
    z[i] = g.z;
  }
}

void encode_level(const GridField& field, size_t l, const GridPoints& points, int64_t n,
                  Real* features, int64_t ld) {
  const HashGridLevel& level = field.shape.levels[l];
  const auto look_up = [&](const auto* table) {
    hash_grid_forward(level, table + level.begin(), points.x, points.y, points.z, n, features, ld);
  };
  if (field.options.table_bits == 16)
    look_up(field.half_table.data());
  else
    look_up(field.table.data());
}

void encode(const GridField& field, const GridPoints& points, int64_t n, Real* features,
            int64_t ld) {
  for (size_t l = 0; l < field.shape.levels.size(); ++l)
    encode_level(field, l, points, n,
                 features + static_cast<int64_t>(l) * field.shape.features_per_entry() * ld, ld);
}

}  // namespace nerf
