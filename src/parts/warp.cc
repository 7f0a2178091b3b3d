#include "nerf/parts/warp.h"

#include "nerf/base/error.h"
#include "nerf/math/random.h"

namespace nerf {

namespace {

int outputs_of(WarpKind kind) {
  return kind == WarpKind::kSe3 ? 6 : kind == WarpKind::kTranslation ? 3 : 0;
}

// Of values alone, or with their tangents.
template <class V>
V record_points(Tape& tape, const PointNetwork& n, const V& position, Value code,
                const FrequencyWeights& window) {
  NERF_CHECK(!n.empty());
  NERF_CHECK_EQ(static_cast<int>(window->size()), n.shape.position_degrees);
  const V encoded = frequency_encoding(tape, position, window, n.shape.identity);
  const V input = n.shape.code > 0 ? concat(tape, encoded, code) : encoded;
  V h = input;
  for (size_t i = 0; i < n.hidden.size(); ++i) {
    if (i > 0 && static_cast<int>(i) + 1 == n.shape.skip)
      h = concat(tape, n.shape.skip_position ? encoded : input, h);
    h = linear(tape, h, n.hidden[i], LinearActivation::kRelu);
  }
  return linear(tape, h, n.last, LinearActivation::kNone);
}

template <class V>
V record(Tape& tape, const WarpNetwork& n, const V& position, Value code,
         const FrequencyWeights& window, Value moving) {
  const V motion = record_points(tape, n, position, code, window);
  if (n.kind == WarpKind::kSe3) {
    NERF_CHECK(moving < 0);
    return rigid_motion(tape, motion, position);
  }
  return add(tape, position, moving < 0 ? motion : multiply(tape, motion, moving));
}

}  // namespace

PointNetwork::PointNetwork(const PointShape& s, int outputs, size_t first)
    : shape(s), begin(first), end(first) {
  if (outputs == 0) return;
  const auto place = [&](int in, int out) {
    const LinearWeights w{end, in, out, /*bias=*/true};
    end += w.size();
    return w;
  };
  const int input = s.encoded() + s.code;
  int from = input;
  for (int i = 0; i < s.depth; ++i) {
    if (i > 0 && i + 1 == s.skip) from += s.skip_position ? s.encoded() : input;
    hidden.push_back(place(from, s.width));
    from = s.width;
  }
  last = place(from, outputs);
}

std::vector<LinearWeights*> PointNetwork::layers() {
  std::vector<LinearWeights*> all;
  if (empty()) return all;
  for (LinearWeights& w : hidden) all.push_back(&w);
  all.push_back(&last);
  return all;
}

void PointNetwork::initialise(uint64_t seed, uint64_t layer, Real* weights) const {
  for (const LinearWeights& w : hidden)
    draw_weights(w, xavier_bound(w),
                 Random(seed, random_key(RandomStream::kFirstNetworks), layer++), weights);
  draw_weights(last, shape.last_bound,
               Random(seed, random_key(RandomStream::kFirstNetworks), layer), weights);
}

WarpNetwork::WarpNetwork(const WarpShape& s, size_t first)
    : PointNetwork(s, outputs_of(s.kind), first), kind(s.kind) {}

Value record_warp(Tape& tape, const WarpNetwork& n, Value position, Value code,
                  const FrequencyWeights& window, Value moving) {
  return record(tape, n, position, code, window, moving);
}

WithTangents record_warp(Tape& tape, const WarpNetwork& n, const WithTangents& position, Value code,
                         const FrequencyWeights& window, Value moving) {
  return record(tape, n, position, code, window, moving);
}

Value record_sheet(Tape& tape, const PointNetwork& n, Value position, Value code,
                   const FrequencyWeights& window) {
  return record_points(tape, n, position, code, window);
}

}  // namespace nerf
