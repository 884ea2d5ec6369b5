// Calibration against truth, against itself and against Debian's mrcal: errors, what the sigmas
// promise, and times.

#include <CLI/CLI.hpp>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "rig/calibration_comparison.h"
#include "rig/sim/board_object.h"
#include "rig/sim/simulate.h"
#include "tests/bench/bench_process.h"
#include "tests/bench/calibration_mean.h"
#include "tests/bench/calibration_real.h"
#include "tests/bench/calibration_run.h"
#include "tests/bench/calibration_verdict.h"
#include "tests/support/projected_corners.h"

namespace rotunda::bench {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

/// Of each coordinate, where a face is seen head-on: what corners of rendered pictures have
/// (CornersAreFoundWithoutBias and PixelsDoNotDrawCornersTowardsThem of board_detection_test).
constexpr double kNoise_px = 0.003;

/// What a calibration of 90 cameras from 12 shots must keep.
constexpr TruthLimits kFull = {0.005, 0.15, 0.03, 0.05};
constexpr double kUnlimited = INFINITY;
constexpr TruthLimits kOneShot = {0.01, 0.3, kUnlimited, kUnlimited};  // with the lenses kept
/// Mean squared error over the predicted one, over the seeds (one rendered run on its own).
constexpr double kLeastRatio = 0.7, kMostRatio = 1.5;

/// Of 90 cameras and 12 shots on two cores, with cross-validation.
constexpr double kMaxSolving_s = 30;

/// Of real cameras: the greatest RMS, and the least share of corners kept.
struct RealLimits {
  double rms_px, kept;
};
constexpr RealLimits kCube = {1.0, 0.8};
constexpr RealLimits kFourCameras = {0.45, 0.8};
/// The same corners through mrcal: differences over what both calibrations' sigmas make together.
constexpr double kMostPeerSigmas = 1;

void KeepRatios(const std::string& run, double rotation, double position, Verdict& verdict) {
  for (const auto& [name, ratio] : {std::pair(": (measured/predicted)^2, rotation", rotation),
                                    std::pair(": (measured/predicted)^2, position", position)}) {
    verdict.AtLeast(run + name, ratio, kLeastRatio);
    verdict.AtMost(run + name, ratio, kMostRatio);
  }
}

/// `needed`: pictures that are not there are as bad as a broken limit.
void KeepReal(const std::string& run, const std::optional<RealFit>& fit, const RealLimits& limits,
              bool needed, Verdict& verdict) {
  verdict.Must(run + ": its pictures are there", fit.has_value() || !needed);
  if (!fit) return;
  for (const std::string& doubt : fit->doubts) {
    verdict.Must(run + ": no doubt of '" + doubt + "'", false);
  }
  verdict.AtMost(run + ": RMS, px", fit->rms_px, limits.rms_px);
  verdict.AtLeast(run + ": corners kept (share)", fit->kept, limits.kept);
  verdict.AtLeast(run + ": cameras and shots posed (share)", fit->posed, 1);
  if (fit->peer_sigmas) {
    verdict.AtMost(run + ": greatest difference from mrcal (OPENCV5) over both sigmas",
                   *fit->peer_sigmas, kMostPeerSigmas);
  }
}

struct Arguments {
  test::ProjectedOptions projected = {.noise_px = kNoise_px};
  int seeds = 5;
  int moved = 20;
  std::vector<std::string> parts = {"projected", "moved", "mean", "real", "rendered"};
  fs::path work = fs::temp_directory_path() / "rotunda-bench-calibration";
};

/// All cameras from all shots, then from one more shot with the lenses kept.
void BenchProjected(test::ProjectedOptions options, int seeds, ThreadPool& threads,
                    Verdict& verdict) {
  std::printf(
      "Projected corners: %d cameras, %d shots, noise %.3f px (head-on), faces misplaced by up to "
      "1 mm and 0.2 deg, bowed by 0.5 mm\n",
      options.cameras, options.shots, options.noise_px);
  PrintTruthHeading();
  std::string times;
  double rotation = 0, position = 0;
  for (int seed = 1; seed <= seeds; ++seed) {
    options.rig_seed = options.noise_seed = static_cast<uint64_t>(seed);
    const test::ProjectedRig world = test::ProjectCorners(options);
    const CalibrationRun run = Calibrate(world.board, world.sightings, {}, threads);
    const std::string name = "seed " + std::to_string(seed);
    const TruthErrors errors = PrintAgainstTruth(world.board, run, world.truth, name);
    verdict.Keep(name, errors, kFull);
    rotation += errors.rotation_ratio / seeds;
    position += errors.position_ratio / seeds;
    times = run.times;
    verdict.AtMost(name + ": solving, s", run.seconds, kMaxSolving_s);
    test::ProjectedOptions one = options;
    one.shots = 1;
    one.first_placement = options.shots;
    one.noise_seed += 1000;
    const test::ProjectedRig daily = test::ProjectCorners(one);
    const TruthErrors later = PrintAgainstTruth(
        daily.board,
        Calibrate(daily.board, daily.sightings, {.intrinsics_from = &run.file}, threads),
        daily.truth, "  one shot later");
    verdict.Keep(name + ", one shot later", later, kOneShot);
  }
  if (seeds > 0) KeepRatios("projected, mean of seeds", rotation, position, verdict);
  std::printf("time of the last: %s\n", times.c_str());
}

/// 1 mm down or 0.1 deg.
void Move(bool turn, CalibratedCamera& camera) {
  const Eigen::Vector3d centre =
      camera.cam_from_rig.OriginInSource() - Eigen::Vector3d(0, 0, turn ? 0 : 1e-3);
  const Eigen::Vector3d turn_rad(0, turn ? RadFromDeg(0.1) : 0, 0);
  camera.cam_from_rig.rotation = rig::RotationOf(turn_rad) * camera.cam_from_rig.rotation;
  camera.cam_from_rig.translation = -(camera.cam_from_rig.rotation * centre);
}

/// Pairs of calibrations between which one camera moved.
void BenchMoved(test::ProjectedOptions options, int runs, ThreadPool& threads, Verdict& verdict) {
  int named = 0, false_alarms = 0, lenses = 0;
  const auto calibrate = [&](const test::ProjectedRig& world) {
    return Calibrate(world.board, world.sightings, {.validate = false}, threads).file;
  };
  for (int run = 0; run < runs; ++run) {
    options.rig_seed = options.noise_seed = static_cast<uint64_t>(run + 1);
    const test::ProjectedRig before = test::ProjectCorners(options);
    Calibration moved = before.truth;
    CalibratedCamera& camera = moved.cameras[static_cast<size_t>(7 * run) % moved.cameras.size()];
    Move(run % 2 == 1, camera);
    test::ProjectedOptions later = options;
    later.noise_seed += 1000;
    later.first_placement = options.shots;
    const auto comparison = OrDie(rig::CompareCalibrations(
        calibrate(before), calibrate(test::ProjectCorners(later, moved)), {}));
    for (const rig::CameraChange& change : comparison.cameras) {
      lenses += change.lens_changed ? 1 : 0;
      if (!change.moved) continue;
      (change.camera == camera.camera ? named : false_alarms) += 1;
    }
  }
  std::printf(
      "\nOne camera of %d moved by 1 mm or 0.1 deg between two calibrations: named in %d of %d "
      "runs, %d false alarms; %d lenses said to have changed (none did)\n",
      options.cameras, named, runs, false_alarms, lenses);
  verdict.AtLeast("moved cameras named", named, runs);
  verdict.AtMost("false alarms", false_alarms, 0);
  verdict.AtMost("false alarms of lenses", lenses, 0);
  std::fflush(stdout);
}

double Since(Clock::time_point begin) {
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

/// Errors of the corners found, under the true cameras and the true target.
void PrintCornerErrors(const rig::Board& board, const rig::BoardSightings& sightings,
                       const Calibration& truth) {
  rig::RigModel model;
  for (const rig::SightedCamera& camera : sightings.cameras) {
    const CalibratedCamera* real = truth.Find(camera.camera);
    model.intrinsics.push_back(real->intrinsics);
    model.cam_from_rig.push_back(real->cam_from_rig);
  }
  for (size_t s = 0; s < sightings.shots.size(); ++s) {
    model.rig_from_board.push_back(sim::BoardPlacement(static_cast<int>(s)));
  }
  model.faces = truth.board;
  constexpr double kWrong_px = 0.5;
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  double squares = 0, predicted = 0, ratio = 0;
  size_t count = 0, wrong = 0;
  for (const rig::FaceView& view : rig::ViewsOf(sightings)) {
    const auto residuals = rig::Residuals_px(model, rig::ShapeOf(board), view);
    for (size_t i = 0; i < residuals.size(); ++i) {
      if (residuals[i].norm() > kWrong_px) {
        ++wrong;
        continue;
      }
      const double sigma_px = view.corners[i].sigma_px;
      sum -= residuals[i];
      squares += 0.5 * residuals[i].squaredNorm();
      predicted += sigma_px * sigma_px;
      ratio += 0.5 * residuals[i].squaredNorm() / (sigma_px * sigma_px);
      ++count;
    }
  }
  const auto n = static_cast<double>(count);
  std::printf(
      "corners against truth: %zu, bias %.4f %.4f px, each coordinate RMS %.4f px, predicted %.4f "
      "px, (measured/predicted)^2 %.2f; %zu off by more than %.1f px\n",
      count, sum.x() / n, sum.y() / n, std::sqrt(squares / n), std::sqrt(predicted / n), ratio / n,
      wrong, kWrong_px);
}

/// The whole chain, from rendered pictures. Shots that are in the work folder are taken from there.
void BenchRendered(const Arguments& arguments, ThreadPool& threads, Verdict& verdict) {
  sim::SimulateOptions options;
  options.target = sim::Target::kCuboid;
  options.cameras = arguments.projected.cameras;
  options.seed = 1;
  const int shots = arguments.projected.shots;
  const fs::path work =
      arguments.work / (std::to_string(options.cameras) + "x" + std::to_string(shots));
  RunContext context{threads};
  fs::create_directories(work);
  const auto begin = Clock::now();
  if (!fs::exists(work / "shots")) {
    OrDie(sim::SimulatePlacements({}, options, shots, work / "shots", context));
  }
  if (!fs::exists(work / "later")) {
    options.placement = shots;
    OrDie(sim::SimulatePlacements({}, options, 1, work / "later", context));
  }
  std::printf("\nRendered: %d cameras of 1200x1600, %d shots (rendering: %.0f s; in %s)\n",
              options.cameras, shots, Since(begin), work.c_str());
  const Calibration truth = OrDie(ReadCalibration(work / "shots" / "placement_00" / "truth.json"));
  const TimedSightings timed = Detect(work / "shots", options.board, threads);
  PrintCornerErrors(options.board, timed.sightings, truth);
  PrintTruthHeading();
  const CalibrationRun run = Calibrate(options.board, timed.sightings, {}, threads);
  const TruthErrors errors = PrintAgainstTruth(options.board, run, truth, "seed 1");
  verdict.Keep("rendered", errors, kFull);
  KeepRatios("rendered", errors.rotation_ratio, errors.position_ratio, verdict);
  const TimedSightings later = Detect(work / "later", options.board, threads);
  const TruthErrors one = PrintAgainstTruth(
      options.board,
      Calibrate(options.board, later.sightings, {.intrinsics_from = &run.file}, threads), truth,
      "  one shot later");
  verdict.Keep("rendered, one shot later", one, kOneShot);
  std::printf("time: %s%s\n", timed.TimeText().c_str(), run.times.c_str());
  verdict.AtMost("rendered: solving, s", run.seconds, kMaxSolving_s);
}

void BenchRealSets(bool needed, ThreadPool& threads, Verdict& verdict) {
  const fs::path source = ROTUNDA_SOURCE_DIR;
  const char* shared = std::getenv("ROTUNDA_SHARED");
  const fs::path data = (shared ? fs::path(shared) : source.parent_path() / "shared") / "data";
  const auto bench = [&](const char* board, const char* set, const RealLimits& limits) {
    KeepReal(set, BenchReal(source / "config/boards" / board, data / set, threads), limits, needed,
             verdict);
  };
  bench("charuco-cube.toml", "charuco-cube", kCube);
  bench("charuco-8x11.toml", "charuco-4cam", kFourCameras);
}

int Main(int argc, char** argv) {
  Arguments arguments;
  CLI::App app(
      "Calibration of simulated rigs against truth, and of real cameras against mrcal; ends "
      "with status 1 when a limit is broken or a mean input does not end as it must (limits of "
      "simulated rigs are for 90 cameras and 12 shots)",
      "calibration");
  app.add_option("--parts", arguments.parts,
                 "Of projected (corners), moved (cameras), mean (inputs), real (pictures, from "
                 "../shared or $ROTUNDA_SHARED; must be there when this part is named), rendered "
                 "(all pictures; a quarter of an hour)")
      ->delimiter(',')
      ->check(CLI::IsMember(arguments.parts))
      ->capture_default_str();
  app.add_option("--cameras", arguments.projected.cameras, "Of the simulated rig")
      ->capture_default_str();
  app.add_option("--shots", arguments.projected.shots, "Of its calibration")->capture_default_str();
  app.add_option("--noise", arguments.projected.noise_px, "Of projected corners, pixels")
      ->capture_default_str();
  app.add_option("--seeds", arguments.seeds, "Rigs of projected corners")->capture_default_str();
  app.add_option("--runs", arguments.moved, "Pairs of calibrations between which a camera moves")
      ->capture_default_str();
  app.add_option("--work", arguments.work, "Where rendered shots are kept")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  ThreadPool threads(0);
  Verdict verdict;
  const std::set<std::string> parts(arguments.parts.begin(), arguments.parts.end());
  if (parts.contains("projected"))
    BenchProjected(arguments.projected, arguments.seeds, threads, verdict);
  if (parts.contains("moved")) BenchMoved(arguments.projected, arguments.moved, threads, verdict);
  if (parts.contains("mean")) BenchMeanInputs(threads, verdict);
  const bool named = app.count("--parts") > 0;
  if (parts.contains("real")) BenchRealSets(named, threads, verdict);
  if (parts.contains("rendered")) BenchRendered(arguments, threads, verdict);
  return verdict.broken() == 0 ? 0 : 1;
}

}  // namespace
}  // namespace rotunda::bench

int main(int argc, char** argv) { return rotunda::bench::Main(argc, argv); }
