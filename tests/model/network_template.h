// A radiance network with its rendering and its colour loss on any scalar type, from what a
// NetworkTape is given.
#pragma once

#include <cmath>
#include <cstddef>
#include <vector>

#include "autodiff/elastic_reference.h"
#include "autodiff/reference_ops.h"
#include "autodiff/tangent_check.h"
#include "nerf/model/network_field.h"
#include "parts/warp_columns.h"

namespace nerf::test {

// The inputs of NetworkTape by their names; those that a network does not read stay empty.
template <class T>
struct NetworkInputs {
  Columns<T> position, variance, directions, delta, background, target, scale, photo = {},
                                                                               camera = {};
  Columns<T> time = {}, moment = {}, moving = {}, elastic_scale = {};
  DeformWindows windows = {};
};

template <class T>
struct NetworkOutputs {
  Columns<T> weights, loss;  // loss: a term of each ray, where the network has colours
};

// Where a level's points stand in the canonical scene; the columns of the warp's Jacobian where it
// is held to be elastic; what is beside the position's features.
template <class T>
struct Deformed {
  Columns<T> canonical, ambient;
  std::vector<Columns<T>> jacobian;
};
template <class T>
Deformed<T> deformed(const NetworkOptions& o, const RadianceNetwork& n,
                     const std::vector<T>& weights, const NetworkInputs<T>& in, const Rays& rays) {
  const DeformOptions& d = o.deform;
  const Columns<T> of_ray =
      d.code > 0
          ? on_columns::table_rows(in.moment, weights, n.deform.codes)
          : on_columns::frequency_encoding(
                in.time, std::vector<double>(static_cast<size_t>(d.time_degrees), 1.0), true);
  const Columns<T> code = on_columns::repeat_for_samples(of_ray, rays);
  Deformed<T> out{in.position, {}, {}};
  if (d.warp != WarpKind::kNone) {
    out.canonical = on_columns::warped(n.deform.warp, in.position, code, weights, in.windows.warp);
    if (d.still_start) {
      const auto motion =
          on_columns::point_outputs(n.deform.warp, in.position, code, weights, in.windows.warp);
      const auto moving = on_columns::repeat_for_samples(in.moving, rays);
      out.canonical = on_columns::add(in.position, on_columns::multiply(motion, moving));
    }
  }
  for (size_t axis = 0; axis < 3 && !in.elastic_scale.empty(); ++axis) {
    const Columns<T> none(code.size(), std::vector<T>(n.deform.warp.shape.code, T(0)));
    Columns<T> along(code.size(), std::vector<T>(3, T(0)));
    for (auto& column : along) column[axis] = T(1);
    out.jacobian.push_back(
        part(on_columns::warped(n.deform.warp, dual(in.position, along), dual(code, none),
                                constants(weights), in.windows.warp),
             &TDual<T>::derivative));
  }
  if (d.slice == Slice::kNone) return out;
  const Columns<T> w = d.has_sheet()
                           ? on_columns::point_outputs(n.deform.sheet, in.position, code, weights,
                                                       DeformWindows::kOpen)
                           : on_columns::repeat_for_samples(
                                 on_columns::table_rows(in.moment, weights, n.deform.planes), rays);
  std::vector<double> window;
  for (int k = 0; k < d.ambient_degrees; ++k)
    window.push_back(reference::window_weight(in.windows.ambient, k));
  out.ambient = on_columns::frequency_encoding(w, window, false);
  return out;
}

template <class T>
NetworkOutputs<T> network_template(const NetworkOptions& o, const RadianceNetwork& n,
                                   const std::vector<T>& weights, const NetworkInputs<T>& in,
                                   const Rays& rays, const NetworkTape::Losses& losses) {
  const auto degrees = [](int count) {
    return std::vector<double>(static_cast<size_t>(count), 1.0);
  };
  Deformed<T> moved{in.position, {}, {}};
  if (o.deform.any()) moved = deformed(o, n, weights, in, rays);
  Columns<T> code =
      o.integrated()
          ? on_columns::integrated_encoding(in.position, in.variance, o.position_degrees)
          : on_columns::frequency_encoding(moved.canonical, degrees(o.position_degrees), true);
  if (!moved.ambient.empty()) code = on_columns::concat(code, moved.ambient);
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
  for (size_t r = 0; r + 1 < rays.size() && !moved.jacobian.empty(); ++r)
    for (size_t s = static_cast<size_t>(rays[r]); s < static_cast<size_t>(rays[r + 1]); ++s) {
      std::vector<T> numbers;
      for (const Columns<T>& column : moved.jacobian)
        numbers.insert(numbers.end(), column[s].begin(), column[s].end());
      using reference::stop_gradient;
      out.loss.push_back({in.elastic_scale[r][0] * stop_gradient(out.weights[s][0]) *
                          elastic_of(numbers, static_cast<double>(0.03_r))});
    }
  if (!n.has_colour || in.target.empty()) return out;
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
    if (o.camera_code > 0)
      seen = on_columns::concat(
          seen, on_columns::repeat_for_samples(
                    on_columns::table_rows(in.camera, weights, n.camera_codes), rays));
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
  const Columns<T> of_pixels = on_columns::pixel_loss(pixel, in.target, in.scale, [&](T e) {
    return epsilon > 0 ? reference::charbonnier(e, epsilon) : reference::squared(e);
  });
  out.loss.insert(out.loss.end(), of_pixels.begin(), of_pixels.end());
  return out;
}

}  // namespace nerf::test
