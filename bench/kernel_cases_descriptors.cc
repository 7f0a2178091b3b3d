// Matching of features: every descriptor of one photo with every one of another.
#include <memory>

#include "kernel_bench.h"
#include "nerf/kernels/descriptors.h"
#include "nerf/math/random.h"

namespace nerf::apps {
namespace {

constexpr int64_t kFeatures = 8000;

struct PhotoPair {
  PhotoPair() {
    // Bytes as SIFT's: most of them small, the length 512.
    Random random(7, 1, 0);
    for (std::vector<uint8_t>* photo : {&a, &b})
      for (uint8_t& v : *photo) {
        const Real x = random.uniform();
        v = static_cast<uint8_t>(102 * x * x);
      }
  }
  std::vector<uint8_t> a = std::vector<uint8_t>(kFeatures * kDescriptorBytes), b = a;
  std::vector<NearestTwo> of_rows = std::vector<NearestTwo>(kFeatures), of_columns = of_rows;
};

}  // namespace

std::vector<KernelCase> descriptor_cases() {
  return {{"nearest descriptors, 8000 x 8000", Unit::kFlops, kBoundFma, [](int threads) {
             // A pair of photos for each thread, as a capture's pairs are shared out.
             auto pairs = std::make_shared<std::vector<PhotoPair>>(threads);
             KernelRun run;
             run.work = 2.0 * kFeatures * kFeatures * kDescriptorBytes * threads;
             run.ceiling = [](Ceilings& c) { return c.flops(); };
             run.run = [=](ThreadPool& pool) {
               pool.parallel_for(threads, [&](int64_t i) {
                 PhotoPair& p = (*pairs)[static_cast<size_t>(i)];
                 nearest_descriptors(kFeatures, p.a.data(), kFeatures, p.b.data(), p.of_rows.data(),
                                     p.of_columns.data());
               });
             };
             return run;
           }}};
}

}  // namespace nerf::apps
