// Denormals: flushed inside the library's calls, as the caller wants them outside; what is computed
// from them is finite and within what flushing may change.
#include <gtest/gtest.h>

#include <cfenv>
#include <cmath>
#include <limits>
#include <memory>
#include <stdexcept>
#include <vector>

#include "kernels/kernel_test.h"
#include "nerf/base/threads.h"
#include "stress/composite_run.h"
#include "stress/stress_field.h"

#if defined(__x86_64__)
#include <xmmintrin.h>
#endif

namespace nerf::stress {
namespace {

// The caller's settings: rounding, and whether denormals are flushed. Not the sticky flags.
unsigned control_word() {
#if defined(__x86_64__)
  return _mm_getcsr() & 0xffc0u;
#else
  const volatile Real least = std::numeric_limits<Real>::denorm_min();
  const Real twice = least + least;
  return static_cast<unsigned>(std::fegetround()) * 2 + (twice > 0);
#endif
}

Frame picture(const RadianceField& field, ThreadPool& pool) {
  return render(field, pinhole(40, 30), look_at({2.5, 1.2, -1.4}, {0, 0, 0}), {}, pool);
}

std::vector<Real> answers(const RadianceField& field, ThreadPool& pool) {
  std::vector<Vec3d> points, directions;
  for (uint64_t i = 0; i < 700; ++i) {
    Random random(81, 0, i);
    points.push_back({random.uniform() - 0.5, random.uniform() - 0.5, random.uniform() - 0.5});
    directions.push_back(normalized(points.back() + Vec3d{0.1, 0, 0}));
  }
  std::vector<Real> out(4 * points.size());
  const std::span<Real> all(out);
  field.query(points, directions, all.first(points.size()), all.subspan(points.size()), pool);
  return out;
}

TEST(StressFpState, CallsLeaveTheCallersStateAsItWas) {
  for_each_target([&](const std::string&) {
    const RadianceField field = wild_field(true, 3, 1, 2, 3);
    for (int threads : {1, 3}) {
      ThreadPool pool(threads);
      const unsigned before = control_word();
      picture(field, pool);
      EXPECT_EQ(control_word(), before) << "after render, threads " << threads;
      answers(field, pool);
      EXPECT_EQ(control_word(), before) << "after query, threads " << threads;
      Cancel cancel;
      cancel.request();
      EXPECT_THROW(render(field, pinhole(40, 30), Pose(), {}, pool, {}, &cancel), Cancelled);
      EXPECT_EQ(control_word(), before) << "after a cancelled render, threads " << threads;
      for (int64_t items : {1, 50})
        EXPECT_THROW(pool.parallel_for(items, [](int64_t) { throw std::runtime_error("test"); }),
                     std::runtime_error);
      EXPECT_EQ(control_word(), before) << "after a failure, threads " << threads;
      {
        FlushDenormals outer;
        const unsigned flushing = control_word();
        EXPECT_NE(flushing, before);
        picture(field, pool);
        EXPECT_EQ(control_word(), flushing) << "a caller that flushes goes on flushing";
      }
      EXPECT_EQ(control_word(), before);
    }
  });
}

// A caller may flush denormals or keep them: the same bits, for fields full of denormals too, among
// them one whose networks magnify denormal features to densities.
TEST(StressFpState, TheCallersStateChangesNoBit) {
  for_each_target([&](const std::string&) {
    for (Real features : {1.0_r, 1e-4_r, 1e-38_r})
      for (Real gain : {1.0_r, 1e-19_r, 3e18_r}) {
        const RadianceField field = wild_field(false, 1, features, gain, 5);
        ThreadPool pool(2), alone(1);
        const Frame kept = picture(field, pool);
        const std::vector<Real> asked = answers(field, pool);
        const FlushDenormals outer;
        const Frame flushed = picture(field, alone);
        EXPECT_EQ(kept.rgb, flushed.rgb);
        EXPECT_EQ(kept.alpha, flushed.alpha);
        EXPECT_EQ(kept.depth_z, flushed.depth_z);
        EXPECT_EQ(asked, answers(field, alone));
        expect_picture(kept);
      }
  });
}

// Rays of denormal densities, lengths, colours and gradients, kept and flushed: in either case
// within the bounds of check_ray.
TEST(StressFpState, CompositeOfDenormals) {
  CompositeErrors errors;
  for_each_target([&](const std::string&) {
    constexpr Real kLeast = std::numeric_limits<Real>::denorm_min();
    for (bool flush : {false, true}) {
      const auto guard = flush ? std::make_unique<FlushDenormals>() : nullptr;
      for (Real density : {kLeast, 1e-40_r, 1e-38_r, 1.0_r})
        for (Real length : {kLeast, 1e-40_r, 1.0_r, 1e7_r})
          for (Real colour : {kLeast, 1e-39_r, 1.0_r}) {
            Matter m;
            m.background = {colour, 1e-40_r, 0};
            m.gradient = {1, kLeast, 1e-38_r, 1e-42_r};
            for (int i = 0; i < 40; ++i)
              m.add(i % 3 ? density : 0.1_r, i % 2 ? length : 0.3_r, {colour, 1, kLeast});
            check_ray(m, errors, "density", density, "length", length, "flush", flush);
          }
    }
  });
  errors.report();
}

}  // namespace
}  // namespace nerf::stress
