// The reference templates as functions of whole values, column by column, for gradient_check.h.
#pragma once

#include <type_traits>
#include <vector>

#include "autodiff/gradient_check.h"
#include "nerf/math/reference/activations.h"
#include "nerf/math/reference/encoding.h"
#include "nerf/math/reference/huber.h"
#include "nerf/math/reference/linear.h"
#include "nerf/math/reference/spherical_harmonics.h"
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

template <class T>
Columns<T> concat(Columns<T> a, const Columns<T>& b) {
  for (size_t s = 0; s < a.size(); ++s) a[s].insert(a[s].end(), b[s].begin(), b[s].end());
  return a;
}

template <class T>
Columns<T> add(Columns<T> a, const Columns<T>& b) {
  for (size_t s = 0; s < a.size(); ++s)
    for (size_t r = 0; r < a[s].size(); ++r) a[s][r] += b[s][r];
  return a;
}

template <class T>
Columns<T> slice(const Columns<T>& x, int first, int rows) {
  return each(x, [&](const std::vector<T>& c) {
    return std::vector<T>(c.begin() + first, c.begin() + first + rows);
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
      return Magnitude(y.value, y.size, y.slope + v.slope * y.size);
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
  return each_element(x, [&](T v) { return T(factor) * v + T(shift); });
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
  Columns<T> y;
  for (size_t s = 0; s < mean.size(); ++s)
    y.push_back(reference::integrated_encoding(mean[s], variance[s], degrees));
  return y;
}

template <class T>
Columns<T> repeat_for_samples(const Columns<T>& x, const Rays& rays) {
  Columns<T> y;
  for (size_t r = 0; r + 1 < rays.size(); ++r)
    for (int32_t s = rays[r]; s < rays[r + 1]; ++s) y.push_back(x[r]);
  return y;
}

template <class T>
Columns<T> table_rows(const Columns<T>& index, const std::vector<T>& weights,
                      const LinearWeights& w) {
  return each(index, [&](const std::vector<T>& c) {
    using reference::real_part;
    const int row = static_cast<int>(std::floor(real_part(c[0])));
    std::vector<T> out;
    for (int k = 0; k < w.in; ++k)
      out.push_back(
          row < 0 ? T(0) : weights[w.offset + static_cast<size_t>(row * weight_stride(w.in) + k)]);
    return out;
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

// Pixels, and the weights of all samples.
template <class T>
std::pair<Columns<T>, Columns<T>> composite(const Columns<T>& density, const Columns<T>& colour,
                                            const Columns<T>& delta, const Columns<T>& background,
                                            const Rays& rays) {
  std::pair<Columns<T>, Columns<T>> out;
  for (size_t r = 0; r + 1 < rays.size(); ++r) {
    std::vector<T> sigma, length;
    std::vector<std::array<T, 3>> c;
    for (size_t s = static_cast<size_t>(rays[r]); s < static_cast<size_t>(rays[r + 1]); ++s) {
      sigma.push_back(density[s][0]);
      length.push_back(delta[s][0]);
      c.push_back({colour[s][0], colour[s][1], colour[s][2]});
    }
    const auto& b = background[r];
    const auto ray = reference::composite<T>(sigma, c, length, {b[0], b[1], b[2]});
    out.first.emplace_back(ray.pixel.begin(), ray.pixel.end());
    for (const T& w : ray.weights) out.second.push_back({w});
  }
  return out;
}

template <class T>
Columns<T> render_weights(const Columns<T>& density, const Columns<T>& delta, const Rays& rays,
                          bool opaque_end) {
  Columns<T> out;
  for (size_t r = 0; r + 1 < rays.size(); ++r) {
    std::vector<T> sigma, length;
    for (size_t s = static_cast<size_t>(rays[r]); s < static_cast<size_t>(rays[r + 1]); ++s) {
      sigma.push_back(density[s][0]);
      length.push_back(delta[s][0]);
    }
    for (const T& w : reference::render_weights(sigma, length, opaque_end)) out.push_back({w});
  }
  return out;
}

template <class T>
Columns<T> accumulate(const Columns<T>& weights, const Columns<T>& colour,
                      const Columns<T>& background, const Rays& rays) {
  Columns<T> out;
  for (size_t r = 0; r + 1 < rays.size(); ++r) {
    std::vector<T> pixel(4);
    for (size_t s = static_cast<size_t>(rays[r]); s < static_cast<size_t>(rays[r + 1]); ++s) {
      for (size_t k = 0; k < 3; ++k) pixel[k] += weights[s][0] * colour[s][k];
      pixel[3] += weights[s][0];
    }
    for (size_t k = 0; k < 3; ++k) pixel[k] += (T(1) - pixel[3]) * background[r][k];
    out.push_back(pixel);
  }
  return out;
}

// x has `rows` rows, also where there is no sample to tell.
template <class T>
Columns<T> sum_along_rays(const Columns<T>& weights, const Columns<T>& x, const Rays& rays,
                          size_t rows) {
  Columns<T> out;
  for (size_t r = 0; r + 1 < rays.size(); ++r) {
    std::vector<T> sum(rows + 1);
    for (size_t s = static_cast<size_t>(rays[r]); s < static_cast<size_t>(rays[r + 1]); ++s) {
      for (size_t k = 0; k < rows; ++k) sum[k] += weights[s][0] * x[s][k];
      sum[rows] += weights[s][0];
    }
    out.push_back(sum);
  }
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
    const T a = opacity[r][0];
    std::vector<T> pixel;
    for (size_t k = 0; k < 3; ++k)
      pixel.push_back(a * colour[r][k] + (T(1) - a) * background[r][k]);
    pixel.push_back(a);
    out.push_back(pixel);
  }
  return out;
}

// One term of the loss per ray: f of each channel's error.
template <class T, class F>
Columns<T> pixel_loss(const Columns<T>& pixel, const Columns<T>& target, const Columns<T>& scale,
                      const F& f) {
  Columns<T> out;
  for (size_t r = 0; r < pixel.size(); ++r) {
    T sum(0);
    for (size_t k = 0; k < 3; ++k) sum += f(pixel[r][k] - target[r][k]);
    out.push_back({sum * scale[r][0]});
  }
  return out;
}

template <class T>
Columns<T> huber_loss(const Columns<T>& pixel, const Columns<T>& target, const Columns<T>& scale,
                      double delta) {
  return pixel_loss(pixel, target, scale, [&](T e) { return reference::huber(e, delta); });
}

}  // namespace nerf::on_columns
