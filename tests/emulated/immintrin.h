// The instructions of kernels/bf16_avx512.cc and kernels/bf16_amx.cc in portable C++, so that those
// sources can be tested on processors that lack them. It stands in front of the compiler's own
// header.
#pragma once

#include <bit>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>

// NOLINTBEGIN: the names are Intel's
using __m512 = float __attribute__((vector_size(64), may_alias));
using __m512i = long long __attribute__((vector_size(64), may_alias));
using __m512bh = short __attribute__((vector_size(64), may_alias));
using __mmask16 = uint16_t;

enum { _CMP_GT_OQ = 30, _MM_HINT_T0 = 3, _MM_HINT_ET0 = 7 };

namespace emulated {

template <class Lane>
struct Lanes {
  static constexpr int kCount = 64 / sizeof(Lane);
  Lanes() = default;
  explicit Lanes(const __m512& v) { std::memcpy(lane, &v, sizeof v); }
  explicit Lanes(const __m512i& v) { std::memcpy(lane, &v, sizeof v); }
  operator __m512() const {
    __m512 v;
    std::memcpy(&v, lane, sizeof v);
    return v;
  }
  operator __m512i() const {
    __m512i v;
    std::memcpy(&v, lane, sizeof v);
    return v;
  }
  Lane lane[kCount] = {};
};
using F32 = Lanes<float>;
using I32 = Lanes<uint32_t>;
using I16 = Lanes<uint16_t>;
using I64 = Lanes<uint64_t>;

// Denormals count as 0, in operands and in results.
inline float flushed(float x) { return std::fabs(x) < 0x1p-126f ? std::copysign(0.0f, x) : x; }
// The first or the second number of a pair.
inline float part_of(uint32_t pair, bool second) {
  return flushed(std::bit_cast<float>(second ? pair & 0xffff0000u : pair << 16));
}
inline uint16_t rounded(float x) {
  const uint32_t bits = std::bit_cast<uint32_t>(flushed(x));
  return static_cast<uint16_t>(std::isnan(x) ? bits >> 16 | 0x40
                                             : (bits + 0x7fff + (bits >> 16 & 1)) >> 16);
}
inline float multiply_add(float a, float b, float sum) {
  return flushed(std::fma(a, b, flushed(sum)));
}

}  // namespace emulated

inline void _mm_prefetch(const char*, int) {}

inline __m512 _mm512_setzero_ps() { return __m512{}; }
inline __m512i _mm512_setzero_si512() { return __m512i{}; }
inline __m512 _mm512_set1_ps(float x) { return x - __m512{}; }
inline __m512i _mm512_set1_epi32(int x) {
  emulated::I32 v;
  for (uint32_t& lane : v.lane) lane = static_cast<uint32_t>(x);
  return v;
}
inline __m512i _mm512_set1_epi16(int x) {
  emulated::I16 v;
  for (uint16_t& lane : v.lane) lane = static_cast<uint16_t>(x);
  return v;
}
inline __m512 _mm512_load_ps(const void* p) { return *static_cast<const __m512*>(p); }
inline void _mm512_store_ps(void* p, __m512 v) { *static_cast<__m512*>(p) = v; }
inline __m512i _mm512_load_si512(const void* p) { return *static_cast<const __m512i*>(p); }
inline void _mm512_store_si512(void* p, __m512i v) { *static_cast<__m512i*>(p) = v; }

inline __m512i _mm512_or_si512(__m512i a, __m512i b) { return a | b; }

inline __m512 _mm512_add_ps(__m512 a, __m512 b) { return a + b; }
// The second where either is not a number, or both are 0.
inline __m512 _mm512_max_ps(__m512 a, __m512 b) {
  emulated::F32 x(a), y(b);
  for (int i = 0; i < x.kCount; ++i) y.lane[i] = x.lane[i] > y.lane[i] ? x.lane[i] : y.lane[i];
  return y;
}
inline float _mm512_reduce_add_ps(__m512 a) {
  float sum = 0;
  for (const float x : emulated::F32(a).lane) sum += x;
  return sum;
}

inline __mmask16 _mm512_cmp_ps_mask(__m512 a, __m512 b, int predicate) {
  if (predicate != _CMP_GT_OQ) std::abort();
  const emulated::F32 x(a), y(b);
  unsigned mask = 0;
  for (int i = 0; i < x.kCount; ++i) mask |= unsigned{x.lane[i] > y.lane[i]} << i;
  return static_cast<__mmask16>(mask);
}
inline __mmask16 _mm512_test_epi32_mask(__m512i a, __m512i b) {
  const emulated::I32 both(a & b);
  unsigned mask = 0;
  for (int i = 0; i < both.kCount; ++i) mask |= unsigned{both.lane[i] != 0} << i;
  return static_cast<__mmask16>(mask);
}
inline __m512 _mm512_maskz_mov_ps(__mmask16 mask, __m512 a) {
  emulated::F32 x(a);
  for (int i = 0; i < x.kCount; ++i)
    if (!(mask >> i & 1)) x.lane[i] = 0;
  return x;
}

