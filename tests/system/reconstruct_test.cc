// The real command from simulated pictures to poses, and on real photographs when they are at hand.

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <regex>
#include <string>
#include <vector>

#include "sfm/colmap_io.h"
#include "sfm/core/calibration.h"
#include "sfm/core/evaluate.h"
#include "sfm/core/file_io.h"
#include "sfm/core/frame_set.h"
#include "sfm/stage_io.h"
#include "tests/support/colmap_database_writer.h"
#include "tests/support/process.h"
#include "tests/support/rotunda_command.h"
#include "tests/support/strecha.h"

namespace rotunda {
namespace {

namespace fs = std::filesystem;
using test::ProcessOutcome;
using test::RunProcess;
using test::RunRotunda;
using test::TemporaryFolder;

std::string Bytes(const fs::path& file) {
  const Result<std::string> bytes = ReadFile(file);
  return bytes.ok() ? *bytes : "cannot read " + file.string();
}

nlohmann::json Evaluate(const fs::path& measured, const fs::path& truth) {
  const ProcessOutcome outcome = RunRotunda({"evaluate", measured, "--truth", truth, "--json"});
  EXPECT_EQ(outcome.exit_code, 0) << outcome.errors;
  return nlohmann::json::parse(outcome.output);
}

/// The keypoints and matches that a reconstruction kept, as COLMAP would have written them.
void WriteAsColmapDatabase(const fs::path& stages, const FrameSet& set, const fs::path& database) {
  const auto features = sfm::ReadFeatures(stages / "features.bin");
  ASSERT_TRUE(features.ok()) << features.error().ToString();
  const auto matches = sfm::ReadMatches(stages / "matches.bin", *features);
  ASSERT_TRUE(matches.ok()) << matches.error().ToString();
  test::ColmapDatabaseWriter writer(database);
  for (size_t i = 0; i < set.frames.size(); ++i) {
    const sfm::ImageFeatures& image = features->images[i];
    const std::string id = std::to_string(i + 1);
    writer.Run("INSERT INTO cameras VALUES (" + id + ", 4, " + std::to_string(image.width_px) +
               ", " + std::to_string(image.height_px) +
               ", x'00', 0); INSERT INTO images (image_id, name, camera_id) VALUES (" + id + ", '" +
               fs::path(set.frames[i].file).filename().string() + "', " + id + ")");
    std::vector<float> keypoints;
    for (const sfm::Keypoint& point : image.keypoints) {
      keypoints.insert(keypoints.end(),
                       {point.x_px, point.y_px, point.scale_px, point.orientation_rad});
    }
    writer.Put("keypoints", static_cast<int64_t>(i + 1), image.keypoints.size(), 4, keypoints);
  }
  for (const sfm::PairMatches& pair : matches->pairs) {
    std::vector<uint32_t> rows;
    for (const sfm::Match& match : pair.matches) {
      rows.push_back(static_cast<uint32_t>(match.first.index()));
      rows.push_back(static_cast<uint32_t>(match.second.index()));
    }
    writer.Put("matches",
               test::ColmapPairId(pair.pair.first.index() + 1, pair.pair.second.index() + 1),
               pair.matches.size(), 2, rows);
  }
}

/// Of the capture below: measured 0.054 deg and 1.55 mm, and 0.9 to 1.2 times the predicted sigmas.
constexpr double kMaxMeanRotation_deg = 0.08;
constexpr double kMaxMeanPosition_mm = 2.3;
constexpr double kMaxErrorOverSigma = 1.5;

bool HasColmap() { return RunProcess({"colmap", "help"}).exit_code == 0; }

/// A capture of 30 cameras at 600x800 and its reconstruction, made once.
class SimulatedCapture : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder();
    const ProcessOutcome simulated = RunRotunda(
        {"simulate", *folder_ / "set", "--cameras", "30", "--scale", "0.5", "--seed", "5"});
    ASSERT_EQ(simulated.exit_code, 0) << simulated.errors;
    Reconstruct("out", {"--threads", "2", "--stages", *folder_ / "stages"});
  }
  static void TearDownTestSuite() {
    delete folder_;
    folder_ = nullptr;
  }
  static void Reconstruct(const std::string& out, const std::vector<std::string>& more) {
    std::vector<std::string> arguments = {"reconstruct", *folder_ / "set", "--out", *folder_ / out};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const ProcessOutcome outcome = RunRotunda(arguments);
    ASSERT_EQ(outcome.exit_code, 0) << outcome.errors;
    EXPECT_EQ(outcome.errors, "") << "quiet when piped";
  }
  static TemporaryFolder* folder_;
};
TemporaryFolder* SimulatedCapture::folder_ = nullptr;

