#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "daemon/store.h"
#include "sfm/core/result.h"

namespace rotunda::daemon {

/// Which captures go. With no rule nothing ever does; with both a capture goes only when both name
/// it. Calibrations and the drift's history always stay.
struct RetentionPolicy {
  std::optional<size_t> keep_count;  // the newest so many stay
  std::optional<int> keep_days;      // what was taken within so many days before the newest stays
  /// kInvalidArgument names the field: both are at least 1.
  Status Validate() const;
};

/// Removes the captures that the policy names, with their reconstructions, and gives their ids. A
/// capture that a queued or running job needs stays until the job has ended. Once `stop` is set the
/// rest stays for the next time.
Result<std::vector<std::string>> ApplyRetention(Store& store, const RetentionPolicy& policy,
                                                std::stop_token stop = {});

/// kIo when less than `reserve_bytes` are free where one of the store's folders is; says where, how
/// much is, and what to do.
Status CheckDiskReserve(Store& store, uint64_t reserve_bytes);
/// Whether that is what it says: not that the disk cannot be asked, nor another error.
bool IsBelowReserve(const Error& error);

}  // namespace rotunda::daemon
