#include "tests/bench/calibration_run.h"

#include <chrono>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <utility>
#include <vector>

#include "rig/calibration_doubts.h"
#include "sfm/core/evaluate.h"
#include "tests/bench/bench_process.h"
#include "tests/support/projected_corners.h"

namespace rotunda::bench {
namespace {

using Clock = std::chrono::steady_clock;

/// Seconds that each stage took, in the order of their begin.
class StageTimes {
 public:
  void Begin(std::string_view stage) {
    if (!times_.empty() && times_.back().first == stage) return;
    End();
    times_.emplace_back(stage, 0.0);
    begin_ = Clock::now();
  }
  void End() {
    if (times_.empty()) return;
    times_.back().second = std::chrono::duration<double>(Clock::now() - begin_).count();
  }
  double Total() const {
    double seconds = 0;
    for (const auto& [stage, some] : times_) seconds += some;
    return seconds;
  }
  std::string Text() const {
    std::string text;
    char part[64];
    for (const auto& [stage, seconds] : times_) {
      std::snprintf(part, sizeof(part), "%s %.1f s  ", stage.c_str(), seconds);
      text += part;
    }
    return text;
  }

 private:
  std::vector<std::pair<std::string, double>> times_;
  Clock::time_point begin_;
};

double MeanFocalError_percent(const Calibration& found, const Calibration& truth) {
  double sum = 0;
  for (const CalibratedCamera& camera : found.cameras) {
    const double true_px = truth.Find(camera.camera)->intrinsics.MeanFocal_px();
    sum += 100 * std::abs(camera.intrinsics.MeanFocal_px() / true_px - 1);
  }
  return sum / static_cast<double>(found.cameras.size());
}

}  // namespace

CalibrationRun Calibrate(const rig::Board& board, const rig::BoardSightings& sightings,
                         const CalibrationRunOptions& options, ThreadPool& threads) {
  StageTimes times;
  RunContext context{threads};
  context.progress = [&](std::string_view stage, size_t, size_t) { times.Begin(stage); };
  rig::RigCalibrationOptions calibrate;
  calibrate.model = options.model;
  calibrate.intrinsics_from = calibrate.frame_from = options.intrinsics_from;
  CalibrationRun run;
  run.result = OrDie(rig::CalibrateRig(board, sightings, calibrate, context));
  if (options.validate) run.validation = OrDie(rig::CrossValidate(board, run.result, {}, context));
  times.End();
  run.seconds = times.Total();
  run.times = times.Text();
  run.file = rig::ToCalibration(board, sightings, run.result, &run.validation);
  return run;
}

std::vector<std::string> DoubtsOn(const rig::Board& board, const rig::BoardSightings& sightings,
                                  const CalibrationRun& run) {
  std::vector<std::string> doubts =
      rig::DoubtsOnFit(run.file, rig::CheckCameras(board, sightings, run.result, {}), nullptr, {});
  const std::string on_board = rig::DoubtOnBoard(board, sightings, &run.result, {});
  if (!on_board.empty()) doubts.push_back("the board file " + on_board);
  return doubts;
}

std::string TimedSightings::TimeText() const {
  char text[96];
  std::snprintf(text, sizeof(text), "detection %.1f s (%zu pictures, %.2f cores busy)  ", seconds,
                pictures, cores);
  return text;
}

TimedSightings Detect(const std::filesystem::path& folder, const rig::Board& board,
                      ThreadPool& threads) {
  RunContext context{threads};
  const auto begin = Clock::now();
  const std::clock_t processor_begin = std::clock();
  TimedSightings timed;
  timed.sightings = OrDie(rig::DetectBoards(OrDie(rig::FindShots({folder})), board, {}, context));
  timed.seconds = std::chrono::duration<double>(Clock::now() - begin).count();
  timed.cores =
      static_cast<double>(std::clock() - processor_begin) / CLOCKS_PER_SEC / timed.seconds;
  timed.pictures = timed.sightings.shots.size() * timed.sightings.cameras.size();
  return timed;
}

void PrintTruthHeading() {
  std::printf(
      "                   cameras   rotation/deg       position/mm     focal  board  (measured/"
      "predicted)^2  kept  held-out/px    halves/sigma\n"
      "                             mean     max       mean    max         %%     mm  "
      "rotation position    %%    RMS     P95   rot.  pos.\n");
}

TruthErrors PrintAgainstTruth(const rig::Board& board, const CalibrationRun& run,
                              const Calibration& truth, const std::string& name) {
  const Evaluation errors = OrDie(EvaluateCalibration(run.file, truth));
  const TruthErrors means = {
      static_cast<double>(errors.registered) / static_cast<double>(errors.of),
      errors.mean_rotation_deg,
      errors.mean_position_mm,
      MeanFocalError_percent(run.file, truth),
      test::BoardError_mm(board, run.result.model.faces, truth.board),
      std::pow(*errors.rotation_error_over_sigma, 2),
      std::pow(*errors.position_error_over_sigma, 2)};
  const CalibrationResiduals& residuals = *run.file.residuals;
  std::printf(
      "%-18s %3zu/%-3zu  %8.5f %8.5f  %7.4f %7.4f  %6.4f %6.4f %9.2f %8.2f  %5.1f  %6.4f %6.4f  "
      "%5.2f %5.2f\n",
      name.c_str(), errors.registered, errors.of, errors.mean_rotation_deg, errors.max_rotation_deg,
      errors.mean_position_mm, errors.max_position_mm, means.focal_percent, means.board_mm,
      means.rotation_ratio, means.position_ratio,
      100 * static_cast<double>(residuals.kept) / static_cast<double>(residuals.corners),
      run.validation.held_out_rms_px.value_or(NAN), run.validation.held_out_p95_px.value_or(NAN),
      run.validation.rotation_ratio.value_or(NAN), run.validation.position_ratio.value_or(NAN));
  std::fflush(stdout);
  return means;
}

}  // namespace rotunda::bench
