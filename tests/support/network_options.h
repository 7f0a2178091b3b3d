// For tests of the model layer, which does not see the table of methods: the papers' networks, and
// the same structure in a size that a test can afford.
#pragma once

#include "nerf/model/network_options.h"

namespace nerf::test {

inline NetworkOptions nerf_options() { return {}; }

inline NetworkOptions mipnerf_options() {
  NetworkOptions o;
  o.cast = Cast::kCone;
  o.encoding = Encoding::kIntegrated;
  o.position_degrees = 16;
  o.sampling.resampling = Resampling::kBlurred;
  o.sampling.coarse = o.sampling.fine = 128;
  o.shared = true;
  o.density = DensityActivation::kSoftplus;
  o.density_bias = -1;
  o.colour_padding = 0.001_r;
  return o;
}

inline NetworkOptions mipnerf360_options() {
  NetworkOptions o = mipnerf_options();
  o.space = Space::kContract;
  o.encoding = Encoding::kOffAxis;
  o.position_degrees = 12;
  o.sampling.resampling = Resampling::kProposal;
  o.sampling.spacing = Spacing::kInverse;
  o.sampling.rounds = 2;
  o.sampling.coarse = 64;
  o.sampling.fine = 32;
  o.sampling.padding = 0;
  o.shared = false;
  o.width = 1024;
  o.proposal_depth = 4;
  o.proposal_colour = false;
  o.opaque_end = true;
  o.initialisation = Initialisation::kHe;
  return o;
}

inline NetworkOptions nerfw_options() {
  NetworkOptions o;
  o.position_degrees = 15;
  o.sampling.coarse = o.sampling.fine = 512;
  o.width = o.bottleneck = o.proposal_width = 512;
  o.density = DensityActivation::kSoftplus;
  o.last_interval = 100;
  o.image_code = 48;
  o.code_spread = 1;
  o.transient_code = 16;
  return o;
}

inline NetworkOptions dnerf_options() {
  NetworkOptions o;
  o.shared = true;
  o.deform.warp = WarpKind::kTranslation;
  o.deform.degrees = 10;
  o.deform.depth = 8;
  o.deform.width = 256;
  o.deform.skip = 6;
  o.deform.code = 0;
  o.deform.still_start = true;
  return o;
}

inline NetworkOptions nerfies_options() {
  NetworkOptions o;
  o.position_degrees = 8;
  o.sampling.coarse = o.sampling.fine = 128;
  o.density = DensityActivation::kSoftplus;
  o.image_code = 8;
  o.camera_code = 2;
  o.code_spread = 0.0144337567_r;
  o.deform.warp = WarpKind::kSe3;
  return o;
}

inline NetworkOptions hypernerf_options() {
  NetworkOptions o = nerfies_options();
  o.image_code = o.camera_code = 0;
  o.deform.degrees = 6;
  o.deform.slice = Slice::kSheet;
  return o;
}

inline NetworkOptions small_network(NetworkOptions o) {
  o.depth = 3;
  o.skip = 1;
  o.width = o.proposal_width = 16;
  o.bottleneck = 5;
  o.view_width = 7;
  if (o.image_code > 0) o.image_code = 3;
  if (o.transient_code > 0) o.transient_code = 2;
  o.transient_depth = 2;
  o.transient_width = 6;
  o.deform.depth = o.deform.sheet_depth = 2;
  o.deform.skip = 2;
  o.deform.width = o.deform.sheet_width = 16;
  o.deform.degrees = o.deform.sheet_degrees = 2;
  if (o.deform.code > 0) o.deform.code = 3;
  o.deform.time_degrees = 2;
  o.proposal_depth = 2;
  o.position_degrees = 2;
  o.direction_degrees = 1;
  o.sampling.coarse = 8;
  o.sampling.fine = 8;
  return o;
}

}  // namespace nerf::test
