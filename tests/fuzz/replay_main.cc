#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <vector>

#include "tests/fuzz/fuzz_input.h"

// Stands in for libFuzzer where that is not to be had: replays every file of the folder that is
// given, and a fixed number of mutants of each, the same on every machine.

namespace {

namespace fs = std::filesystem;

constexpr uint64_t kSeed = 1;
constexpr int kMutants = 300;
constexpr int kMaxChanges = 6;
constexpr size_t kMaxRange = 64;
constexpr unsigned char kTellingBytes[] = {0, 1, 0x7F, 0x80, 0xFE, 0xFF, '"', '-', '9', '{', '['};

/// One flipped bit, telling byte, deleted or repeated range, end cut off, or telling 8-byte number.
void Change(std::mt19937_64& random, std::string& bytes) {
  const auto below = [&random](size_t limit) { return limit == 0 ? 0 : random() % limit; };
  const size_t place = below(bytes.size());
  const size_t range = std::min(1 + below(kMaxRange), bytes.size() - place);
  switch (random() % 6) {
    case 0:
      if (!bytes.empty()) bytes[place] = static_cast<char>(bytes[place] ^ (1 << below(8)));
      return;
    case 1:
      if (!bytes.empty()) {
        bytes[place] = static_cast<char>(kTellingBytes[below(std::size(kTellingBytes))]);
      }
      return;
    case 2:
      bytes.erase(place, range);
      return;
    case 3:
      bytes.insert(below(bytes.size() + 1), bytes.substr(place, range));
      return;
    case 4:
      bytes.resize(place);
      return;
    default: {
      uint64_t number = uint64_t{1} << below(64);
      if (below(2) == 0) number = ~number;
      for (size_t i = 0; i < sizeof(number) && place + i < bytes.size(); ++i) {
        bytes[place + i] = static_cast<char>(number >> (8 * i));
      }
    }
  }
}

void Run(const std::string& bytes) {
  LLVMFuzzerTestOneInput(reinterpret_cast<const uint8_t*>(bytes.data()), bytes.size());
}

void ReplayWithMutants(const std::string& bytes) {
  Run(bytes);
  std::mt19937_64 random(kSeed);
  for (int i = 0; i < kMutants; ++i) {
    std::string mutant = bytes;
    const uint64_t changes = 1 + random() % kMaxChanges;
    for (uint64_t k = 0; k < changes; ++k) Change(random, mutant);
    Run(mutant);
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: %s CORPUS_FOLDER\n", argv[0]);
    return 2;
  }
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(argv[1])) files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  for (const fs::path& file : files) {
    std::printf("%s and %d mutants, seed %llu\n", file.filename().c_str(), kMutants,
                static_cast<unsigned long long>(kSeed));
    std::fflush(stdout);
    std::ifstream stream(file, std::ios::binary);
    ReplayWithMutants(std::string(std::istreambuf_iterator<char>(stream), {}));
  }
  return files.empty() ? 1 : 0;
}
