#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "sfm/matching_kernel.h"

namespace rotunda::sfm {
namespace {

/// Descriptors like RootSIFT's: most of the mass in few elements.
std::vector<uint8_t> Descriptors(size_t count, uint64_t seed) {
  std::mt19937_64 random(seed);
  std::vector<uint8_t> bytes(count * kDescriptorSize);
  for (uint8_t& byte : bytes) byte = static_cast<uint8_t>((random() % 16) * (random() % 8));
  return bytes;
}

/// One pair of pictures with `range` keypoints each; items are inner products.
void FindNearestInPair(benchmark::State& state, MatchKernel kernel) {
  const auto count = static_cast<size_t>(state.range(0));
  const std::vector<uint8_t> first = Descriptors(count, 1), second = Descriptors(count, 2);
  for (auto _ : state) {
    benchmark::DoNotOptimize(FindNearest(kernel, {first.data(), count}, {second.data(), count}));
  }
  state.SetItemsProcessed(state.iterations() * state.range(0) * state.range(0));
}

const bool kRegistered = [] {
  for (const MatchKernel& kernel : MatchKernels()) {
    benchmark::RegisterBenchmark((std::string("FindNearest/") + kernel.name).c_str(),
                                 FindNearestInPair, kernel)
        ->Arg(1000)
        ->Arg(4000)
        ->Arg(8192)
        ->Unit(benchmark::kMillisecond);
  }
  return true;
}();

}  // namespace
}  // namespace rotunda::sfm
