// bfloat16, the upper half of a float: which unit of the processor multiplies it, and conversions.
//
// Every unit multiplies pairs of bf16 and sums in f32. Their orders differ, so that a run's bits
// belong to one unit; math/reference/bf16.h has each as a template.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "nerf/base/options.h"

namespace nerf {

// Precision of the operands of linear layers; sums and everything else are f32 in both.
enum class Precision {
  kAuto,  // bf16 where it is the faster one
  kF32,
  kBf16,
};
inline auto option_names(Precision) {
  return std::array{OptionName{Precision::kAuto, "auto"}, OptionName{Precision::kF32, "f32"},
                    OptionName{Precision::kBf16, "bf16"}};
}

enum class Bf16Unit {
  kNone,
  kAvx512,  // AVX512-BF16: vdpbf16ps
  kAmx,     // AMX-BF16: tdpbf16ps on tiles
};

// The unit in use, chosen once per process: the best that the processor has, or the one that the
// environment variable NERF_BF16 names. kNone where there is none, or where the kernels run on
// another target than AVX-512 (simd.h). Throws Error where NERF_BF16 names one that is not here.
Bf16Unit bf16_unit();
// The units of this processor, best first, without kNone.
std::vector<Bf16Unit> bf16_units();
std::string bf16_unit_name(Bf16Unit unit);  // "AMX_BF16", "AVX512_BF16", "none"
// For tests and benchmarks; not while kernels run.
void force_bf16_unit(Bf16Unit unit);

// kF32 or kBf16. kAuto takes bf16 on AMX, and on AMD's processors that have AVX512-BF16: Intel's
// run its products at half the rate of f32 multiply-adds (measured). Throws Error for kBf16 where
// there is no unit.
Precision resolve_precision(Precision wanted);
// "f32" or "bf16 (AMX_BF16)", of a resolved one.
std::string precision_name(Precision precision);

// Rounds to nearest, ties to even. A not-a-number stays one; a result below the normal numbers is
// 0. The same on every target. No alignment is needed.
void round_to_bf16(int64_t n, const float* x, uint16_t* out);
void widen_bf16(int64_t n, const uint16_t* x, float* out);

}  // namespace nerf
