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

// Whether the input is concatenated behind layer i: every skip-th, but not behind the last, where
// nothing would read it.
bool skip_behind(int i, int skip, int depth) {
  return skip > 0 && i > 0 && i % skip == 0 && i + 1 < depth;
}

RadianceNetwork place_network(const NetworkOptions& o, int depth, int width, bool colour,
                              size_t begin) {
  RadianceNetwork n;
  Placement place(begin);
  n.begin = begin;
  const int in = position_features(o);
  int from = in;
  for (int i = 0; i < depth; ++i) {
    n.trunk.push_back(place.layer(from, width));
    from = width + (skip_behind(i, o.skip, depth) ? in : 0);
  }
  n.density = place.layer(width, 1);
  n.has_colour = colour;
  if (colour && o.view_dependence) {
    n.bottleneck = place.layer(width, o.bottleneck);
    n.view = place.layer(o.bottleneck + direction_features(o) + o.image_code, o.view_width);
    n.colour = place.layer(o.view_width, 3);
  } else if (colour) {
    n.colour = place.layer(width, 3);
  }
  n.end = place.at();
  return n;
}

template <class Network, class F>
void each_layer(Network& n, const F& f) {
  for (auto& w : n.trunk) f(w);
  for (auto* w : {&n.density, &n.bottleneck, &n.view, &n.colour})
    if (w->out > 0) f(*w);
}

void uniform_weights(const LinearWeights& w, Initialisation kind, Random random, Real* weights) {
  const Real fan = static_cast<Real>(kind == Initialisation::kHe ? w.in : w.in + w.out);
  const Real bound = std::sqrt(6.0_r / fan);
  for (int j = 0; j < w.out; ++j)
    for (int k = 0; k < w.in; ++k)
      weights[w.offset + static_cast<size_t>(j) * static_cast<size_t>(weight_stride(w.in)) +
              static_cast<size_t>(k)] = bound * (2 * random.uniform() - 1);
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
  return 2 * o.position_degrees * position_rows(o) + (o.integrated() ? 0 : 3);
}

int direction_features(const NetworkOptions& o) { return 3 + 6 * o.direction_degrees; }

size_t RadianceNetwork::parameters() const {
  size_t sum = 0;
  each_layer(*this, [&](const LinearWeights& w) { sum += w.parameters(); });
  return sum;
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
  if (!proposal_colour && shared && sampling.rounds > 0)
    throw Error("a network that all levels share has colours at every level", "--network-shared",
                "leave it out, or give --network-proposal-colour");
}

std::vector<RadianceNetwork> place_networks(const NetworkOptions& o, int photos) {
  std::vector<RadianceNetwork> networks;
  size_t at = 0;
  if (o.sampling.rounds > 0 && !o.shared) {
    networks.push_back(place_network(o, o.proposal_depth, o.proposal_width, o.proposal_colour, at));
    at = networks.back().end;
  }
  networks.push_back(place_network(o, o.depth, o.width, /*colour=*/true, at));
  const LinearWeights codes{networks.back().end, o.image_code, o.image_code > 0 ? photos : 0};
  for (RadianceNetwork& n : networks) n.codes = codes;
  std::vector<LinearWeights*> layers;
  for (RadianceNetwork& n : networks)
    each_layer(n, [&](LinearWeights& w) { layers.push_back(&w); });
  place_packs(layers);
  return networks;
}

CodeShape code_shape(const NetworkOptions& o, std::vector<std::string> photos) {
  return {o.image_code, false, std::move(photos)};
}

NetworkField::NetworkField(const NetworkOptions& o, double n, double f,
                           std::vector<std::string> photos)
    : options(o), near(n), far(f), networks(place_networks(o, static_cast<int>(photos.size()))) {
  simd_target();  // chosen, or found missing, before any kernel runs
  books = CodeBooks(code_shape(o, std::move(photos)), network_size());
  weights = AlignedArray<Real>(network_size() + books.size());
}

size_t NetworkField::parameters() const {
  size_t sum = 0;
  for (const RadianceNetwork& n : networks) sum += n.parameters();
  return sum;
}

std::vector<LinearWeights> NetworkField::layers() const {
  std::vector<LinearWeights> all;
  for (const RadianceNetwork& n : networks)
    each_layer(n, [&](const LinearWeights& w) { all.push_back(w); });
  return all;
}

