// Density, colour and the gradient of density of the grid method's field at points.
#include <algorithm>
#include <memory>
#include <numeric>

#include "model/point_lattice.h"
#include "nerf/base/error.h"
#include "nerf/math/contraction.h"
#include "nerf/model/grid_field.h"

namespace nerf {

namespace {

constexpr int kBlock = kChunkSamples;

class GridQuery final : public FieldQuery {
 public:
  GridQuery(const GridField& field, const LayerPacks* packs) : field_(field), packs_(packs) {}

  void ask(const FieldPoints& points, const FieldAnswers& answers) override {
    const int64_t n = static_cast<int64_t>(points.positions.size());
    for (int64_t begin = 0; begin < n; begin += kBlock)
      ask_block(points, answers, static_cast<size_t>(begin),
                static_cast<int>(std::min<int64_t>(kBlock, n - begin)));
  }

 private:
  // A tape and its values, made when they are first needed.
  struct Worker {
    Worker(const GridField& field, GridTape::Purpose purpose, const LayerPacks* packs)
        : tape(field, purpose), chunk(tape.tape) {
      chunk.weights = field.weights.data();
      chunk.packs = packs;
    }
    GridTape tape;
    Chunk chunk;
  };
  Worker& worker(std::unique_ptr<Worker>& made, GridTape::Purpose purpose) {
    if (!made) made = std::make_unique<Worker>(field_, purpose, packs_);
    return *made;
  }

  // Without directions all points are of one ray, so that what a ray's time gives is found once.
  void place(const FieldPoints& points, size_t begin, int n, bool directed, Worker& w) {
    for (int i = 0; i < n; ++i) {
      const Vec3 g =
          field_.grid_position(points.positions[begin + static_cast<size_t>(i)].cast<Real>());
      x_[i] = g.x;
      y_[i] = g.y;
      z_[i] = g.z;
    }
    const int rays = directed ? n : 1;
    std::iota(ray_begin_, ray_begin_ + rays, 0);
    for (Real* const a : {x_, y_, z_}) std::fill(a + n, a + round_up(n, kLane), 0.5_r);
    ray_begin_[rays] = n;
    Chunk& c = w.chunk;
    c.samples = n;
    c.rays = rays;
    c.ray_begin = ray_begin_;
    if (!field_.motion.empty()) move(points, begin, n, w);
    const GridPoints p = looked_up();
    encode(field_, p, n, c.data(w.tape.features), c.stride(w.tape.features));
  }

  void ask_block(const FieldPoints& points, const FieldAnswers& answers, size_t begin, int n) {
    if (!answers.gradient.empty()) find_gradient(points, answers, begin, n);
    const bool coloured = !answers.rgb.empty();
    if (!coloured && answers.density.empty()) return;
    Worker& w = worker(plain_, GridTape::Purpose::kPictures);
    Chunk& chunk = w.chunk;
    const GridTape& tape = w.tape;
    place(points, begin, n, coloured, w);
    const int64_t lr = chunk.stride(tape.directions);
    for (int i = 0; coloured && i < n; ++i)
      for (int k = 0; k < 3; ++k)
        chunk.data(tape.directions)[k * lr + i] =
            static_cast<Real>(points.directions[begin + static_cast<size_t>(i)][k]);
    if (coloured) set_code(points.photo, n, w);
    if (coloured)
      tape.forward_field(chunk);
    else
      tape.forward_density(chunk);
    if (!answers.density.empty())
      std::copy_n(chunk.data(tape.density), n, answers.density.data() + begin);
    const int64_t lc = coloured ? chunk.stride(tape.colour) : 0;
    for (int i = 0; coloured && i < n; ++i)
      for (int64_t k = 0; k < 3; ++k)
        answers.rgb[3 * (begin + static_cast<size_t>(i)) + static_cast<size_t>(k)] =
            chunk.data(tape.colour)[k * lc + i];
  }

  // Where the table is looked up.
  GridPoints looked_up() const {
    if (field_.motion.empty()) return {x_, y_, z_};
    return {canonical_[0], canonical_[1], canonical_[2]};
  }

  void move(const FieldPoints& points, size_t begin, int n, Worker& w) {
    const bool sloped = w.tape.density_gradient >= 0;
    if (!motion_ || (sloped && !motion_goes_back_))
      motion_ = std::make_unique<MotionChunk>(field_, packs_, motion_goes_back_ = sloped);
    Chunk& c = w.chunk;
    std::fill_n(c.data(w.tape.time), round_up(c.rays, kLane), points.time);
    const Real* const from[] = {x_, y_, z_};
    for (int k = 0; k < 3; ++k)
      for (Real* const to :
           {c.data(w.tape.position) + k * c.stride(w.tape.position), canonical_[k]})
        std::copy_n(from[k], round_up(n, kLane), to);
    const auto asked = points.positions.subspan(begin, static_cast<size_t>(n));
    if (!sloped && points.motion_spacing > 0 && lattice_.surround(asked, points.motion_spacing))
      interpolate(n, points.time);
    else
      lead(canonical_, n, points.time);
  }

