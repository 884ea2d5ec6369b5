// Our reconstruction beside Debian's colmap on the same pictures with the same intrinsics, in one
// run: time and peak memory stage by stage, registered images and pose errors, and the ratios.

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "sfm/core/calibration.h"
#include "sfm/core/evaluate.h"
#include "sfm/core/file_io.h"
#include "sfm/core/frame_set.h"
#include "tests/bench/bench_process.h"
#include "tests/bench/colmap_mapper.h"
#include "tests/support/process.h"
#include "tests/support/strecha.h"

namespace rotunda::bench {
namespace {

namespace fs = std::filesystem;
using test::ProcessOutcome;

struct Cost {
  double seconds = 0;
  double peak_memory_mb = 0;
};

struct Outcome {
  std::map<std::string, Cost> stages;  // "features", "matching", "reconstruction"
  Evaluation evaluation;
};

/// A set of pictures with known intrinsics and truth.
struct Scene {
  std::string name;
  fs::path pictures;     // plain folder for colmap
  fs::path frameset;     // what rotunda is given
  fs::path calibration;  // intrinsics for both
  Calibration truth;
};

void Add(Cost& to, double seconds, double peak_memory_mb) {
  to.seconds += seconds;
  to.peak_memory_mb = std::max(to.peak_memory_mb, peak_memory_mb);
}

/// Which of colmap's three programs does what our stage does.
std::string ColmapStage(const std::string& stage) {
  if (stage == "features") return "features";
  if (stage == "matching" || stage == "two-view geometry") return "matching";
  return "reconstruction";
}

Outcome RunRotunda(const Scene& scene, const fs::path& work) {
  const fs::path out = work / (scene.name + "-rotunda");
  const ProcessOutcome run =
      RunOrDie({ROTUNDA_COMMAND, "reconstruct", scene.frameset, "--calibration", scene.calibration,
                "--fix-intrinsics", "--out", out, "--json"});
  Outcome outcome;
  const nlohmann::json result = nlohmann::json::parse(run.output);
  for (const nlohmann::json& stage : result["stages"]) {
    Add(outcome.stages[ColmapStage(stage["stage"])], stage["seconds"], stage["peak_memory_mb"]);
  }
  outcome.evaluation = OrDie(EvaluatePoses(OrDie(ReadPoseSet(out / "poses.json")), scene.truth));
  return outcome;
}

Outcome RunColmap(const Scene& scene, const fs::path& work) {
  const fs::path database = work / (scene.name + ".db");
  const fs::path models = work / (scene.name + "-colmap");
  fs::create_directories(models);
  Outcome outcome;
  const auto step = [&](const std::string& stage, const std::vector<std::string>& arguments) {
    const ProcessOutcome run = RunOrDie(arguments);
    Add(outcome.stages[stage], run.seconds, run.peak_memory_mb);
  };
  step("features",
       {"colmap", "feature_extractor", "--database_path", database, "--image_path", scene.pictures,
        "--ImageReader.camera_model", "PINHOLE", "--SiftExtraction.use_gpu", "0"});
  WriteKnownIntrinsics(database, OrDie(ReadFrameSet(scene.frameset)),
                       OrDie(ReadCalibration(scene.calibration)));
  step("matching", {"colmap", "exhaustive_matcher", "--database_path", database,
                    "--SiftMatching.use_gpu", "0"});
  step("reconstruction", MapperCommand(database, scene.pictures, models));
  outcome.evaluation =
      OrDie(EvaluatePoses(ReadMapperModels(models, scene.truth).largest, scene.truth));
  return outcome;
}

void PrintRow(const char* name, const Cost& ours, const Cost& theirs) {
  std::printf("  %-16s %9.2f s %7.0f MB   %9.2f s %7.0f MB   %6.3f\n", name, ours.seconds,
              ours.peak_memory_mb, theirs.seconds, theirs.peak_memory_mb,
              ours.seconds / theirs.seconds);
}

void PrintAccuracy(const char* name, const Evaluation& evaluation) {
  std::printf(
      "  %-8s %3zu of %-3zu   rotation mean %.4f max %.4f deg   position mean %.3f max %.3f mm%s\n",
      name, evaluation.registered, evaluation.of, evaluation.mean_rotation_deg,
      evaluation.max_rotation_deg, evaluation.mean_position_mm, evaluation.max_position_mm,
      evaluation.folded ? "   FOLDED" : "");
}

void Compare(const Scene& scene, const fs::path& work) {
  const Outcome ours = RunRotunda(scene, work);
  const Outcome theirs = RunColmap(scene, work);
  std::printf("\n%s\n  %-16s %22s   %22s   %6s\n", scene.name.c_str(), "stage", "rotunda",
              "colmap 3.8, CPU", "ratio");
  Cost our_total, their_total;
  for (const char* stage : {"features", "matching", "reconstruction"}) {
    const Cost& our = ours.stages.at(stage);
    const Cost& their = theirs.stages.at(stage);
    PrintRow(stage, our, their);
    Add(our_total, our.seconds, our.peak_memory_mb);
    Add(their_total, their.seconds, their.peak_memory_mb);
  }
  PrintRow("total", our_total, their_total);
  PrintAccuracy("rotunda", ours.evaluation);
  PrintAccuracy("colmap", theirs.evaluation);
  std::printf("  error ratio rotunda / colmap: rotation %.3f, position %.3f\n",
              ours.evaluation.mean_rotation_deg / theirs.evaluation.mean_rotation_deg,
              ours.evaluation.mean_position_mm / theirs.evaluation.mean_position_mm);
  std::fflush(stdout);
}

struct Arguments {
  int cameras = 90;
  double scale = 0.5;
  std::string texture = "unique";
  uint64_t seed = 1;
  std::vector<std::string> scenes = {"simulated", "fountain-P11", "Herz-Jesus-P8"};
};

Scene SimulatedScene(const Arguments& arguments, const fs::path& work) {
  Scene scene;
  scene.name = "simulated";
  scene.frameset = work / "simulated";
  RunOrDie({ROTUNDA_COMMAND, "simulate", scene.frameset, "--cameras",
            std::to_string(arguments.cameras), "--scale", std::to_string(arguments.scale),
            "--texture", arguments.texture, "--seed", std::to_string(arguments.seed)});
  scene.pictures = scene.frameset / "frames";
  scene.calibration = scene.frameset / "calibration.json";
  scene.truth = OrDie(ReadCalibration(scene.frameset / "truth.json"));
  return scene;
}

Scene StrechaScene(const std::string& name, const fs::path& shared, const fs::path& work) {
  const fs::path folder = shared / "data" / "strecha" / name;
  Scene scene;
  scene.name = name;
  scene.frameset = folder / "images";
  scene.pictures = scene.frameset;
  scene.truth = test::ReadStrechaTruth(folder);
  scene.calibration = work / (name + ".json");
  OrDie(WriteCalibration(scene.truth, scene.calibration));
  return scene;
}

int Main(int argc, char** argv) {
  Arguments arguments;
  CLI::App app(
      "Time, memory and accuracy of rotunda beside Debian's colmap (CPU, default options, same "
      "pictures, same fixed intrinsics). The simulated set at full size takes colmap hours: see "
      "--scale.",
      "compare_colmap");
  app.add_option("--cameras", arguments.cameras, "Cameras of the simulated set")
      ->capture_default_str();
  app.add_option("--scale", arguments.scale, "Size of its pictures; 1 is 1200x1600")
      ->capture_default_str();
  app.add_option("--texture", arguments.texture, "Garment of its person")->capture_default_str();
  app.add_option("--seed", arguments.seed, "Seed of its world")->capture_default_str();
  app.add_option("--scenes", arguments.scenes,
                 "Which to run: simulated, fountain-P11, Herz-Jesus-P8 (the last two need the "
                 "folder of shared data, $ROTUNDA_SHARED)")
      ->delimiter(',');
  CLI11_PARSE(app, argc, argv);

  const test::TemporaryFolder work;
  for (const std::string& name : arguments.scenes) {
    if (name == "simulated") {
      Compare(SimulatedScene(arguments, work.path()), work.path());
    } else if (const auto shared = test::SharedFolder()) {
      Compare(StrechaScene(name, *shared, work.path()), work.path());
    } else {
      std::printf("\n%s: left out, there is no folder of shared data\n", name.c_str());
    }
  }
  return 0;
}

}  // namespace
}  // namespace rotunda::bench

int main(int argc, char** argv) { return rotunda::bench::Main(argc, argv); }
