#pragma once

#include <optional>
#include <string>

#include "daemon/store.h"

namespace rotunda::daemon {

/// In the folder of a calibration that was made here: {"captures": [ids], "board": its name,
/// "model"?, "frame_from"?, "intrinsics_from"?: ids of calibrations}.
inline constexpr char kMadeFromName[] = "made_from.json";

/// `wanted`, or with "-2", "-3", ... behind it when that is taken.
Result<std::string> FreeCalibrationId(Store& store, const std::string& wanted);

/// Makes the row of calibrations/<id>/calibration.json. Doing it twice changes nothing.
Result<CalibrationRecord> RecordCalibration(Store& store, const std::string& id);

/// The text of calibrations/<id>/calibration.json, whole and in order. An error says what to do.
Result<std::string> CalibrationText(const Store& store, const std::string& id);

/// The calibration is in force from now on; captures get a copy of it.
Result<CalibrationRecord> ActivateCalibration(Store& store, const std::string& id);

Result<CalibrationRecord> FindCalibration(Store& store, const std::string& id);
/// nullopt: none is in force.
Result<std::optional<CalibrationRecord>> ActiveCalibration(Store& store);
Result<Listing<CalibrationRecord>> ListCalibrations(Store& store, const Page& page);

}  // namespace rotunda::daemon
