// Products on tiles (AMX-BF16).
#if defined(__x86_64__)

#include <immintrin.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "kernels/bf16_pairs-inl.h"
#include "kernels/bf16_product.h"

namespace nerf::internal {

bool request_amx() {
  constexpr long kRequestPermission = 0x1023, kTileData = 18;  // Linux: arch_prctl
  return syscall(SYS_arch_prctl, kRequestPermission, kTileData) == 0;
}

namespace {

// All tiles whole: 16 rows of 64 bytes. Sums in 0 to 3, left factors in 4 and 5, right ones in 6
// and 7.
struct alignas(64) TileConfig {
  uint8_t palette = 1, start = 0, reserved[14] = {};
  uint16_t row_bytes[16] = {64, 64, 64, 64, 64, 64, 64, 64};
  uint8_t rows[16] = {16, 16, 16, 16, 16, 16, 16, 16};
};
static_assert(sizeof(TileConfig) == 64);

// Tiles in use for the scope; the state is left clean, or every switch of threads would save it.
class Tiles {
 public:
  Tiles() {
    const TileConfig config;
    _tile_loadconfig(&config);
  }
  ~Tiles() { _tile_release(); }
  Tiles(const Tiles&) = delete;
  Tiles& operator=(const Tiles&) = delete;
};

// From a tile's sums to the output.
template <Bf16Epilogue kEpilogue>
void finish(const Bf16Product& p, const float* sums, int64_t row, int64_t column) {
  const int64_t rows = p.rows - row < kBf16Rows ? p.rows - row : kBf16Rows;
  const int64_t pairs_at = column / 16 * p.pairs_stride + row * 16;
  const __m512 zero = _mm512_setzero_ps();
  const auto value = [&](int64_t r) {
    __m512 y = _mm512_load_ps(sums + r * 16);
    if constexpr (kEpilogue == Bf16Epilogue::kAdd) {
      y = _mm512_add_ps(_mm512_load_ps(p.out + (row + r) * p.ld + column), y);
    } else {
      y = _mm512_add_ps(y, p.bias ? _mm512_set1_ps(p.bias[row + r]) : zero);
      if constexpr (kEpilogue == Bf16Epilogue::kRelu)
        y = _mm512_maskz_mov_ps(_mm512_cmp_ps_mask(y, zero, _CMP_GT_OQ), y);
      if constexpr (kEpilogue == Bf16Epilogue::kMask) {
        __mmask16 open;
        if (p.mask_pairs)
          open = not_zero(load(p.mask_pairs + pairs_at + r / 2 * 32), r % 2 == 1);
        else
          open = _mm512_cmp_ps_mask(_mm512_load_ps(p.mask + (row + r) * p.ld + column), zero,
                                    _CMP_GT_OQ);
        y = _mm512_maskz_mov_ps(open, y);
      }
    }
    return y;
  };
  if (p.out_pairs)
    for (int64_t r = 0; r < rows; r += 2)
      store(p.out_pairs + pairs_at + r * 16,
            pairs_of(value(r), r + 1 < rows ? value(r + 1) : zero));
  else
    for (int64_t r = 0; r < rows; ++r) _mm512_store_ps(p.out + (row + r) * p.ld + column, value(r));
}

// Two blocks of rows by two of columns at a time: a tile that is loaded is multiplied twice.
template <Bf16Epilogue kEpilogue>
void product(const Bf16Product& p) {
  alignas(64) float sums[4][256];
  const int64_t depth = p.depth_blocks, stride = depth * kBf16Block;
  for (int64_t c = 0; c < p.column_blocks; c += 2) {
    const bool two_columns = c + 1 < p.column_blocks;
    const uint16_t* b0 = p.b + c * stride;
    const uint16_t* b1 = two_columns ? b0 + stride : b0;
    for (int64_t row = 0; row < p.rows; row += 2 * kBf16Rows) {
      const bool two_rows = row + kBf16Rows < p.rows;
      const uint16_t* a0 = p.a + row / kBf16Rows * stride;
      const uint16_t* a1 = two_rows ? a0 + stride : a0;
      _tile_zero(0);
      _tile_zero(1);
      _tile_zero(2);
      _tile_zero(3);
      if (two_rows && two_columns) {
        for (int64_t k = 0; k < depth; ++k) {
          _tile_loadd(4, a0 + k * kBf16Block, 64);
          _tile_loadd(6, b0 + k * kBf16Block, 64);
          _tile_loadd(7, b1 + k * kBf16Block, 64);
          _tile_loadd(5, a1 + k * kBf16Block, 64);
          _tile_dpbf16ps(0, 4, 6);
          _tile_dpbf16ps(1, 4, 7);
          _tile_dpbf16ps(2, 5, 6);
          _tile_dpbf16ps(3, 5, 7);
        }
      } else if (two_columns) {
        for (int64_t k = 0; k < depth; ++k) {
          _tile_loadd(4, a0 + k * kBf16Block, 64);
          _tile_loadd(6, b0 + k * kBf16Block, 64);
          _tile_loadd(7, b1 + k * kBf16Block, 64);
          _tile_dpbf16ps(0, 4, 6);
          _tile_dpbf16ps(1, 4, 7);
        }
      } else {
        for (int64_t k = 0; k < depth; ++k) {
          _tile_loadd(4, a0 + k * kBf16Block, 64);
          _tile_loadd(6, b0 + k * kBf16Block, 64);
          _tile_loadd(5, a1 + k * kBf16Block, 64);
          _tile_dpbf16ps(0, 4, 6);
          _tile_dpbf16ps(2, 5, 6);
        }
      }
      _tile_stored(0, sums[0], 64);
      finish<kEpilogue>(p, sums[0], row, c * kBf16Columns);
      if (two_columns) {
        _tile_stored(1, sums[1], 64);
        finish<kEpilogue>(p, sums[1], row, (c + 1) * kBf16Columns);
      }
      if (!two_rows) continue;
      _tile_stored(2, sums[2], 64);
      finish<kEpilogue>(p, sums[2], row + kBf16Rows, c * kBf16Columns);
      if (two_columns) {
        _tile_stored(3, sums[3], 64);
        finish<kEpilogue>(p, sums[3], row + kBf16Rows, (c + 1) * kBf16Columns);
      }
    }
  }
}

}  // namespace

void bf16_product_amx(const Bf16Product& p) {
  const Tiles tiles;
  switch (p.epilogue) {
    case Bf16Epilogue::kNone:
      return product<Bf16Epilogue::kNone>(p);
    case Bf16Epilogue::kRelu:
      return product<Bf16Epilogue::kRelu>(p);
    case Bf16Epilogue::kMask:
      return product<Bf16Epilogue::kMask>(p);
    case Bf16Epilogue::kAdd:
      return product<Bf16Epilogue::kAdd>(p);
  }
}

int64_t bf16_loop_amx(int64_t rounds, float* sink) {
  alignas(64) static const uint16_t kZeros[kBf16Block] = {};
  alignas(64) float sums[256];
  const Tiles tiles;
  _tile_zero(0);
  _tile_zero(1);
  _tile_zero(2);
  _tile_zero(3);
  _tile_loadd(4, kZeros, 64);
  _tile_loadd(5, kZeros, 64);
  _tile_loadd(6, kZeros, 64);
  _tile_loadd(7, kZeros, 64);
  for (int64_t r = 0; r < rounds; ++r) {
    _tile_dpbf16ps(0, 4, 6);
    _tile_dpbf16ps(1, 4, 7);
    _tile_dpbf16ps(2, 5, 6);
    _tile_dpbf16ps(3, 5, 7);
  }
  _tile_stored(0, sums, 64);
  *sink = sums[0];
  return int64_t{2 * 4 * 16 * 16 * 32} * rounds;
}

}  // namespace nerf::internal

#endif  // x86-64
