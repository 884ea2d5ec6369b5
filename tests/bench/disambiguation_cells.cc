#include "tests/bench/disambiguation_cells.h"

#include <algorithm>
#include <vector>

#include "sfm/core/calibration.h"
#include "sfm/core/checksum.h"
#include "sfm/core/evaluate.h"
#include "sfm/core/file_io.h"
#include "sfm/core/frame_set.h"
#include "sfm/stage_io.h"
#include "tests/bench/bench_process.h"
#include "tests/bench/colmap_mapper.h"
#include "tests/bench/disambiguation_photographs.h"
#include "tests/bench/revision.h"

namespace rotunda::bench {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;
using test::ProcessOutcome;
using test::RunProcess;

/// Below this many cameras no similarity can be fitted, so that there is nothing to compare.
constexpr size_t kMinEvaluated = 3;
constexpr size_t kMaxErrorText = 600;
constexpr int kRefused = 1;  // exit status of `rotunda` when the work itself did not succeed

std::string NameOf(const Cell& cell) { return cell.capture.name + "--" + cell.method.name; }
fs::path RecordFile(const Cell& cell, const fs::path& work) {
  return work / "cells" / (NameOf(cell) + ".json");
}

/// A method with a front end of its own has its own stages of the capture.
CaptureFiles FilesOf(const Cell& cell, const fs::path& work) {
  CaptureFiles files = FilesOf(cell.capture, work);
  if (!cell.method.front_end.empty()) files.stages = work / "stages" / NameOf(cell);
  return files;
}

std::vector<std::string> OptionsOf(const Method& method) {
  std::vector<std::string> options = method.options;
  options.insert(options.end(), method.front_end.begin(), method.front_end.end());
  return options;
}

Json ParseFile(const fs::path& file) { return Json::parse(OrDie(ReadFile(file))); }

void RecordFailure(const ProcessOutcome& outcome, CellRecord& record) {
  std::string text = outcome.errors.empty() ? outcome.output : outcome.errors;
  text = text.substr(text.size() > kMaxErrorText ? text.size() - kMaxErrorText : 0);
  while (!text.empty() && text.back() == '\n') text.pop_back();
  record["error"] = "ended with " + std::to_string(outcome.exit_code) + ": " + text;
  record["refused"] = outcome.exit_code == kRefused;
}

/// What the result says of itself, and which cameras it finds in another place than the calibration
/// has them.
void RecordPoses(const Json& poses, const CaptureFiles& files, CellRecord& record) {
  const Json& summary = poses["summary"];
  for (const char* key : {"registered", "of", "models", "rms_px", "margin", "verdict",
                          "verdict_reason", "verdict_of_pictures"}) {
    if (summary.contains(key)) record[key] = summary[key];
  }
  record["gives_margins"] = poses["method"] == "tc-sfm";
  if (summary.contains("folded")) record["says_folded"] = summary["folded"];
  record["moved"] = Json::array();
  record["swapped"] = Json::array();
  for (const Json& camera : poses["cameras"]) {
    if (!camera.contains("vs_calibration")) continue;
    const Json& versus = camera["vs_calibration"];
    const bool swapped = versus.contains("swapped_with");
    if (swapped) record["swapped"].push_back(camera["camera"]);
    if (!swapped && versus["moved"]) record["moved"].push_back(camera["camera"]);
  }
  record["poses_xxh3"] = Xxh3Text(poses["cameras"].dump());
  record["expected"] = fs::exists(files.expected)
                           ? ParseFile(files.expected)
                           : Json{{"moved", Json::array()}, {"swapped", Json::array()}};
}

/// Without the list of cameras.
void RecordEvaluation(Json evaluation, CellRecord& record) {
  evaluation.erase("cameras");
  record["evaluation"] = evaluation;
}

void RecordScene(const Cell& cell, const CaptureFiles& files, const fs::path& model,
                 const fs::path& picture, CellRecord& record) {
  fs::create_directories(picture.parent_path());
  const SceneJudgement judgement = JudgeScene(cell, files, model, picture);
  record["scene"] = {{"right", judgement.right},
                     {"why", judgement.why},
                     {"truth", cell.capture.scene.truth},
                     {"picture", picture.string()}};
}

void RunRotunda(const Cell& cell, const fs::path& work, CellRecord& record) {
  const CaptureFiles files = FilesOf(cell, work);
  const fs::path out = work / "runs" / NameOf(cell);
  fs::remove_all(out);
  fs::create_directories(out.parent_path());
  const ProcessOutcome run = RunProcess(ReconstructCommand(files, cell.method.options, out));
  if (run.exit_code != 0) {
    RecordFailure(run, record);
    return;
  }
  const Json result = Json::parse(run.output);
  record["seconds"] = run.seconds;
  record["stages"] = result["stages"];
  record["notes"] = result["notes"];
  RecordPoses(ParseFile(out / "poses.json"), files, record);
  if (!cell.capture.photographs.empty()) {
    RecordScene(cell, files, out / "sparse" / "0", work / "layouts" / (NameOf(cell) + ".png"),
                record);
    return;
  }
  const ProcessOutcome evaluation = RunProcess(
      {ROTUNDA_COMMAND, "evaluate", out / "poses.json", "--truth", files.truth, "--json"});
  if (evaluation.exit_code == 0) {
    RecordEvaluation(Json::parse(evaluation.output), record);
  } else {
    RecordFailure(evaluation, record);
  }
}

void WriteDatabase(const CaptureFiles& files, const fs::path& database) {
  const FrameSet set = OrDie(ReadFrameSet(files.frameset));
  const Calibration calibration = OrDie(ReadCalibration(files.frameset / "calibration.json"));
  const sfm::Features features = OrDie(sfm::ReadFeatures(files.stages / "features.bin"));
  const sfm::TwoViews two_views =
      OrDie(sfm::ReadTwoViews(files.stages / "two_views.bin", features));
  WriteMatchedDatabase(database, {set, calibration, features, two_views});
}

void RunColmap(const Cell& cell, const fs::path& work, CellRecord& record) {
  const CaptureFiles files = FilesOf(cell, work);
  const fs::path out = work / "runs" / NameOf(cell);
  fs::remove_all(out);
  fs::create_directories(out / "models");
  WriteDatabase(files, out / "database.db");
  const ProcessOutcome run =
      RunProcess(MapperCommand(out / "database.db", files.frameset / "frames", out / "models"));
  fs::remove(out / "database.db");
  if (run.exit_code != 0) {
    RecordFailure(run, record);
    return;
  }
  const Calibration truth = OrDie(ReadCalibration(files.truth));
  const MapperModels models = ReadMapperModels(out / "models", truth);
  const auto& cameras = models.largest.cameras;
  const auto registered = static_cast<size_t>(std::count_if(
      cameras.begin(), cameras.end(), [](const CameraPose& pose) { return pose.registered; }));
  record["seconds"] = run.seconds;
  record["registered"] = registered;
  record["of"] = truth.cameras.size();
  record["models"] = models.count;
  if (registered < kMinEvaluated) return;
  RecordEvaluation(Json::parse(EvaluationToJson(OrDie(EvaluatePoses(models.largest, truth)))),
                   record);
}

}  // namespace

const char* const kRevision = ROTUNDA_REVISION;

std::optional<CellRecord> ReadCell(const Cell& cell, const fs::path& work) {
  const fs::path file = RecordFile(cell, work);
  if (!fs::exists(file)) return std::nullopt;
  return ParseFile(file);
}

CellRecord RunCell(const Cell& cell, const fs::path& work) {
  PrepareCapture(cell.capture, work);
  PrepareStages(FilesOf(cell, work), cell.method.front_end);
  CellRecord record = {{"capture", cell.capture.name},
                       {"method", cell.method.name},
                       {"options", OptionsOf(cell.method)},
                       {"revision", kRevision}};
  if (cell.method.is_colmap) {
    RunColmap(cell, work, record);
  } else {
    RunRotunda(cell, work, record);
  }
  fs::create_directories(work / "cells");
  OrDie(WriteFileAtomically(RecordFile(cell, work), record.dump(1) + "\n"));
  return record;
}

}  // namespace rotunda::bench
