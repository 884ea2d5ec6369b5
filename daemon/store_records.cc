#include "daemon/store_records.h"

#include <array>

namespace rotunda::daemon {
namespace {

constexpr std::array<const char*, 3> kKindNames = {"capture", "calibration", "reconstruction"};
constexpr std::array<const char*, 6> kStateNames = {"queued", "running",   "done",
                                                    "failed", "cancelled", "interrupted"};

template <typename Enum, size_t N>
std::optional<Enum> FromName(const std::array<const char*, N>& names, const std::string& name) {
  for (size_t i = 0; i < N; ++i) {
    if (name == names[i]) return static_cast<Enum>(i);
  }
  return std::nullopt;
}

}  // namespace

const char* JobKindName(JobKind kind) { return kKindNames[static_cast<size_t>(kind)]; }
std::optional<JobKind> JobKindFromName(const std::string& name) {
  return FromName<JobKind>(kKindNames, name);
}

const char* JobStateName(JobState state) { return kStateNames[static_cast<size_t>(state)]; }
std::optional<JobState> JobStateFromName(const std::string& name) {
  return FromName<JobState>(kStateNames, name);
}

}  // namespace rotunda::daemon
