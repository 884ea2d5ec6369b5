#pragma once

#include <cstddef>
#include <cstdint>

#include "sfm/matching_kernel.h"

/// The walk over tiles that the vector kernels share. Included by each of them below the pragma
/// that sets its instruction set, and in an unnamed namespace throughout: no function compiled for
/// one instruction set may stand in for another translation unit's. For the same reason nothing of
/// the standard library is called.
///
/// A `Simd` type gives
///   kLanes            inner products a vector
///   kRowBlock         rows that are worked on at once
///   Vector            kLanes 32-bit keys, with Zero, Set (broadcast), Load, Store, Max, Min, Or
///                     (unsigned) and Shift (left by kPlaceBits)
///   Packed            element type of packed columns
///   Pack              a panel of kPanel = 2 kLanes columns, transposed for Dots
///   Prepare           what Dots needs of a block of rows beside their bytes
///   Dots              inner products of kRowBlock rows with a panel's columns
namespace rotunda::sfm {
namespace {

[[gnu::always_inline]] inline size_t Smaller(size_t a, size_t b) { return a < b ? a : b; }

/// Merges what a tile found for one row or column: best and second best as keys, `index` the
/// best's place in its picture. Tiles come in order of index, so a tie leaves what is there.
[[gnu::always_inline]] inline void Merge(NearestTwo& nearest, uint32_t best_key,
                                         uint32_t second_key, uint32_t index) {
  const uint32_t best_dot = best_key >> kPlaceBits;
  const uint32_t second_dot = second_key >> kPlaceBits;
  if (best_dot > nearest.best_dot || nearest.best == NearestTwo::kNone) {
    nearest.second_dot = nearest.best_dot > second_dot ? nearest.best_dot : second_dot;
    nearest.best_dot = best_dot;
    nearest.best = index;
  } else if (best_dot > nearest.second_dot) {
    nearest.second_dot = best_dot;
  }
}

[[gnu::always_inline]] inline uint32_t PlaceOf(uint32_t key) {
  return kPlaceMask - (key & kPlaceMask);
}

/// Brings the lanes of one row together: of equal products the smallest column wins.
template <typename Simd>
void MergeRow(const uint32_t* keys, size_t first_col, NearestTwo& nearest) {
  constexpr size_t kLanes = Simd::kLanes;
  uint32_t best_key = 0, second_key = 0, best_col = 0;
  for (size_t lane = 0; lane < kLanes; ++lane) {
    const uint32_t key = keys[lane];
    const auto col = static_cast<uint32_t>(PlaceOf(key) * kLanes + lane);
    const uint32_t dot = key >> kPlaceBits, best_dot = best_key >> kPlaceBits;
    const bool better = lane == 0 || dot > best_dot || (dot == best_dot && col < best_col);
    const uint32_t loser = better ? best_key : key;
    if (better) {
      best_key = key;
      best_col = col;
    }
    if (loser > second_key) second_key = loser;
    if (keys[kLanes + lane] > second_key) second_key = keys[kLanes + lane];
  }
  Merge(nearest, best_key, second_key, static_cast<uint32_t>(first_col) + best_col);
}

/// One tile: `rows` against packed columns [first_col, first_col + cols).
template <typename Simd>
void WalkTile(const DescriptorView& rows, size_t first_row, size_t cols, size_t first_col,
              const KernelScratch& scratch, NearestTwo* nearest_of_row,
              NearestTwo* nearest_of_col) {
  using Vector = typename Simd::Vector;
  constexpr size_t kLanes = Simd::kLanes, kBlock = Simd::kRowBlock, kPanel = 2 * kLanes;
  alignas(64) static constexpr uint8_t kZeroRow[kDescriptorSize] = {};
  auto* row_keys = reinterpret_cast<uint32_t*>(scratch.row_keys);
  const auto* packed = reinterpret_cast<const typename Simd::Packed*>(scratch.packed_columns);
  for (size_t i = 0; i < kTileRows * 2 * kLanes; ++i) row_keys[i] = 0;
  int32_t row_bias[kTileRows];
  Simd::Prepare(rows, row_bias);

  for (size_t panel = 0; panel * kPanel < cols; ++panel) {
    Vector best[2] = {Simd::Zero(), Simd::Zero()}, second[2] = {Simd::Zero(), Simd::Zero()};
    const Vector block_key[2] = {Simd::Set(kPlaceMask - static_cast<uint32_t>(2 * panel)),
                                 Simd::Set(kPlaceMask - static_cast<uint32_t>(2 * panel + 1))};
    for (size_t row = 0; row < rows.count; row += kBlock) {
      const uint8_t* row_bytes[kBlock];
      for (size_t i = 0; i < kBlock; ++i) {
        row_bytes[i] = row + i < rows.count ? rows.bytes + (row + i) * kDescriptorSize : kZeroRow;
      }
      Vector dots[kBlock][2];
      Simd::Dots(row_bytes, row_bias + row, packed + panel * kPanel * kDescriptorSize, dots);
#pragma GCC unroll 8
      for (size_t i = 0; i < kBlock; ++i) {
        const Vector row_key = Simd::Set(kPlaceMask - static_cast<uint32_t>(row + i));
        uint32_t* keys = row_keys + (row + i) * 2 * kLanes;
        Vector row_best = Simd::Load(keys), row_second = Simd::Load(keys + kLanes);
#pragma GCC unroll 2
        for (size_t half = 0; half < 2; ++half) {
          const Vector shifted = Simd::Shift(dots[i][half]);
          const Vector by_row = Simd::Or(shifted, row_key);
          const Vector by_col = Simd::Or(shifted, block_key[half]);
          second[half] = Simd::Max(second[half], Simd::Min(best[half], by_row));
          best[half] = Simd::Max(best[half], by_row);
          row_second = Simd::Max(row_second, Simd::Min(row_best, by_col));
          row_best = Simd::Max(row_best, by_col);
        }
        Simd::Store(keys, row_best);
        Simd::Store(keys + kLanes, row_second);
      }
    }
    uint32_t best_keys[kPanel], second_keys[kPanel];
    for (size_t half = 0; half < 2; ++half) {
      Simd::Store(best_keys + half * kLanes, best[half]);
      Simd::Store(second_keys + half * kLanes, second[half]);
    }
    const size_t in_panel = Smaller(kPanel, cols - panel * kPanel);
    for (size_t i = 0; i < in_panel; ++i) {
      Merge(nearest_of_col[first_col + panel * kPanel + i], best_keys[i], second_keys[i],
            static_cast<uint32_t>(first_row) + PlaceOf(best_keys[i]));
    }
  }
  for (size_t i = 0; i < rows.count; ++i) {
    MergeRow<Simd>(row_keys + i * 2 * kLanes, first_col, nearest_of_row[first_row + i]);
  }
}

template <typename Simd>
void WalkAllTiles(const DescriptorView& rows, const DescriptorView& cols,
                  const KernelScratch& scratch, NearestTwo* nearest_of_row,
                  NearestTwo* nearest_of_col) {
  constexpr size_t kPanel = 2 * Simd::kLanes;
  auto* packed = reinterpret_cast<typename Simd::Packed*>(scratch.packed_columns);
  for (size_t col = 0; col < cols.count; col += kTileCols) {
    const size_t in_tile = Smaller(kTileCols, cols.count - col);
    for (size_t at = 0; at < in_tile; at += kPanel) {
      const DescriptorView panel{cols.bytes + (col + at) * kDescriptorSize,
                                 Smaller(kPanel, in_tile - at)};
      Simd::Pack(panel, packed + at * kDescriptorSize);
    }
    for (size_t row = 0; row < rows.count; row += kTileRows) {
      const DescriptorView tile{rows.bytes + row * kDescriptorSize,
                                Smaller(kTileRows, rows.count - row)};
      WalkTile<Simd>(tile, row, in_tile, col, scratch, nearest_of_row, nearest_of_col);
    }
  }
}

}  // namespace
}  // namespace rotunda::sfm