void NetworkField::initialise(uint64_t seed) {
  constexpr uint64_t kStream = random_key(RandomStream::kFirstNetworks);
  std::fill(weights.begin(), weights.end(), 0.0_r);
  uint64_t layer = 0;
  for (const RadianceNetwork& n : networks)
    each_layer(n, [&](const LinearWeights& w) {
      uniform_weights(w, options.initialisation, Random(seed, kStream, layer++), weights.data());
    });
  // Of variance 1 / image_code, as the authors' embeddings begin (flax.linen.Embed).
  const LinearWeights& c = books.appearance;
  Random random(seed, kStream, layer++);
  for (int j = 0; j < c.out; ++j)
    for (int k = 0; k < c.in; ++k)
      weights[c.offset + static_cast<size_t>(j) * static_cast<size_t>(weight_stride(c.in)) +
              static_cast<size_t>(k)] =
          std::sqrt(3.0_r / static_cast<Real>(c.in)) * (2 * random.uniform() - 1);
}

NetworkTape::NetworkTape(const NetworkOptions& o, const RadianceNetwork& n, int samples, int rays,
                         Purpose purpose, const Losses& losses)
    : tape(samples, rays) {
  const bool points = purpose == Purpose::kPoints, sloped = purpose == Purpose::kGradient;
  position = tape.input(position_rows(o), Domain::kSamples, /*gradient=*/sloped);
  if (o.integrated()) variance = tape.input(position_rows(o), Domain::kSamples);
  directions = tape.input(3, Domain::kRays);
  delta = tape.input(1, Domain::kSamples);
  background = tape.input(3, Domain::kRays);

  const std::vector<Real> open(static_cast<size_t>(o.position_degrees), 1.0_r);
  const Value encoded = o.integrated()
                            ? integrated_encoding(tape, position, variance, o.position_degrees)
                            : frequency_encoding(tape, position, open, /*identity=*/true);
  Value h = encoded;
  const int depth = static_cast<int>(n.trunk.size());
  for (int i = 0; i < depth; ++i) {
    h = linear(tape, h, n.trunk[static_cast<size_t>(i)], LinearActivation::kRelu);
    if (skip_behind(i, o.skip, depth)) h = concat(tape, encoded, h);
  }
  Value raw = linear(tape, h, n.density, LinearActivation::kNone);
  if (losses.density_noise) {
    noise = tape.input(1, Domain::kSamples);
    raw = add(tape, raw, noise);
  }
  if (o.density == DensityActivation::kSoftplus)
    density = softplus(tape, raw, o.density_bias);
  else
    density = relu(tape, o.density_bias == 0 ? raw : scale_shift(tape, raw, 1, o.density_bias));
  if (sloped) {
    density_gradient = tape.input(1, Domain::kSamples);
    add_gradient(tape, density, density_gradient);
  } else if (!points) {
    weights = render_weights(tape, density, delta, o.opaque_end);
  }
  weight_operations_ = tape.operations();

  if (n.has_colour &&
      (purpose == Purpose::kRender || points || (purpose == Purpose::kTrain && losses.colour))) {
    Value seen = h;
    if (o.view_dependence) {
      const std::vector<Real> all(static_cast<size_t>(o.direction_degrees), 1.0_r);
      const Value view = frequency_encoding(tape, directions, all, /*identity=*/true);
      seen = linear(tape, h, n.bottleneck, LinearActivation::kNone);
      seen = concat(tape, seen, repeat_for_samples(tape, view));
      if (o.image_code > 0) {
        Value numbers;
        if (purpose == Purpose::kTrain) {
          photo = tape.input(1, Domain::kRays);
          numbers = table_rows(tape, photo, n.codes);
        } else {
          numbers = code = tape.input(o.image_code, Domain::kRays);
        }
        seen = concat(tape, seen, repeat_for_samples(tape, numbers));
      }
      seen = linear(tape, seen, n.view, LinearActivation::kRelu);
    }
    colour = sigmoid(tape, linear(tape, seen, n.colour, LinearActivation::kNone));
    if (o.colour_padding > 0)
      colour = scale_shift(tape, colour, 1 + 2 * o.colour_padding, -o.colour_padding);
    if (!points) pixel = accumulate(tape, weights, colour, background);
  }
  if (purpose == Purpose::kTrain) {
    if (pixel >= 0) pixel_loss = record_pixel_loss(tape, pixel, losses.pixel);
    if (losses.on_weights) {
      weight_gradient = tape.input(1, Domain::kSamples);
      add_gradient(tape, weights, weight_gradient);
    }
  }
  tape.plan();
}

}  // namespace nerf
