// Which instruction set the kernels run on. Chosen once per process, when the first field is made:
// the best that the processor has, or the one that the environment variable NERF_SIMD names.
#pragma once

#include <string>
#include <vector>

namespace nerf {

// Name of the target in use, e.g. "AVX2". Throws Error where the processor has none of the targets
// (x86-64 without AVX2) or NERF_SIMD names one that is unknown or not available here.
std::string simd_target();

// Targets that can run on this processor, best first.
std::vector<std::string> simd_targets();

// Forces a target by name ("" = the best again). For tests and benchmarks; not while kernels run.
void force_simd_target(const std::string& name);

}  // namespace nerf