TEST_F(SimulatedCapture, AllPosesAreRight) {
  const nlohmann::json errors =
      Evaluate(*folder_ / "out" / "poses.json", *folder_ / "set" / "truth.json");
  EXPECT_EQ(errors["registered"], 30);
  EXPECT_EQ(errors["of"], 30);
  EXPECT_EQ(errors["folded"], false);
  EXPECT_LT(errors["mean_rotation_deg"], kMaxMeanRotation_deg);
  EXPECT_LT(errors["mean_position_mm"], kMaxMeanPosition_mm);
  EXPECT_LT(errors["rotation_error_over_sigma"], kMaxErrorOverSigma);
  EXPECT_LT(errors["position_error_over_sigma"], kMaxErrorOverSigma);
}

TEST_F(SimulatedCapture, SameBytesOnAnyNumberOfThreadsTwice) {
  for (const char* threads : {"1", "2"}) {
    const std::string out = std::string("threads-") + threads;
    Reconstruct(out, {"--threads", threads});
    for (const char* file : {"poses.json", "points.ply", "report.html", "sparse/0/points3D.bin"}) {
      EXPECT_TRUE(Bytes(*folder_ / out / file) == Bytes(*folder_ / "out" / file)) << file;
    }
  }
}

TEST_F(SimulatedCapture, StartingFromAnyStageGivesTheSamePoses) {
  const std::string expected = Bytes(*folder_ / "out" / "poses.json");
  for (const char* stage : {"features", "matches", "two-views"}) {
    const std::string out = std::string("from-") + stage;
    Reconstruct(out, {"--stages", *folder_ / "stages", "--start-from", stage});
    EXPECT_TRUE(Bytes(*folder_ / out / "poses.json") == expected) << stage;
  }
}

TEST_F(SimulatedCapture, ThePlainMethodStartsFromTracksTooAndGivesNoVerdict) {
  const fs::path stages = *folder_ / "plain-stages";
  fs::copy(*folder_ / "stages", stages);
  Reconstruct("plain", {"--method", "plain", "--stages", stages, "--start-from", "two-views"});
  Reconstruct("plain-from-tracks",
              {"--method", "plain", "--stages", stages, "--start-from", "tracks"});
  EXPECT_TRUE(Bytes(*folder_ / "plain-from-tracks" / "poses.json") ==
              Bytes(*folder_ / "plain" / "poses.json"));
  const nlohmann::json errors =
      Evaluate(*folder_ / "plain" / "poses.json", *folder_ / "set" / "truth.json");
  EXPECT_EQ(errors["registered"], 30);
  EXPECT_EQ(errors["folded"], false) << "another print on the back";

  const nlohmann::json plain = nlohmann::json::parse(Bytes(*folder_ / "plain" / "poses.json"));
  const nlohmann::json tc_sfm = nlohmann::json::parse(Bytes(*folder_ / "out" / "poses.json"));
  EXPECT_EQ(plain["method"], "plain");
  EXPECT_FALSE(plain["summary"].contains("verdict"));
  EXPECT_EQ(tc_sfm["method"], "tc-sfm");
  EXPECT_EQ(tc_sfm["summary"]["verdict"], "sure");
  EXPECT_EQ(tc_sfm["options"]["preset"], "rig");
}

