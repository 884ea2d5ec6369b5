// `rotunda calibrate` and `rotunda board` as an operator types them.

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <vector>

#include "tests/support/process.h"

namespace rotunda {
namespace {

namespace fs = std::filesystem;
using test::ProcessOutcome;
using test::RunProcess;
using test::TemporaryFolder;
using test::TextOf;

const fs::path kCuboid = fs::path(ROTUNDA_SOURCE_DIR) / "config/cuboid.toml";

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
  EXPECT_EQ(result["rig_frame"], "the target in simulated-1-placement-0");
  EXPECT_GT(result["uncertainty"]["mean_position_mm"], 0.0);
  EXPECT_GE(result["uncertainty"]["max_rotation_deg"], result["uncertainty"]["mean_rotation_deg"]);
  EXPECT_GT(result["uncertainty"]["mean_focal_percent"], 0.0);
  ASSERT_EQ(result["cameras"].size(), 5u);
  for (const auto& camera : result["cameras"]) {
    EXPECT_GT(camera["position_mm"], 0.0);
    EXPECT_LE(camera["kept"], camera["corners"]);
  }
  EXPECT_FALSE(result.contains("comparison"));
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
  EXPECT_EQ(daily["comparison"]["same_rig"], true);
  EXPECT_EQ(daily["comparison"]["cameras"].size(), 5u);
  EXPECT_TRUE(daily.contains("half_split_position_ratio"));
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
  EXPECT_EQ(changes["before_file"], whole.string());
  EXPECT_NE(changes["before"], changes["after"]) << "their shots are of different times";

  const fs::path rows = folder / "rows.toml", squares = folder / "squares.toml";
  std::ofstream(rows) << "[cuboid]\nrows = 23\n";
  std::ofstream(squares) << "[board]\nsquare_mm = 61\n";
  for (const std::string option : {"--fix-intrinsics-from", "--compare"}) {
    const ProcessOutcome other = RunProcess({ROTUNDA_COMMAND, "calibrate", shot(3), "--board", rows,
                                             "--out", folder / "other.json", option, whole});
    EXPECT_EQ(other.exit_code, 1);
    EXPECT_NE(other.errors.find(rows.string() + ": rows of face 'front': is 23, but " +
                                whole.string() + " was made with 25"),
              std::string::npos)
        << other.errors;
    EXPECT_FALSE(fs::exists(folder / "other.json"));
  }

  // Without an earlier calibration only the pictures can tell: rows do, another scale does not.
  const auto calibrate_with = [&](const fs::path& board, const fs::path& out) {
    return RunProcess({ROTUNDA_COMMAND, "calibrate", shot(0), shot(1), shot(2), "--board", board,
                       "--out", out, "--report", folder / "wrong.html"});
  };
  const ProcessOutcome wrong = calibrate_with(rows, folder / "wrong.json");
  EXPECT_EQ(wrong.exit_code, 1);
  EXPECT_NE(wrong.errors.find(rows.string() + ": is probably not this target's"), std::string::npos)
      << wrong.errors;
  EXPECT_FALSE(fs::exists(folder / "wrong.json") || fs::exists(folder / "wrong.html"));

  // An earlier calibration that does not say what was printed still says where the faces stand.
  auto old = nlohmann::json::parse(TextOf(whole));
  for (auto& face : old["board"]["faces"]) face.erase("print");
  std::ofstream(folder / "old.json") << old;
  const ProcessOutcome doubted = RunProcess(
      {ROTUNDA_COMMAND, "calibrate", shot(3), "--board", squares, "--out", folder / "doubted.json",
       "--report", folder / "doubted.html", "--fix-intrinsics-from", folder / "old.json"});
  ASSERT_EQ(doubted.exit_code, 0) << doubted.errors;
  EXPECT_EQ(doubted.output.find("note: "),
            doubted.output.find("note: " + squares.string() + " is probably not this target's"))
      << doubted.output;
  EXPECT_NE(TextOf(folder / "doubted.html").find("is probably not this target"), std::string::npos);

  // No room for the page: the calibration is not lost, and where it is is told.
  const fs::path disk = folder / "disk";
  fs::create_directory(disk);
  const auto on_small_disk = [&](const std::string& command) {
    return RunProcess({"unshare", "--user", "--map-root-user", "--mount", "sh", "-c",
                       "mount -t tmpfs -o size=16k tmpfs " + disk.string() + " && " + command});
  };
  if (on_small_disk("true").exit_code == 0) {
    const ProcessOutcome full = on_small_disk(
        std::string(ROTUNDA_COMMAND) + " calibrate " + shot(3).string() + " --board " +
        kCuboid.string() + " --out " + (folder / "kept.json").string() + " --report " +
        (disk / "page.html").string() + " --fix-intrinsics-from " + whole.string());
    EXPECT_EQ(full.exit_code, 1);
    EXPECT_NE(full.errors.find("No space left on device; the calibration itself is whole in " +
                               (folder / "kept.json").string()),
              std::string::npos)
        << full.errors;
    EXPECT_EQ(TextOf(folder / "kept.json"), TextOf(folder / "daily.json"));
  }

