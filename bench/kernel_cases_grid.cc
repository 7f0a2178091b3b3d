// The hash grid's lookup, its scatter and its gradient by position, and Adam.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "kernel_bench.h"
#include "nerf/kernels/adam.h"
#include "nerf/kernels/hash_grid.h"
#include "nerf/math/random.h"
#include "nerf/model/grid_field.h"
#include "nerf/model/level_order.h"

namespace nerf::apps {
namespace {

HashGridShape shape_of(int log2_entries) {
  const GridOptions o;
  return hash_grid_shape(o.levels, log2_entries, o.base_resolution, GridOptions::kFinestUnbounded);
}

enum class Pass { kForward, kForwardHalf, kBackward, kPositionHalf };

const char* name_of(Pass pass) {
  switch (pass) {
    case Pass::kForward:
      return "forward";
    case Pass::kForwardHalf:
      return "forward in 16 bits";
    case Pass::kBackward:
      return "backward";
    case Pass::kPositionHalf:
      return "position gradient in 16 bits";
  }
  return "";
}

// All levels of a grid over one training batch, cut as a training step cuts it: forward by level
// and sixteen chunks, backward by level; by position level after level, which are added up.
class Grid {
 public:
  Grid(HashGridShape shape, int log2_samples, Pass pass)
      : pass_(pass),
        shape_(std::move(shape)),
        chunks_((int64_t{1} << log2_samples) / kChunkSamples),
        x_(static_cast<size_t>(samples())),
        y_(x_.size()),
        z_(x_.size()),
        features_(noise(static_cast<size_t>(shape_.features()) * x_.size(), 6)) {
    if (pass == Pass::kBackward) {
      gradient_ = AlignedArray<Real>(shape_.size());
      marks_ = AlignedArray<uint8_t>(shape_.rows);
    } else if (pass != Pass::kForward) {
      // Bits of numbers between 1/4 and 1/2: only how fast they are read matters.
      half_ = AlignedArray<uint16_t>(shape_.size());
      for (size_t i = 0; i < half_.size(); ++i)
        half_[i] = static_cast<uint16_t>(0x3400 + (i * 2654435761u >> 22));
    } else {
      table_ = noise(shape_.size(), 4);
    }
    if (pass == Pass::kPositionHalf) by_position_ = AlignedArray<Real>(3 * x_.size());
    place_samples();
  }

  void run(ThreadPool& pool) {
    if (pass_ == Pass::kBackward)
      backward(pool);
    else if (pass_ == Pass::kPositionHalf)
      by_position(pool);
    else
      forward(pool);
  }

  void forward(ThreadPool& pool) {
    each_level_of_chunks(pool, levels(), chunks_, [&](int64_t l, int64_t first, int64_t last) {
      const HashGridLevel& level = shape_.levels[static_cast<size_t>(l)];
      for (int64_t c = first; c < last; ++c)
        if (half_.size() == 0)
          hash_grid_forward(level, table_.data() + level.begin(), x_.data() + at(c),
                            y_.data() + at(c), z_.data() + at(c), kChunkSamples, features(c, l),
                            kChunkSamples);
        else
          hash_grid_forward(level, half_.data() + level.begin(), x_.data() + at(c),
                            y_.data() + at(c), z_.data() + at(c), kChunkSamples, features(c, l),
                            kChunkSamples);
    });
  }

  void backward(ThreadPool& pool) {
    pool.parallel_for(levels(), [&](int64_t i) {
      const int64_t l = levels() - 1 - i;
      const HashGridLevel& level = shape_.levels[static_cast<size_t>(l)];
      for (int64_t c = 0; c < chunks_; ++c)
        hash_grid_backward(level, x_.data() + at(c), y_.data() + at(c), z_.data() + at(c),
                           kChunkSamples, features(c, l), kChunkSamples,
                           gradient_.data() + level.begin(), marks_.data() + level.offset);
    });
  }

  void by_position(ThreadPool& pool) {
    std::ranges::fill(by_position_, 0.0_r);
    Real *dx = by_position_.data(), *dy = dx + samples(), *dz = dy + samples();
    for (int64_t l = 0; l < levels(); ++l)
      pool.parallel_for(chunks_, [&](int64_t c) {
        const HashGridLevel& level = shape_.levels[static_cast<size_t>(l)];
        hash_grid_position_backward(level, half_.data() + level.begin(), x_.data() + at(c),
                                    y_.data() + at(c), z_.data() + at(c), kChunkSamples,
                                    features(c, l), kChunkSamples, dx + at(c), dy + at(c),
                                    dz + at(c));
      });
  }

