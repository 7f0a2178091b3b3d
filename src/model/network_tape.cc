// A network of a paper's method with its rendering and its losses, written on a tape.
#include <vector>

#include "nerf/model/network_field.h"

namespace nerf {

namespace {

// The residual from which on a Jacobian's error hardly counts more (Park et al. 2021, section 3.3).
constexpr Real kElasticPenalty = 0.03_r;

Value activated(Tape& tape, const NetworkOptions& o, Value raw) {
  const Value colour = sigmoid(tape, raw);
  if (o.colour_padding == 0) return colour;
  return scale_shift(tape, colour, 1 + 2 * o.colour_padding, -o.colour_padding);
}

}  // namespace

Value record_colour(Tape& tape, const NetworkOptions& o, const RadianceNetwork& n, Value features,
                    Value directions, Value numbers) {
  Value seen = features;
  if (o.view_dependence) {
    const std::vector<Real> all(static_cast<size_t>(o.direction_degrees), 1.0_r);
    const Value view = frequency_encoding(tape, directions, all, /*identity=*/true);
    seen = concat(tape, seen, repeat_for_samples(tape, view));
    if (numbers >= 0) seen = concat(tape, seen, repeat_for_samples(tape, numbers));
    seen = linear(tape, seen, n.view, LinearActivation::kRelu);
  }
  return activated(tape, o, linear(tape, seen, n.colour, LinearActivation::kNone));
}

NetworkTape::NetworkTape(const NetworkOptions& o, const RadianceNetwork& n, int samples, int rays,
                         Purpose purpose, const Losses& losses)
    : tape(samples, rays) {
  const bool points = purpose == Purpose::kPoints, sloped = purpose == Purpose::kGradient;
  const bool train = purpose == Purpose::kTrain;
  const bool transient = train && losses.colour && losses.transient && !n.transient.empty();
  position = tape.input(position_rows(o), Domain::kSamples, /*gradient=*/sloped);
  if (o.integrated()) variance = tape.input(position_rows(o), Domain::kSamples);
  directions = tape.input(3, Domain::kRays);
  delta = tape.input(1, Domain::kSamples);
  background = tape.input(3, Domain::kRays);

  const Value encoded = record_position(o, n, purpose, losses);
  Value h = encoded;
  const int depth = static_cast<int>(n.trunk.size());
  for (int i = 0; i < depth; ++i) {
    h = linear(tape, h, n.trunk[static_cast<size_t>(i)], LinearActivation::kRelu);
    if (input_behind(o, i, depth)) h = concat(tape, encoded, h);
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
  } else if (!points && !transient) {
    weights = render_weights(tape, density, delta, o.opaque_end);
  }
  weight_operations_ = tape.operations();

  if (n.has_colour && (purpose == Purpose::kRender || points || (train && losses.colour))) {
    if (o.view_dependence) features = linear(tape, h, n.bottleneck, LinearActivation::kNone);
    Value numbers = -1;
    if (train && (o.image_code > 0 || transient)) photo = tape.input(1, Domain::kRays);
    if (train && o.image_code > 0) numbers = table_rows(tape, photo, n.codes);
    if (train && o.camera_code > 0) {
      camera = tape.input(1, Domain::kRays);
      const Value own = table_rows(tape, camera, n.camera_codes);
      numbers = numbers < 0 ? own : concat(tape, numbers, own);
    }
    if (!train && o.light() > 0) numbers = code = tape.input(o.light(), Domain::kRays);
    colour = record_colour(tape, o, n, o.view_dependence ? features : h, directions, numbers);
    if (transient)
      record_transient(o, n, losses);
    else if (!points)
      pixel = accumulate(tape, weights, colour, background);
  }
  if (train) {
    if (pixel >= 0 && !transient) pixel_loss = record_pixel_loss(tape, pixel, losses.pixel);
    if (losses.on_weights) {
      weight_gradient = tape.input(1, Domain::kSamples);
      add_gradient(tape, weights, weight_gradient);
    }
    if (deform.jacobian[0] >= 0) {
      deform.elastic_scale = tape.input(1, Domain::kRays);
      elastic_loss(tape, deform.jacobian, weights, deform.elastic_scale, kElasticPenalty);
    }
  }
  tape.plan();
}

// The static matter's weights are those it has alone, as in pictures. They reach its density only
// where a loss on them does.
void NetworkTape::record_transient(const NetworkOptions& o, const RadianceNetwork& n,
                                   const Losses& losses) {
  const Value numbers = table_rows(tape, photo, n.transient_codes);
  Value x = concat(tape, features, repeat_for_samples(tape, numbers));
  for (size_t i = 0; i + 1 < n.transient.size(); ++i)
    x = linear(tape, x, n.transient[i], LinearActivation::kRelu);
  x = linear(tape, x, n.transient.back(), LinearActivation::kNone);
  const Value passing = softplus(tape, slice(tape, x, 0, 1), 0);
  const Value passing_colour = activated(tape, o, slice(tape, x, 1, 3));
  const Value deviation = softplus(tape, slice(tape, x, 4, 1), 0);
  const Composite all = composite_transient(
      tape, {density, colour, passing, passing_colour, deviation}, delta, background, o.opaque_end);
  pixel = all.pixel;
  weights = losses.on_weights ? render_weights(tape, density, delta, o.opaque_end) : all.weights;
  pixel_loss.target = tape.input(3, Domain::kRays);
  pixel_loss.scale = tape.input(1, Domain::kRays);
  uncertain_loss(tape, pixel, pixel_loss.target, pixel_loss.scale, losses.least_deviation);
  if (losses.transient_density > 0)
    mean_loss(tape, passing, pixel_loss.scale, losses.transient_density);
}

}  // namespace nerf
