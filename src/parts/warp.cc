#include "nerf/parts/warp.h"

#include <cmath>

#include "nerf/base/error.h"
#include "nerf/math/random.h"

namespace nerf {

WarpNetwork::WarpNetwork(const WarpShape& s, size_t first) : shape(s), begin(first), end(first) {
  if (empty()) return;
  const auto place = [&](int in, int out) {
    const LinearWeights w{end, in, out, /*bias=*/true};
    end += w.size();
    return w;
  };
  const int encoded = 3 + 6 * s.position_degrees, input = encoded + s.code;
  int from = input;
  for (int i = 0; i < s.depth; ++i) {
    if (i > 0 && i + 1 == s.skip) from += s.skip_position ? encoded : input;
    hidden.push_back(place(from, s.width));
    from = s.width;
  }
  last = place(from, s.kind == WarpKind::kSe3 ? 6 : 3);
}

void WarpNetwork::initialise(uint64_t seed, uint64_t layer, Real* weights) const {
  for (const LinearWeights& w : hidden)
    draw_weights(w, xavier_bound(w),
                 Random(seed, random_key(RandomStream::kFirstNetworks), layer++), weights);
  draw_weights(last, shape.last_bound,
               Random(seed, random_key(RandomStream::kFirstNetworks), layer), weights);
}

Value record_warp(Tape& tape, const WarpNetwork& n, Value position, Value code,
                  const FrequencyWeights& window) {
  NERF_CHECK(!n.empty());
  NERF_CHECK_EQ(static_cast<int>(window->size()), n.shape.position_degrees);
  const Value encoded = frequency_encoding(tape, position, window, /*identity=*/true);
  const Value input = n.shape.code > 0 ? concat(tape, encoded, code) : encoded;
  Value h = input;
  for (size_t i = 0; i < n.hidden.size(); ++i) {
    if (i > 0 && static_cast<int>(i) + 1 == n.shape.skip)
      h = concat(tape, n.shape.skip_position ? encoded : input, h);
    h = linear(tape, h, n.hidden[i], LinearActivation::kRelu);
  }
  const Value motion = linear(tape, h, n.last, LinearActivation::kNone);
  return n.shape.kind == WarpKind::kSe3 ? rigid_motion(tape, motion, position)
                                        : add(tape, position, motion);
}

}  // namespace nerf