inline __m512i _mm512_permutexvar_epi16(__m512i index, __m512i a) {
  const emulated::I16 from(a), at(index);
  emulated::I16 to;
  for (int i = 0; i < to.kCount; ++i) to.lane[i] = from.lane[at.lane[i] & 31];
  return to;
}
inline __m512i _mm512_permutex2var_epi16(__m512i a, __m512i index, __m512i b) {
  const emulated::I16 low(a), high(b), at(index);
  emulated::I16 to;
  for (int i = 0; i < to.kCount; ++i)
    to.lane[i] = (at.lane[i] & 32 ? high : low).lane[at.lane[i] & 31];
  return to;
}
// Of each 128 bits of both, elements in turn from their lower or their upper half.
template <class V>
inline __m512i emulated_unpack(__m512i a, __m512i b, int half) {
  const V x(a), y(b);
  V to;
  constexpr int kPart = V::kCount / 4;
  for (int part = 0; part < 4; ++part)
    for (int i = 0; i < kPart / 2; ++i) {
      const int from = part * kPart + half * kPart / 2 + i;
      to.lane[part * kPart + 2 * i] = x.lane[from];
      to.lane[part * kPart + 2 * i + 1] = y.lane[from];
    }
  return to;
}
inline __m512i _mm512_unpacklo_epi32(__m512i a, __m512i b) {
  return emulated_unpack<emulated::I32>(a, b, 0);
}
inline __m512i _mm512_unpackhi_epi32(__m512i a, __m512i b) {
  return emulated_unpack<emulated::I32>(a, b, 1);
}
inline __m512i _mm512_unpacklo_epi64(__m512i a, __m512i b) {
  return emulated_unpack<emulated::I64>(a, b, 0);
}
inline __m512i _mm512_unpackhi_epi64(__m512i a, __m512i b) {
  return emulated_unpack<emulated::I64>(a, b, 1);
}
// 128 bits of a, twice, then of b, twice, as two bits each of `select` say.
inline __m512i _mm512_shuffle_i32x4(__m512i a, __m512i b, int select) {
  const emulated::I64 x(a), y(b);
  emulated::I64 to;
  for (int part = 0; part < 4; ++part)
    for (int i = 0; i < 2; ++i)
      to.lane[2 * part + i] = (part < 2 ? x : y).lane[2 * (select >> 2 * part & 3) + i];
  return to;
}

// `low` is the second.
inline __m512bh _mm512_cvtne2ps_pbh(__m512 high, __m512 low) {
  const emulated::F32 h(high), l(low);
  emulated::I16 to;
  for (int i = 0; i < 16; ++i) {
    to.lane[i] = emulated::rounded(l.lane[i]);
    to.lane[16 + i] = emulated::rounded(h.lane[i]);
  }
  return (__m512bh)(__m512i)to;
}
inline __m512 _mm512_dpbf16_ps(__m512 sum, __m512bh a, __m512bh b) {
  using emulated::multiply_add, emulated::part_of;
  emulated::F32 to(sum);
  const emulated::I32 x((__m512i)a), y((__m512i)b);
  for (int i = 0; i < to.kCount; ++i) {
    float& s = to.lane[i];
    s = multiply_add(part_of(x.lane[i], true), part_of(y.lane[i], true), s);
    s = multiply_add(part_of(x.lane[i], false), part_of(y.lane[i], false), s);
  }
  return to;
}

// Tiles: each thread's eight, all of 16 rows of 64 bytes.
namespace emulated {
struct alignas(64) Tile {
  uint32_t words[16][16];
};
inline thread_local Tile tiles[8];
}  // namespace emulated

inline void _tile_loadconfig(const void*) {}
inline void _tile_release() {}
inline void _tile_zero(int tile) { std::memset(&emulated::tiles[tile], 0, sizeof(emulated::Tile)); }
inline void _tile_loadd(int tile, const void* from, int64_t stride) {
  for (int r = 0; r < 16; ++r)
    std::memcpy(emulated::tiles[tile].words[r], static_cast<const char*>(from) + r * stride, 64);
}
inline void _tile_stored(int tile, void* to, int64_t stride) {
  for (int r = 0; r < 16; ++r)
    std::memcpy(static_cast<char*>(to) + r * stride, emulated::tiles[tile].words[r], 64);
}
inline void _tile_dpbf16ps(int sums, int left, int right) {
  using emulated::flushed, emulated::multiply_add, emulated::part_of, emulated::tiles;
  for (int r = 0; r < 16; ++r) {
    float first[16] = {}, second[16] = {};
    for (int k = 0; k < 16; ++k) {
      const uint32_t a = tiles[left].words[r][k];
      const float a0 = part_of(a, false), a1 = part_of(a, true);
      for (int c = 0; c < 16; ++c) {
        const uint32_t b = tiles[right].words[k][c];
        first[c] = multiply_add(a0, part_of(b, false), first[c]);
        second[c] = multiply_add(a1, part_of(b, true), second[c]);
      }
    }
    for (int c = 0; c < 16; ++c) {
      uint32_t& to = tiles[sums].words[r][c];
      to = std::bit_cast<uint32_t>(
          flushed(std::bit_cast<float>(to) + flushed(first[c] + second[c])));
    }
  }
}
// NOLINTEND