  // Samples per second if every corner were a random row of its level's table.
  double ceiling(Ceilings& c) const {
    double seconds = 0;
    for (const HashGridLevel& level : shape_.levels)
      seconds += 8 / c.random_rows(static_cast<uint64_t>(level.entries * row_bytes(level)));
    return 1 / seconds;
  }
  // Of a sample, at each level: a point, its features or their gradient, and eight rows, which are
  // read; backward they are written too, and marked. A gradient by position is read and written.
  double bytes() const {
    double sum = 0;
    for (const HashGridLevel& level : shape_.levels) {
      const double row = static_cast<double>(row_bytes(level));
      sum += static_cast<double>(3 + level.features) * sizeof(Real) +
             8 * (gradient_.size() > 0 ? 2 * row + sizeof(uint8_t) : row) +
             (by_position_.size() > 0 ? 6 * sizeof(Real) : 0);
    }
    return sum;
  }
  int64_t samples() const { return chunks_ * kChunkSamples; }

 private:
  // Sixteen neighbours along each of many short stretches of rays.
  void place_samples() {
    constexpr int64_t kStretch = 16;
    for (int64_t s = 0; s < samples(); s += kStretch) {
      Random random(7, 5, static_cast<uint64_t>(s));
      Real p[3], d[3];
      for (int k = 0; k < 3; ++k) {
        p[k] = random.uniform();
        d[k] = (random.uniform() - 0.5_r) * 0.01_r;
      }
      for (int64_t i = s; i < s + kStretch; ++i) {
        const Real t = static_cast<Real>(i - s);
        x_[static_cast<size_t>(i)] = p[0] + t * d[0];
        y_[static_cast<size_t>(i)] = p[1] + t * d[1];
        z_[static_cast<size_t>(i)] = p[2] + t * d[2];
      }
    }
  }
  // Of the table that is looked up, or of its gradient.
  size_t row_bytes(const HashGridLevel& level) const {
    return static_cast<size_t>(level.features) *
           (half_.size() > 0 ? sizeof(uint16_t) : sizeof(Real));
  }
  int64_t levels() const { return static_cast<int64_t>(shape_.levels.size()); }
  static int64_t at(int64_t chunk) { return chunk * kChunkSamples; }
  Real* features(int64_t chunk, int64_t level) {
    return features_.data() +
           (chunk * levels() + level) * shape_.features_per_entry() * kChunkSamples;
  }

