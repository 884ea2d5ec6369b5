#pragma once

#include <optional>
#include <string>
#include <vector>

#include "daemon/store.h"
#include "daemon/store_jobs.h"

namespace rotunda::daemon {

/// An id for a capture taken now ("20261122T230501Z", "20261122T230501Z-2", ...) that neither the
/// disk nor the database knows.
Result<std::string> FreeCaptureId(Store& store);

/// Makes the row of the frame set that lies in captures/<id>, whole and durable, and queues
/// `follow_up` with it. A capture is acknowledged only after this. Doing it twice changes nothing.
Result<CaptureRecord> RecordCapture(Store& store, const std::string& id,
                                    const std::optional<NewJob>& follow_up);

/// kNotFound. So do all functions that take the id of something.
Result<CaptureRecord> FindCapture(Store& store, const std::string& id);
/// Which reconstructions may speak for a capture; kOfTheRig: SpeaksOfTheRig() in drift.h.
enum class Speakers { kAll, kOfTheRig };
Result<Listing<CaptureRecord>> ListCaptures(Store& store, const Page& page,
                                            Speakers speakers = Speakers::kAll);
/// By camera name.
Result<std::vector<FrameRecord>> ListFrames(Store& store, const std::string& capture);

}  // namespace rotunda::daemon
