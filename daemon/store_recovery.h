#pragma once

#include "daemon/store.h"
#include "sfm/core/result.h"

// Private to the store.

namespace rotunda::daemon {

/// Puts right what a crash left: temporary folders of killed writers go, folders without a row are
/// adopted (a capture with the follow-up that its job asked for), rows whose folder is missing are
/// marked (and unmarked when it is back), jobs that ran are interrupted. Runs before anybody else
/// uses the store.
Result<RecoveryReport> Recover(Store& store);

}  // namespace rotunda::daemon
