// Operations that model code writes on a tape. Shapes in brackets: [rows x columns], columns being
// the samples, the rays or the groups of a chunk.
#pragma once

#include <array>
#include <memory>
#include <span>
#include <vector>

#include "nerf/autodiff/linear_weights.h"
#include "nerf/autodiff/tape.h"
#include "nerf/base/real.h"
#include "nerf/kernels/linear.h"

namespace nerf {

// [in x n] -> [out x n]: act(W x + b).
Value linear(Tape& tape, Value x, const LinearWeights& w, LinearActivation activation);

// ReLU layers with a linear last one: one operation for each layer, as linear() records it.
Value mlp(Tape& tape, Value x, std::span<const LinearWeights> layers);

// Rows of a above rows of b.
Value concat(Tape& tape, Value a, Value b);

// Rows [first, first + rows) of x.
Value slice(Tape& tape, Value x, int first, int rows);

// Density exp(x), truncated (kernels/elementwise.h).
Value truncated_exp(Tape& tape, Value x);

Value sigmoid(Tape& tape, Value x);

// log(1 + exp(x + shift)): a density that cannot die (Barron et al. 2021, section 3.1).
Value softplus(Tape& tape, Value x, Real shift);

Value relu(Tape& tape, Value x);

// a + b, of the same shape.
Value add(Tape& tape, Value a, Value b);

// a b, element by element, of the same shape.
Value multiply(Tape& tape, Value a, Value b);

// factor x + shift.
Value scale_shift(Tape& tape, Value x, Real factor, Real shift);

// [d x n] -> [(identity ? d : 0) + 2 d F x n], F the number of weights: x itself, then for each
// frequency 2^k the sines of all coordinates and their cosines, times weights[k] (Mildenhall et al.
// 2020, equation 4, in the order of the authors' code, without its factor pi; with the weights of a
// window: Park et al. 2021, equation 8).
Value frequency_encoding(Tape& tape, Value x, std::span<const Real> weights, bool identity);
// The same with weights that may change between passes, as those of a window that opens
// (math/window.h); their number may not.
using FrequencyWeights = std::shared_ptr<const std::vector<Real>>;
Value frequency_encoding(Tape& tape, Value x, const FrequencyWeights& weights, bool identity);
// Each of so many frequencies in full: a window that is open.
FrequencyWeights open_window(int degrees);

// [d x n], [d x n] -> [2 d degrees x n]: the expected sines of 2^k x, then the expected cosines, of
// a Gaussian with this mean and variance along each axis (Barron et al. 2021, equation 14).
Value integrated_encoding(Tape& tape, Value mean, Value variance, int degrees);

// [d x rays] -> [d x samples]: a ray's column for each of its samples.
Value repeat_for_samples(Tape& tape, Value x);
// Or [d x groups], behind group_light(): for each of its groups.
Value repeat_for(Tape& tape, Value x, Domain domain);

// [1 x n] -> [w.in x n]: row floor(index) of the table w [w.out x w.in], whose numbers are learnt;
// zeros where the index is below 0. A code for each photo (Bojanowski et al. 2018).
Value table_rows(Tape& tape, Value index, const LinearWeights& w);

// screw [6 x n], a rotation vector w above a velocity v; x [3 x n] -> [3 x n]: R x + G v, each
// point moved by the screw of its own, the exponential of a rigid motion (Park et al. 2021,
// section 3.2). Exact and smooth at any angle |w|, 0 too; the angle's size is not limited.
Value rigid_motion(Tape& tape, Value screw, Value x);

// Spherical harmonics of the unit directions [3 x rays]: [16 x rays], or repeated for what belongs
// to a ray, [16 x samples] or [16 x groups].
Value view_code(Tape& tape, Value directions, Domain domain = Domain::kSamples);

// Volume rendering (NeRF, equation 3) over the samples of each ray.
//   density [1 x samples], colour [3 x samples], delta [1 x samples] interval lengths (the last may
//   be infinite: kLongestInterval, kernels/elementwise.h),
//   background [3 x rays] -> [4 x rays]: colour over the background, opacity.
// Weights are left in the chunk: see weights().
struct Composite {
  Value pixel;    // [4 x rays]
  Value weights;  // [1 x samples], no gradient
};
Composite composite(Tape& tape, Value density, Value colour, Value delta, Value background);

// The two halves of composite(), for losses on the weights.
//   density [1 x samples], delta [1 x samples] -> weights [1 x samples]
// With `opaque_end` the last interval of each ray lets nothing through, whatever its density is.
Value render_weights(Tape& tape, Value density, Value delta, bool opaque_end);
//   weights [1 x samples], colour [3 x samples], background [3 x rays] -> [4 x rays]: colour over
//   the background, which shows where the weights do not add up to 1; sum of the weights. Or of
//   groups: light [1 x groups], colour [3 x groups].
Value accumulate(Tape& tape, Value weights, Value colour, Value background);

// The two steps of accumulate() apart, for a colour that is found once for a ray:
//   weights [1 x samples], x [r x samples] -> [r + 1 x rays]: sums of weight times x; sum of the
//   weights, a ray's opacity.
Value sum_along_rays(Tape& tape, Value weights, Value x);
//   colour [3 x rays], opacity [1 x rays], background [3 x rays] -> [4 x rays]: opacity colour +
//   (1 - opacity) background; opacity.
Value over(Tape& tape, Value colour, Value opacity, Value background);

// Successive samples of a ray put together, as many as have at most `most` of a pixel's light (or
// one that has more by itself), up to the first that less than `stop` of the light reaches; what is
// behind belongs to no group and receives no gradient. Where the borders lie is not differentiated.
//   weights [1 x samples] -> [1 x groups]: the groups' light, sums of their weights. A tape may
//   have one such operation, which says how many groups there are.
Value group_light(Tape& tape, Value weights, Real most, Real stop);
//   light, from group_light(); x [r x samples] -> [r x groups]: means of x by the weights that
//   `light` was found from (where there is hardly any light, plain).
Value mean_of_groups(Tape& tape, Value light, Value x);
// Of each sample (kernels/sample_groups.h): its group, its share of the group's mean, and the
// inverse of the group's light.
struct GroupState : OperationState {
  std::vector<int32_t> of, begin;  // begin: Chunk::group_begin
  std::vector<Real> share, per_light;
};

// Colours at distances, as they are seen through a medium (model/medium.h); of samples or of
// groups. `numbers`: where in the model's weights are those it is learnt as, one row of as many as
// math/medium_numbers.h says.
//   colour [3 x n], distance [1 x n] -> exp(-attenuation distance) colour
//                                       + (1 - exp(-backscatter distance)) medium colour
Value see_through(Tape& tape, Value colour, Value distance, const LinearWeights& numbers);
// pixel [4 x rays] before black -> the same before the medium, which is without an end.
Value over_medium(Tape& tape, Value pixel, const LinearWeights& numbers);

// pixel [4 x rays] before black, sky [3 x rays], cover [1 x rays] -> [4 x rays]: the pixel before a
// sky that hides so much of what is behind it (Porter and Duff 1984, `over`). The cover has no
// gradient.
//   rgb + (1 - opacity) cover sky,   opacity + (1 - opacity) cover
Value over_sky(Tape& tape, Value pixel, Value sky, Value cover);

// Adds `gradient` [rows of x], which the caller fills between forward and backward, to the gradient
// of x: for losses that are computed beside the tape (parts/losses.h).
void add_gradient(Tape& tape, Value x, Value gradient);

// pixel [4 x rays], background [3 x rays], change [12 x rays] -> [4 x rays]: what stands before the
// background through an affine map of its ray's, rgb' = (I + A) rgb + b, A standing by rows above
// b; background and opacity as they are.
Value change_colours(Tape& tape, Value pixel, Value background, Value change);

// pixel [4 x rays], background [3 x rays], falloff [3 x rays], corner [1 x rays], the square of the
// pixel's distance from the principal point -> [4 x rays]: what stands before the background with
// the light that the lens lets through there (math/vignetting.h); background and opacity as they
// are. The falloff's numbers may get gradients, the corner none.
Value vignette(Tape& tape, Value pixel, Value background, Value falloff, Value corner);

// Russian roulette (kernels/roulette.h) on the gradient of x [rows x samples], once all operations
// recorded after this one have added to it. Operations recorded before it go back with the kept
// samples alone, as if the chunk had no others (RouletteState). Values of samples recorded before
// it, x among them, are moved accordingly and lose what they were. A tape may have one roulette,
// and no values of groups before it. `least` of 0 leaves out only what has no gradient at all.
// Returns the value whose state it has.
Value roulette(Tape& tape, Value x, Real least);
struct RouletteState : OperationState {
  double offset = 0.5;  // random number in [0, 1), which the chunk's user sets
  // The samples that the backward pass went on with, and the rays' offsets among them: the chunk's
  // `samples` and `ray_begin` from then on.
  std::vector<int32_t> kept, ray_begin;
  std::vector<Real> norms, factor;
};

// What stays and what only one photo shows on the same rays, each giving light by an opacity of its
// own and hiding what is behind it of both (Martin-Brualla et al. 2021, equations 6 to 8, 11, 12).
// All need gradients; the deviation says how uncertain the transient colour is.
struct TransientMatter {
  Value density, colour;                      // [1 x samples], [3 x samples]
  Value transient_density, transient_colour;  // likewise
  Value deviation;                            // [1 x samples]
};
//   delta [1 x samples], background [3 x rays] -> [5 x rays]: colour over the background; opacity,
//   of both kinds; the deviation, weighted by the transient light. Of the static matter alone the
//   weights, which have no gradient. With `opaque_end` the last interval's static matter lets
//   nothing through.
Composite composite_transient(Tape& tape, const TransientMatter& matter, Value delta,
                              Value background, bool opaque_end);

// Of such pixels [5 x rays]: the negative logarithm of a normal distribution's likelihood, without
// its constant, whose standard deviation b is the pixel's and at least `least` (equation 13):
//   scale (sum_k (pixel_k - target_k)^2 / (2 b^2) + 3 log b),   b = deviation + least
Value uncertain_loss(Tape& tape, Value pixel, Value target, Value scale, Real least);

// x [1 x samples]: 3 scale factor times the mean of x over each ray's samples. Adds to Chunk::loss.
Value mean_loss(Tape& tape, Value x, Value scale, Real factor);

// How far a map is from one that only turns and moves (Park et al. 2021, section 3.3), of the
// columns [3 x samples] of its Jacobian: with s_k its singular values
//   scale sum over a ray's samples of weight rho(sum_k log(max(s_k, 1e-6))^2),
//   rho(q) = penalty 2 u / (u + 4),  u = q / penalty^2   (as the authors' code has it)
// The weights [1 x samples] get no gradient. Adds to Chunk::loss.
Value elastic_loss(Tape& tape, const std::array<Value, 3>& columns, Value weights, Value scale,
                   Real penalty);
// The same penalty of |moved - point|^2, both [3 x samples]: scale times its sum over a ray's
// samples, of points that should stay where they are (ibid., section 3.4). Adds to Chunk::loss.
Value still_loss(Tape& tape, Value moved, Value point, Value scale, Real penalty);

// Huber loss of the pixels' colour against target [3 x rays], summed over channels and rays of the
// chunk and times `scale` (1 / (3 rays of the step)); for |r| <= delta it equals r^2. Adds to
// Chunk::loss.
Value huber_loss(Tape& tape, Value pixel, Value target, Value scale, Real delta);

// The same with the squared error r^2, and with the Charbonnier loss sqrt(r^2 + epsilon^2) (Barron
// et al. 2022, section 5).
Value squared_loss(Tape& tape, Value pixel, Value target, Value scale);
Value charbonnier_loss(Tape& tape, Value pixel, Value target, Value scale, Real epsilon);

}  // namespace nerf
