#include "nerf/kernels/simd.h"

#include <hwy/targets.h>

#include <cstdlib>
#include <mutex>

#include "nerf/base/error.h"

namespace nerf {
namespace {

// The targets that the kernel sources are compiled for (cmake/NerfLayers.cmake), best first.
#if defined(__x86_64__)
constexpr int64_t kCompiled[] = {HWY_AVX3, HWY_AVX2};
#else
constexpr int64_t kCompiled[] = {HWY_NEON};
#endif

// Must be called before any target is forced: Highway then still says what the processor has.
std::vector<int64_t> detect() {
  const int64_t supported = hwy::SupportedTargets();
  std::vector<int64_t> out;
  for (int64_t t : kCompiled)
    if (supported & t) out.push_back(t);
  if (out.empty())
    throw Error("this processor lacks the AVX2 and FMA instructions that the kernels need", "",
                "run on a processor of 2015 or later");
  return out;
}

const std::vector<int64_t>& available() {
  static const std::vector<int64_t> targets = detect();
  return targets;
}

void force(const std::string& name, const std::string& where) {
  const std::vector<int64_t>& targets = available();
  std::string known;
  for (int64_t t : targets) {
    if (name.empty() || name == hwy::TargetName(t)) {
      // Highway picks the best of the supported set, so leave it only this one.
      hwy::SetSupportedTargetsForTest(t);
      hwy::GetChosenTarget().Update(hwy::SupportedTargets());
      return;
    }
    known += (known.empty() ? "" : ", ") + std::string(hwy::TargetName(t));
  }
  throw Error("no SIMD target '" + name + "' on this processor", where, "available: " + known);
}

void choose_once() {
  static std::once_flag once;
  std::call_once(once, [] {
    const char* name = std::getenv("NERF_SIMD");
    force(name ? name : "", "NERF_SIMD");
  });
}

}  // namespace

std::string simd_target() {
  choose_once();
  return hwy::TargetName(hwy::SupportedTargets() & -hwy::SupportedTargets());
}

std::vector<std::string> simd_targets() {
  choose_once();
  std::vector<std::string> out;
  for (int64_t t : available()) out.push_back(hwy::TargetName(t));
  return out;
}

void force_simd_target(const std::string& name) {
  choose_once();
  force(name, "");
}

}  // namespace nerf