  ASSERT_EQ(calibrate_with(squares, folder / "larger.json").exit_code, 0);
  const ProcessOutcome larger =
      RunProcess({ROTUNDA_COMMAND, "compare", whole, folder / "larger.json"});
  EXPECT_NE(larger.output.find("square_mm of face 'front': 60 before, 61 after"), std::string::npos)
      << larger.output;
  EXPECT_EQ(larger.output.find("counted in"), std::string::npos) << larger.output;
}

TEST(CalibrateCommand, WhatCannotBeWrittenIsRefusedBeforeTheWork) {
  const TemporaryFolder folder;
  const auto errors = [&](const fs::path& out, const fs::path& report) {
    const ProcessOutcome refused =
        RunProcess({ROTUNDA_COMMAND, "calibrate", folder / "no shots", "--board", kCuboid, "--out",
                    out, "--report", report});
    EXPECT_EQ(refused.exit_code, 1) << refused.output;
    return refused.errors;
  };
  EXPECT_NE(errors(folder.path(), folder / "page.html")
                .find("--out: " + folder.path().string() + ": is a folder"),
            std::string::npos);
  EXPECT_NE(errors(folder / "c.json", folder / "none" / "page.html").find("make it first"),
            std::string::npos);
  for (const auto& [out, report] :
       {std::pair<fs::path, fs::path>(folder / "x", folder / "x"), {"x.json", "./x.json"}}) {
    const std::string twice = errors(out, report);
    EXPECT_NE(twice.find("is also what --out names"), std::string::npos) << twice;
  }
  const std::string board = errors(kCuboid, folder / "page.html");
  EXPECT_NE(board.find("--out: " + kCuboid.string() + ": is also what --board names"),
            std::string::npos)
      << board;
  EXPECT_TRUE(fs::is_empty(folder.path()));
}

TEST(CalibrateCommand, EarlierCalibrationsAreNotWrittenOver) {
  const TemporaryFolder folder;
  for (const char* file : {"c.json", "d.json"}) std::ofstream(folder / file) << "{}";
  for (const std::string option : {"--fix-intrinsics-from", "--frame-from", "--compare"}) {
    for (const std::string output : {"--out", "--report"}) {
      const fs::path other = folder / (output == "--out" ? "page.html" : "new.json");
      const ProcessOutcome refused =
          RunProcess({ROTUNDA_COMMAND, "calibrate", folder / "no shots", "--board", kCuboid, option,
                      folder / "c.json", output, folder / "." / "c.json",
                      output == "--out" ? "--report" : "--out", other});
      EXPECT_EQ(refused.exit_code, 1) << refused.output;
      EXPECT_NE(refused.errors.find("is also what " + option + " names, which would be lost"),
                std::string::npos)
          << refused.errors;
    }
  }
  EXPECT_EQ(TextOf(folder / "c.json"), "{}");
}

TEST(CalibrateCommand, PicturesTooSmallToBeReadSayHowLargeTheyMustBe) {
  const TemporaryFolder folder;
  const ProcessOutcome simulated = RunProcess(
      {ROTUNDA_COMMAND, "simulate", folder / "shots", "--target", "cuboid", "--placements", "2",
       "--cameras", "4", "--scale", "0.15", "--seed", "1", "--background", "plain"});
  ASSERT_EQ(simulated.exit_code, 0) << simulated.errors;
  const ProcessOutcome refused = RunProcess({ROTUNDA_COMMAND, "calibrate", folder / "shots",
                                             "--board", kCuboid, "--out", folder / "c.json"});
  EXPECT_EQ(refused.exit_code, 1) << refused.output;
  EXPECT_NE(refused.errors.find("small: its markers are about "), std::string::npos)
      << refused.errors;
  EXPECT_NE(refused.errors.find("they must be 16 px; bring the target nearer"), std::string::npos)
      << refused.errors;
}

TEST(CalibrateCommand, AModelForLensesThatAreKeptIsWrongUsage) {
  const ProcessOutcome refused =
      RunProcess({ROTUNDA_COMMAND, "calibrate", "shots", "--board", kCuboid, "--out", "c.json",
                  "--fix-intrinsics-from", kCuboid, "--model", "opencv5"});
  EXPECT_EQ(refused.exit_code, 2) << refused.output;
}

}  // namespace
}  // namespace rotunda
