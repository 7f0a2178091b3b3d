// The gradients of a method's whole loss, all levels and networks and every loss of theirs, against
// the scalar template by complex step.
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "autodiff/gradient_check.h"
#include "model/network_template.h"
#include "nerf/math/reference/histogram_losses.h"
#include "nerf/model/network_levels.h"
#include "nerf/parts/losses.h"
#include "support/network_options.h"
#include "support/network_rays.h"

namespace nerf {
namespace {

constexpr int kGradientRays = 2;
constexpr double kDepth = 2, kDepthWeight = 0.5;  // of the first ray alone
constexpr double kBefore = static_cast<double>(gradient_check::Run::kBefore);

NetworkOptions tiny(NetworkOptions o) {
  o = test::small_network(o);
  o.width = o.proposal_width = 8;
  o.bottleneck = 3;
  o.view_width = 6;
  o.transient_width = 5;
  o.deform.width = o.deform.sheet_width = 8;
  o.sampling.coarse = 4;
  o.sampling.fine = 5;
  return o;
}

// What one level read: where samples lie is no function of the weights (all three papers stop
// gradients there).
struct LevelGiven {
  test::NetworkInputs<double> inputs;
  Rays rays;
  std::vector<std::vector<double>> edges;   // of each ray, in normalised distance
  std::vector<std::vector<double>> places;  // of each ray's samples, in inverse distance
};

LevelGiven level_given(const NetworkLevels& levels, int level) {
  const NetworkTape& t = levels.tape(level);
  const Chunk& c = levels.chunk(level);
  const auto columns = [&](Value v) {
    Columns<double> out(static_cast<size_t>(c.count(v)));
    for (size_t s = 0; s < out.size(); ++s)
      for (int row = 0; row < t.tape.rows(v); ++row)
        out[s].push_back(c.data(v)[static_cast<size_t>(row * c.stride(v)) + s]);
    return out;
  };
  LevelGiven out;
  out.inputs.position = columns(t.position);
  if (t.variance > 0) out.inputs.variance = columns(t.variance);
  out.inputs.delta = columns(t.delta);
  if (t.pixel >= 0) {
    out.inputs.directions = columns(t.directions);
    out.inputs.background = columns(t.background);
    out.inputs.target = columns(t.pixel_loss.target);
    out.inputs.scale = columns(t.pixel_loss.scale);
    if (t.photo >= 0) out.inputs.photo = columns(t.photo);
    if (t.camera >= 0) out.inputs.camera = columns(t.camera);
  }
  if (t.deform.time >= 0) out.inputs.time = columns(t.deform.time);
  if (t.deform.moment >= 0) out.inputs.moment = columns(t.deform.moment);
  if (t.deform.moving >= 0) out.inputs.moving = columns(t.deform.moving);
  if (t.deform.elastic_scale >= 0) out.inputs.elastic_scale = columns(t.deform.elastic_scale);
  out.rays.assign(c.ray_begin, c.ray_begin + c.rays + 1);
  for (int r = 0; r < c.rays; ++r) {
    out.edges.emplace_back();
    for (const Real entry : levels.posts(level, r))
      out.edges.back().push_back(levels.sampler().normalised(entry));
    if (!levels.sampler().intervals()) out.edges.back().push_back(1);
    std::vector<double> ends;
    for (const Real entry : levels.posts(level, r)) {
      const double distance = static_cast<double>(levels.sampler().distance(entry));
      ends.push_back(1 - 1 / (1 + distance));
    }
    out.places.emplace_back(ends);
    if (!levels.sampler().intervals()) continue;
    out.places.back().pop_back();
    for (size_t i = 0; i + 1 < ends.size(); ++i) out.places.back()[i] = (ends[i] + ends[i + 1]) / 2;
  }
  return out;
}

template <class T>
Columns<T> in_type(const Columns<double>& x) {
  Columns<T> out;
  for (const auto& column : x) out.emplace_back(column.begin(), column.end());
  return out;
}

template <class T>
std::vector<T> of_ray(const Columns<T>& x, const Rays& rays, size_t r) {
  std::vector<T> out;
  for (int32_t s = rays[r]; s < rays[r + 1]; ++s) out.push_back(x[static_cast<size_t>(s)][0]);
  return out;
}

// Every term of the loss of all levels.
template <class T>
Columns<T> loss_of_levels(const NetworkField& field, const NetworkLosses& losses,
                          const std::vector<LevelGiven>& given, double ray_scale,
                          const std::vector<T>& weights) {
  Columns<T> terms;
  std::vector<test::NetworkOutputs<T>> outputs;
  for (size_t l = 0; l < given.size(); ++l) {
    const auto& in = given[l].inputs;
    outputs.push_back(test::network_template<T>(
        field.options, field.network_of(static_cast<int>(l)), weights,
        {in_type<T>(in.position), in_type<T>(in.variance), in_type<T>(in.directions),
         in_type<T>(in.delta), in_type<T>(in.background), in_type<T>(in.target),
         in_type<T>(in.scale), in_type<T>(in.photo), in_type<T>(in.camera), in_type<T>(in.time),
         in_type<T>(in.moment), in_type<T>(in.moving), in_type<T>(in.elastic_scale), field.windows},
        given[l].rays,
        {.pixel = losses.pixel,
         .transient = l + 1 == given.size(),
         .least_deviation = losses.least_deviation,
         .transient_density = losses.transient_density}));
    for (const auto& term : outputs.back().loss) terms.push_back(term);
  }
  // A ray's scale is that of a mean over rays and three channels.
  const LevelGiven& last = given.back();
  const double per_ray = 3 * ray_scale;
  if (losses.depth)
    for (size_t l = 0; l < given.size(); ++l)
      if (!given[l].inputs.target.empty())
        terms.push_back(
            {reference::depth_loss(given[l].places[0], of_ray(outputs[l].weights, given[l].rays, 0),
                                   1 - 1 / (1 + kDepth), 0.01) *
             T(kDepthWeight * per_ray)});
  for (size_t r = 0; r < kGradientRays; ++r) {
    const std::vector<T> w = of_ray(outputs.back().weights, last.rays, r);
    if (losses.distortion > 0)
      terms.push_back({reference::distortion_loss(last.edges[r], w) *
                       T(static_cast<double>(losses.distortion) * per_ray)});
    if (losses.interlevel == 0) continue;
    std::vector<double> fixed;
    for (const T& v : w) {
      using reference::real_part;
      fixed.push_back(real_part(v));
    }
    for (size_t l = 0; l + 1 < given.size(); ++l)
      terms.push_back(
          {reference::interlevel_loss(last.edges[r], fixed, given[l].edges[r],
                                      of_ray(outputs[l].weights, given[l].rays, r),
                                      static_cast<double>(kInterlevelEpsilon)) *
           T(static_cast<double>(losses.interlevel) * per_ray / static_cast<double>(w.size()))});
  }
  return terms;
}

struct MethodCase {
  std::string name;
  NetworkOptions options;
  NetworkLosses losses;
};

std::vector<MethodCase> methods() {
  MethodCase mipnerf360{"mipnerf360", tiny(test::mipnerf360_options()), {}};
  mipnerf360.options.image_code = 3;
  mipnerf360.losses.coarse = 0;
  mipnerf360.losses.interlevel = 1;
  mipnerf360.losses.distortion = 0.3_r;
  mipnerf360.losses.pixel = PixelLoss::charbonnier(0.001_r);
  MethodCase mipnerf{"mipnerf", tiny(test::mipnerf_options()), {}};
  mipnerf.losses.coarse = 0.1_r;
  mipnerf.losses.distortion = 0.1_r;
  MethodCase nerf{"nerf", tiny(test::nerf_options()), {}};
  nerf.options.density_bias = 1;  // a ReLU that is dead for all samples has no gradient
  MethodCase nerfw{"nerfw", tiny(test::nerfw_options()), {}};
  nerfw.losses.coarse = 0.5_r;
  nerfw.losses.least_deviation = 0.3_r;
  nerfw.losses.transient_density = 0.1_r;
  MethodCase weighed = nerfw;  // a loss on the weights of what is not transient
  weighed.name = "nerfw_distortion";
  weighed.losses.distortion = 0.3_r;
  MethodCase dnerf{"dnerf", tiny(test::dnerf_options()), {}};
  dnerf.options.density_bias = 1;
  dnerf.losses.coarse = 0;  // one network, whose first level gives weights alone
  MethodCase nerfies{"nerfies", tiny(test::nerfies_options()), {}};
  nerfies.losses.elastic = true;
  MethodCase sheet{"hypernerf_sheet", tiny(test::hypernerf_options()), {}};
  MethodCase plane = sheet;
  plane.name = "hypernerf_plane";
  plane.options.deform.slice = Slice::kPlane;
  std::vector<MethodCase> all{nerf,  mipnerf, mipnerf360, nerfw, weighed,
                              dnerf, nerfies, sheet,      plane};
  for (const MethodCase& method : {nerf, mipnerf, mipnerf360, nerfw, dnerf}) {
    all.push_back(method);
    all.back().name += "_depth";
    all.back().losses.depth = true;
  }
  return all;
}

// Of two photos of two moments, by two cameras.
CodeShape codes_of(const NetworkOptions& o) {
  CodeShape codes = code_shape(o, {"a", "b"});
  codes.moments = {0, 0.5};
  codes.photo_moments = {0, 1};
  codes.cameras = {1, 2};
  codes.photo_cameras = {0, 1};
  return codes;
}

// As trainings do, whose warps begin within 1e-4 of standing still. Motions as long as the scene,
// encoded and encoded again, would have bounds that cannot tell a gradient from another.
void move_little(const NetworkField& field, gradient_check::Problem& problem) {
  const DeformNetworks& deform = field.networks.back().deform;
  for (const LinearWeights* last : {&deform.warp.last, &deform.sheet.last})
    if (last->out > 0)
      for (const size_t at : gradient_check::Problem::places(*last)) problem.weights[at] /= 16;
}

TEST(NetworkLevels, GradientOfEveryLevelAndLoss) {
  for (const MethodCase& method : methods()) {
    SCOPED_TRACE(method.name);
    WorstError loss(method.name + "_loss"), element(method.name + "_backward"),
        norm(method.name + "_norm");
    NetworkField field(codes_of(method.options), method.options, 1, 4);
    field.windows = {1.25, 0.5};  // within a frequency
    for_each_target([&](const std::string&) {
      // Weights as the generic test draws them; there is no tape of which it could be one's input.
      TapeUnderTest of_weights{nullptr, {}, {}, field.layers(), {}, 900, 1, 0.5};
      for (const LinearWeights* table :
           {&field.books.appearance, &field.books.transient, &field.books.deformation,
            &field.books.plane, &field.books.camera})
        if (table->out > 0) of_weights.layers.push_back(*table);
      const Rays no_rays{0};
      gradient_check::Problem problem(of_weights, no_rays, 4);
      move_little(field, problem);
      for (size_t i = 0; i < problem.weights.size(); ++i)
        field.weights[i] = static_cast<Real>(problem.weights[i]);

      std::vector<NetworkRay> rays = test::some_rays(kGradientRays, 2);
      for (int r = 0; r < kGradientRays; ++r) {
        NetworkRay& ray = rays[static_cast<size_t>(r)];
        ray.photo = ray.moment = ray.camera = r;
        ray.time = 0.5_r * static_cast<Real>(r);
        ray.depth = r == 0 ? static_cast<Real>(kDepth) : 0;
      }
      const std::vector<NetworkRay> before = rays;
      NetworkLevels levels(field, kGradientRays, true, method.losses);
      // A hundredth of the loss: beside the pixels' terms, whose bound it shares, a penalty that
      // is a fifteenth off shows.
      levels.weigh_elastic(0.05_r);
      levels.weigh_depth(static_cast<Real>(kDepthWeight));
      levels.forward(rays, 1);
      std::vector<LevelGiven> given;
      for (int l = 0; l < levels.levels(); ++l) given.push_back(level_given(levels, l));
      const ScalarFunction f = [&]<class T>(const Given<T>& v) {
        return Outputs<T>{loss_of_levels(field, method.losses, given,
                                         static_cast<double>(rays[0].scale), v.weights)};
      };
      const auto truth = gradient_check::expected_gradients(problem, f);
      for (size_t i = 0; i < truth.size(); ++i)
        EXPECT_TRUE(std::ranges::any_of(truth[i], [](const auto& e) { return e.gradient != 0; }))
            << "layer " << i;
      const auto nothing = [](auto&) {};
      const double want = problem.loss(problem.evaluate<double>(f, nothing));
      const double size = problem.loss(problem.evaluate<Magnitude>(f, nothing)).size;

      for (const bool skip : {false, true}) {
        if (skip && !levels.can_skip()) continue;
        rays = before;  // the same random numbers
        if (skip) levels.forward(rays, 1, true);
        AlignedArray<Real> gradient(field.weights.size());
        for (Real& g : gradient) g = gradient_check::Run::kBefore;
        loss.compare(levels.backward(gradient.data()), want,
                     of_weights.roundings * kRoundoff * size, "loss");
        for (size_t i = 0; i < truth.size(); ++i) {
          std::vector<double> got;
          for (const size_t at : gradient_check::Problem::places(of_weights.layers[i]))
            got.push_back(static_cast<double>(gradient[at]) - kBefore);
          gradient_check::compare_gradient(of_weights, i, true, got, truth[i], element, norm);
        }
      }
    });
    loss.report();
    element.report();
    norm.report();
  }
}

}  // namespace
}  // namespace nerf
