#include "nerf/model/network_field.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "nerf/base/error.h"
#include "nerf/kernels/simd.h"
#include "nerf/math/random.h"

namespace nerf {

template CollectedOptions collect_options(NetworkOptions&);

namespace {

// Layers of one network, one behind the other in the field's weights.
class Placement {
 public:
  explicit Placement(size_t begin) : at_(begin) {}
  LinearWeights layer(int in, int out) {
    const LinearWeights w{at_, in, out, /*bias=*/true};
    at_ += w.size();
    return w;
  }
  size_t at() const { return at_; }

 private:
  size_t at_;
};

RadianceNetwork place_network(const NetworkOptions& o, int depth, int width, bool colour,
                              bool transient, size_t begin) {
  RadianceNetwork n;
  Placement place(begin);
  n.begin = begin;
  const int in = position_features(o);
  int from = in;
  for (int i = 0; i < depth; ++i) {
    n.trunk.push_back(place.layer(from, width));
    from = width + (input_behind(o, i, depth) ? in : 0);
  }
  n.density = place.layer(width, 1);
  n.has_colour = colour;
  if (colour && o.view_dependence) {
    n.bottleneck = place.layer(width, o.bottleneck);
    n.view = place.layer(o.bottleneck + direction_features(o) + o.light(), o.view_width);
    n.colour = place.layer(o.view_width, 3);
  } else if (colour) {
    n.colour = place.layer(width, 3);
  }
  if (transient) {
    int inputs = o.bottleneck + o.transient_code;
    for (int i = 0; i < o.transient_depth; ++i, inputs = o.transient_width)
      n.transient.push_back(place.layer(inputs, o.transient_width));
    n.transient.push_back(place.layer(inputs, kTransientRows));
  }
  n.end = place.at();
  return n;
}

template <class Network, class F>
void each_layer(Network& n, const F& f) {
  for (auto& w : n.trunk) f(w);
  for (auto* w : {&n.density, &n.bottleneck, &n.view, &n.colour})
    if (w->out > 0) f(*w);
  for (auto& w : n.transient) f(w);
}

void uniform_weights(const LinearWeights& w, Initialisation kind, Random random, Real* weights) {
  const Real fan = static_cast<Real>(kind == Initialisation::kHe ? w.in : w.in + w.out);
  const Real bound = std::sqrt(6.0_r / fan);
  for (int j = 0; j < w.out; ++j)
    for (int k = 0; k < w.in; ++k)
      weights[w.offset + static_cast<size_t>(j) * static_cast<size_t>(weight_stride(w.in)) +
              static_cast<size_t>(k)] = bound * (2 * random.uniform() - 1);
}

// Even, of variance 1 / numbers, as mip-NeRF 360's embeddings begin (flax.linen.Embed), or with the
// spread that is asked for.
void first_codes(const LinearWeights& w, const NetworkOptions& o, Random random, Real* weights) {
  const Real variance =
      o.code_spread > 0 ? o.code_spread * o.code_spread : 1 / static_cast<Real>(std::max(w.in, 1));
  for (int j = 0; j < w.out; ++j)
    for (int k = 0; k < w.in; ++k)
      weights[w.offset + static_cast<size_t>(j) * static_cast<size_t>(weight_stride(w.in)) +
              static_cast<size_t>(k)] = std::sqrt(3 * variance) * (2 * random.uniform() - 1);
}

// Of moments and cameras: even in [0, 0.05), as google/nerfies begins its own.
void first_numbers(const LinearWeights& w, Random random, Real* weights) {
  for (int j = 0; j < w.out; ++j)
    for (int k = 0; k < w.in; ++k)
      weights[w.offset + static_cast<size_t>(j) * static_cast<size_t>(weight_stride(w.in)) +
              static_cast<size_t>(k)] = 0.05_r * random.uniform();
}

std::vector<Vec3> halved_icosahedron() {
  const double g = (1 + std::sqrt(5.0)) / 2;
  std::vector<Vec3d> vertices;
  for (int axis = 0; axis < 3; ++axis)
    for (double a : {-1.0, 1.0})
      for (double b : {-g, g}) {
        Vec3d v;
        v[axis] = 0;
        v[(axis + 1) % 3] = a;
        v[(axis + 2) % 3] = b;
        vertices.push_back(normalized(v));
      }
  std::vector<Vec3d> all = vertices;
  // The edge of an icosahedron with unit radius is 4 / sqrt(10 + 2 sqrt 5) long; no other two
  // vertices are as near.
  const double edge = 4 / std::sqrt(10 + 2 * std::sqrt(5.0));
  for (size_t i = 0; i < vertices.size(); ++i)
    for (size_t j = 0; j < i; ++j)
      if (length(vertices[i] - vertices[j]) < 1.01 * edge)
        all.push_back(normalized(vertices[i] + vertices[j]));
  std::vector<Vec3> half;
  std::vector<Vec3d> kept;
  for (const Vec3d& v : all)
    if (std::ranges::none_of(kept, [&](const Vec3d& u) { return length(u + v) < 1e-6; })) {
      kept.push_back(v);
      half.push_back(v.cast<Real>());
    }
  return half;
}

}  // namespace

std::span<const Vec3> off_axis_directions() {
  static const std::vector<Vec3> directions = halved_icosahedron();
  return directions;
}

std::span<const Vec3> encoding_axes(const NetworkOptions& options) {
  static constexpr std::array<Vec3, 3> kAxes{Vec3{1, 0, 0}, Vec3{0, 1, 0}, Vec3{0, 0, 1}};
  return options.encoding == Encoding::kOffAxis ? off_axis_directions() : kAxes;
}

int position_rows(const NetworkOptions& o) {
  return o.encoding == Encoding::kOffAxis ? static_cast<int>(off_axis_directions().size()) : 3;
}

int position_features(const NetworkOptions& o) {
  return 2 * o.position_degrees * position_rows(o) + (o.integrated() ? 0 : 3) +
         ambient_features(o.deform);
}

int direction_features(const NetworkOptions& o) { return 3 + 6 * o.direction_degrees; }

size_t RadianceNetwork::parameters() const {
  size_t sum = 0;
  each_layer(*this, [&](const LinearWeights& w) { sum += w.parameters(); });
  return sum;
}

bool input_behind(const NetworkOptions& o, int layer, int depth) {
  return o.skip > 0 && layer > 0 && layer % o.skip == 0 && layer + 1 < depth;
}

void NetworkOptions::check_options() const {
  if (integrated() && position_degrees == 0)
    throw Error("an integrated encoding needs at least one frequency", "--network-position-degrees",
                "give 1 or more");
  if (cast == Cast::kCone && sampling.resampling == Resampling::kCoarseFine)
    throw Error("cones need intervals, which coarse+fine resampling does not have",
                "--network-cast", "take blurred or proposal resampling, or points");
  if (sampling.resampling == Resampling::kCoarseFine && sampling.rounds > 0 && sampling.coarse < 4)
    throw Error("coarse+fine resampling needs at least 4 coarse samples",
                "--network-sampling-coarse", "give 4 or more");
  if (space == Space::kNdc && sampling.spacing == Spacing::kInverse)
    throw Error("normalised device coordinates are even in inverse depth already, from 0 on",
                "--network-sampling-spacing", "take uniform with --network-space ndc");
  if (image_code > 0 && !view_dependence)
    throw Error("photos' codes join the view direction, which colours do not depend on",
                "--network-image-code", "leave it out, or give --network-view-dependence");
  if (transient_code > 0 && !view_dependence)
    throw Error("what is transient is found from the features that the view direction joins",
                "--network-transient-code", "leave it out, or give --network-view-dependence");
  if (camera_code > 0 && !view_dependence)
    throw Error("cameras' codes join the view direction, which colours do not depend on",
                "--network-camera-code", "leave it out, or give --network-view-dependence");
  if (deform.any() && integrated())
    throw Error("points are moved, and integrated encodings have none", "--network-deform-warp",
                "take --network-encoding frequency");
  if (deform.still_start && deform.warp != WarpKind::kTranslation)
    throw Error("translations alone can be told to stand still at time 0",
                "--network-deform-still-start", "take --network-deform-warp translation");
  if (!proposal_colour && shared && sampling.rounds > 0)
    throw Error("a network that all levels share has colours at every level", "--network-shared",
                "leave it out, or give --network-proposal-colour");
}

std::vector<RadianceNetwork> place_networks(const NetworkOptions& o, const CodeShape& codes) {
  std::vector<RadianceNetwork> networks;
  DeformNetworks deform(o.deform, 0);
  size_t at = deform.end;
  if (o.sampling.rounds > 0 && !o.shared) {
    networks.push_back(
        place_network(o, o.proposal_depth, o.proposal_width, o.proposal_colour, false, at));
    at = networks.back().end;
  }
  networks.push_back(place_network(o, o.depth, o.width, /*colour=*/true, o.transient_code > 0, at));
  std::vector<LinearWeights*> layers = deform.layers();
  for (RadianceNetwork& n : networks)
    each_layer(n, [&](LinearWeights& w) { layers.push_back(&w); });
  place_packs(layers);
  const CodeBooks books(codes, networks.back().end);
  deform.codes = books.deformation;
  deform.planes = books.plane;
  deform.codes.in = o.deform.code;
  deform.planes.in = o.deform.ambient;
  for (RadianceNetwork& n : networks) {
    n.codes = books.appearance;
    n.camera_codes = books.camera;
    n.transient_codes = books.transient;
    n.codes.in = o.image_code;
    n.camera_codes.in = o.camera_code;
    n.transient_codes.in = o.transient_code;
    n.deform = deform;
  }
  return networks;
}

CodeShape code_shape(const NetworkOptions& o, std::vector<std::string> photos) {
  CodeShape shape{o.image_code, false, std::move(photos), o.transient_code};
  if (o.deform.any() && o.deform.code > 0) shape.deformation = o.deform.code;
  if (o.deform.slice == Slice::kPlane) shape.plane = o.deform.ambient;
  shape.camera = o.camera_code;
  return shape;
}

NetworkField::NetworkField(const CodeShape& codes, const NetworkOptions& o, double n, double f)
    : options(o), near(n), far(f), networks(place_networks(o, codes)) {
  simd_target();  // chosen, or found missing, before any kernel runs
  books = CodeBooks(codes, network_size());
  weights = AlignedArray<Real>(network_size() + books.size());
}

std::vector<Real> NetworkField::default_code(Real time, int camera) const {
  if (!books.photo_moments.empty() || !books.cameras.empty())
    return appearance_at(books, weights.span(), static_cast<double>(time), camera).code;
  return std::vector<Real>(static_cast<size_t>(options.light()), 0.0_r);
}

size_t NetworkField::parameters() const {
  size_t sum = 0;
  for (const RadianceNetwork& n : networks) sum += n.parameters();
  DeformNetworks deform = networks.back().deform;
  for (const LinearWeights* w : deform.layers()) sum += w->parameters();
  return sum;
}

std::vector<LinearWeights> NetworkField::layers() const {
  std::vector<LinearWeights> all;
  DeformNetworks deform = networks.back().deform;
  for (const LinearWeights* w : deform.layers()) all.push_back(*w);
  for (const RadianceNetwork& n : networks)
    each_layer(n, [&](const LinearWeights& w) { all.push_back(w); });
  return all;
}

void NetworkField::initialise(uint64_t seed) {
  constexpr uint64_t kStream = random_key(RandomStream::kFirstNetworks);
  std::fill(weights.begin(), weights.end(), 0.0_r);
  uint64_t layer = networks.back().deform.initialise(seed, 0, weights.data());
  for (const RadianceNetwork& n : networks)
    each_layer(n, [&](const LinearWeights& w) {
      uniform_weights(w, options.initialisation, Random(seed, kStream, layer++), weights.data());
    });
  for (const LinearWeights* table : {&books.appearance, &books.transient})
    first_codes(*table, options, Random(seed, kStream, layer++), weights.data());
  for (const LinearWeights* table : {&books.deformation, &books.plane, &books.camera})
    first_numbers(*table, Random(seed, kStream, layer++), weights.data());
}

}  // namespace nerf
