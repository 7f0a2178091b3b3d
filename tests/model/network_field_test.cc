#include "nerf/model/network_field.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <string>

#include "autodiff/gradient_check.h"
#include "model/network_template.h"
#include "nerf/base/error.h"
#include "support/network_options.h"

namespace nerf {
namespace {

using test::mipnerf360_options;
using test::mipnerf_options;
using test::nerf_options;
using test::small_network;

// NeRF: 595,844 each (methods' reference); mip-NeRF 360: the authors' own count.
TEST(NetworkField, ParametersAreThePapers) {
  const NetworkField nerf(nerf_options(), 2, 6);
  ASSERT_EQ(nerf.networks.size(), 2u);
  EXPECT_EQ(nerf.networks[0].parameters(), 595844u);
  EXPECT_EQ(nerf.networks[1].parameters(), 595844u);
  const NetworkField mipnerf360(mipnerf360_options(), 0.2, 1e6);
  EXPECT_EQ(mipnerf360.parameters(), 9007493u);
  const NetworkField mipnerf(mipnerf_options(), 2, 6);
  EXPECT_EQ(mipnerf.networks.size(), 1u);  // shared
  // By hand: 96 to 256, six of 256 to 256 besides the one behind the skip, heads.
  EXPECT_EQ(mipnerf.parameters(), 97u * 256 + 6u * 257 * 256 + (256u + 96 + 1) * 256 + 257 +
                                      257u * 256 + (256u + 27 + 1) * 128 + 129u * 3);
}

TEST(NetworkField, OffAxisDirections) {
  const auto p = off_axis_directions();
  ASSERT_EQ(p.size(), 21u);
  for (size_t i = 0; i < p.size(); ++i) {
    EXPECT_NEAR(length(p[i]), 1, 1e-6);
    for (size_t j = 0; j < i; ++j) EXPECT_LT(std::fabs(dot(p[i], p[j])), 0.9_r);  // 31.7 degrees
  }
  // Evenly spread: sum p p^T is a multiple of the identity, 21 / 3.
  for (int a = 0; a < 3; ++a)
    for (int b = 0; b < 3; ++b) {
      double sum = 0;
      for (const Vec3& v : p) sum += static_cast<double>(v[a]) * static_cast<double>(v[b]);
      EXPECT_NEAR(sum, a == b ? 7 : 0, 1e-5);
    }
}

TEST(NetworkField, FirstWeightsFollowTheSeedAndTheirBounds) {
  for (Initialisation kind : {Initialisation::kGlorot, Initialisation::kHe}) {
    NetworkOptions o = nerf_options();
    o.initialisation = kind;
    NetworkField a(o, 2, 6), b(o, 2, 6), c(o, 2, 6);
    a.initialise(1);
    b.initialise(1);
    c.initialise(2);
    EXPECT_TRUE(std::equal(a.weights.begin(), a.weights.end(), b.weights.begin()));
    EXPECT_FALSE(std::equal(a.weights.begin(), a.weights.end(), c.weights.begin()));
    const LinearWeights& w = a.networks[0].trunk[1];
    const Real bound =
        std::sqrt(6.0_r / static_cast<Real>(kind == Initialisation::kHe ? w.in : w.in + w.out));
    Real largest = 0;
    for (size_t i = w.offset; i < w.bias_offset(); ++i)
      largest = std::max(largest, std::fabs(a.weights[i]));
    EXPECT_LE(largest, bound);
    EXPECT_GT(largest, 0.99_r * bound);  // of 65536 draws
    for (int j = 0; j < w.out; ++j)
      EXPECT_EQ(a.weights[w.bias_offset() + static_cast<size_t>(j)], 0);
    EXPECT_NE(a.weights[a.networks[0].trunk[0].offset], a.weights[a.networks[1].trunk[0].offset]);
  }
}

// A row for each photo while it is trained, none in what is rendered; the networks stay where they
// are.
TEST(NetworkField, PhotosHaveCodesOfTheirOwn) {
  NetworkOptions o = mipnerf360_options();
  o.image_code = 4;
  NetworkField trained(o, 2, 6, {"a", "b", "c", "d", "e"});
  const NetworkField rendered(o, 2, 6);
  EXPECT_EQ(trained.codes().appearance.out, 5);
  EXPECT_EQ(trained.network_size(), rendered.weights.size());
  EXPECT_EQ(trained.parameters(), 9007493u + 4 * 128);
  trained.initialise(1);
  double square = 0;
  Real largest = 0;
  for (int j = 0; j < 5; ++j)
    for (int k = 0; k < 4; ++k) {
      const Real c = trained.weights[trained.codes().appearance.offset +
                                     static_cast<size_t>(j * weight_stride(4) + k)];
      square += static_cast<double>(c * c);
      largest = std::max(largest, std::fabs(c));
    }
  EXPECT_LE(largest, std::sqrt(0.75_r));
  // 20 draws of variance 1/4; of their squares the standard deviation is 0.224.
  EXPECT_NEAR(square / 20, 0.25, 4 * 0.224 / std::sqrt(20.0));
}

// NeRF-W's: of variance 1, those of what is transient behind the others; the head of what is
// transient is the last network's alone.
TEST(NetworkField, PhotosHaveCodesOfWhatIsTransient) {
  const NetworkOptions o = test::nerfw_options();
  NetworkField field(o, 2, 6, {"a", "b", "c"});
  EXPECT_EQ(field.networks[0].transient_codes.offset, field.books.transient.offset);
  EXPECT_EQ(field.networks[1].codes.offset, field.books.appearance.offset);
  EXPECT_EQ(field.books.transient.in, 16);
  EXPECT_TRUE(field.networks[0].transient.empty());
  ASSERT_EQ(field.networks[1].transient.size(), 5u);
  const size_t head = (512u + 16 + 1) * 128 + 3u * 129 * 128 + 129u * 5;
  EXPECT_EQ(field.networks[1].parameters(), field.networks[0].parameters() + head);
  field.initialise(1);
  for (const LinearWeights* table : {&field.books.appearance, &field.books.transient}) {
    double square = 0;
    for (int j = 0; j < 3; ++j)
      for (int k = 0; k < table->in; ++k)
        square += std::pow(
            static_cast<double>(field.weights[gradient_check::Problem::index(*table, j, k)]), 2);
    const double n = 3 * table->in;
    EXPECT_NEAR(square / n, 1, 4 * 0.894 / std::sqrt(n)) << table->in;
  }
}

TEST(NetworkField, ImpossibleCombinationsAreErrors) {
  const auto refused = [](const std::function<void(NetworkOptions&)>& change) {
    NetworkOptions o = nerf_options();
    change(o);
    try {
      o.check_options();
    } catch (const Error& e) {
      return std::string(e.what());
    }
    return std::string();
  };
  EXPECT_EQ(refused([](NetworkOptions&) {}), "");
  EXPECT_NE(refused([](NetworkOptions& o) { o.cast = Cast::kCone; }).find("cones need intervals"),
            std::string::npos);
  EXPECT_NE(refused([](NetworkOptions& o) {
              o.encoding = Encoding::kIntegrated;
              o.position_degrees = 0;
            }).find("at least one frequency"),
            std::string::npos);
  EXPECT_NE(refused([](NetworkOptions& o) {
              o.shared = true;
              o.proposal_colour = false;
            }).find("colours at every level"),
            std::string::npos);
  EXPECT_NE(refused([](NetworkOptions& o) {
              o.image_code = 4;
              o.view_dependence = false;
            }).find("view direction"),
            std::string::npos);
  EXPECT_NE(refused([](NetworkOptions& o) {
              o.transient_code = 4;
              o.view_dependence = false;
            }).find("transient"),
            std::string::npos);
}

// The whole network with its rendering and its loss, against the scalar templates.
TEST(NetworkField, GradientOfTheWholeModel) {
  for (const NetworkOptions& full : {nerf_options(), mipnerf_options(), mipnerf360_options()}) {
    for (bool view_dependence : {true, false}) {
      NetworkOptions o = small_network(full);
      o.view_dependence = view_dependence;
      if (view_dependence && o.opaque_end) o.image_code = 3;
      const NetworkField field(o, 2, 6, {"a", "b"});
      NetworkTape t(o, field.networks.back(), 32, 4, NetworkTape::Purpose::kTrain, {});
      TapeUnderTest test{&t.tape, {}, {}, {}, {}, 900};
      const auto input = [&](Value value, TestInput spec) {
        test.inputs.push_back(value);
        test.specs.push_back(spec);
      };
      input(t.position, {position_rows(o), Domain::kSamples, false, -1, 1});
      if (o.integrated()) input(t.variance, {position_rows(o), Domain::kSamples, false, 0, 0.1});
      input(t.directions, {3, Domain::kRays, false, -1, 1, /*unit=*/true});
      input(t.delta, {1, Domain::kSamples, false, 0.05, 0.3});
      input(t.background, {3, Domain::kRays, false, 0, 1});
      input(t.pixel_loss.target, {3, Domain::kRays, false, 0, 1});
      input(t.pixel_loss.scale, {1, Domain::kRays, false, 0.1, 1});
      if (o.image_code > 0) input(t.photo, {1, Domain::kRays, false, -1, 2});
      const RadianceNetwork& n = field.networks.back();
      for (const LinearWeights& w : n.trunk) test.layers.push_back(w);
      for (const LinearWeights* w : {&n.density, &n.bottleneck, &n.view, &n.colour, &n.codes})
        if (w->out > 0) test.layers.push_back(*w);
      test.shared = 1;
      test.weight_range = 0.4;
      SCOPED_TRACE(position_features(o));
      check_gradients(
          "network", test,
          [&]<class T>(const Given<T>& v) {
            test::NetworkInputs<T> in;
            size_t next = 0;
            in.position = v[next++];
            if (o.integrated()) in.variance = v[next++];
            for (auto* value : {&in.directions, &in.delta, &in.background, &in.target, &in.scale})
              *value = v[next++];
            if (o.image_code > 0) in.photo = v[next];
            return Outputs<T>{test::network_template<T>(o, n, v.weights, in, v.rays, {}).loss};
          },
          {{0, 3, 3, 10}});
    }
  }
}

}  // namespace
}  // namespace nerf
