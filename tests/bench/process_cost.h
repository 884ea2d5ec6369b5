#pragma once

#include <sys/resource.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <string>

#include "sfm/core/result.h"

namespace rotunda {

inline double SecondsSince(std::chrono::steady_clock::time_point begin) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

/// What this process has used so far, all threads, user and system.
inline double Cpu_s() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_utime.tv_sec + usage.ru_stime.tv_sec) +
         1e-6 * static_cast<double>(usage.ru_utime.tv_usec + usage.ru_stime.tv_usec);
}

/// What this process holds.
struct Footprint {
  double memory_mb = 0;  // resident
  int threads = 0;
  int descriptors = 0;
};

inline Footprint FootprintNow() {
  Footprint now;
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    if (line.starts_with("VmRSS:")) now.memory_mb = 1.024e-3 * std::stod(line.substr(6));
    if (line.starts_with("Threads:")) now.threads = std::stoi(line.substr(8));
  }
  const std::filesystem::directory_iterator open("/proc/self/fd");
  now.descriptors = static_cast<int>(std::distance(begin(open), end(open)));
  return now;
}

/// Benchmarks have nobody to hand an error to.
template <typename T>
T Must(Result<T> result) {
  if (!result) throw std::runtime_error(result.error().ToString());
  return std::move(*result);
}
inline void Must(const Status& status) {
  if (!status) throw std::runtime_error(status.error().ToString());
}

}  // namespace rotunda