  // From positions to canonical ones; rows of `x` are padded to whole lanes.
  void lead(Real (&x)[3][kBlock], int n, Real time) {
    const int32_t ray_begin[] = {0, n};
    motion_->forward(x[0], x[1], x[2], n, 1, ray_begin, &time);
    for (int k = 0; k < 3; ++k) std::copy_n(motion_->canonical(k), round_up(n, kLane), x[k]);
  }

  // Adds to the points the offsets of the lattice's corners.
  void interpolate(int n, Real time) {
    const int m = static_cast<int>(lattice_.corners().size());
    offsets_.clear();
    for (const Vec3d& corner : lattice_.corners())
      offsets_.push_back(field_.grid_position(corner.cast<Real>()));
    for (int k = 0; k < 3; ++k) {
      for (int i = 0; i < m; ++i) corner_[k][i] = offsets_[static_cast<size_t>(i)][k];
      std::fill(corner_[k] + m, corner_[k] + round_up(m, kLane), 0.5_r);
    }
    lead(corner_, m, time);
    for (int i = 0; i < m; ++i) {
      Vec3& offset = offsets_[static_cast<size_t>(i)];
      offset = Vec3{corner_[0][i], corner_[1][i], corner_[2][i]} - offset;
    }
    for (int i = 0; i < n; ++i) {
      const Vec3 offset = lattice_.at(static_cast<size_t>(i), offsets_);
      for (int k = 0; k < 3; ++k) canonical_[k][i] += offset[k];
    }
  }

  // The code of a photo, the same for all points.
  void set_code(int photo, int n, Worker& w) {
    if (w.tape.code < 0) return;
    if (photo != photo_ || code_.empty()) {
      code_ = photo < 0 ? field_.default_code(0)
                        : appearance_of(field_.books, field_.weights.span(), photo).code;
      photo_ = photo;
    }
    fill_rows(code_, n, w.tape.code, w.chunk);
  }

  // Backward from density to the features, and from these to positions level by level.
  void find_gradient(const FieldPoints& points, const FieldAnswers& answers, size_t begin, int n) {
    Worker& w = worker(sloped_, GridTape::Purpose::kGradient);
    place(points, begin, n, false, w);
    if (unused_.size() == 0) unused_ = AlignedArray<Real>(field_.weights.size());
    w.chunk.weight_gradient = unused_.data();
    std::fill_n(w.chunk.data(w.tape.density_gradient), n, 1.0_r);
    w.tape.tape.forward(w.chunk);
    w.tape.tape.backward(w.chunk);
    alignas(64) Real d[3][kBlock] = {};
    const GridPoints p = looked_up();
    const int64_t ld = w.chunk.stride(w.tape.features);
    for (size_t l = 0; l < field_.shape.levels.size(); ++l) {
      const HashGridLevel& level = field_.shape.levels[l];
      const Real* d_features =
          w.chunk.gradient(w.tape.features) + static_cast<int64_t>(l) * level.features * ld;
      const auto add = [&](const auto* table) {
        hash_grid_position_backward(level, table + level.begin(), p.x, p.y, p.z, n, d_features, ld,
                                    d[0], d[1], d[2]);
      };
      if (field_.options.table_bits == 16)
        add(field_.half_table.data());
      else
        add(field_.table.data());
    }
    if (!field_.motion.empty()) {
      motion_->backward(d[0], kBlock, unused_.data());
      const int64_t lp = w.chunk.stride(w.tape.position);
      for (int k = 0; k < 3; ++k)
        for (int i = 0; i < n; ++i)
          d[k][i] =
              motion_->position_gradient(k)[i] + w.chunk.gradient(w.tape.position)[k * lp + i];
    }
    for (int i = 0; i < n; ++i) {
      const size_t at = begin + static_cast<size_t>(i);
      // The contraction's Jacobian is symmetric, so that it is its own transpose.
      Vec3 g{d[0][i], d[1][i], d[2][i]};
      g = field_.unbounded ? contraction_jacobian(points.positions[at].cast<Real>())(g) * 0.25_r
                           : g * 0.5_r;
      for (int k = 0; k < 3; ++k) answers.gradient[3 * at + static_cast<size_t>(k)] = g[k];
    }
  }

  const GridField& field_;
  const LayerPacks* packs_;
  std::unique_ptr<Worker> plain_, sloped_;
  std::unique_ptr<MotionChunk> motion_;
  bool motion_goes_back_ = false;
  alignas(64) Real x_[kBlock], y_[kBlock], z_[kBlock];
  alignas(64) Real canonical_[3][kBlock], corner_[3][kBlock];
  internal::PointLattice lattice_;
  std::vector<Vec3> offsets_;  // of its corners
  int32_t ray_begin_[kBlock + 1];
  std::vector<Real> code_;  // of photo_
  int photo_ = -1;
  AlignedArray<Real> unused_;  // gradient of the networks
};

}  // namespace

std::unique_ptr<FieldQuery> GridField::query(const LayerPacks* packs) const {
  return std::make_unique<GridQuery>(*this, packs);
}

bool GridField::may_hold(const Vec3d& p) const {
  for (int k = 0; k < 3; ++k)
    if (!(p[k] >= clip.min[k] && p[k] <= clip.max[k])) return false;
  return occupancy.occupied(p.cast<Real>());
}

}  // namespace nerf