  Pass pass_;
  HashGridShape shape_;
  int64_t chunks_;
  AlignedArray<Real> table_, gradient_, by_position_;
  AlignedArray<uint16_t> half_;
  AlignedArray<uint8_t> marks_;
  AlignedArray<Real> x_, y_, z_, features_;
};

KernelRun grid_run(const HashGridShape& shape, int log2_samples, Pass pass) {
  auto grid = std::make_shared<Grid>(shape, log2_samples, pass);
  KernelRun run;
  run.work = static_cast<double>(grid->samples());
  run.bytes = run.work * grid->bytes();
  run.ceiling = [grid](Ceilings& c) { return grid->ceiling(c); };
  run.run = [grid](ThreadPool& pool) { grid->run(pool); };
  return run;
}

// The marks of the default grid's rows, of which every fourth (at random) is set, listed level by
// level as in a training step: a mark is read, and where it is set it is cleared and the row
// listed.
struct MarkedRows {
  MarkedRows() : shape(shape_of(GridOptions().log2_entries)), pattern(shape.rows) {
    Random random(7, 9, 0);
    for (uint8_t& mark : pattern) mark = random.below(4) == 0;
    marks = AlignedArray<uint8_t>(pattern.size());
    list = AlignedArray<uint32_t>(pattern.size());
  }
  void run(ThreadPool& pool) {
    pool.parallel_for(static_cast<int64_t>(shape.levels.size()), [&](int64_t l) {
      const HashGridLevel& level = shape.levels[static_cast<size_t>(l)];
      list_rows(level.entries, marks.data() + level.offset, list.data() + level.offset);
    });
  }
  HashGridShape shape;
  std::vector<uint8_t> pattern;
  AlignedArray<uint8_t> marks;
  AlignedArray<uint32_t> list;
};

KernelRun list_rows_run() {
  auto rows = std::make_shared<MarkedRows>();
  const size_t set = static_cast<size_t>(std::ranges::count(rows->pattern, uint8_t{1}));
  const uint64_t listed = rows->pattern.size() + set * sizeof(uint32_t);
  KernelRun run;
  run.work = static_cast<double>(listed + set);
  run.ceiling = [listed](Ceilings& c) { return c.read(listed); };
  run.prepare = [rows] { std::ranges::copy(rows->pattern, rows->marks.begin()); };
  run.run = [rows](ThreadPool& pool) { rows->run(pool); };
  return run;
}

// The tables of the default grid, of whose rows every `every`th (at random) has a gradient. Bytes
// are those of such rows: their gradients and states are read and written, their half floats
// written.
struct AdamRows {
  AdamRows(int log2_entries, uint64_t every)
      : rows(shape_of(log2_entries).rows),
        gradient(noise(kFeatures * rows, 1)),
        states(kRowParts * kFeatures * rows),
        rounded(kFeatures * rows),
        correction(2 * kBiasCorrections) {
    bias_corrections(AdamStep(), correction.data());
    Random random(7, 8, 0);
    for (size_t row = 0; row < rows; ++row)
      if (random.below(every) == 0) touched.push_back(static_cast<uint32_t>(row));
  }
  void run(ThreadPool& pool) {
    constexpr int64_t kRows = 8192;
    const int64_t count = static_cast<int64_t>(touched.size());
    pool.parallel_for((count + kRows - 1) / kRows, [&](int64_t i) {
      adam_rows(AdamStep(), kFeatures, touched.data() + i * kRows,
                std::min(kRows, count - i * kRows), gradient.data(), states.data(), rounded.data(),
                correction.data());
    });
  }
  static constexpr size_t kFeatures = 4;
  size_t rows;
  AlignedArray<Real> gradient, states;
  AlignedArray<uint16_t> rounded;
  AlignedArray<Real> correction;
  std::vector<uint32_t> touched;
};

KernelRun adam_rows_run(uint64_t every) {
  auto adam = std::make_shared<AdamRows>(GridOptions().log2_entries, every);
  KernelRun run;
  // Gradient, both moments and weights, and a number of steps.
  constexpr size_t kNumbers = 4 * AdamRows::kFeatures + 1;
  constexpr size_t kRowBytes = 2 * kNumbers * sizeof(Real) + AdamRows::kFeatures * sizeof(uint16_t);
  run.work = static_cast<double>(adam->touched.size() * kRowBytes);
  run.ceiling = [adam](Ceilings& c) {
    return c.read((adam->gradient.size() + adam->states.size()) * sizeof(Real) +
                  adam->rounded.size() * sizeof(uint16_t));
  };
  run.run = [adam](ThreadPool& pool) { adam->run(pool); };
  return run;
}

KernelRun adam_dense_run() {
  constexpr int64_t kParameters = 1 << 22, kPiece = 1 << 14;
  struct Arrays {
    AlignedArray<Real> gradient = noise(kParameters, 1), weights = noise(kParameters, 2);
    AlignedArray<Real> m{kParameters}, v{kParameters};
  };
  auto a = std::make_shared<Arrays>();
  KernelRun run;
  run.work = kParameters * 7.0 * sizeof(Real);  // four arrays read, three written
  run.ceiling = [](Ceilings& c) { return c.read(4 * kParameters * sizeof(Real)); };
  run.run = [a](ThreadPool& pool) {
    pool.parallel_for(kParameters / kPiece, [&](int64_t i) {
      const int64_t at = i * kPiece;
      adam_dense(AdamStep(), 1000, kPiece, a->gradient.data() + at, a->m.data() + at,
                 a->v.data() + at, a->weights.data() + at);
    });
  };
  return run;
}

}  // namespace

std::vector<KernelCase> grid_cases() {
  std::vector<KernelCase> cases;
  const auto add = [&](const HashGridShape& shape, int log2_entries, int log2_samples) {
    for (Pass pass : {Pass::kForward, Pass::kForwardHalf, Pass::kBackward, Pass::kPositionHalf})
      cases.push_back(
          {fmt::format("hash grid {}x{} {}, 2^{} entries, 2^{} samples", shape.levels.size(),
                       shape.features_per_entry(), name_of(pass), log2_entries, log2_samples),
           Unit::kSamples, kBoundRows, [=](int) { return grid_run(shape, log2_samples, pass); }});
  };
  for (int log2_entries = 15; log2_entries <= 19; ++log2_entries)
    add(shape_of(log2_entries), log2_entries, 16);
  // The setting of Mueller et al. 2022, with small tables and large.
  for (int log2_entries : {15, 17, 19})
    add(hash_grid_shape(16, log2_entries, 16, 2048, 2), log2_entries, 18);
  cases.push_back({"list of rows, a quarter marked", Unit::kBytes, kBoundRead,
                   [](int) { return list_rows_run(); }});
  cases.push_back({"Adam rows, all with a gradient", Unit::kBytes, kBoundRead,
                   [](int) { return adam_rows_run(1); }});
  cases.push_back({"Adam rows, a quarter with a gradient", Unit::kBytes, kBoundRead,
                   [](int) { return adam_rows_run(4); }});
  cases.push_back({"Adam dense, 2^22 parameters", Unit::kBytes, kBoundRead,
                   [](int) { return adam_dense_run(); }});
  return cases;
}

}  // namespace nerf::apps
