// Loops that do nothing but one thing: what a processor reaches at most, as the ceilings that
// nerf_bench holds the kernels against. Dispatched as the kernels are (simd.h). One thread each.
#pragma once

#include <cstdint>

#include "nerf/base/real.h"

namespace nerf {

// `rounds` multiply-adds of each of several independent chains of vectors, all in registers.
// Returns the FLOPs done (two per multiply-add and lane); `sink` gets a value that needs them.
int64_t fma_loop(int64_t rounds, Real* sink);

// The same with the products of bf16_unit() (bf16.h), which must not be kNone; two FLOPs for each
// pair of operands.
int64_t bf16_loop(int64_t rounds, Real* sink);

// Sum of x, read in order. n is a multiple of kReadUnit, x aligned to 64 bytes.
inline constexpr int64_t kReadUnit = 128;
Real read_loop(int64_t n, const Real* x);

// Sum over `reads` rows of 4 values at random places of a table, the places found as a hash grid
// finds them: a hash of a counter. `rows` is a power of two up to 2^32, `reads` a multiple of
// kRowUnit, the table aligned to a row. Another `salt` reads other rows.
inline constexpr int64_t kRowUnit = 64;
inline constexpr int64_t kRowBytes = 4 * sizeof(Real);
Real random_row_loop(int64_t rows, const Real* table, int64_t reads, uint32_t salt);

}  // namespace nerf
