// Density, colour and the gradient of density of a paper method's last level at points.
#include <algorithm>
#include <memory>

#include "nerf/math/contraction.h"
#include "nerf/model/moments.h"
#include "nerf/model/network_field.h"

namespace nerf {

namespace {

constexpr int kBlock = 256;  // points of a network call, each on a ray of its own

class NetworkQuery final : public FieldQuery {
 public:
  NetworkQuery(const NetworkField& field, const LayerPacks* packs)
      : field_(field), axes_(encoding_axes(field.options)), packs_(packs), moments_(field) {}

  void ask(const FieldPoints& points, const FieldAnswers& answers) override {
    const size_t n = points.positions.size();
    moments_.begin();
    for (size_t begin = 0; begin < n; begin += kBlock)
      ask_block(points, answers, begin, static_cast<int>(std::min<size_t>(kBlock, n - begin)));
  }

 private:
  // A tape and its values, made when they are first needed.
  struct Worker {
    Worker(const NetworkField& field, NetworkTape::Purpose purpose, const LayerPacks* packs)
        : tape(field.options, field.networks.back(), kBlock, kBlock, purpose, {}),
          chunk(tape.tape) {
      chunk.weights = field.weights.data();
      chunk.packs = packs;
      if (field.options.deform.any()) tape.open(field.windows);
    }
    NetworkTape tape;
    Chunk chunk;
  };
  Worker& worker(std::unique_ptr<Worker>& made, NetworkTape::Purpose purpose) {
    if (!made) made = std::make_unique<Worker>(field_, purpose, packs_);
    return *made;
  }

  // In the space that the encoding reads.
  Vec3 placed(const Vec3d& p) const {
    if (field_.options.space == Space::kNdc)
      return point_to_ndc(field_.ndc, p).value_or(Vec3d{0, 0, -1}).cast<Real>();
    const Vec3 at = p.cast<Real>();
    return field_.options.space == Space::kContract ? contract(at) : at;
  }

  // Of a density in the cube of normalised device coordinates per unit of the engine.
  double per_unit(const FieldPoints& points, size_t at) const {
    return per_unit(points, at, points.positions[at]);
  }
  double per_unit(const FieldPoints& points, size_t at, const Vec3d& p) const {
    if (field_.options.space != Space::kNdc) return 1;
    const Vec3d forward = field_.ndc.reference.rotation.column(2);
    return ndc_stretch(field_.ndc, p, points.directions.empty() ? forward : points.directions[at]);
  }
  // Its derivative by the position, from differences in double.
  Vec3 per_unit_slope(const FieldPoints& points, size_t at) const {
    Vec3 slope{0, 0, 0};
    if (field_.options.space != Space::kNdc) return slope;
    const Vec3d& p = points.positions[at];
    const double step = 1e-5 * std::max(1.0, length(p - field_.ndc.reference.translation));
    for (int k = 0; k < 3; ++k) {
      Vec3d before = p, behind = p;
      before[k] -= step;
      behind[k] += step;
      slope[k] = static_cast<Real>((per_unit(points, at, behind) - per_unit(points, at, before)) /
                                   (2 * step));
    }
    return slope;
  }

  void place(const FieldPoints& points, size_t begin, int n, Worker& w) {
    const NetworkOptions& o = field_.options;
    Chunk& c = w.chunk;
    const int64_t ld = c.stride(w.tape.position), lr = c.stride(w.tape.directions);
    for (int i = 0; i < n; ++i) {
      const size_t at = begin + static_cast<size_t>(i);
      ray_begin_[i] = i;
      const Vec3 p = placed(points.positions[at]);
      for (int k = 0; k < position_rows(o); ++k) {
        c.data(w.tape.position)[k * ld + i] = dot(axes_[static_cast<size_t>(k)], p);
        if (o.integrated()) c.data(w.tape.variance)[k * ld + i] = 0;
      }
      const Vec3d d = points.directions.empty() ? Vec3d{0, 0, 1} : points.directions[at];
      for (int k = 0; k < 3; ++k) c.data(w.tape.directions)[k * lr + i] = static_cast<Real>(d[k]);
    }
    if (w.tape.code >= 0)
      fill_rows(points.photo < 0
                    ? field_.default_code(points.time)
                    : appearance_of(field_.books, field_.weights.span(), points.photo).code,
                n, w.tape.code, c);
    for (int i = 0; i < n && field_.options.deform.any(); ++i)
      moments_.place(w.tape, c, i, points.time, -1);
    ray_begin_[n] = n;
    c.samples = c.rays = n;
    c.ray_begin = ray_begin_;
  }

