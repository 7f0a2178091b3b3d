// A radiance network with its rendering and its colour loss on any scalar type, from what a
// NetworkTape is given.
#pragma once

#include <cmath>
#include <cstddef>
#include <vector>

#include "autodiff/reference_ops.h"
#include "nerf/model/network_field.h"

namespace nerf::test {

// The inputs of NetworkTape by their names; those that a network does not read stay empty.
template <class T>
struct NetworkInputs {
  Columns<T> position, variance, directions, delta, background, target, scale, photo;
};

template <class T>
struct NetworkOutputs {
  Columns<T> weights, loss;  // loss: a term of each ray, where the network has colours
};

template <class T>
NetworkOutputs<T> network_template(const NetworkOptions& o, const RadianceNetwork& n,
                                   const std::vector<T>& weights, const NetworkInputs<T>& in,
                                   const Rays& rays, const NetworkTape::Losses& losses) {
  const auto degrees = [](int count) {
    return std::vector<double>(static_cast<size_t>(count), 1.0);
  };
  const Columns<T> code =
      o.integrated()
          ? on_columns::integrated_encoding(in.position, in.variance, o.position_degrees)
          : on_columns::frequency_encoding(in.position, degrees(o.position_degrees), true);
  Columns<T> h = code;
  for (size_t i = 0; i < n.trunk.size(); ++i) {
    h = on_columns::linear(h, weights, n.trunk[i], true);
    if (i > 0 && i + 1 < n.trunk.size() && o.skip > 0 && i % static_cast<size_t>(o.skip) == 0)
      h = on_columns::concat(code, h);
  }
  const Columns<T> raw = on_columns::linear(h, weights, n.density, false);
  const Columns<T> density =
      o.density == DensityActivation::kSoftplus
          ? on_columns::softplus(raw, static_cast<double>(o.density_bias))
          : on_columns::relu(on_columns::scale_shift(raw, 1, static_cast<double>(o.density_bias)));
  NetworkOutputs<T> out;
  out.weights = on_columns::render_weights(density, in.delta, rays, o.opaque_end);
  if (!n.has_colour) return out;
  Columns<T> seen = h;
  if (o.view_dependence) {
    const Columns<T> view =
        on_columns::frequency_encoding(in.directions, degrees(o.direction_degrees), true);
    seen = on_columns::linear(h, weights, n.bottleneck, false);
    seen = on_columns::concat(seen, on_columns::repeat_for_samples(view, rays));
    if (o.image_code > 0)
      seen = on_columns::concat(
          seen,
          on_columns::repeat_for_samples(on_columns::table_rows(in.photo, weights, n.codes), rays));
    seen = on_columns::linear(seen, weights, n.view, true);
  }
  const double padding = static_cast<double>(o.colour_padding);
  const auto activated = [&](const Columns<T>& x) {
    return on_columns::scale_shift(on_columns::sigmoid(x), 1 + 2 * padding, -padding);
  };
  const Columns<T> colour = activated(on_columns::linear(seen, weights, n.colour, false));
  if (losses.transient && !n.transient.empty()) {
    Columns<T> x =
        on_columns::concat(on_columns::linear(h, weights, n.bottleneck, false),
                           on_columns::repeat_for_samples(
                               on_columns::table_rows(in.photo, weights, n.transient_codes), rays));
    for (size_t i = 0; i < n.transient.size(); ++i)
      x = on_columns::linear(x, weights, n.transient[i], i + 1 < n.transient.size());
    const Columns<T> passing = on_columns::softplus(on_columns::slice(x, 0, 1), 0);
    const Columns<T> both = on_columns::composite_transient<T>(
        {density, colour, passing, activated(on_columns::slice(x, 1, 3)),
         on_columns::softplus(on_columns::slice(x, 4, 1), 0)},
        in.delta, in.background, rays, o.opaque_end);
    out.loss = on_columns::uncertain_loss(both, in.target, in.scale,
                                          static_cast<double>(losses.least_deviation));
    for (const auto& term : on_columns::mean_loss(passing, in.scale, rays,
                                                  static_cast<double>(losses.transient_density)))
      out.loss.push_back(term);
    return out;
  }
  const Columns<T> pixel = on_columns::accumulate(out.weights, colour, in.background, rays);
  const double epsilon = static_cast<double>(losses.pixel.parameter);
  out.loss = on_columns::pixel_loss(pixel, in.target, in.scale, [&](T e) {
    return epsilon > 0 ? reference::charbonnier(e, epsilon) : reference::squared(e);
  });
  return out;
}

}  // namespace nerf::test
