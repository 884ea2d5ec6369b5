#include <CLI/CLI.hpp>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <optional>

#include "config/board_config.h"
#include "rig/board_sightings.h"
#include "rig/calibration_comparison.h"
#include "rig/calibration_result.h"
#include "sfm/core/evaluate.h"
#include "tests/bench/bench_process.h"
#include "tests/bench/calibration_mrcal.h"
#include "tests/support/projected_corners.h"

// Calibration against truth, against itself and against Debian's mrcal: errors, what the sigmas
// promise, and times.

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
    if (!times_.empty() && times_.back().second == 0) {
      times_.back().second = std::chrono::duration<double>(Clock::now() - begin_).count();
    }
  }
  std::string Text() {
    End();
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

struct Run {
  rig::RigCalibration result;
  rig::CrossValidation validation;
  Calibration file;
  std::string times;
};

Run Calibrate(const rig::Board& board, const rig::BoardSightings& sightings,
              const Calibration* intrinsics_from, ThreadPool& threads) {
  StageTimes times;
  RunContext context{threads};
  context.progress = [&](std::string_view stage, size_t, size_t) { times.Begin(stage); };
  rig::RigCalibrationOptions options;
  options.intrinsics_from = options.frame_from = intrinsics_from;
  Run run;
  run.result = OrDie(rig::CalibrateRig(board, sightings, options, context));
  run.validation = OrDie(rig::CrossValidate(board, run.result, {}, context));
  run.file = rig::ToCalibration(board, sightings, run.result, &run.validation);
  run.times = times.Text();
  return run;
}

void PrintAgainstTruth(const test::ProjectedRig& world, const Run& run, uint64_t seed) {
  const Evaluation errors = OrDie(EvaluateCalibration(run.file, world.truth));
  std::printf(
      "%4llu %5zu %7zu/%zu  %8.5f %8.5f  %7.4f %7.4f  %7.4f  %7.4f  %5.2f %5.2f  %6.4f  %6.4f "
      "%6.4f  %5.2f %5.2f\n",
      static_cast<unsigned long long>(seed), world.sightings.shots.size(), errors.registered,
      errors.of, errors.mean_rotation_deg, errors.max_rotation_deg, errors.mean_position_mm,
      errors.max_position_mm, MeanFocalError_percent(run.file, world.truth),
      test::BoardError_mm(world.board, run.result.model.faces, world.truth.board),
      std::pow(*errors.rotation_error_over_sigma, 2),
      std::pow(*errors.position_error_over_sigma, 2),
      static_cast<double>(run.file.residuals->kept) /
          static_cast<double>(run.file.residuals->corners),
      run.validation.held_out_rms_px, run.validation.held_out_p95_px,
      run.validation.rotation_ratio.value_or(NAN), run.validation.position_ratio.value_or(NAN));
  std::fflush(stdout);
}

/// All cameras from all shots, then from one more shot with the lenses kept.
void BenchProjected(test::ProjectedOptions options, int seeds, ThreadPool& threads) {
  std::printf("Projected corners, noise %.3f px (head-on), misplaced and bowed faces\n",
              options.noise_px);
  std::printf(
      "seed shots cameras     rotation/deg       position/mm      focal/%%  board/mm (measured/"
      "predicted)^2  kept  held-out/px: RMS, P95  halves/sigma\n"
      "                           mean      max      mean     max                    rot   pos\n");
  std::string times;
  for (int seed = 1; seed <= seeds; ++seed) {
    options.rig_seed = options.noise_seed = static_cast<uint64_t>(seed);
    const test::ProjectedRig world = test::ProjectCorners(options);
    const Run run = Calibrate(world.board, world.sightings, nullptr, threads);
    PrintAgainstTruth(world, run, options.rig_seed);
    times = run.times;
    test::ProjectedOptions one = options;
    one.shots = 1;
    one.first_placement = options.shots;
    one.noise_seed += 1000;
    const test::ProjectedRig daily = test::ProjectCorners(one);
    PrintAgainstTruth(daily, Calibrate(daily.board, daily.sightings, &run.file, threads),
                      options.rig_seed);
  }
  std::printf("time: %s\n", times.c_str());
}

/// Pairs of calibrations between which one camera moved.
void BenchMoved(test::ProjectedOptions options, int runs, ThreadPool& threads) {
  int named = 0, false_alarms = 0;
  for (int run = 0; run < runs; ++run) {
    options.rig_seed = static_cast<uint64_t>(run + 1);
    options.noise_seed = options.rig_seed;
    const test::ProjectedRig before = test::ProjectCorners(options);
    Calibration moved = before.truth;
    CalibratedCamera& camera = moved.cameras[static_cast<size_t>(7 * run) % moved.cameras.size()];
    const Eigen::Vector3d centre =
        camera.cam_from_rig.OriginInSource() + Eigen::Vector3d(0, 0, run % 2 == 0 ? 1e-3 : 0);
    const Eigen::Vector3d turn_rad(0, run % 2 == 0 ? 0 : RadFromDeg(0.1), 0);
    camera.cam_from_rig.rotation = rig::RotationOf(turn_rad) * camera.cam_from_rig.rotation;
    camera.cam_from_rig.translation = -(camera.cam_from_rig.rotation * centre);
    test::ProjectedOptions later = options;
    later.noise_seed += 1000;
    later.first_placement = options.shots;
    const test::ProjectedRig after = test::ProjectCorners(later, moved);
    const auto comparison = OrDie(rig::CompareCalibrations(
        Calibrate(before.board, before.sightings, nullptr, threads).file,
        Calibrate(after.board, after.sightings, nullptr, threads).file, {}));
    for (const rig::CameraChange& change : comparison.cameras) {
      if (!change.moved) continue;
      (change.camera == camera.camera ? named : false_alarms) += 1;
    }
  }
  std::printf("one camera moved by 1 mm or 0.1 deg: named in %d of %d runs, %d false alarms\n",
              named, runs, false_alarms);
}

void PrintReal(const Run& run, const rig::BoardSightings& sightings) {
  size_t shots = 0;
  for (const auto& shot : run.result.model.rig_from_board) shots += shot.has_value();
  const CalibrationResiduals& residuals = *run.file.residuals;
  std::printf("  cameras %zu of %zu, shots %zu of %zu, kept %zu of %zu corners (%.1f %%)\n",
              run.file.cameras.size(), sightings.cameras.size(), shots, sightings.shots.size(),
              residuals.kept, residuals.corners,
              100.0 * static_cast<double>(residuals.kept) / static_cast<double>(residuals.corners));
  std::printf(
      "  RMS %.3f px, held-out RMS %.3f px, P95 %.3f px; halves over sigma: rotation "
      "%.2f, position %.2f\n  time: %s\n",
      residuals.rms_px, run.validation.held_out_rms_px, run.validation.held_out_p95_px,
      run.validation.rotation_ratio.value_or(NAN), run.validation.position_ratio.value_or(NAN),
      run.times.c_str());
}

/// Our intrinsics and poses relative to the first camera against mrcal's, with the combined
/// standard deviation of two such calibrations.
void CompareWithMrcal(const rig::Board& board, const rig::BoardSightings& sightings, const Run& run,
                      const std::string& lens_model) {
  const MrcalOutcome peer = RunMrcal(board, sightings, run.result.kept, lens_model,
                                     run.file.cameras[0].intrinsics.MeanFocal_px());
  std::printf("  %s: %s%.1f s\n", lens_model.c_str(), peer.summary.c_str(), peer.seconds);
  std::printf(
      "  camera      focal/px: ours  mrcal  difference  sigma   relative pose: "
      "difference/deg sigma  difference/mm sigma\n");
  const CalibratedCamera& first = run.file.cameras[0];
  const Rigid3 rig_from_first = first.cam_from_rig.Inverse();
  for (size_t c = 0; c < run.file.cameras.size(); ++c) {
    const CalibratedCamera& ours = run.file.cameras[c];
    const MrcalCamera& theirs = peer.cameras[c];
    const double focal_px = 0.5 * (theirs.intrinsics[0] + theirs.intrinsics[1]);
    const Rigid3 cam_from_first = ours.cam_from_rig * rig_from_first;
    const double both = std::sqrt(2.0);
    std::printf(
        "  %-10s %11.2f %9.2f %8.2f %8.2f %25.4f %7.4f %10.3f %6.3f\n", ours.camera.c_str(),
        ours.intrinsics.MeanFocal_px(), focal_px, ours.intrinsics.MeanFocal_px() - focal_px,
        both * ours.sigma->focal_px.value_or(0),
        DegFromRad(RotationAngle_rad(cam_from_first.rotation, theirs.cam_from_first.rotation)),
        both * std::hypot(ours.sigma->rotation_deg, first.sigma->rotation_deg),
        1e3 * (cam_from_first.OriginInSource() - theirs.cam_from_first.OriginInSource()).norm(),
        both * std::hypot(ours.sigma->position_mm, first.sigma->position_mm));
  }
}

rig::BoardSightings Detect(const std::string& folder, const rig::Board& board,
                           ThreadPool& threads) {
  RunContext context{threads};
  return OrDie(rig::DetectBoards(OrDie(rig::FindShots({folder})), board, {}, context));
}

int Main(int argc, char** argv) {
  test::ProjectedOptions options;
  int seeds = 5, moved = 0;
  std::vector<std::string> real;
  CLI::App app("Calibration of simulated rigs against truth, and of real cameras against mrcal");
  app.add_option("--cameras", options.cameras, "Of the simulated rig")->capture_default_str();
  app.add_option("--shots", options.shots, "Of its calibration")->capture_default_str();
  app.add_option("--seeds", seeds, "Rigs; 0: none")->capture_default_str();
  app.add_option("--noise", options.noise_px, "Of the corners, pixels")->capture_default_str();
  app.add_option("--moved", moved, "Pairs of calibrations between which one camera moves")
      ->capture_default_str();
  app.add_option("--real", real,
                 "A board file and a folder of shots; with a board of one face mrcal calibrates "
                 "from the same corners")
      ->expected(2);
  CLI11_PARSE(app, argc, argv);
  ThreadPool threads(0);
  if (seeds > 0) BenchProjected(options, seeds, threads);
  if (moved > 0) BenchMoved(options, moved, threads);
  if (!real.empty()) {
    const rig::Board board = OrDie(config::ReadBoard(real[0]));
    const rig::BoardSightings sightings = Detect(real[1], board, threads);
    const Run run = Calibrate(board, sightings, nullptr, threads);
    std::printf("%s\n", real[1].c_str());
    PrintReal(run, sightings);
    if (board.faces.size() == 1) {
      for (const char* model : {"LENSMODEL_OPENCV4", "LENSMODEL_OPENCV5"}) {
        CompareWithMrcal(board, sightings, run, model);
      }
    }
  }
  return 0;
}

}  // namespace
}  // namespace rotunda::bench

int main(int argc, char** argv) { return rotunda::bench::Main(argc, argv); }