  void ask_block(const FieldPoints& points, const FieldAnswers& answers, size_t begin, int n) {
    if (!answers.gradient.empty()) find_gradient(points, answers, begin, n);
    const bool coloured = !answers.rgb.empty();
    if (!coloured && answers.density.empty()) return;
    Worker& w = worker(plain_, NetworkTape::Purpose::kPoints);
    place(points, begin, n, w);
    if (coloured)
      w.tape.forward(w.chunk);
    else
      w.tape.forward_weights(w.chunk);
    const Chunk& c = w.chunk;
    for (int i = 0; !answers.density.empty() && i < n; ++i) {
      const size_t at = begin + static_cast<size_t>(i);
      answers.density[at] =
          static_cast<Real>(static_cast<double>(c.data(w.tape.density)[i]) * per_unit(points, at));
    }
    const int64_t lc = coloured ? c.stride(w.tape.colour) : 0;
    for (int i = 0; coloured && i < n; ++i)
      for (int64_t k = 0; k < 3; ++k)
        answers.rgb[3 * (begin + static_cast<size_t>(i)) + static_cast<size_t>(k)] =
            std::clamp(c.data(w.tape.colour)[k * lc + i], 0.0_r, 1.0_r);
  }

  void find_gradient(const FieldPoints& points, const FieldAnswers& answers, size_t begin, int n) {
    Worker& w = worker(sloped_, NetworkTape::Purpose::kGradient);
    place(points, begin, n, w);
    if (unused_.size() == 0) unused_ = AlignedArray<Real>(field_.weights.size());
    w.chunk.weight_gradient = unused_.data();
    std::fill_n(w.chunk.data(w.tape.density_gradient), n, 1.0_r);
    w.tape.tape.forward(w.chunk);
    w.tape.tape.backward(w.chunk);
    const Real* gradient = w.chunk.gradient(w.tape.position);
    const int64_t ld = w.chunk.stride(w.tape.position);
    for (int i = 0; i < n; ++i) {
      const size_t at = begin + static_cast<size_t>(i);
      Vec3 g{0, 0, 0};
      for (int k = 0; k < position_rows(field_.options); ++k)
        g = g + axes_[static_cast<size_t>(k)] * gradient[k * ld + i];
      g = unplaced(points.positions[at], g) * static_cast<Real>(per_unit(points, at)) +
          per_unit_slope(points, at) * std::as_const(w.chunk).data(w.tape.density)[i];
      for (int k = 0; k < 3; ++k) answers.gradient[3 * at + static_cast<size_t>(k)] = g[k];
    }
  }

  // A gradient by placed() of p, by p.
  Vec3 unplaced(const Vec3d& p, const Vec3& g) const {
    if (field_.options.space == Space::kContract)
      return contraction_jacobian(p.cast<Real>())(g);  // symmetric
    if (field_.options.space != Space::kNdc) return g;
    const NdcFrame& f = field_.ndc;
    const Vec3d c = f.reference.rotation.transposed() * (p - f.reference.translation);
    if (!(c.z > 0)) return {0, 0, 0};
    const Vec3d d = g.cast<double>();
    const Vec3d by_camera{
        d.x * f.scale_x / c.z, d.y * f.scale_y / c.z,
        (2 * f.near * d.z - d.x * f.scale_x * c.x - d.y * f.scale_y * c.y) / (c.z * c.z)};
    return (f.reference.rotation * by_camera).cast<Real>();
  }

  const NetworkField& field_;
  std::span<const Vec3> axes_;
  const LayerPacks* packs_;
  Moments moments_;
  std::unique_ptr<Worker> plain_, sloped_;
  int32_t ray_begin_[kBlock + 1];
  AlignedArray<Real> unused_;  // gradient of the networks
};

}  // namespace

std::unique_ptr<FieldQuery> NetworkField::query(const LayerPacks* packs) const {
  return std::make_unique<NetworkQuery>(*this, packs);
}

}  // namespace nerf
