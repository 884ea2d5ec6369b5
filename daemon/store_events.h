#pragma once

#include <cstdint>
#include <vector>

#include "daemon/store.h"

namespace rotunda::daemon {

/// At most `limit` events with numbers above `after`, in their order.
Result<std::vector<EventRecord>> ListEvents(Store& store, int64_t after, size_t limit);
/// 0: there is none.
Result<int64_t> LastEventNumber(Store& store);

}  // namespace rotunda::daemon
