#pragma once

#include <nlohmann/json.hpp>
#include <vector>

#include "daemon/events.h"
#include "daemon/store_records.h"
#include "rig/camera_worker.h"

// Private to the .cc files of this folder and of cli: no public header shows the JSON library.

namespace rotunda::daemon {

/// What the API says of the daemon's records; the schemas are in openapi_schemas.cc. Fields that
/// are not known are left out.
nlohmann::ordered_json ToJson(const CaptureRecord& capture);
nlohmann::ordered_json ToJson(const FrameRecord& frame);
nlohmann::ordered_json ToJson(const CalibrationRecord& calibration);
nlohmann::ordered_json ToJson(const ReconstructionRecord& reconstruction);
nlohmann::ordered_json ToJson(const DriftRecord& drift);
nlohmann::ordered_json ToJson(const CameraDrift& drift);
nlohmann::ordered_json ToJson(const JobRecord& job);
nlohmann::ordered_json ToJson(const EventRecord& event);
nlohmann::ordered_json ToJson(const rig::CameraState& camera);

template <typename T>
nlohmann::ordered_json ItemsJson(const std::vector<T>& items) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const T& item : items) list.push_back(ToJson(item));
  return list;
}

/// {"items": [...], "next": "..."?}
template <typename T>
nlohmann::ordered_json ToJson(const Listing<T>& listing) {
  nlohmann::ordered_json page = {{"items", ItemsJson(listing.items)}};
  if (!listing.next.empty()) page["next"] = listing.next;
  return page;
}

/// Text of an answer; bytes that are not UTF-8 (a subject's name) become U+FFFD.
std::string AnswerText(const nlohmann::ordered_json& value);

}  // namespace rotunda::daemon