/// The cameras of a result that stand in another's place, with that.
std::map<std::string, std::string> SwappedCameras(const fs::path& poses_file) {
  std::map<std::string, std::string> swapped;
  const nlohmann::json poses = nlohmann::json::parse(Bytes(poses_file));
  for (const nlohmann::json& camera : poses["cameras"]) {
    if (!camera.contains("vs_calibration")) continue;
    const nlohmann::json& versus = camera["vs_calibration"];
    EXPECT_FALSE(versus["moved"]) << camera["camera"];
    if (versus.contains("swapped_with")) swapped[camera["camera"]] = versus["swapped_with"];
  }
  return swapped;
}

TEST_F(SimulatedCapture, TellsSwappedCamerasFromMovedOnes) {
  nlohmann::json calibration = nlohmann::json::parse(Bytes(*folder_ / "set" / "calibration.json"));
  nlohmann::json& cameras = calibration["cameras"];
  std::swap(cameras[6]["camera"], cameras[19]["camera"]);
  const fs::path file = *folder_ / "swapped.json";
  ASSERT_TRUE(WriteFileAtomically(file, calibration.dump()).ok());
  Reconstruct("swapped",
              {"--calibration", file, "--stages", *folder_ / "stages", "--start-from", "matches"});
  const std::string a = cameras[6]["camera"], b = cameras[19]["camera"];
  EXPECT_EQ(SwappedCameras(*folder_ / "swapped" / "poses.json"),
            (std::map<std::string, std::string>{{a, b}, {b, a}}));
  const nlohmann::json summary =
      nlohmann::json::parse(Bytes(*folder_ / "swapped" / "poses.json"))["summary"];
  EXPECT_EQ(summary["folded"], false);
}

