// The reference templates as functions of whole values, column by column, for gradient_check.h.
#pragma once

#include <array>
#include <type_traits>
#include <utility>
#include <vector>

#include "autodiff/gradient_check.h"
#include "nerf/math/reference/activations.h"
#include "nerf/math/reference/encoding.h"
#include "nerf/math/reference/huber.h"
#include "nerf/math/reference/linear.h"
#include "nerf/math/reference/pixel_losses.h"
#include "nerf/math/reference/rigid_motion.h"
#include "nerf/math/reference/spherical_harmonics.h"
#include "nerf/math/reference/transient.h"
#include "nerf/math/reference/values.h"
#include "nerf/math/reference/volume_rendering.h"

namespace nerf::on_columns {

// f of every column.
template <class T, class F>
Columns<T> each(const Columns<T>& x, const F& f) {
  Columns<T> y;
  for (const std::vector<T>& column : x) y.push_back(f(column));
  return y;
}

// f of every element.
template <class T, class F>
Columns<T> each_element(Columns<T> x, const F& f) {
  for (std::vector<T>& column : x)
    for (T& v : column) v = f(v);
  return x;
}

template <class T>
Columns<T> linear(const Columns<T>& x, const std::vector<T>& weights, const LinearWeights& w,
                  bool relu) {
  std::vector<T> packed;
  for (int j = 0; j < w.out; ++j)
    for (int k = 0; k < w.in; ++k)
      packed.push_back(weights[gradient_check::Problem::index(w, j, k)]);
  std::vector<T> bias;
  for (int j = 0; w.bias && j < w.out; ++j)
    bias.push_back(weights[w.bias_offset() + static_cast<size_t>(j)]);
  return each(x, [&](const std::vector<T>& c) {
    return reference::linear(packed, bias, c, static_cast<size_t>(w.out), relu);
  });
}

template <class T>
Columns<T> mlp(Columns<T> x, const std::vector<T>& weights,
               const std::vector<LinearWeights>& layers) {
  for (size_t i = 0; i < layers.size(); ++i)
    x = linear(x, weights, layers[i], i + 1 < layers.size());
  return x;
}

// f of the columns of both.
template <class T, class F>
Columns<T> each_pair(const Columns<T>& a, const Columns<T>& b, const F& f) {
  Columns<T> y;
  for (size_t s = 0; s < a.size(); ++s) y.push_back(f(a[s], b[s]));
  return y;
}

template <class T>
Columns<T> concat(const Columns<T>& a, const Columns<T>& b) {
  return each_pair(a, b, [](const auto& x, const auto& y) { return reference::concat(x, y); });
}

template <class T>
Columns<T> add(const Columns<T>& a, const Columns<T>& b) {
  return each_pair(a, b, [](const auto& x, const auto& y) { return reference::add(x, y); });
}

template <class T>
Columns<T> multiply(const Columns<T>& a, const Columns<T>& b) {
  return each_pair(a, b, [](const auto& x, const auto& y) { return reference::multiply(x, y); });
}

template <class T>
Columns<T> rigid_motion(const Columns<T>& screw, const Columns<T>& x) {
  return each_pair(screw, x,
                   [](const auto& s, const auto& p) { return reference::rigid_motion(s, p); });
}

template <class T>
Columns<T> slice(const Columns<T>& x, int first, int rows) {
  return each(x, [&](const std::vector<T>& c) {
    return reference::slice(c, static_cast<size_t>(first), static_cast<size_t>(rows));
  });
}

template <class T>
Columns<T> truncated_exp(const Columns<T>& x) {
  return each_element(x, [](T v) { return reference::truncated_exp(v); });
}

template <class T>
Columns<T> sigmoid(const Columns<T>& x) {
  return each_element(x, [](T v) {
    const T y = reference::sigmoid(v);
    // The tape takes the slope from the rounded output, y (1 - y): next to 1 an error of y is one
    // of the whole difference.
    if constexpr (std::is_same_v<T, Magnitude>)
      return Magnitude(y.value, y.size, y.derivative,
                       y.derivative_size + std::fabs(v.derivative) * y.size);
    return y;
  });
}

template <class T>
Columns<T> softplus(const Columns<T>& x, double shift) {
  return each_element(x, [&](T v) { return reference::softplus(v + T(shift)); });
}

template <class T>
Columns<T> relu(const Columns<T>& x) {
  return each_element(x, [](T v) { return reference::relu(v); });
}

template <class T>
Columns<T> scale_shift(const Columns<T>& x, double factor, double shift) {
  return each(x, [&](const auto& c) { return reference::scale_shift(c, factor, shift); });
}

template <class T>
Columns<T> frequency_encoding(const Columns<T>& x, const std::vector<double>& weights,
                              bool identity) {
  return each(x, [&](const std::vector<T>& c) {
    return reference::frequency_encoding(c, weights, identity);
  });
}

template <class T>
Columns<T> integrated_encoding(const Columns<T>& mean, const Columns<T>& variance, int degrees) {
  return each_pair(mean, variance, [&](const auto& x, const auto& v) {
    return reference::integrated_encoding(x, v, degrees);
  });
}

template <class T>
Columns<T> repeat_for_samples(const Columns<T>& x, const Rays& rays) {
  return reference::repeat_for_samples(x, rays);
}

template <class T>
Columns<T> table_rows(const Columns<T>& index, const std::vector<T>& weights,
                      const LinearWeights& w) {
  const std::vector<T> table(weights.begin() + static_cast<ptrdiff_t>(w.offset), weights.end());
  return each(index, [&](const std::vector<T>& c) {
    return reference::table_row(table, static_cast<size_t>(w.in),
                                static_cast<size_t>(weight_stride(w.in)), c[0]);
  });
}

// One code per ray, repeated for its samples.
template <class T>
Columns<T> view_code(const Columns<T>& directions, const Rays& rays) {
  Columns<T> y;
  for (size_t r = 0; r + 1 < rays.size(); ++r) {
    const auto& d = directions[r];
    const auto code = reference::spherical_harmonics(d[0], d[1], d[2]);
    for (int32_t s = rays[r]; s < rays[r + 1]; ++s) y.emplace_back(code.begin(), code.end());
  }
  return y;
}

template <class T>
Columns<T> view_code_of_rays(const Columns<T>& directions) {
  return each(directions, [](const std::vector<T>& d) {
    const auto code = reference::spherical_harmonics(d[0], d[1], d[2]);
    return std::vector<T>(code.begin(), code.end());
  });
}

// One-row values of a ray's samples, and three-row values.
template <class T>
std::vector<T> of_ray(const Columns<T>& x, const Rays& rays, size_t r) {
  std::vector<T> out;
  for (size_t s = static_cast<size_t>(rays[r]); s < static_cast<size_t>(rays[r + 1]); ++s)
    out.push_back(x[s][0]);
  return out;
}
template <class T>
std::array<T, 3> colour_of(const std::vector<T>& column) {
  return {column[0], column[1], column[2]};
}
template <class T>
std::vector<std::array<T, 3>> colours_of_ray(const Columns<T>& x, const Rays& rays, size_t r) {
  std::vector<std::array<T, 3>> out;
  for (size_t s = static_cast<size_t>(rays[r]); s < static_cast<size_t>(rays[r + 1]); ++s)
    out.push_back(colour_of(x[s]));
  return out;
}

// Pixels, and the weights of all samples.
template <class T>
std::pair<Columns<T>, Columns<T>> composite(const Columns<T>& density, const Columns<T>& colour,
                                            const Columns<T>& delta, const Columns<T>& background,
                                            const Rays& rays) {
  std::pair<Columns<T>, Columns<T>> out;
  for (size_t r = 0; r + 1 < rays.size(); ++r) {
    const auto ray =
        reference::composite<T>(of_ray(density, rays, r), colours_of_ray(colour, rays, r),
                                of_ray(delta, rays, r), colour_of(background[r]));
    out.first.emplace_back(ray.pixel.begin(), ray.pixel.end());
    for (const T& w : ray.weights) out.second.push_back({w});
  }
  return out;
}

template <class T>
Columns<T> render_weights(const Columns<T>& density, const Columns<T>& delta, const Rays& rays,
                          bool opaque_end) {
  Columns<T> out;
  for (size_t r = 0; r + 1 < rays.size(); ++r)
    for (const T& w :
         reference::render_weights(of_ray(density, rays, r), of_ray(delta, rays, r), opaque_end))
      out.push_back({w});
  return out;
}

template <class T>
Columns<T> accumulate(const Columns<T>& weights, const Columns<T>& colour,
                      const Columns<T>& background, const Rays& rays) {
  Columns<T> out;
  for (size_t r = 0; r + 1 < rays.size(); ++r) {
    const auto pixel = reference::accumulate(
        of_ray(weights, rays, r), colours_of_ray(colour, rays, r), colour_of(background[r]));
    out.emplace_back(pixel.begin(), pixel.end());
  }
  return out;
}

// x has `rows` rows, also where there is no sample to tell.
template <class T>
Columns<T> sum_along_rays(const Columns<T>& weights, const Columns<T>& x, const Rays& rays,
                          size_t rows) {
  Columns<T> out;
  for (size_t r = 0; r + 1 < rays.size(); ++r)
    out.push_back(reference::sum_along_ray(
        of_ray(weights, rays, r), Columns<T>(x.begin() + rays[r], x.begin() + rays[r + 1]), rows));
  return out;
}

// f(ray, weights of its samples, first sample and number of samples of a group) for each group.
template <class T, class F>
void each_group(const Columns<T>& weights, const Rays& rays, double most, double stop, const F& f) {
  using reference::real_part;
  for (size_t r = 0; r + 1 < rays.size(); ++r) {
    std::vector<double> w;
    for (int32_t s = rays[r]; s < rays[r + 1]; ++s)
      w.push_back(real_part(weights[static_cast<size_t>(s)][0]));
    size_t first = static_cast<size_t>(rays[r]);
    for (const size_t count : reference::light_groups(w, most, stop)) {
      f(r, first, count);
      first += count;
    }
  }
}

template <class T>
Columns<T> group_light(const Columns<T>& weights, const Rays& rays, double most, double stop) {
  Columns<T> out;
  each_group(weights, rays, most, stop, [&](size_t, size_t first, size_t count) {
    T sum(0);
    for (size_t s = first; s < first + count; ++s) sum += weights[s][0];
    out.push_back({sum});
  });
  return out;
}

template <class T>
Columns<T> mean_of_groups(const Columns<T>& weights, const Columns<T>& x, const Rays& rays,
                          double most, double stop) {
  std::vector<T> w;
  for (const std::vector<T>& column : weights) w.push_back(column[0]);
  Columns<T> out;
  each_group(weights, rays, most, stop, [&](size_t, size_t first, size_t count) {
    out.emplace_back();
    for (size_t k = 0; k < x[first].size(); ++k) {
      std::vector<T> row;
      for (const std::vector<T>& column : x) row.push_back(column[k]);
      out.back().push_back(reference::mean_by_light(w, row, first, count));
    }
  });
  return out;
}

// How many groups each ray has, as offsets like those of `rays`.
template <class T>
Rays groups_of_rays(const Columns<T>& weights, const Rays& rays, double most, double stop) {
  Rays out(rays.size(), 0);
  each_group(weights, rays, most, stop, [&](size_t r, size_t, size_t) { ++out[r + 1]; });
  for (size_t r = 0; r + 1 < out.size(); ++r) out[r + 1] += out[r];
  return out;
}

template <class T>
Columns<T> over(const Columns<T>& colour, const Columns<T>& opacity, const Columns<T>& background) {
  Columns<T> out;
  for (size_t r = 0; r < colour.size(); ++r) {
    const auto pixel =
        reference::over(colour_of(colour[r]), opacity[r][0], colour_of(background[r]));
    out.emplace_back(pixel.begin(), pixel.end());
  }
  return out;
}

// Values in the order of TransientMatter.
template <class T>
Columns<T> composite_transient(const std::array<Columns<T>, 5>& m, const Columns<T>& delta,
                               const Columns<T>& background, const Rays& rays, bool opaque_end) {
  Columns<T> out;
  for (size_t r = 0; r + 1 < rays.size(); ++r) {
    std::vector<reference::TransientSample<T>> samples;
    for (size_t s = static_cast<size_t>(rays[r]); s < static_cast<size_t>(rays[r + 1]); ++s)
      samples.push_back({m[0][s][0], colour_of(m[1][s]), m[2][s][0], colour_of(m[3][s]), m[4][s][0],
                         delta[s][0]});
    const auto pixel =
        reference::composite_transient(samples, colour_of(background[r]), opaque_end);
    out.emplace_back(pixel.begin(), pixel.end());
  }
  return out;
}

template <class T>
Columns<T> uncertain_loss(const Columns<T>& pixel, const Columns<T>& target,
                          const Columns<T>& scale, double least) {
  Columns<T> out;
  for (size_t r = 0; r < pixel.size(); ++r) {
    const auto& p = pixel[r];
    out.push_back({reference::uncertain_loss<T>({p[0], p[1], p[2], p[3], p[4]},
                                                colour_of(target[r]), scale[r][0], least)});
  }
  return out;
}

template <class T>
Columns<T> mean_loss(const Columns<T>& x, const Columns<T>& scale, const Rays& rays,
                     double factor) {
  Columns<T> out;
  for (size_t r = 0; r + 1 < rays.size(); ++r)
    out.push_back({reference::mean_loss(of_ray(x, rays, r), scale[r][0], factor)});
  return out;
}

// One term of the loss per ray: f of each channel's error.
template <class T, class F>
Columns<T> pixel_loss(const Columns<T>& pixel, const Columns<T>& target, const Columns<T>& scale,
                      const F& f) {
  Columns<T> out;
  for (size_t r = 0; r < pixel.size(); ++r) {
    const auto& p = pixel[r];
    out.push_back(
        {reference::pixel_loss<T>({p[0], p[1], p[2], p[3]}, colour_of(target[r]), scale[r][0], f)});
  }
  return out;
}

template <class T>
Columns<T> huber_loss(const Columns<T>& pixel, const Columns<T>& target, const Columns<T>& scale,
                      double delta) {
  return pixel_loss(pixel, target, scale, [&](T e) { return reference::huber(e, delta); });
}
template <class T>
Columns<T> squared_loss(const Columns<T>& pixel, const Columns<T>& target,
                        const Columns<T>& scale) {
  return pixel_loss(pixel, target, scale, [](T e) { return reference::squared(e); });
}
template <class T>
Columns<T> charbonnier_loss(const Columns<T>& pixel, const Columns<T>& target,
                            const Columns<T>& scale, double epsilon) {
  return pixel_loss(pixel, target, scale, [&](T e) { return reference::charbonnier(e, epsilon); });
}

}  // namespace nerf::on_columns
