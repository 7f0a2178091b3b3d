// A march in float against brute_march.h: says in what they differ by more than float must.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "parts/brute_march.h"

namespace nerf::march_check {

// Segments lie within `most` and cover `least` (the same where there is no doubt), up to the slack
// of the stretches' ends; says what is wrong, or nothing.
inline std::string difference(const RaySampler& sampler, const std::vector<Stretch>& most,
                              const std::vector<Stretch>& least, double sliver) {
  std::ostringstream out;
  double slack = 1e-9, length = 0, got = 0, before = 0;
  for (const Stretch& s : least) {
    slack += s.slack0 + s.slack1 + s.gaps;
    length += s.t1 - s.t0;
  }
  for (const Segment& s : sampler.segments()) {
    if (!(s.t0 < s.t1) || !(s.thickness > 0)) out << "empty segment at " << s.t0 << "; ";
    if (!(s.t0 >= before)) out << "segments overlap at " << s.t0 << "; ";
    before = s.t1;
    got += static_cast<double>(s.t1) - static_cast<double>(s.t0);
    slack += kRoundoff * 4;
    const double a = sampler.start() + s.t0, b = sampler.start() + s.t1;
    const double rounding = kRoundoff * 4 * (1 + s.t1) + 1e-15 * std::fabs(sampler.start());
    double inside = 0;
    for (const Stretch& w : most)
      inside += std::max(
          0.0, std::min(b, w.t1 + w.slack1 + rounding) - std::max(a, w.t0 - w.slack0 - rounding));
    // Thin gaps between stretches are counted twice by their slack: at least is what matters.
    if (!(inside >= (b - a) * (1 - 1e-6) - sliver))
      out << "segment " << a << " to " << b << " holds empty space; ";
  }
  if (got < length - slack || (&most == &least && got > length + slack))
    out << "length of matter " << got << ", expected " << length << " within " << slack << "; ";
  return out.str();
}

// What is in both; what is in either, with stretches that may overlap.
inline std::vector<Stretch> intersection(const std::vector<Stretch>& a,
                                         const std::vector<Stretch>& b) {
  std::vector<Stretch> out;
  for (const Stretch& x : a)
    for (const Stretch& y : b) {
      const Stretch &late = x.t0 > y.t0 ? x : y, &early = x.t1 < y.t1 ? x : y;
      if (late.t0 < early.t1)
        out.push_back({late.t0, early.t1, late.slack0, early.slack1, x.gaps + y.gaps});
    }
  return out;
}

// A grid and the pattern that it was made of.
struct Scene {
  std::string name;
  int cascades;
  Pattern pattern;
  int side;
  OccupancyGrid grid;
  Scene(std::string n, int c, Pattern p, int s = OccupancyGrid::kDefaultSide)
      : name(std::move(n)),
        cascades(c),
        pattern(std::move(p)),
        side(s),
        grid(make_grid(c, pattern, s)) {}
};

// `sliver`: how far a segment may reach into empty space, where a ray meets corners of cells.
inline void march_and_compare(const Scene& scene, RaySampler& sampler, const Ray& ray,
                              const std::string& what, const Box3& clip = kEverywhere,
                              double sliver = 1e-9) {
  RaySamples samples;
  sampler.sample_all(ray, 1, samples);
  const std::vector<Stretch> exact =
      brute_march(ray, clip, scene.cascades, scene.pattern, scene.side);
  std::string wrong = difference(sampler, exact, exact, sliver);
  // Where a ray runs along a plane so closely that float can hardly tell the sides apart, matter on
  // either side is right.
  std::vector<Stretch> most = exact, least = exact;
  // A far origin is subtracted in double.
  const double unseen = 8 * kRoundoff * std::ldexp(1.0, scene.cascades - 1) +
                        4 * kDoubleRoundoff * length(ray.origin);
  for (int i = 0; i < 3 && !wrong.empty(); ++i) {
    if (std::fabs(ray.direction[i]) > 1e-5) continue;
    for (double side : {-unseen, unseen}) {
      Ray beside = ray;
      beside.origin[i] += side;
      const auto other = brute_march(beside, clip, scene.cascades, scene.pattern, scene.side);
      most.insert(most.end(), other.begin(), other.end());
      least = intersection(least, other);
    }
    wrong = difference(sampler, most, least, sliver);
  }
  if (wrong.empty()) return;
  const Vec3d &o = ray.origin, &d = ray.direction;
  ADD_FAILURE() << scene.name << ", " << what << ": " << wrong << "origin " << o.x << ' ' << o.y
                << ' ' << o.z << " direction " << d.x << ' ' << d.y << ' ' << d.z;
}

}  // namespace nerf::march_check
