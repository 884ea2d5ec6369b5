#pragma once

#include <string>
#include <vector>

#include "daemon/store.h"

namespace rotunda::daemon {

/// "<capture>-r1", "-r2", ...
Result<std::string> FreeReconstructionId(Store& store, const std::string& capture);

/// Makes the row of reconstructions/<id>/poses.json and those of its cameras' drift, when the
/// result may speak of it (drift.h). Cameras that moved, were not registered for too long, or came
/// back by this are events. Doing it twice changes nothing.
Result<ReconstructionRecord> RecordReconstruction(Store& store, const std::string& id);

Result<ReconstructionRecord> FindReconstruction(Store& store, const std::string& id);
/// Of one capture, newest first: a page, or all of them.
Result<Listing<ReconstructionRecord>> ListReconstructions(Store& store, const std::string& capture,
                                                          const Page& page);
Result<std::vector<ReconstructionRecord>> ListReconstructions(Store& store,
                                                              const std::string& capture);

/// Every camera that was compared with the calibration in force, by name; empty without one.
Result<std::vector<CameraDrift>> DriftNow(Store& store);
/// Cameras that as many captures in a row as DriftLimits asks have no pose of, by name.
Result<std::vector<UnregisteredCamera>> UnregisteredNow(Store& store);
/// One camera through the captures, newest first, against any calibration (`after`: id of a
/// reconstruction, which compares with one).
Result<Listing<DriftRecord>> DriftHistory(Store& store, const std::string& camera,
                                          const Page& page);

}  // namespace rotunda::daemon
