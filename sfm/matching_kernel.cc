#include "sfm/matching_kernel.h"

#include <algorithm>
#include <new>

namespace rotunda::sfm {
namespace {

constexpr std::align_val_t kCacheLine{64};

struct AlignedDelete {
  void operator()(std::byte* bytes) const { ::operator delete[](bytes, kCacheLine); }
};
using AlignedBytes = std::unique_ptr<std::byte[], AlignedDelete>;

AlignedBytes AllocateAligned(size_t size) {
  return AlignedBytes(static_cast<std::byte*>(::operator new[](size, kCacheLine)));
}

uint32_t Dot(const uint8_t* a, const uint8_t* b) {
  uint32_t dot = 0;
  for (size_t i = 0; i < kDescriptorSize; ++i) dot += uint32_t{a[i]} * uint32_t{b[i]};
  return dot;
}

/// Candidates come in order of index, so that a tie leaves the smaller one.
void Offer(NearestTwo& nearest, uint32_t dot, uint32_t index) {
  if (dot > nearest.best_dot || nearest.best == NearestTwo::kNone) {
    nearest.second_dot = nearest.best_dot;
    nearest.best_dot = dot;
    nearest.best = index;
  } else {
    nearest.second_dot = std::max(nearest.second_dot, dot);
  }
}

std::vector<MatchKernel> SupportedKernels() {
  std::vector<MatchKernel> kernels;
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512vnni")) {
    kernels.push_back({"avx512-vnni", &NearestAvx512Vnni});
  }
  if (__builtin_cpu_supports("avx2")) kernels.push_back({"avx2", &NearestAvx2});
#endif
  kernels.push_back({"generic", &NearestGeneric});
  return kernels;
}

}  // namespace

void NearestGeneric(const DescriptorView& rows, const DescriptorView& cols, const KernelScratch&,
                    NearestTwo* nearest_of_row, NearestTwo* nearest_of_col) {
  constexpr size_t kBlock = 64;  // descriptors: two blocks stay in the first-level cache
  for (size_t row_begin = 0; row_begin < rows.count; row_begin += kBlock) {
    const size_t row_end = std::min(rows.count, row_begin + kBlock);
    for (size_t col_begin = 0; col_begin < cols.count; col_begin += kBlock) {
      const size_t col_end = std::min(cols.count, col_begin + kBlock);
      for (size_t i = row_begin; i < row_end; ++i) {
        for (size_t j = col_begin; j < col_end; ++j) {
          const uint32_t dot =
              Dot(rows.bytes + i * kDescriptorSize, cols.bytes + j * kDescriptorSize);
          Offer(nearest_of_row[i], dot, static_cast<uint32_t>(j));
          Offer(nearest_of_col[j], dot, static_cast<uint32_t>(i));
        }
      }
    }
  }
}

std::span<const MatchKernel> MatchKernels() {
  static const std::vector<MatchKernel> kernels = SupportedKernels();
  return kernels;
}

NearestInPair FindNearest(const MatchKernel& kernel, const DescriptorView& first,
                          const DescriptorView& second) {
  NearestInPair nearest{std::vector<NearestTwo>(first.count),
                        std::vector<NearestTwo>(second.count)};
  if (first.count == 0 || second.count == 0) return nearest;
  const AlignedBytes packed = AllocateAligned(kPackedColumnsBytes);
  const AlignedBytes row_keys = AllocateAligned(kRowKeysBytes);
  kernel.function(first, second, {packed.get(), row_keys.get()}, nearest.of_first.data(),
                  nearest.of_second.data());
  return nearest;
}

}  // namespace rotunda::sfm
