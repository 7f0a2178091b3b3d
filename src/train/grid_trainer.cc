#include "train/grid_trainer.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "base/half.h"
#include "nerf/kernels/roulette.h"
#include "nerf/model/level_order.h"
#include "train/finest_resolution.h"
#include "train/free_space.h"
#include "train/lenses.h"
#include "train/visibility.h"

namespace nerf {

namespace {

int cascades_of(const Scene& scene) {
  int c = 1;
  while (scene.unbounded && c < kMostCascades && std::ldexp(1.0, c - 1) < scene.far) ++c;
  return c;
}

// A file's view.
std::vector<size_t> views_of_files(const Scene& scene, const PixelSource& source) {
  std::vector<size_t> views(source.files().size());
  for (size_t i = scene.train.size(); i-- > 0;)
    views[static_cast<size_t>(source.file_of(i))] = static_cast<size_t>(scene.train[i]);
  return views;
}

CodeShape learnt_light(const LightRecipe& light, const Scene& scene, const PixelSource& source) {
  CodeShape shape{light.appearance.count, light.colour_correction == Switch::kOn, source.files()};
  if (light.vignetting != Switch::kOn) return shape;
  const Lenses lenses = lenses_of(scene);
  std::vector<int> rows(lenses.names.size(), -1);
  for (const size_t v : views_of_files(scene, source)) {
    const int lens = lenses.of_view[v];
    if (lens < 0) {
      shape.photo_lenses.push_back(0);  // of a panorama, whose pixels are all in the middle
      continue;
    }
    int& row = rows[static_cast<size_t>(lens)];
    if (row < 0) {
      row = static_cast<int>(shape.lenses.size());
      shape.lenses.push_back(lenses.names[static_cast<size_t>(lens)]);
    }
    shape.photo_lenses.push_back(row);
  }
  return shape;
}

}  // namespace

TableState::TableState(const GridField& field)
    : rows(field.shape.rows),
      features(field.shape.features_per_entry()),
      table_gradient(field.shape.size()),
      marks(rows),
      row_states(kRowParts * field.shape.size()),
      listed(rows),
      listed_count(field.shape.levels.size()) {}

uint64_t TableState::memory_bytes(const HashGridShape& shape) {
  return (1 + kRowParts) * shape.size() * sizeof(Real) +
         (sizeof(uint8_t) + sizeof(uint32_t)) * shape.rows;
}

void TableState::take_weights(const GridField& field) {
  const size_t f = static_cast<size_t>(features);
  for (size_t i = 0; i < field.half_table.size(); ++i)
    row_states[(i / f * kRowParts + kRowWeights) * f + i % f] =
        internal::half_to_float(field.half_table[i]);
}

void TableState::give_weights(GridField& field) const {
  const size_t f = static_cast<size_t>(features);
  for (size_t i = 0; i < field.half_table.size(); ++i)
    field.half_table[i] = internal::float_to_half(
        static_cast<float>(row_states[(i / f * kRowParts + kRowWeights) * f + i % f]));
}

GridTrainer::GridTrainer(const Scene& s, const PhotoSet& p, const TrainOptions& o, ThreadPool& t)
    : TrainerImpl(s, p, o, t, {Rise::kLinear, Fall::kLinear}),
      distortion(distortion_weight(o, s)),
      clearing(learns_sky(o, s) ? o.grid_recipe.light.sky_clearing : 0),
      offset_weight(nerf::offset_weight(o.grid_recipe.motion, s)),
      field(resolved(o.grid, s, p), s.unbounded, cascades_of(s),
            {.codes = learnt_light(o.grid_recipe.light, s, source),
             .motion = o.grid_recipe.motion.shape(),
             .medium = o.grid_recipe.medium.medium,
             .sky = learns_sky(o, s)}),
      optimiser(field),
      maker(source, field, distortion > 0 || depth_weight > 0 || clearing > 0, t),
      batch(std::max(1, o.grid_recipe.batch_samples / kChunkSamples)) {
  const size_t columns = static_cast<size_t>(batch.max_chunks) * kChunkSamples;
  features = AlignedArray<Real>(columns * static_cast<size_t>(field.shape.features()));
  d_features = AlignedArray<Real>(features.size());
  densities = AlignedArray<Real>(columns);
  std::vector<ParameterSection> sections;
  const auto add = [&](const char* network, const std::vector<LinearWeights>& layers) {
    for (size_t l = 0; l < layers.size(); ++l)
      sections.push_back({"layer " + std::to_string(l + 1) + " of the " + network + " network",
                          layers[l].offset, layers[l].offset + layers[l].size()});
  };
  add("density", field.density_layers);
  add("colour", field.colour_layers);
  add("sky", field.sky_layers);
  if (!field.motion.empty())
    sections.push_back({"the motion's networks", field.motion.begin, field.motion.end, 0,
                        o.grid_recipe.motion.rate});
  if (has_medium()) {
    check_medium(scene, o.grid_recipe.medium);
    sections.push_back({"the medium", field.medium_numbers.offset,
                        field.medium_numbers.offset + field.medium_numbers.size(), 0,
                        o.grid_recipe.medium.rate});
  }
  const LightRecipe& light = o.grid_recipe.light;
  const auto add_book = [&](const char* name, const LinearWeights& book, double rate,
                            double decay) {
    if (book.out > 0)
      sections.push_back({name, book.offset, book.offset + book.size(), 0, rate, decay});
  };
  add_book("the photos' appearance", field.books.appearance, light.code_rate, light.code_decay);
  add_book("the photos' colours", field.books.colours, light.colour_rate, light.colour_decay);
  if (field.books.colours.out > 0 && light.exif_exposure.number > 0)
    sections.back().centre = expected_colours();
  add_book("the lenses' falloff", field.books.falloff, light.vignetting_rate,
           light.vignetting_decay);
  dense = std::make_unique<DenseParameters>(field.weights.span(), field.layers(),
                                            std::move(sections), kAccumulators);
  chunk_loss.resize(static_cast<size_t>(batch.max_chunks));
  chunk_colours.resize(chunk_loss.size());
  chunk_kept.resize(chunk_loss.size());
  chunk_opacity.resize(chunk_loss.size());
  chunk_squared_error.resize(chunk_loss.size());
  corrections.resize(2 * kBiasCorrections);
  queries.resize(static_cast<size_t>(pool.size()));
  const CameraRecipe& camera_recipe = o.grid_recipe.cameras;
  if (camera_recipe.rolling_shutter.any()) {
    shutter = std::make_unique<RollingShutter>(scene, camera_recipe);
    shutter->place(source);
  }
  if (camera_recipe.refine == RefineCameras::kOn || camera_recipe.rolling_shutter.learnt) {
    cameras =
        std::make_unique<CameraRefinement>(scene, photos, camera_recipe, source, shutter.get());
    ray_moves.resize(batch.weight.size());
  }
  if (cameras || has_medium()) batch.keep_lines();
  if (!field.motion.empty()) {
    moving = std::make_unique<MovingSamples>(field, dense->packs(), batch.max_chunks, pool.size());
    if (cameras) moving->d_points = AlignedArray<Real>(3 * columns);
    if (offset_weight > 0) moving->pull = AlignedArray<Real>(columns);
  }
  if (cameras || moving) d_position = AlignedArray<Real>(3 * columns);
  if (const double share = o.grid_recipe.light.robust.number; share > 0) {
    robust = std::make_unique<RobustMask>(p, s.train, share);
    maker.use_tiles(*robust);
    ray_errors.resize(batch.weight.size());
  }
  if (clearing > 0) {
    skylines = std::make_unique<Skylines>(scene);
    maker.use_skylines(*skylines);
  }
  initialise();
  const PixelLoss pixel = PixelLoss::huber(static_cast<Real>(o.grid_recipe.huber_delta));
  own_head = std::make_unique<GridHead>(field, losses(pixel), *dense, pool);
}

uint64_t GridTrainer::memory_bytes(const TrainOptions& options, bool unbounded, int threads) {
  constexpr uint64_t kFloat = sizeof(Real);
  const GridOptions& o = options.grid;
  const HashGridShape shape = hash_grid_shape(o);  // a resolution left open: the finest
  const int cascades = unbounded ? kMostCascades : 1;
  const uint64_t field = GridField::memory_bytes(o, unbounded, cascades);
  const uint64_t weights = GridField::network_weights(o);
  const uint64_t table = TableState::memory_bytes(shape);
  const uint64_t dense = DenseParameters::memory_bytes(weights, kAccumulators);
  const uint64_t workers = static_cast<uint64_t>(threads) * GridTape::memory_bytes(o);
  const uint64_t samples = static_cast<uint64_t>(options.grid_recipe.batch_samples);
  const uint64_t batch = samples * (RayBatch::kBytesOfSample + RayBatchMaker::kBytesOfSample +
                                    2 * static_cast<uint64_t>(shape.features()) * kFloat);

  // At different times: a copy of the field and its packs with the table in half precision and the
  // levels compressed (a saved model), a checkpoint read whole, moments made anew.
  const uint64_t half_table = shape.size() * sizeof(uint16_t);
  const uint64_t side = static_cast<uint64_t>(occupancy_side(o, unbounded));
  const uint64_t cells = side * side * side * static_cast<uint64_t>(cascades);
  const uint64_t saving = field + 2 * kFloat * weights + half_table + cells;
  const uint64_t resuming =
      kFloat * (3 * (shape.size() + weights) + shape.rows) + cells * (kFloat + 2);
  const uint64_t restarting = table + DenseParameters::kArrays * kFloat * weights;
  return field + table + dense + workers + batch + std::max({saving, resuming, restarting});
}

std::vector<Real> GridTrainer::expected_colours() const {
  const LinearWeights& book = field.books.colours;
  std::vector<Real> out(book.size());
  const std::vector<size_t> views = views_of_files(scene, source);
  for (size_t p = 0; p < views.size(); ++p) {
    const auto change = change_of_exposure(options.grid_recipe.light.exif_exposure.number *
                                           scene.views[views[p]].exposure.value_or(0));
    std::ranges::copy(change, out.begin() + static_cast<ptrdiff_t>(p) * weight_stride(book.in));
  }
  return out;
}

void GridTrainer::initialise() {
  field.initialise(options.seed ^ salt);
  if (field.books.colours.out > 0 && options.grid_recipe.light.exif_exposure.number > 0)
    std::ranges::copy(expected_colours(), field.weights.begin() + field.books.colours.offset);
  if (!field.motion.empty()) field.occupancy.remember_moments();
  optimiser.take_weights(field);
  // A finer cascade answers for the middle of a coarser one.
  for (int c = 1; c < field.occupancy.cascades(); ++c)
    for (int64_t i = 0; i < field.occupancy.cells(); ++i) {
      const Real w = field.occupancy.cell_width(c);
      const Vec3 centre = field.occupancy.cell_corner(i, c) + Vec3{0.5_r * w, 0.5_r * w, 0.5_r * w};
      if (field.occupancy.cascade_of(centre) < c) field.occupancy.switch_off(c, i);
    }
  switch_off_impossible_cells(scene, photos, options, pool, field.occupancy);
  if (!options.grid_recipe.keep_free) switch_off_free_space(scene, photos, pool, field.occupancy);
  field.occupancy.rebuild(static_cast<Real>(options.grid_recipe.occupancy_threshold), &pool);
  dense->pack(options.precision, pool);
}

GridPoints GridTrainer::points_of(int64_t chunk) const {
  const int64_t at = chunk * kChunkSamples;
  if (moving) return {moving->x.data() + at, moving->y.data() + at, moving->z.data() + at};
  return {batch.x.data() + at, batch.y.data() + at, batch.z.data() + at};
}

// However long its rays are, a chunk holds as many of the longest.
int64_t GridTrainer::most_rays() const {
  return int64_t{batch.max_chunks} * (kChunkSamples / options.grid.sampler.max_samples);
}

void GridTrainer::draw() {
  batch.lists = open;
  if (has_medium()) maker.set_background(field.medium().colour);
  if (!given.empty())
    return maker.fill(seed(), done, static_cast<int64_t>(given.size()), samples_per_cell_at(done),
                      given, batch);
  // Nothing is transparent in a medium.
  if (!has_medium()) source.draw_masked(static_cast<Real>(masked.at(progress_at(done))));
  const double capacity = static_cast<double>(batch.max_chunks) * kChunkSamples;
  const int64_t rays = static_cast<int64_t>(
      std::clamp(capacity / std::max(samples_per_ray, 0.05) * 1.03, 64.0, capacity));
  maker.fill(seed(), done, rays, samples_per_cell_at(done), batch);
}

void GridTrainer::look_up() {
  if (moving) find_canonical();
  const int64_t ld = kChunkSamples;
  const int64_t level_count = static_cast<int64_t>(field.shape.levels.size());
  const int64_t rows = field.shape.features_per_entry();
  const int64_t open = open_levels();
  each_level_of_chunks(pool, level_count, batch.chunks,
                       [&](int64_t l, int64_t first, int64_t last) {
                         for (int64_t c = first; c < last; ++c) {
                           Real* const to = features.data() + (c * level_count + l) * rows * ld;
                           if (l < open)
                             encode_level(field, static_cast<size_t>(l), points_of(c),
                                          batch.samples[static_cast<size_t>(c)], to, ld);
                           else
                             std::fill_n(to, rows * ld, 0.0_r);
                         }
                       });
}

void GridTrainer::keep_samples(int64_t c, const GridTape& tape, Chunk& chunk) {
  const auto& roulette = chunk.state<RouletteState>(tape.gradient_roulette);
  const int32_t* const kept = roulette.kept.data();
  chunk_kept[static_cast<size_t>(c)] = chunk.samples;
  batch.keep_points(static_cast<int>(c), kept, chunk.samples);
  if (!moving) return;
  for (auto* a : {&moving->x, &moving->y, &moving->z})
    keep_columns(1, kept, chunk.samples, a->data() + c * kChunkSamples, kChunkSamples);
  std::copy_n(chunk.ray_begin, chunk.rays + 1, moving->ray_begin.data() + c * (kChunkRays + 1));
  if (!(offset_weight > 0)) return;
  const Real* const weights = chunk.data(tape.image.weights);
  for (int r = 0; r < chunk.rays; ++r) {
    const Real scale = offset_scale(c, r);
    for (int32_t i = chunk.ray_begin[r]; i < chunk.ray_begin[r + 1]; ++i) {
      const size_t at = static_cast<size_t>(i);
      moving->pull[static_cast<size_t>(c) * kChunkSamples + at] =
          scale * roulette.factor[at] * weights[roulette.kept[at]];
    }
  }
}

AdamStep GridTrainer::dense_step() const {
  AdamStep adam = adam_at(done);
  adam.rate *= static_cast<Real>(options.grid_recipe.network_rate);
  return adam;
}

// The occupancy's cells have one owner too, so it shares the work.
void GridTrainer::scatter(StepReport& report) {
  const int64_t ld = kChunkSamples;
  const int64_t levels = static_cast<int64_t>(field.shape.levels.size());
  const AdamStep step = adam_at(done);
  const int64_t open = open_levels();
  bias_corrections(step, corrections.data());
  const auto list_of = [&](int64_t l) {
    return optimiser.listed.data() + field.shape.levels[static_cast<size_t>(l)].offset;
  };
  const auto adam = [&](int64_t l, int64_t first, int64_t count) {
    const HashGridLevel& level = field.shape.levels[static_cast<size_t>(l)];
    const auto update = [&](auto* table) {
      adam_rows(step, level.features, list_of(l) + first, count,
                optimiser.table_gradient.data() + level.begin(),
                optimiser.row_states.data() + kRowParts * level.begin(), table + level.begin(),
                corrections.data());
    };
    if (field.options.table_bits == 16)
      update(field.half_table.data());
    else
      update(field.table.data());
  };
  // A level's gradient is still in a cache right after it was summed; with many threads the levels
  // are too few to share the optimiser's work.
  const bool at_once = 2 * pool.size() <= levels;
  // A level's rows belong to one item, which takes the samples in order. Fine levels first: they
  // are the dearest.
  pool.parallel_for(levels + 1, [&](int64_t i) {
    if (i == levels) return observe_samples();
    const int64_t l = levels - 1 - i;
    const HashGridLevel& level = field.shape.levels[static_cast<size_t>(l)];
    Real* const gradient = optimiser.table_gradient.data() + level.begin();
    uint8_t* const marks = optimiser.marks.data() + level.offset;
    optimiser.listed_count[static_cast<size_t>(l)] = 0;
    if (l >= open) return;
    for (int64_t c = 0; c < batch.chunks; ++c) {
      const GridPoints p = points_of(c);
      hash_grid_backward(level, p.x, p.y, p.z, chunk_kept[static_cast<size_t>(c)],
                         d_features.data() + (c * levels + l) * level.features * ld, ld, gradient,
                         marks);
    }
    int64_t& count = optimiser.listed_count[static_cast<size_t>(l)];
    count = list_rows(level.entries, marks, list_of(l));
    if (at_once) adam(l, 0, count);
  });
  constexpr int64_t kRows = 8192;
  for (int64_t l = 0; l < levels; ++l) {
    const int64_t count = optimiser.listed_count[static_cast<size_t>(l)];
    report.rows += count;
    if (at_once) continue;
    pool.parallel_for((count + kRows - 1) / kRows,
                      [&](int64_t i) { adam(l, i * kRows, std::min(kRows, count - i * kRows)); });
  }
}

void GridTrainer::observe(const StepReport& report, const PhaseSeconds& seconds) {
  const double rays = static_cast<double>(std::max<int64_t>(report.rays, 1));
  const double samples = static_cast<double>(report.samples);
  const auto follow = [&](double& mean, double now) {
    mean = done == 0 ? now : 0.8 * mean + 0.2 * now;
  };
  if (robust && given.empty()) robust->observe(batch, ray_errors, progress_at(done));
  follow(samples_per_ray, samples / rays);
  follow(chunk_seconds, seconds.head);
  follow(table_seconds, seconds.scatter);
  follow(colours_per_sample, static_cast<double>(report.colours) / std::max(samples, 1.0));
}

void GridTrainer::begin_anew() {
  samples_per_ray = 16;
  optimiser = TableState(field);
  dense->forget();
  if (cameras) cameras->reset();
  if (robust) robust->reset();
  field.occupancy = OccupancyGrid(field.occupancy.cascades(), field.occupancy.side());
  initialise();
}

RadianceField GridTrainer::snapshot(ModelInfo info) const {
  auto grid = std::make_shared<GridField>(field);
  grid->occupancy.forget_training();
  return RadianceField(std::move(info), std::move(grid));
}

}  // namespace nerf
