#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

// Private to the .cc files of this folder: what the daemon answers, for people, on standard output.

namespace rotunda::cli {

/// A field as it is shown; "-" when it is not there. Control characters become '?': a subject's
/// name must not speak to the terminal.
std::string FieldText(const nlohmann::ordered_json& object, const std::string& key);

struct Column {
  const char* title;
  const char* key;
};
/// Columns as wide as they need.
void PrintTable(const nlohmann::ordered_json& items, const std::vector<Column>& columns);
/// Fields of one thing, a line each, without those that hold others.
void PrintFields(const nlohmann::ordered_json& object);

void PrintJson(const nlohmann::ordered_json& value);
void PrintStatus(const nlohmann::ordered_json& status);
/// Of the status, cameras that are not where the calibration in force has them.
void PrintMoved(const nlohmann::ordered_json& status);
void PrintCameras(const nlohmann::ordered_json& list);
void PrintJob(const nlohmann::ordered_json& job);
void PrintJobs(const nlohmann::ordered_json& page);
void PrintCapture(const nlohmann::ordered_json& capture);
void PrintCaptures(const nlohmann::ordered_json& page);
void PrintCalibration(const nlohmann::ordered_json& calibration);
void PrintCalibrations(const nlohmann::ordered_json& page);
/// Of each camera the newest that is known.
void PrintDrift(const nlohmann::ordered_json& drift);
/// Of one camera.
void PrintDriftHistory(const nlohmann::ordered_json& page);
void PrintEvent(const nlohmann::ordered_json& event);

}  // namespace rotunda::cli