TEST_F(SimulatedCapture, WithoutACalibrationTheFrontIsNamed) {
  const fs::path set = *folder_ / "uncalibrated";
  fs::copy(*folder_ / "set", set, fs::copy_options::recursive);
  fs::remove(set / "calibration.json");
  const ProcessOutcome outcome =
      RunRotunda({"reconstruct", set, "--out", *folder_ / "sides", "--stages", *folder_ / "stages",
                  "--start-from", "two-views", "--front", "c00r0"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.errors;
  const auto sides_in = [](const fs::path& poses_file) {
    std::map<std::string, std::string> sides;
    const nlohmann::json poses = nlohmann::json::parse(Bytes(poses_file));
    for (const nlohmann::json& camera : poses["cameras"]) {
      sides[camera["camera"]] = camera.value("side", "");
      EXPECT_EQ(camera["evidence"]["doubtful"], false);
    }
    return sides;
  };
  // Column 0 of the rig stands at azimuth 0, where its calibration has the front.
  EXPECT_EQ(sides_in(*folder_ / "sides" / "poses.json"), sides_in(*folder_ / "out" / "poses.json"));
  const auto poses = nlohmann::json::parse(Bytes(*folder_ / "sides" / "poses.json"));
  EXPECT_EQ(poses["options"]["front"], "c00r0");
}

TEST_F(SimulatedCapture, NeighbourPairsGiveAllPosesToo) {
  Reconstruct("neighbours", {"--pairs", "neighbours"});
  const nlohmann::json errors =
      Evaluate(*folder_ / "neighbours" / "poses.json", *folder_ / "set" / "truth.json");
  EXPECT_EQ(errors["registered"], 30);
  EXPECT_LT(errors["mean_rotation_deg"], kMaxMeanRotation_deg);
  EXPECT_LT(errors["mean_position_mm"], kMaxMeanPosition_mm);
}

/// "Mean reprojection error: 0.41px" and such in the text of `colmap model_analyzer`.
double FigureAfter(const std::string& text, const std::string& name) {
  std::smatch found;
  if (!std::regex_search(text, found, std::regex(name + ": *([0-9.]+)"))) return -1;
  return std::stod(found[1]);
}

TEST_F(SimulatedCapture, ColmapReadsTheModelAndAgrees) {
  if (!HasColmap()) GTEST_SKIP() << "colmap is not installed";
  const nlohmann::json summary =
      nlohmann::json::parse(Bytes(*folder_ / "out" / "poses.json"))["summary"];
  const ProcessOutcome analyzer =
      RunProcess({"colmap", "model_analyzer", "--path", *folder_ / "out" / "sparse" / "0"});
  ASSERT_EQ(analyzer.exit_code, 0) << analyzer.errors;
  const std::string text = analyzer.output + analyzer.errors;
  EXPECT_EQ(FigureAfter(text, "Registered images"), summary["registered"]) << text;
  EXPECT_EQ(FigureAfter(text, "Points"), summary["points"]) << text;
  EXPECT_NEAR(FigureAfter(text, "Mean reprojection error"), summary["mean_reprojection_px"], 1e-5);

  fs::create_directory(*folder_ / "converted");
  const ProcessOutcome converter =
      RunProcess({"colmap", "model_converter", "--input_path", *folder_ / "out" / "sparse" / "0",
                  "--output_path", *folder_ / "converted", "--output_type", "TXT"});
  ASSERT_EQ(converter.exit_code, 0) << converter.errors;
  const auto converted = sfm::ReadColmapModel(*folder_ / "converted");
  ASSERT_TRUE(converted.ok()) << converted.error().ToString();
  EXPECT_EQ(sfm::RegisteredCount(converted->reconstruction), summary["registered"]);
  EXPECT_EQ(converted->reconstruction.points.size(), summary["points"]);
  EXPECT_NEAR(sfm::SummarizeReprojection(converted->reconstruction, converted->features)
                  .mean_over_points_px,
              summary["mean_reprojection_px"], 1e-4);
}

TEST_F(SimulatedCapture, ExportsAreReadable) {
  for (const char* format :
       {"colmap", "colmap-text", "nerfstudio", "metashape", "realitycapture", "ply"}) {
    const fs::path out = *folder_ / (std::string("export-") + format);
    const ProcessOutcome outcome =
        RunRotunda({"export", *folder_ / "out", "--format", format, "--out", out, "--json"});
    ASSERT_EQ(outcome.exit_code, 0) << outcome.errors;
    EXPECT_EQ(nlohmann::json::parse(outcome.output)["images"], 30);
  }
  const auto exported = sfm::ReadColmapModel(*folder_ / "export-colmap");
  const auto original = sfm::ReadColmapModel(*folder_ / "out" / "sparse" / "0");
  ASSERT_TRUE(exported.ok() && original.ok());
  EXPECT_EQ(exported->image_names, original->image_names);
  for (size_t i = 0; i < 30; ++i) {
    EXPECT_LT((exported->reconstruction.cam_from_model[i]->Matrix() -
               original->reconstruction.cam_from_model[i]->Matrix())
                  .norm(),
              1e-12);
  }
  EXPECT_TRUE(Bytes(*folder_ / "export-ply" / "points.ply") ==
              Bytes(*folder_ / "out" / "points.ply"));
  for (const std::string& name : original->image_names) {
    const std::string stem = fs::path(name).stem();
    EXPECT_TRUE(fs::exists(*folder_ / "export-realitycapture" / (stem + ".xmp"))) << stem;
    EXPECT_NE(Bytes(*folder_ / "export-metashape" / "cameras.xml").find("\"" + stem + "\""),
              std::string::npos);
    EXPECT_NE(Bytes(*folder_ / "export-nerfstudio" / "transforms.json").find("images/" + name),
              std::string::npos);
  }
}

TEST_F(SimulatedCapture, ExportWarnsOfPosesThatAreNotSure) {
  const fs::path model = *folder_ / "doubtful";
  fs::copy(*folder_ / "out", model, fs::copy_options::recursive);
  nlohmann::ordered_json poses = nlohmann::ordered_json::parse(Bytes(model / "poses.json"));
  for (const std::string verdict : {"sure", "unsure", "folded"}) {
    poses["summary"]["verdict"] = verdict;
    std::ofstream(model / "poses.json") << poses;
    const ProcessOutcome outcome =
        RunRotunda({"export", model, "--format", "ply", "--out", *folder_ / ("ply-" + verdict)});
    EXPECT_EQ(outcome.exit_code, 0) << outcome.errors;
    EXPECT_EQ(outcome.errors.find("warning") != std::string::npos, verdict != "sure") << verdict;
  }
}

TEST_F(SimulatedCapture, TheSameMatchesFromAColmapDatabaseGiveTheSamePoses) {
  const auto set = ReadFrameSet(*folder_ / "set");
  ASSERT_TRUE(set.ok()) << set.error().ToString();
  const fs::path database = *folder_ / "database.db";
  WriteAsColmapDatabase(*folder_ / "stages", *set, database);
  Reconstruct("from-database", {"--database", database});
  const auto poses = [](const std::string& out) {
    return nlohmann::json::parse(Bytes(*folder_ / out / "poses.json"));
  };
  EXPECT_EQ(poses("from-database")["cameras"], poses("out")["cameras"]);
  EXPECT_EQ(poses("from-database")["options"]["pairs"], "database");
}

class RealPhotographs : public testing::TestWithParam<std::string> {
 protected:
  void SetUp() override {
    const auto shared = test::SharedFolder();
    if (!shared) GTEST_SKIP() << "the folder of shared data is not there";
    scene_ = *shared / "data" / "strecha" / GetParam();
    truth_ = test::ReadStrechaTruth(scene_);
    ASSERT_TRUE(WriteCalibration(truth_, folder_ / "truth.json").ok());
  }
  fs::path scene_;
  Calibration truth_;
  TemporaryFolder folder_;
};

TEST_P(RealPhotographs, KnownIntrinsics) {
  const ProcessOutcome outcome =
      RunRotunda({"reconstruct", scene_ / "images", "--calibration", folder_ / "truth.json",
                  "--fix-intrinsics", "--out", folder_ / "out"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.errors;
  const nlohmann::json errors = Evaluate(folder_ / "out" / "poses.json", folder_ / "truth.json");
  EXPECT_EQ(errors["registered"], truth_.cameras.size());
  // The truth is a laser scan's, good to some millimetres. Against that of Herz-Jesus-P8 all
  // cameras of any pipeline are turned by the same 0.1 deg.
  EXPECT_LT(errors["mean_position_mm"], 5.0);
  EXPECT_LT(errors["mean_rotation_deg"], GetParam() == "fountain-P11" ? 0.05 : 0.15);
}

TEST_P(RealPhotographs, PlainFolderWithoutCalibration) {
  const ProcessOutcome outcome =
      RunRotunda({"reconstruct", scene_ / "images", "--out", folder_ / "out"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.errors;
  const nlohmann::json errors = Evaluate(folder_ / "out" / "poses.json", folder_ / "truth.json");
  EXPECT_EQ(errors["registered"], truth_.cameras.size());
  // Focal length and distortion are estimated along, the principal point is not: measured 7.8 mm
  // and 0.39 deg (fountain), 12.9 mm and 0.41 deg (Herz-Jesus).
  EXPECT_LT(errors["mean_position_mm"], 20.0);
  EXPECT_LT(errors["mean_rotation_deg"], 0.6);
}

INSTANTIATE_TEST_SUITE_P(Strecha, RealPhotographs, testing::Values("fountain-P11", "Herz-Jesus-P8"),
                         [](const auto& info) {
                           return info.param == "fountain-P11" ? "fountain" : "herzjesus";
                         });

}  // namespace
}  // namespace rotunda
