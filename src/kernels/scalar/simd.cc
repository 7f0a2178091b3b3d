// The one target of a build in double.
#include "nerf/kernels/simd.h"

#include <cstdlib>
#include <mutex>

#include "nerf/base/error.h"

namespace nerf {
namespace {

const std::string kTarget = "DOUBLE";

void check(const std::string& name, const std::string& where) {
  if (!name.empty() && name != kTarget)
    throw Error("no SIMD target '" + name + "' in a build in double", where,
                "available: " + kTarget);
}

}  // namespace

std::string simd_target() {
  static std::once_flag once;
  std::call_once(once, [] {
    const char* name = std::getenv("NERF_SIMD");
    check(name ? name : "", "NERF_SIMD");
  });
  return kTarget;
}

std::vector<std::string> simd_targets() { return {simd_target()}; }

void force_simd_target(const std::string& name) {
  simd_target();
  check(name, "");
}

}  // namespace nerf
