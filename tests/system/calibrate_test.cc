// `rotunda calibrate` and `rotunda board` as an operator types them.

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "tests/support/process.h"

namespace rotunda {
namespace {

namespace fs = std::filesystem;
using test::ProcessOutcome;
using test::RunProcess;
using test::TemporaryFolder;

const fs::path kCuboid = fs::path(ROTUNDA_SOURCE_DIR) / "config/cuboid.toml";

std::string TextOf(const fs::path& file) {
  std::ostringstream text;
  text << std::ifstream(file, std::ios::binary).rdbuf();
  return text.str();
}

TEST(BoardDraw, WritesEveryFaceTrueToScaleAndNothingOverAnother) {
  const TemporaryFolder folder;
  for (const std::string format : {"pdf", "svg"}) {
    const fs::path out = folder / format;
    const std::vector<std::string> command = {ROTUNDA_COMMAND, "board", "draw",     kCuboid,
                                              "--out",         out,     "--format", format};
    const ProcessOutcome drawn = RunProcess(command);
    ASSERT_EQ(drawn.exit_code, 0) << drawn.errors;
    std::set<std::string> files;
    for (const auto& entry : fs::directory_iterator(out))
      files.insert(entry.path().filename().string());
    std::set<std::string> faces;
    for (const std::string face : {"front", "left", "back", "right", "top"}) {
      faces.insert(face + "." + format);
    }
    EXPECT_EQ(files, faces);
    EXPECT_EQ(RunProcess(command).exit_code, 1) << "the folder is not empty";
  }
  // 7 squares of 60 mm and 2 margins of 20 mm: 460 mm, 1303.937 points.
  EXPECT_NE(TextOf(folder / "svg" / "front.svg").find("width=\"460.00000mm\""), std::string::npos);
  EXPECT_NE(TextOf(folder / "pdf" / "front.pdf").find("/MediaBox [0 0 1303.937"),
            std::string::npos);
}

nlohmann::json Calibrate(const std::vector<fs::path>& shots, const fs::path& out,
                         const std::vector<std::string>& more) {
  std::vector<std::string> command = {ROTUNDA_COMMAND, "calibrate"};
  command.insert(command.end(), shots.begin(), shots.end());
  command.insert(command.end(), {"--board", kCuboid, "--out", out, "--json"});
  command.insert(command.end(), more.begin(), more.end());
  const ProcessOutcome done = RunProcess(command);
  EXPECT_EQ(done.exit_code, 0) << done.errors;
  return nlohmann::json::parse(done.output, nullptr, false);
}

TEST(CalibrateCommand, CalibratesReportsAndRecalibratesFromOneShot) {
  const TemporaryFolder folder;
  const ProcessOutcome simulated = RunProcess(
      {ROTUNDA_COMMAND, "simulate", folder / "shots", "--target", "cuboid", "--placements", "4",
       "--cameras", "5", "--scale", "0.5", "--seed", "1", "--background", "plain"});
  ASSERT_EQ(simulated.exit_code, 0) << simulated.errors;
  const auto shot = [&](int k) { return folder / "shots" / ("placement_0" + std::to_string(k)); };
  const fs::path whole = folder / "whole.json", page = folder / "page.html";

  auto result = Calibrate({shot(0), shot(1), shot(2)}, whole, {"--report", page.string()});
  ASSERT_TRUE(result.is_object());
  EXPECT_EQ(result["calibrated"], 5);
  EXPECT_EQ(result["shots_used"], 3);
  EXPECT_LT(result["rms_px"].get<double>(), 0.05);
  for (const char* list : {"rejected_markers", "rejected_corners"}) {
    ASSERT_TRUE(result[list].is_array()) << list;
    for (const auto& rejected : result[list]) {
      EXPECT_FALSE(rejected["reason"].get<std::string>().empty());
      int count = 0;
      for (const auto& [camera, some] : rejected["cameras"].items()) count += some.get<int>();
      EXPECT_EQ(rejected["count"], count);
    }
  }
  EXPECT_FALSE(result["rejected_corners"].empty()) << "some always are cut by a picture's edge";
  const std::string html = TextOf(page);
  for (const char* section : {"Layout", "Coverage and residuals over the picture", "Cameras",
                              "Markers not used", "Corners not used", "Target", "Shots"}) {
    EXPECT_NE(html.find("<h2>" + std::string(section) + "</h2>"), std::string::npos) << section;
  }

  auto daily = Calibrate({shot(3)}, folder / "daily.json",
                         {"--fix-intrinsics-from", whole.string(), "--compare", whole.string()});
  ASSERT_TRUE(daily.is_object());
  EXPECT_EQ(daily["calibrated"], 5);
  EXPECT_EQ(daily["rig_frame"], "the earlier calibration's");
  EXPECT_TRUE(daily["changes"].empty()) << daily["changes"];
  Calibrate({shot(3)}, folder / "again.json",
            {"--fix-intrinsics-from", whole.string(), "--threads", "1"});
  EXPECT_EQ(TextOf(folder / "again.json"), TextOf(folder / "daily.json"));

  const ProcessOutcome compared =
      RunProcess({ROTUNDA_COMMAND, "compare", whole, folder / "daily.json", "--json"});
  ASSERT_EQ(compared.exit_code, 0) << compared.errors;
  const auto changes = nlohmann::json::parse(compared.output, nullptr, false);
  EXPECT_EQ(changes["cameras"].size(), 5u);
  for (const auto& camera : changes["cameras"]) EXPECT_EQ(camera["lens_sigmas"], 0.0) << "kept";
  EXPECT_EQ(changes["changes"], daily["changes"]);
}

TEST(CalibrateCommand, AModelForLensesThatAreKeptIsWrongUsage) {
  const ProcessOutcome refused =
      RunProcess({ROTUNDA_COMMAND, "calibrate", "shots", "--board", kCuboid, "--out", "c.json",
                  "--fix-intrinsics-from", kCuboid, "--model", "opencv5"});
  EXPECT_EQ(refused.exit_code, 2) << refused.output;
}

}  // namespace
}  // namespace rotunda
