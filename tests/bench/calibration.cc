#include <CLI/CLI.hpp>
#include <chrono>
#include <cmath>
#include <cstdio>

#include "rig/calibration_result.h"
#include "sfm/core/evaluate.h"
#include "tests/support/projected_corners.h"

// The calibration on corners projected by a simulated rig: errors against truth, what the sigmas
// promise, and times.

namespace rotunda {
namespace {

using Clock = std::chrono::steady_clock;

double Since(Clock::time_point begin) {
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

double MeanFocalError_percent(const Calibration& found, const Calibration& truth) {
  double sum = 0;
  for (const CalibratedCamera& camera : found.cameras) {
    const double true_px = truth.Find(camera.camera)->intrinsics.MeanFocal_px();
    sum += 100 * std::abs(camera.intrinsics.MeanFocal_px() / true_px - 1);
  }
  return sum / static_cast<double>(found.cameras.size());
}

int Row(const test::ProjectedOptions& options, const Calibration* intrinsics_from, bool validate,
        Calibration* out, ThreadPool& threads) {
  const test::ProjectedRig world = test::ProjectCorners(options);
  double start_s = 0;
  auto begin = Clock::now();
  const auto all = begin;
  RunContext context{threads};
  context.progress = [&](std::string_view stage, size_t done, size_t) {
    if (stage == "start" && done == 1) {
      start_s = Since(begin);
      begin = Clock::now();
    }
  };
  rig::RigCalibrationOptions calibrate;
  calibrate.intrinsics_from = intrinsics_from;
  const auto result = rig::CalibrateRig(world.board, world.sightings, calibrate, context);
  const double solve_s = Since(begin);
  if (!result) {
    std::printf("failed: %s\n", result.error().ToString().c_str());
    return 1;
  }
  begin = Clock::now();
  std::optional<rig::CrossValidation> validation;
  if (validate) {
    auto v = rig::CrossValidate(world.board, *result, {}, context);
    if (v)
      validation = *v;
    else
      std::printf("validation: %s\n", v.error().ToString().c_str());
  }
  const double validate_s = Since(begin);
  const Calibration found = rig::ToCalibration(world.board, world.sightings, *result,
                                               validation ? &*validation : nullptr);
  const auto evaluation = EvaluateCalibration(found, world.truth);
  if (!evaluation) {
    std::printf("evaluation: %s\n", evaluation.error().ToString().c_str());
    return 1;
  }
  std::printf(
      "%3d x %2d seed %llu: %zu/%zu  rot %.5f (max %.5f) deg  pos %.4f (max %.4f) mm  focal %.4f "
      "%%  board "
      "%.4f mm  ratio^2 rot %.2f pos %.2f  noise %.3f rms %.4f kept %.4f dropped %zu  | start %.1f "
      "solve %.1f validate %.1f total %.1f s\n",
      options.cameras, options.shots, static_cast<unsigned long long>(options.rig_seed),
      evaluation->registered, evaluation->of, evaluation->mean_rotation_deg,
      evaluation->max_rotation_deg, evaluation->mean_position_mm, evaluation->max_position_mm,
      MeanFocalError_percent(found, world.truth),
      test::BoardError_mm(world.board, result->model.faces, world.truth.board),
      std::pow(*evaluation->rotation_error_over_sigma, 2),
      std::pow(*evaluation->position_error_over_sigma, 2), result->noise, found.residuals->rms_px,
      static_cast<double>(found.residuals->kept) / static_cast<double>(found.residuals->corners),
      result->dropped.size(), start_s, solve_s, validate_s, Since(all));
  if (validation) {
    std::printf(
        "   held-out rms %.4f p95 %.4f px; halves: %.5f deg %.4f mm, over sigma rot %.2f pos "
        "%.2f\n",
        validation->held_out_rms_px, validation->held_out_p95_px, validation->half_rotation_deg,
        validation->half_position_mm, validation->rotation_ratio.value_or(-1),
        validation->position_ratio.value_or(-1));
  }
  for (const auto& dropped : result->dropped) {
    std::printf("   dropped shot %zu camera %d: %s\n", dropped.shot,
                dropped.camera ? static_cast<int>(*dropped.camera) : -1, dropped.reason.c_str());
  }
  if (out) *out = found;
  std::fflush(stdout);
  return 0;
}

int Main(int argc, char** argv) {
  test::ProjectedOptions options;
  int seeds = 5;
  bool validate = true;
  CLI::App app("Calibration of simulated rigs against truth");
  app.add_option("--cameras", options.cameras);
  app.add_option("--shots", options.shots);
  app.add_option("--seeds", seeds);
  app.add_option("--noise", options.noise_px);
  app.add_flag("!--no-validation", validate);
  CLI11_PARSE(app, argc, argv);
  ThreadPool threads(0);
  for (int seed = 1; seed <= seeds; ++seed) {
    options.rig_seed = options.noise_seed = static_cast<uint64_t>(seed);
    Calibration found;
    if (Row(options, nullptr, validate, &found, threads) != 0) return 1;
    test::ProjectedOptions one = options;
    one.shots = 1;
    one.first_placement = 0;
    one.noise_seed += 1000;
    if (Row(one, &found, false, nullptr, threads) != 0) return 1;
  }
  return 0;
}

}  // namespace
}  // namespace rotunda

int main(int argc, char** argv) { return rotunda::Main(argc, argv); }
