// `rotunda compare` as an operator types it.

#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "rig/sim/calibrated_rig.h"
#include "rig/sim/rig_options.h"
#include "tests/support/process.h"

namespace rotunda {
namespace {

namespace fs = std::filesystem;
using test::ProcessOutcome;
using test::RunProcess;
using test::TemporaryFolder;

constexpr int kCameras = 20;
constexpr double kFocalSigma_px = 0.2;

/// Of one rig, with errors of 0.005 deg and 0.15 mm; all of them lenses as they truly are.
Calibration Draw(uint64_t seed) {
  Calibration calibration = sim::DrawCalibration(sim::DrawRig({}, 1, kCameras, 1.0), seed);
  for (CalibratedCamera& camera : calibration.cameras) camera.sigma->focal_px = kFocalSigma_px;
  calibration.id = "drawn-" + std::to_string(seed);
  return calibration;
}

ProcessOutcome Compare(const fs::path& before, const fs::path& after,
                       const std::vector<std::string>& more = {}) {
  std::vector<std::string> command = {ROTUNDA_COMMAND, "compare", before, after};
  command.insert(command.end(), more.begin(), more.end());
  return RunProcess(command);
}

class CompareCommand : public testing::Test {
 protected:
  /// 10 mm up.
  static void Push(CalibratedCamera& camera) {
    camera.cam_from_rig.translation -= camera.cam_from_rig.rotation * Eigen::Vector3d(0, 0, 0.01);
  }
  fs::path Write(const Calibration& calibration) {
    const fs::path file = folder_ / (calibration.id + ".json");
    const Status written = WriteCalibration(calibration, file);
    EXPECT_TRUE(written.ok());
    return file;
  }
  TemporaryFolder folder_;
};

TEST_F(CompareCommand, NamesWhoMovedChangedTheLensCameAndWent) {
  const Calibration before = Draw(1);
  Calibration after = Draw(2);
  const std::string pushed = after.cameras[3].camera, refocused = after.cameras[5].camera;
  const std::string gone = after.cameras.back().camera;
  Push(after.cameras[3]);
  for (const size_t focal : {0, 1}) after.cameras[5].intrinsics.params[focal] *= 1.002;
  after.cameras.back().camera = "z-new";  // the last one by name

  const ProcessOutcome json = Compare(Write(before), Write(after), {"--json"});
  ASSERT_EQ(json.exit_code, 0) << json.errors;
  const nlohmann::json result = nlohmann::json::parse(json.output, nullptr, false);
  ASSERT_TRUE(result.is_object()) << json.output;
  EXPECT_EQ(result["before"], "drawn-1");
  EXPECT_EQ(result["after"], "drawn-2");
  ASSERT_EQ(result["cameras"].size(), kCameras - 1);
  for (const auto& camera : result["cameras"]) {
    EXPECT_EQ(camera["moved"], camera["camera"] == pushed) << camera;
    EXPECT_EQ(camera["lens_changed"], camera["camera"] == refocused) << camera;
    EXPECT_EQ(camera["sigmas"] > result["sigmas_limit"], camera["moved"].get<bool>()) << camera;
    for (const char* sigma : {"sigma_before", "sigma_after"}) {
      EXPECT_EQ(camera[sigma]["position_mm"], 0.15);
      EXPECT_EQ(camera[sigma]["rotation_deg"], 0.005);
      EXPECT_EQ(camera[sigma]["focal_px"], kFocalSigma_px);
    }
    if (camera["camera"] == pushed) {
      EXPECT_NEAR(camera["position_mm"].get<double>(), 10, 1);
    }
    if (camera["camera"] == refocused) {
      EXPECT_NEAR(camera["focal_percent"].get<double>(), 0.2, 1e-9);
    }
  }
  EXPECT_EQ(result["only_before"], std::vector<std::string>{gone});
  EXPECT_EQ(result["only_after"], std::vector<std::string>{"z-new"});
  EXPECT_EQ(result["changes"].size(), 4u) << result["changes"];

  const ProcessOutcome table = Compare(Write(before), Write(after));
  ASSERT_EQ(table.exit_code, 0) << table.errors;
  for (const std::string& told :
       {pushed + " moved by ", refocused + " has another lens",
        gone + " is only in the earlier calibration",
        std::string("z-new is only in the later calibration"), std::string("sigma then, now")}) {
    EXPECT_NE(table.output.find(told), std::string::npos) << told << "\n" << table.output;
  }
}

TEST_F(CompareCommand, SaysThatNothingMoved) {
  const ProcessOutcome table = Compare(Write(Draw(1)), Write(Draw(2)));
  ASSERT_EQ(table.exit_code, 0) << table.errors;
  EXPECT_NE(table.output.find("No camera moved and no lens changed"), std::string::npos)
      << table.output;
}

TEST_F(CompareCommand, RefusesWhatCannotBeCompared) {
  const fs::path before = Write(Draw(1));
  Calibration other = Draw(2);
  other.cameras.resize(2);
  const ProcessOutcome few = Compare(before, Write(other));
  EXPECT_EQ(few.exit_code, 1);
  EXPECT_NE(few.errors.find("drawn-1.json and "), std::string::npos) << few.errors;
  EXPECT_NE(few.errors.find("at least 3"), std::string::npos) << few.errors;
  const ProcessOutcome none = Compare(before, folder_ / "none.json");
  EXPECT_EQ(none.exit_code, 1);
  EXPECT_NE(none.errors.find("none.json"), std::string::npos) << none.errors;
  EXPECT_EQ(RunProcess({ROTUNDA_COMMAND, "compare", before}).exit_code, 2);
}

}  // namespace
}  // namespace rotunda
