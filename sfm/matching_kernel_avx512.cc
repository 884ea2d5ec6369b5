#if defined(__x86_64__)

#include <immintrin.h>

#include "sfm/matching_kernel.h"

#if defined(__clang__)
#pragma clang diagnostic ignored "-Wunknown-pragmas"  // GCC unroll; clang unrolls by itself
#pragma clang attribute push(__attribute__((target("avx512f,avx512bw,avx512vnni"))), \
                             apply_to = function)
#else
// GCC 12 takes the undefined pass-through operand of its own intrinsics for a mistake (GCC bug
// 105593).
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#pragma GCC push_options
#pragma GCC target("avx512f,avx512bw,avx512vnni")
#endif
#include "sfm/matching_tile.h"

namespace rotunda::sfm {
namespace {

/// VPDPBUSD multiplies unsigned by signed bytes and adds four neighbours into 32 bits without
/// saturation. Rows are the unsigned side; columns are stored less 128, and a.b = a.(b - 128) + 128
/// sum(a), the last term being a row's bias.
struct Avx512Vnni {
  static constexpr size_t kLanes = 16;
  static constexpr size_t kRowBlock = 8;
  using Vector = __m512i;
  using Packed = uint8_t;

  static Vector Zero() { return _mm512_setzero_si512(); }
  static Vector Set(uint32_t value) { return _mm512_set1_epi32(static_cast<int>(value)); }
  static Vector Load(const uint32_t* at) { return _mm512_loadu_si512(at); }
  static void Store(uint32_t* at, Vector v) { _mm512_storeu_si512(at, v); }
  static Vector Max(Vector a, Vector b) { return _mm512_max_epu32(a, b); }
  static Vector Min(Vector a, Vector b) { return _mm512_min_epu32(a, b); }
  static Vector Or(Vector a, Vector b) { return _mm512_or_si512(a, b); }
  static Vector Shift(Vector v) { return _mm512_slli_epi32(v, kPlaceBits); }

  /// [group of 4 elements][column][element in group]. Missing columns are zero, which is 128 below
  /// zero here.
  static void Pack(const DescriptorView& panel, uint8_t* packed) {
    constexpr size_t kPanel = 2 * kLanes;
    for (size_t col = 0; col < kPanel; ++col) {
      for (size_t group = 0; group < kDescriptorSize / 4; ++group) {
        uint32_t four = 0;
        if (col < panel.count) {
          __builtin_memcpy(&four, panel.bytes + col * kDescriptorSize + 4 * group, 4);
        }
        four ^= 0x80808080U;
        __builtin_memcpy(packed + (group * kPanel + col) * 4, &four, 4);
      }
    }
  }

  static void Prepare(const DescriptorView& rows, int32_t* bias) {
    for (size_t i = 0; i < kTileRows; ++i) bias[i] = 0;
    for (size_t i = 0; i < rows.count; ++i) {
      const uint8_t* bytes = rows.bytes + i * kDescriptorSize;
      const Vector sums = _mm512_add_epi64(_mm512_sad_epu8(_mm512_loadu_si512(bytes), Zero()),
                                           _mm512_sad_epu8(_mm512_loadu_si512(bytes + 64), Zero()));
      bias[i] = 128 * static_cast<int32_t>(_mm512_reduce_add_epi64(sums));
    }
  }

  [[gnu::always_inline]] static void Dots(const uint8_t* const* rows, const int32_t* bias,
                                          const uint8_t* packed, Vector (&dots)[kRowBlock][2]) {
    Vector sums[kRowBlock][2];
#pragma GCC unroll 8
    for (size_t i = 0; i < kRowBlock; ++i) {
      sums[i][0] = _mm512_set1_epi32(bias[i]);
      sums[i][1] = sums[i][0];
    }
    for (size_t group = 0; group < kDescriptorSize / 4; ++group) {
      const Vector left = _mm512_load_si512(packed + group * 128);
      const Vector right = _mm512_load_si512(packed + group * 128 + 64);
#pragma GCC unroll 8
      for (size_t i = 0; i < kRowBlock; ++i) {
        int four;
        __builtin_memcpy(&four, rows[i] + 4 * group, 4);
        const Vector row = _mm512_set1_epi32(four);
        sums[i][0] = _mm512_dpbusd_epi32(sums[i][0], row, left);
        sums[i][1] = _mm512_dpbusd_epi32(sums[i][1], row, right);
      }
    }
#pragma GCC unroll 8
    for (size_t i = 0; i < kRowBlock; ++i) {
      dots[i][0] = sums[i][0];
      dots[i][1] = sums[i][1];
    }
  }
};

}  // namespace

void NearestAvx512Vnni(const DescriptorView& rows, const DescriptorView& cols,
                       const KernelScratch& scratch, NearestTwo* nearest_of_row,
                       NearestTwo* nearest_of_col) {
  WalkAllTiles<Avx512Vnni>(rows, cols, scratch, nearest_of_row, nearest_of_col);
}

}  // namespace rotunda::sfm
#if defined(__clang__)
#pragma clang attribute pop
#else
#pragma GCC pop_options
#endif

#endif
