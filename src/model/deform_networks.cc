#include "nerf/model/deform_networks.h"

#include <algorithm>
#include <cmath>

#include "nerf/math/window.h"
#include "nerf/model/network_field.h"

namespace nerf {

namespace {

// A hidden layer that the input is given again to, where there are so many.
int skip_of(int skip, int depth) { return skip >= 2 && skip <= depth ? skip : 0; }

int code_rows(const DeformOptions& o) { return o.code > 0 ? o.code : 1 + 2 * o.time_degrees; }

// The authors of the warp that is found from time itself give the position again alone.
WarpShape warp_shape(const DeformOptions& o) {
  WarpShape s;
  s.kind = o.warp;
  s.position_degrees = o.degrees;
  s.code = code_rows(o);
  s.depth = o.depth;
  s.width = o.width;
  s.skip = skip_of(o.skip, o.depth);
  s.skip_position = o.code == 0;
  return s;
}

PointShape sheet_shape(const DeformOptions& o) {
  PointShape s;
  s.position_degrees = o.sheet_degrees;
  s.identity = false;
  s.code = code_rows(o);
  s.depth = o.sheet_depth;
  s.width = o.sheet_width;
  s.skip = skip_of(5, o.sheet_depth);
  s.last_bound = std::sqrt(3.0_r) * 1e-5_r;  // of that deviation
  return s;
}

}  // namespace

DeformNetworks::DeformNetworks(const DeformOptions& o, size_t first) : begin(first), end(first) {
  warp = WarpNetwork(warp_shape(o), end);
  end = warp.end;
  if (!o.has_sheet()) return;
  sheet = PointNetwork(sheet_shape(o), o.ambient, end);
  end = sheet.end;
}

std::vector<LinearWeights*> DeformNetworks::layers() {
  std::vector<LinearWeights*> all = warp.layers();
  for (LinearWeights* w : sheet.layers()) all.push_back(w);
  return all;
}

uint64_t DeformNetworks::initialise(uint64_t seed, uint64_t layer, Real* weights) const {
  for (const PointNetwork* network : {static_cast<const PointNetwork*>(&warp), &sheet}) {
    if (network->empty()) continue;
    network->initialise(seed, layer, weights);
    layer += network->hidden.size() + 1;
  }
  return layer;
}

void NetworkTape::open(const DeformWindows& windows) {
  window_weights(windows.warp, *warp_window_);
  window_weights(windows.ambient, *ambient_window_);
}

Value NetworkTape::record_position(const NetworkOptions& o, const RadianceNetwork& n,
                                   Purpose purpose, const Losses& losses) {
  const FrequencyWeights all = open_window(o.position_degrees);
  if (o.integrated()) return integrated_encoding(tape, position, variance, o.position_degrees);
  const DeformOptions& d = o.deform;
  if (!d.any()) return frequency_encoding(tape, position, all, /*identity=*/true);
  warp_window_ = std::make_shared<std::vector<Real>>(static_cast<size_t>(d.degrees));
  ambient_window_ = std::make_shared<std::vector<Real>>(static_cast<size_t>(d.ambient_degrees));
  open({});

  const bool train = purpose == Purpose::kTrain;
  const auto of_moment = [&](const LinearWeights& book, Value& given) {
    if (!train) return given = tape.input(book.in, Domain::kRays);
    if (deform.moment < 0) deform.moment = tape.input(1, Domain::kRays);
    return table_rows(tape, deform.moment, book);
  };
  Value code = -1;
  if (d.code > 0) {
    code = of_moment(n.deform.codes, deform.code);
  } else {
    deform.time = tape.input(1, Domain::kRays);
    code = frequency_encoding(tape, deform.time, open_window(d.time_degrees), /*identity=*/true);
  }
  code = repeat_for_samples(tape, code);

  deform.canonical = position;
  if (!n.deform.warp.empty()) {
    Value moving = -1;
    if (d.still_start) {
      deform.moving = tape.input(3, Domain::kRays);
      moving = repeat_for_samples(tape, deform.moving);
    }
    if (train && losses.elastic) {
      WithTangents x{position, {}};
      for (Value& axis : deform.axes) x.tangents.push_back(axis = tape.input(3, Domain::kSamples));
      const WithTangents y = record_warp(tape, n.deform.warp, x, code, warp_window_, moving);
      deform.canonical = y.value;
      std::ranges::copy(y.tangents, deform.jacobian.begin());
    } else {
      deform.canonical = record_warp(tape, n.deform.warp, position, code, warp_window_, moving);
    }
  }
  const Value encoded = frequency_encoding(tape, deform.canonical, all, /*identity=*/true);
  if (d.slice == Slice::kNone) return encoded;
  const Value ambient =
      d.has_sheet()
          ? record_sheet(tape, n.deform.sheet, position, code, open_window(d.sheet_degrees))
          : repeat_for_samples(tape, of_moment(n.deform.planes, deform.plane));
  return concat(tape, encoded,
                frequency_encoding(tape, ambient, FrequencyWeights(ambient_window_), false));
}

void NetworkTape::place_axes(Chunk& chunk) const {
  if (deform.axes[0] < 0) return;
  const int64_t ld = chunk.stride(deform.axes[0]), n = round_up(chunk.samples, kLane);
  for (int axis = 0; axis < 3; ++axis)
    for (int k = 0; k < 3; ++k)
      std::fill_n(chunk.data(deform.axes[static_cast<size_t>(axis)]) + k * ld, n,
                  k == axis ? 1.0_r : 0.0_r);
}

}  // namespace nerf
