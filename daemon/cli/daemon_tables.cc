#include "daemon/cli/daemon_tables.h"

#include <algorithm>
#include <cstdio>

#include "sfm/core/bytes_text.h"
#include "sfm/core/plain_text.h"

namespace rotunda::cli {
namespace {

using Json = nlohmann::ordered_json;

/// In characters: bytes that begin one.
size_t Width(const std::string& text) {
  return static_cast<size_t>(
      std::count_if(text.begin(), text.end(), [](char c) { return (c & 0xC0) != 0x80; }));
}

std::string ValueText(const Json& value) {
  if (value.is_string()) return Printable(value.get<std::string>());
  if (value.is_boolean()) return value.get<bool>() ? "yes" : "no";
  if (!value.is_number_float()) return value.dump();
  char text[32];
  std::snprintf(text, sizeof(text), "%.3f", value.get<double>());
  return text;
}

void PrintLine(const std::string& key, const Json& value) {
  std::printf("%-18s %s\n", key.c_str(), ValueText(value).c_str());
}

/// Fields of what a job was asked for, or what came of it; of a list each item.
void PrintPart(const std::string& name, const Json& part) {
  std::printf("%s\n", name.c_str());
  for (const auto& [key, value] : part.items()) {
    if (!value.is_array()) PrintLine("  " + key, value);
    if (!value.is_array()) continue;
    if (value.empty()) PrintLine("  " + key, "none");
    for (const Json& item : value) PrintLine("  " + key, item);
  }
}

/// The job with "at": how far it is, if it runs.
Json WithPlace(Json job) {
  if (!job.contains("progress")) return job;
  const Json& progress = job["progress"];
  job["at"] =
      FieldText(progress, "stage") + " " + progress["done"].dump() + "/" + progress["total"].dump();
  return job;
}

/// A page of a list, and how to see the next one.
void PrintPage(const Json& page, const std::vector<Column>& columns) {
  PrintTable(page["items"], columns);
  if (page.contains("next")) {
    std::printf("older ones: the same with --after %s\n", FieldText(page, "next").c_str());
  }
}

/// What has become of a capture's pictures.
std::string VerdictText(const Json& capture) {
  if (capture.contains("verdict")) return FieldText(capture, "verdict");
  return capture.contains("reconstruction") ? "no verdict" : "not reconstructed";
}

}  // namespace

std::string FieldText(const Json& object, const std::string& key) {
  return object.contains(key) ? ValueText(object[key]) : "-";
}

void PrintTable(const Json& items, const std::vector<Column>& columns) {
  std::vector<size_t> widths;
  for (const Column& column : columns) {
    size_t width = Width(column.title);
    for (const Json& item : items) width = std::max(width, Width(FieldText(item, column.key)));
    widths.push_back(width);
  }
  const auto print_row = [&](const auto& cell) {
    std::string line;
    for (size_t i = 0; i < columns.size(); ++i) {
      const std::string text = cell(columns[i]);
      line += text + std::string(widths[i] + 2 - Width(text), ' ');
    }
    line.erase(line.find_last_not_of(' ') + 1);
    std::printf("%s\n", line.c_str());
  };
  print_row([](const Column& column) { return std::string(column.title); });
  for (const Json& item : items) {
    print_row([&](const Column& column) { return FieldText(item, column.key); });
  }
}

void PrintFields(const Json& object) {
  for (const auto& [key, value] : object.items()) {
    if (!value.is_structured()) PrintLine(key, value);
  }
}

void PrintJson(const Json& value) { std::printf("%s\n", value.dump(1).c_str()); }

void PrintMoved(const Json& status) {
  for (const Json& camera : status["moved"]) {
    std::printf("  moved: %s by %s mm, %s deg\n", FieldText(camera, "camera").c_str(),
                FieldText(camera, "position_mm").c_str(),
                FieldText(camera, "rotation_deg").c_str());
  }
}

void PrintStatus(const Json& status) {
  const Json& cameras = status["cameras"];
  std::printf("cameras      %s of %s ready\n", cameras["ready"].dump().c_str(),
              cameras["of"].dump().c_str());
  std::printf("calibration  %s\n",
              status.contains("calibration") ? FieldText(status, "calibration").c_str() : "none");
  if (status.contains("last_capture")) {
    const Json& last = status["last_capture"];
    std::printf("last capture %s, %s of %s frames, %s\n", FieldText(last, "id").c_str(),
                last["ok"].dump().c_str(), last["of"].dump().c_str(), VerdictText(last).c_str());
  }
  std::printf("jobs         %zu running, %s queued\n", status["jobs"]["running"].size(),
              status["jobs"]["queued"].dump().c_str());
  std::printf("disk         %s free\n",
              BytesText(status["disk"]["free_bytes"].get<uint64_t>()).c_str());
  PrintMoved(status);
  for (const Json& problem : status["problems"]) {
    std::printf("  see to: %s\n", ValueText(problem).c_str());
  }
}

void PrintCameras(const Json& list) {
  Json rows = list["items"];
  for (Json& row : rows) {
    if (!row.contains("drift")) continue;
    for (const char* key : {"position_mm", "rotation_deg", "moved"}) row[key] = row["drift"][key];
  }
  PrintTable(rows, {{"camera", "camera"},
                    {"is", "condition"},
                    {"address", "address"},
                    {"serial", "serial"},
                    {"model", "model"},
                    {"temp C", "temperature_deg_c"},
                    {"resent", "resent_packets"},
                    {"off mm", "position_mm"},
                    {"off deg", "rotation_deg"},
                    {"moved", "moved"},
                    {"problem", "problem"}});
}

void PrintJob(const Json& job) {
  PrintFields(WithPlace(job));
  for (const char* part : {"request", "result"}) {
    if (job.contains(part)) PrintPart(part, job[part]);
  }
}

void PrintJobs(const Json& page) {
  Json shown = page;
  for (Json& row : shown["items"]) row = WithPlace(row);
  PrintPage(shown, {{"job", "id"},
                    {"kind", "kind"},
                    {"state", "state"},
                    {"created", "created_at"},
                    {"at", "at"},
                    {"product", "product"},
                    {"error", "error"}});
}

void PrintCapture(const Json& capture) {
  PrintFields(capture);
  for (const Json& frame : capture["frames"]) {
    if (frame["status"] == "ok") continue;
    const std::string reason = frame.contains("reason") ? ", " + FieldText(frame, "reason") : "";
    std::printf("  %s: %s%s\n", FieldText(frame, "camera").c_str(),
                FieldText(frame, "status").c_str(), reason.c_str());
  }
  const Json& reconstructions = capture["reconstructions"];
  if (reconstructions.empty()) return;
  PrintTable(reconstructions, {{"reconstruction", "id"},
                               {"registered", "registered"},
                               {"of", "of"},
                               {"rms px", "rms_px"},
                               {"preset", "preset"},
                               {"prior", "prior"},
                               {"verdict", "verdict"},
                               {"mean mm", "mean_position_mm"},
                               {"mean deg", "mean_rotation_deg"}});
  for (const Json& each : reconstructions) {
    if (each["verdict_reason"] == "") continue;
    std::printf("  %s: %s, %s\n", FieldText(each, "id").c_str(), FieldText(each, "verdict").c_str(),
                FieldText(each, "verdict_reason").c_str());
  }
}

void PrintCaptures(const Json& page) {
  PrintPage(page, {{"capture", "id"},
                   {"captured", "captured_at"},
                   {"subject", "subject"},
                   {"ok", "ok"},
                   {"of", "of"},
                   {"verdict", "verdict"}});
}

void PrintCalibration(const Json& calibration) {
  PrintFields(calibration);
  if (calibration.contains("made_from")) PrintPart("made_from", calibration["made_from"]);
}

void PrintCalibrations(const Json& page) {
  PrintPage(page, {{"calibration", "id"},
                   {"created", "created_at"},
                   {"cameras", "cameras"},
                   {"rms px", "rms_px"},
                   {"held out px", "held_out_rms_px"},
                   {"in force", "active"}});
}

void PrintDrift(const Json& drift) {
  PrintTable(drift["cameras"], {{"camera", "camera"},
                                {"moved", "moved"},
                                {"off mm", "position_mm"},
                                {"sigma mm", "position_sigma_mm"},
                                {"off deg", "rotation_deg"},
                                {"sigma deg", "rotation_sigma_deg"},
                                {"beyond in a row", "beyond_in_a_row"},
                                {"of", "captures"},
                                {"stands for", "swapped_with"},
                                {"newest capture", "capture"}});
  std::printf("calibration in force: %s\n",
              drift.contains("calibration") ? FieldText(drift, "calibration").c_str() : "none");
}

void PrintDriftHistory(const Json& page) {
  PrintPage(page, {{"captured", "captured_at"},
                   {"capture", "capture"},
                   {"calibration", "calibration"},
                   {"off mm", "position_mm"},
                   {"sigma mm", "position_sigma_mm"},
                   {"off deg", "rotation_deg"},
                   {"sigma deg", "rotation_sigma_deg"},
                   {"beyond", "beyond_limit"},
                   {"stands for", "swapped_with"}});
}

void PrintEvent(const Json& event) {
  std::printf("%s %s %s %s %s\n", event["number"].dump().c_str(), FieldText(event, "at").c_str(),
              FieldText(event, "kind").c_str(), FieldText(event, "about").c_str(),
              event["data"].dump().c_str());
}

}  // namespace rotunda::cli
