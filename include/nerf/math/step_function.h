// Step functions on a ray: n bins between n + 1 sorted edges, a weight each, and samples drawn from
// them. All functions are templates on the scalar (float in the engine, double and what else
// math/reference/scalar.h lists in tests) and write into arrays of the caller's. What decides where
// a number goes looks at real parts only. Edges may coincide; a bin without width is never drawn
// from by the functions that say so.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <span>
#include <vector>

#include "nerf/math/reference/scalar.h"

namespace nerf {

// Comparisons, std::max(), min() and clamp() by real parts.
namespace by_real_part {
template <class T>
bool less(const T& a, const T& b) {
  using reference::real_part;
  return real_part(a) < real_part(b);
}
template <class T>
bool equal(const T& a, const T& b) {
  using reference::real_part;
  return real_part(a) == real_part(b);
}
template <class T>
const T& max(const T& a, const T& b) {
  return less(a, b) ? b : a;
}
template <class T>
const T& min(const T& a, const T& b) {
  return less(b, a) ? b : a;
}
template <class T>
const T& clamp(const T& x, const T& low, const T& high) {
  return less(x, low) ? low : less(high, x) ? high : x;
}
}  // namespace by_real_part

// cdf[0 .. n]: cumulative share of the weights, 0 at the first edge and 1 at the last, never
// falling. Weights are at least 0; where they sum to less than 1e-5 an equal share is added to
// each, so that a histogram without mass is drawn from bin by bin (mip-NeRF's
// sorted_piecewise_constant_pdf).
template <class T>
void cumulative_shares(std::span<const T> weights, std::span<T> cdf) {
  T sum(0);
  for (const T w : weights) sum += w;
  const T least(1e-5);
  const T padding = by_real_part::less(sum, least)
                        ? (least - sum) / T(static_cast<double>(weights.size()))
                        : T(0);
  const T total = by_real_part::max(sum, least);
  T below(0);
  cdf[0] = T(0);
  for (size_t i = 0; i < weights.size(); ++i) {
    below += weights[i] + padding;
    cdf[i + 1] = by_real_part::min(T(1), below / total);
  }
  cdf[weights.size()] = T(1);
}

// Positions at which the piecewise linear cdf over the edges takes the values u, each in [0, 1).
// u sorted: one pass over the bins.
template <class T>
void invert_sorted(std::span<const T> edges, std::span<const T> cdf, std::span<const T> u,
                   std::span<T> out) {
  size_t bin = 0;
  const size_t last = edges.size() - 2;
  for (size_t i = 0; i < u.size(); ++i) {
    while (bin < last && !by_real_part::less(u[i], cdf[bin + 1])) ++bin;
    const T mass = cdf[bin + 1] - cdf[bin];
    const T share = by_real_part::less(T(0), mass)
                        ? by_real_part::clamp((u[i] - cdf[bin]) / mass, T(0), T(1))
                        : T(0);
    // In the form that reproduces both edges exactly.
    out[i] = by_real_part::equal(share, T(1)) ? edges[bin + 1]
                                              : edges[bin] + share * (edges[bin + 1] - edges[bin]);
  }
}

// Added to every weight by resample_points(), as in the authors' code.
inline constexpr double kRaisedWeight = 1e-5;

// NeRF's fine samples (Mildenhall et al. 2020, section 5.2; sample_pdf of the authors' code): drawn
// from the histogram of the coarse weights[1 .. n-1) between the middles of the n coarse positions,
// each weight raised by kRaisedWeight. u: sorted numbers in [0, 1). scratch: at least 2 n. n >= 3.
template <class T>
void resample_points(std::span<const T> coarse, std::span<const T> weights, std::span<const T> u,
                     std::span<T> scratch, std::span<T> out) {
  const size_t bins = coarse.size() - 2;
  const std::span<T> edges = scratch.subspan(0, bins + 1),
                     cdf = scratch.subspan(bins + 1, bins + 1);
  for (size_t i = 0; i <= bins; ++i) edges[i] = T(0.5) * (coarse[i] + coarse[i + 1]);
  T total(0);
  for (size_t i = 0; i < bins; ++i) total += weights[i + 1] + T(kRaisedWeight);
  cdf[0] = T(0);
  for (size_t i = 0; i < bins; ++i)
    cdf[i + 1] = cdf[i] + (weights[i + 1] + T(kRaisedWeight)) / total;
  cdf[bins] = T(1);
  invert_sorted<T>(edges, cdf, u, out);
}

// mip-NeRF's blurred weights (Barron et al. 2021, section 3.1): the larger one of two neighbours,
// averaged over two of those, plus `padding`. In place is allowed.
template <class T>
void blur_weights(std::span<const T> weights, T padding, std::span<T> out) {
  const size_t n = weights.size();
  T before = weights[0], here = weights[0];  // edges repeat
  T left = by_real_part::max(before, here);
  for (size_t i = 0; i < n; ++i) {
    const T next = i + 1 < n ? weights[i + 1] : here;
    const T right = by_real_part::max(here, next);
    out[i] = T(0.5) * (left + right) + padding;
    left = right;
    here = next;
  }
}

// Weights raised to `exponent` and normalised, 0 for bins without width: mip-NeRF 360's annealed
// histogram (Barron et al. 2022, section 4, equation 18 with bias in annealing_exponent). In place
// is allowed.
template <class T>
void anneal_weights(std::span<const T> edges, std::span<const T> weights, T exponent,
                    std::span<T> out) {
  T sum(0);
  for (size_t i = 0; i < weights.size(); ++i) {
    using std::pow;
    const bool open = by_real_part::less(edges[i], edges[i + 1]);
    out[i] = !open                                  ? T(0)
             : by_real_part::less(T(0), weights[i]) ? pow(weights[i], exponent)
             : by_real_part::equal(exponent, T(0))  ? T(1)
                                                    : T(0);
    sum += out[i];
  }
  if (by_real_part::less(T(0), sum))
    for (size_t i = 0; i < weights.size(); ++i) out[i] = out[i] / sum;
}

// Schlick's bias of the share of training done: 0 at the start, 1 at the end.
template <class T>
T annealing_exponent(T share, T slope = T(10)) {
  return slope * share / ((slope - T(1)) * share + T(1));
}

// Posts between the middles of the sorted `centres`, n + 1 of them; the outer two mirror their
// neighbours at the outer centres and stay within [low, high] (multinerf's sample_intervals).
template <class T>
void posts_around(std::span<const T> centres, T low, T high, std::span<T> posts) {
  const size_t n = centres.size();
  if (n == 1) {
    posts[0] = low;
    posts[1] = high;
    return;
  }
  for (size_t i = 1; i < n; ++i) posts[i] = T(0.5) * (centres[i - 1] + centres[i]);
  posts[0] = by_real_part::max(low, T(2) * centres[0] - posts[1]);
  posts[n] = by_real_part::min(high, T(2) * centres[n - 1] - posts[n - 1]);
}

// Edges of dilate_weights(): those of n bins, and each bin's moved outwards.
inline size_t dilated_edges(size_t bins) { return 3 * bins + 1; }

// What dilate_weights() needs besides: made once, it allocates no more while bins do not become
// more.
template <class T>
struct DilationScratch {
  std::vector<T> density;       // of each bin
  std::vector<size_t> falling;  // bins in reach whose densities fall from one to the next
};

// Largest density of all bins that reach within `dilation` of a point, as a step function between
// all edges and the moved ones, which stay in [low, high]; as weights that sum to 1 (Barron et al.
// 2022, supplement, section C; multinerf's max_dilate_weights). edges: sorted. out_edges:
// dilated_edges(n), one weight less. Takes a time that grows with n alone.
template <class T>
void dilate_weights(std::span<const T> edges, std::span<const T> weights, T dilation, T low, T high,
                    std::span<T> out_edges, std::span<T> out_weights, DilationScratch<T>& scratch) {
  const size_t n = weights.size(), all = dilated_edges(n);
  using reference::real_part;
  using Limits = std::numeric_limits<decltype(real_part(T()))>;
  const auto reached = [](const T& a, const T& b) { return !by_real_part::less(b, a); };  // a <= b
  // Three sorted lists become one.
  const T never(Limits::infinity());
  const auto before = [&](size_t i) {
    return i < n ? by_real_part::clamp(edges[i] - dilation, low, high) : never;
  };
  const auto behind = [&](size_t i) {
    return i < n ? by_real_part::clamp(edges[i + 1] + dilation, low, high) : never;
  };
  T of_a = edges[0], of_b = before(0), of_c = behind(0);
  for (size_t k = 0, a = 0, b = 0, c = 0; k < all; ++k) {
    if (reached(of_b, of_a) && reached(of_b, of_c)) {
      out_edges[k] = of_b;
      of_b = before(++b);
    } else if (reached(of_a, of_c)) {
      out_edges[k] = of_a;
      of_a = ++a <= n ? edges[a] : never;
    } else {
      out_edges[k] = of_c;
      of_c = behind(++c);
    }
  }

  scratch.density.resize(n);
  scratch.falling.resize(n);
  for (size_t i = 0; i < n; ++i) {
    const T width = edges[i + 1] - edges[i];
    scratch.density[i] = by_real_part::less(T(0), width) ? weights[i] / width : T(0);
  }
  T sum(0);
  size_t next = 0;               // the first bin that begins behind the interval's start
  size_t front = 0, length = 0;  // of `falling`: its first has the largest density in reach
  for (size_t j = 0; j + 1 < all; ++j) {
    const T begin = out_edges[j], end = out_edges[j + 1];
    for (; next < n && reached(edges[next] - dilation, begin); ++next) {
      while (length > 0 &&
             !by_real_part::less(scratch.density[next],
                                 scratch.density[scratch.falling[front + length - 1]]))
        --length;
      if (length == 0) front = 0;
      scratch.falling[front + length++] = next;
    }
    while (length > 0 && reached(edges[scratch.falling[front] + 1] + dilation, begin)) {
      ++front;
      --length;
    }
    const T density = length > 0 ? scratch.density[scratch.falling[front]] : T(0);
    out_weights[j] = density * (end - begin);
    sum += out_weights[j];
  }
  const T least(Limits::epsilon());
  for (size_t j = 0; j + 1 < all; ++j)
    out_weights[j] = out_weights[j] / by_real_part::max(sum, least);
}

}  // namespace nerf
