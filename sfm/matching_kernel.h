#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "sfm/features.h"

namespace rotunda::sfm {

/// The candidate with the largest inner product (ties: the smallest index) and the largest inner
/// product among all others; 0 stands for "no other", which is an orthogonal descriptor.
struct NearestTwo {
  static constexpr uint32_t kNone = UINT32_MAX;
  uint32_t best_dot = 0;
  uint32_t second_dot = 0;
  uint32_t best = kNone;
  bool operator==(const NearestTwo&) const = default;
};

/// `count` descriptors of kDescriptorSize bytes, one after the other.
struct DescriptorView {
  const uint8_t* bytes = nullptr;
  size_t count = 0;
};

/// Kernels walk a rectangle of kTileRows x kTileCols inner products at a time and keep, in one
/// 32-bit key, the inner product above the place within the tile: (dot << kPlaceBits) | (kPlaceMask
/// - place). The largest key is then the largest product with the smallest place, and best and
/// second best cost a maximum and a minimum each. 128 * 255^2 < 2^23, so any bytes fit.
inline constexpr int kPlaceBits = 9;
inline constexpr uint32_t kPlaceMask = (1U << kPlaceBits) - 1;
static_assert((uint64_t{kDescriptorSize * 255 * 255} << kPlaceBits) <= UINT32_MAX);
inline constexpr size_t kTileRows = size_t{1} << kPlaceBits;
/// Columns are told by lane and block of lanes; kernels have at least 8 lanes.
inline constexpr size_t kTileCols = 8 * (size_t{1} << kPlaceBits);

/// Working memory of one call, in bytes aligned to a cache line.
struct KernelScratch {
  std::byte* packed_columns = nullptr;  // kTileCols descriptors as 16-bit numbers
  std::byte* row_keys = nullptr;        // kTileRows x kMaxLanes x {best, second}
};
inline constexpr size_t kMaxLanes = 16;
inline constexpr size_t kPackedColumnsBytes = kTileCols * kDescriptorSize * 2;
inline constexpr size_t kRowKeysBytes = kTileRows * kMaxLanes * 2 * sizeof(uint32_t);

/// Updates rows[i] with all columns and cols[j] with all rows.
using NearestFunction = void (*)(const DescriptorView& rows, const DescriptorView& cols,
                                 const KernelScratch& scratch, NearestTwo* nearest_of_row,
                                 NearestTwo* nearest_of_col);

struct MatchKernel {
  const char* name;
  NearestFunction function;
};

/// What this processor runs, fastest first; the last is the portable one. All give equal results.
std::span<const MatchKernel> MatchKernels();

/// Nearest two of every descriptor in the other picture.
struct NearestInPair {
  std::vector<NearestTwo> of_first;
  std::vector<NearestTwo> of_second;
};
NearestInPair FindNearest(const MatchKernel& kernel, const DescriptorView& first,
                          const DescriptorView& second);

/// The implementations behind MatchKernels(). The first two are there on x86-64 alone and must be
/// called on processors that have the instructions alone.
void NearestAvx512Vnni(const DescriptorView& rows, const DescriptorView& cols,
                       const KernelScratch& scratch, NearestTwo* nearest_of_row,
                       NearestTwo* nearest_of_col);
void NearestAvx2(const DescriptorView& rows, const DescriptorView& cols,
                 const KernelScratch& scratch, NearestTwo* nearest_of_row,
                 NearestTwo* nearest_of_col);
void NearestGeneric(const DescriptorView& rows, const DescriptorView& cols,
                    const KernelScratch& scratch, NearestTwo* nearest_of_row,
                    NearestTwo* nearest_of_col);

}  // namespace rotunda::sfm
