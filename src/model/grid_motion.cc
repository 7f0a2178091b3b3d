#include "nerf/model/grid_motion.h"

#include <algorithm>
#include <cmath>

#include "nerf/math/random.h"
#include "nerf/model/grid_field.h"

namespace nerf {

namespace {

constexpr int kSheetDepth = 2, kSheetWidth = 32, kAmbientDegrees = 1;
// Of the first weights of what shapes little at first (Park et al. 2021b, appendix).
constexpr Real kSheetBound = 1e-4_r;

int encoded_rows(int rows, int degrees) { return rows + 2 * rows * degrees; }

}  // namespace

MotionNetworks::MotionNetworks(const MotionShape& s, size_t first)
    : shape(s), begin(first), end(first) {
  if (empty()) return;
  const auto place = [&](int in, int out) {
    const LinearWeights w{end, in, out, /*bias=*/true};
    end += w.size();
    return w;
  };
  time_hidden = place(encoded_rows(1, s.time_degrees), s.time_width);
  time_last = place(s.time_width, s.time_code);
  shape.warp.code = s.time_code;
  warp = WarpNetwork(shape.warp, end);
  end = warp.end;
  if (s.ambient == 0) return;
  int in = encoded_rows(3, s.point_degrees) + s.time_code;
  for (int i = 0; i < kSheetDepth; ++i, in = kSheetWidth) sheet.push_back(place(in, kSheetWidth));
  sheet.push_back(place(in, s.ambient));
}

int MotionNetworks::rows() const {
  if (empty()) return 0;
  return encoded_rows(3, shape.point_degrees) + shape.time_code +
         (shape.ambient > 0 ? encoded_rows(shape.ambient, kAmbientDegrees) : 0);
}

std::vector<LinearWeights*> MotionNetworks::layers() {
  std::vector<LinearWeights*> all;
  if (empty()) return all;
  all = {&time_hidden, &time_last};
  for (LinearWeights& w : warp.hidden) all.push_back(&w);
  all.push_back(&warp.last);
  for (LinearWeights& w : sheet) all.push_back(&w);
  return all;
}

void MotionNetworks::initialise(uint64_t seed, uint64_t layer, Real* weights) const {
  if (empty()) return;
  const auto random = [&] {
    return Random(seed, random_key(RandomStream::kFirstNetworks), layer++);
  };
  const auto xavier = [&](const LinearWeights& w) {
    draw_weights(w, xavier_bound(w), random(), weights);
  };
  xavier(time_hidden);
  xavier(time_last);
  warp.initialise(seed, layer, weights);
  layer += warp.hidden.size() + 1;
  for (size_t i = 0; i + 1 < sheet.size(); ++i) xavier(sheet[i]);
  if (!sheet.empty()) draw_weights(sheet.back(), kSheetBound, random(), weights);
}

Value record_time_code(Tape& tape, const MotionNetworks& n, Value time) {
  const Value encoded = frequency_encoding(tape, scale_shift(tape, time, 2, -1),
                                           open_window(n.shape.time_degrees), /*identity=*/true);
  const Value hidden = linear(tape, encoded, n.time_hidden, LinearActivation::kRelu);
  return linear(tape, hidden, n.time_last, LinearActivation::kNone);
}

Value record_moment(Tape& tape, const MotionNetworks& n, Value position, Value code) {
  const Value encoded =
      frequency_encoding(tape, position, open_window(n.shape.point_degrees), /*identity=*/true);
  const Value moment = concat(tape, encoded, code);
  if (n.sheet.empty()) return moment;
  const Value ambient = mlp(tape, moment, n.sheet);
  return concat(tape, moment,
                frequency_encoding(tape, ambient, open_window(kAmbientDegrees), /*identity=*/true));
}

MotionTape::MotionTape(const GridField& field, bool training) : tape(kChunkSamples, kChunkRays) {
  const Real extent = field.extent();
  position = tape.input(3, Domain::kSamples, training);
  time = tape.input(1, Domain::kRays);
  const Value code = repeat_for_samples(tape, record_time_code(tape, field.motion, time));
  const FrequencyWeights window = open_window(field.motion.shape.warp.position_degrees);
  const Value contracted = scale_shift(tape, position, 2 * extent, -extent);
  const Value warped = record_warp(tape, field.motion.warp, contracted, code, window);
  canonical = scale_shift(tape, warped, 1 / (2 * extent), 0.5_r);
  if (training) {
    gradient = tape.input(3, Domain::kSamples);
    add_gradient(tape, canonical, gradient);
  }
  tape.plan();
}

MotionChunk::MotionChunk(const GridField& field, const LayerPacks* packs, bool training)
    : tape_(std::make_unique<MotionTape>(field, training)), chunk_(tape_->tape) {
  chunk_.weights = field.weights.data();
  chunk_.packs = packs;
}

void MotionChunk::forward(const Real* x, const Real* y, const Real* z, int samples, int rays,
                          const int32_t* ray_begin, const Real* times) {
  chunk_.samples = samples;
  chunk_.rays = rays;
  chunk_.ray_begin = ray_begin;
  const int64_t padded = round_up(samples, kLane), ld = chunk_.stride(tape_->position);
  const Real* const from[] = {x, y, z};
  for (int k = 0; k < 3; ++k) std::copy_n(from[k], padded, chunk_.data(tape_->position) + k * ld);
  std::copy_n(times, rays, chunk_.data(tape_->time));
  std::fill(chunk_.data(tape_->time) + rays, chunk_.data(tape_->time) + round_up(rays, kLane),
            0.0_r);
  tape_->tape.forward(chunk_);
}

const Real* MotionChunk::canonical(int axis) const {
  return chunk_.data(tape_->canonical) + axis * chunk_.stride(tape_->canonical);
}

void MotionChunk::backward(const Real* d_canonical, int64_t ld, Real* weight_gradient) {
  chunk_.weight_gradient = weight_gradient;
  const int64_t to = chunk_.stride(tape_->gradient);
  for (int k = 0; k < 3; ++k)
    std::copy_n(d_canonical + k * ld, chunk_.samples, chunk_.data(tape_->gradient) + k * to);
  tape_->tape.backward(chunk_);
}

const Real* MotionChunk::position_gradient(int axis) const {
  Chunk& chunk = const_cast<Chunk&>(chunk_);
  return chunk.gradient(tape_->position) + axis * chunk.stride(tape_->position);
}

}  // namespace nerf
