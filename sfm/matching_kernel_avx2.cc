#if defined(__x86_64__)

#include <immintrin.h>

#include "sfm/matching_kernel.h"

#if defined(__clang__)
#pragma clang diagnostic ignored "-Wunknown-pragmas"  // GCC unroll; clang unrolls by itself
#pragma clang attribute push(__attribute__((target("avx2"))), apply_to = function)
#else
#pragma GCC push_options
#pragma GCC target("avx2")
#endif
#include "sfm/matching_tile.h"

namespace rotunda::sfm {
namespace {

/// VPMADDWD on 16-bit numbers: VPMADDUBSW on bytes would saturate at 2 * 255 * 127.
struct Avx2 {
  static constexpr size_t kLanes = 8;
  static constexpr size_t kRowBlock = 4;
  using Vector = __m256i;
  using Packed = int16_t;

  static Vector Zero() { return _mm256_setzero_si256(); }
  static Vector Set(uint32_t value) { return _mm256_set1_epi32(static_cast<int>(value)); }
  static Vector Load(const uint32_t* at) {
    return _mm256_loadu_si256(reinterpret_cast<const __m256i*>(at));
  }
  static void Store(uint32_t* at, Vector v) {
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(at), v);
  }
  static Vector Max(Vector a, Vector b) { return _mm256_max_epu32(a, b); }
  static Vector Min(Vector a, Vector b) { return _mm256_min_epu32(a, b); }
  static Vector Or(Vector a, Vector b) { return _mm256_or_si256(a, b); }
  static Vector Shift(Vector v) { return _mm256_slli_epi32(v, kPlaceBits); }

  /// [pair of elements][column][element in pair]; missing columns are zero.
  static void Pack(const DescriptorView& panel, int16_t* packed) {
    constexpr size_t kPanel = 2 * kLanes;
    for (size_t col = 0; col < kPanel; ++col) {
      for (size_t i = 0; i < kDescriptorSize; ++i) {
        const int16_t value = col < panel.count ? panel.bytes[col * kDescriptorSize + i] : 0;
        packed[((i / 2) * kPanel + col) * 2 + i % 2] = value;
      }
    }
  }

  static void Prepare(const DescriptorView&, int32_t*) {}

  [[gnu::always_inline]] static void Dots(const uint8_t* const* rows, const int32_t*,
                                          const int16_t* packed, Vector (&dots)[kRowBlock][2]) {
#pragma GCC unroll 4
    for (size_t i = 0; i < kRowBlock; ++i) {
      dots[i][0] = Zero();
      dots[i][1] = Zero();
    }
    for (size_t pair = 0; pair < kDescriptorSize / 2; ++pair) {
      const Vector left = _mm256_load_si256(reinterpret_cast<const __m256i*>(packed + pair * 32));
      const Vector right =
          _mm256_load_si256(reinterpret_cast<const __m256i*>(packed + pair * 32 + 16));
#pragma GCC unroll 4
      for (size_t i = 0; i < kRowBlock; ++i) {
        const uint32_t two = rows[i][2 * pair] | (uint32_t{rows[i][2 * pair + 1]} << 16);
        const Vector row = Set(two);
        dots[i][0] = _mm256_add_epi32(dots[i][0], _mm256_madd_epi16(row, left));
        dots[i][1] = _mm256_add_epi32(dots[i][1], _mm256_madd_epi16(row, right));
      }
    }
  }
};

}  // namespace

void NearestAvx2(const DescriptorView& rows, const DescriptorView& cols,
                 const KernelScratch& scratch, NearestTwo* nearest_of_row,
                 NearestTwo* nearest_of_col) {
  WalkAllTiles<Avx2>(rows, cols, scratch, nearest_of_row, nearest_of_col);
}

}  // namespace rotunda::sfm
#if defined(__clang__)
#pragma clang attribute pop
#else
#pragma GCC pop_options
#endif

#endif
