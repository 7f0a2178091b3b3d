#include "nerf/kernels/bf16.h"

#include <algorithm>
#include <cstdlib>
#include <mutex>

#include "kernels/bf16_product.h"
#include "nerf/base/error.h"
#include "nerf/kernels/peak.h"
#include "nerf/kernels/simd.h"

#if defined(__x86_64__) && !defined(NERF_DOUBLE)
#define NERF_BF16_UNITS
#include <cpuid.h>
#endif

namespace nerf {
namespace {

struct Processor {
  bool avx512_bf16 = false, amx_bf16 = false, amd = false;
};

Processor detect() {
  Processor p;
#ifdef NERF_EMULATED_BF16  // tests/emulated
  p.avx512_bf16 = p.amx_bf16 = true;
#elif defined(NERF_BF16_UNITS)
  unsigned a, b, c, d;
  if (!__get_cpuid(0, &a, &b, &c, &d)) return p;
  p.amd = b == signature_AMD_ebx && c == signature_AMD_ecx && d == signature_AMD_edx;
  if (!__get_cpuid_count(7, 0, &a, &b, &c, &d)) return p;
  const bool amx = (d >> 22 & 1) && (d >> 24 & 1);  // AMX-BF16, AMX-TILE
  if (__get_cpuid_count(7, 1, &a, &b, &c, &d)) p.avx512_bf16 = a >> 5 & 1;
  p.amx_bf16 = amx && p.avx512_bf16 && internal::request_amx();
#endif
  return p;
}

const Processor& processor() {
  static const Processor p = detect();
  return p;
}

Bf16Unit& chosen() {
  static Bf16Unit unit = Bf16Unit::kNone;
  return unit;
}

// Whether one of them is the target that the units belong to.
bool has_target([[maybe_unused]] const std::vector<std::string>& targets) {
#ifdef NERF_EMULATED_BF16
  return true;
#else
  return std::ranges::find(targets, "AVX3") != targets.end();
#endif
}

void choose_once() {
  static std::once_flag once;
  std::call_once(once, [] {
    const std::vector<Bf16Unit> units = bf16_units();
    chosen() = units.empty() ? Bf16Unit::kNone : units.front();
    const char* name = std::getenv("NERF_BF16");
    if (!name || !*name) return;
    std::string known = bf16_unit_name(Bf16Unit::kNone);
    if (name == known) {
      chosen() = Bf16Unit::kNone;
      return;
    }
    for (const Bf16Unit u : units) {
      if (name == bf16_unit_name(u)) {
        chosen() = u;
        return;
      }
      known += ", " + bf16_unit_name(u);
    }
    throw Error("no bf16 unit '" + std::string(name) + "' on this processor", "NERF_BF16",
                "available: " + known);
  });
}

}  // namespace

std::vector<Bf16Unit> bf16_units() {
  std::vector<Bf16Unit> out;
  if (!has_target(simd_targets())) return out;
  if (processor().amx_bf16) out.push_back(Bf16Unit::kAmx);
  if (processor().avx512_bf16) out.push_back(Bf16Unit::kAvx512);
  return out;
}

Bf16Unit internal::chosen_bf16_unit() {
  choose_once();
  return chosen();
}

Bf16Unit bf16_unit() {
  choose_once();
  return has_target({simd_target()}) ? chosen() : Bf16Unit::kNone;
}

std::string bf16_unit_name(Bf16Unit unit) {
  switch (unit) {
    case Bf16Unit::kAvx512:
      return "AVX512_BF16";
    case Bf16Unit::kAmx:
      return "AMX_BF16";
    default:
      return "none";
  }
}

void force_bf16_unit(Bf16Unit unit) {
  choose_once();
  chosen() = unit;
}

Precision resolve_precision(Precision wanted) {
  const Bf16Unit unit = bf16_unit();
  if (wanted == Precision::kBf16 && unit == Bf16Unit::kNone)
    throw Error(
        "the kernels have no bf16 products on this processor (target " + simd_target() + ")",
        "--precision", "take f32, or auto");
  if (wanted != Precision::kAuto) return wanted;
  const bool faster = unit == Bf16Unit::kAmx || (unit == Bf16Unit::kAvx512 && processor().amd);
  return faster ? Precision::kBf16 : Precision::kF32;
}

std::string precision_name(Precision precision) {
  return precision == Precision::kBf16 ? "bf16 (" + bf16_unit_name(bf16_unit()) + ")" : "f32";
}

int64_t bf16_loop(int64_t rounds, Real* sink) {
#ifdef NERF_BF16_UNITS
  if (bf16_unit() == Bf16Unit::kAmx) return internal::bf16_loop_amx(rounds, sink);
  if (bf16_unit() == Bf16Unit::kAvx512) return internal::bf16_loop_avx512(rounds, sink);
#endif
  static_cast<void>(rounds), static_cast<void>(sink);
  throw Error("this processor has no bf16 products", "");
}

}  // namespace nerf
