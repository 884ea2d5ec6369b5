#include "config/daemon_config.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "tests/support/process.h"

namespace rotunda::config {
namespace {

namespace fs = std::filesystem;

fs::path Shipped() { return fs::path(ROTUNDA_SOURCE_DIR) / "config" / "rotundad.toml"; }

std::vector<std::string> Texts(const std::vector<Error>& problems) {
  std::vector<std::string> texts;
  for (const Error& problem : problems) texts.push_back(problem.ToString());
  return texts;
}

TEST(DaemonConfig, TheShippedFileHasNothingWrongAndTheDefaultValues) {
  const CheckedDaemonConfig shipped = CheckDaemonConfig(Shipped());
  EXPECT_EQ(Texts(shipped.problems), std::vector<std::string>());
  EXPECT_EQ(shipped.config.capture.cameras.size(), 90u);
  EXPECT_EQ(shipped.config.devices.capture, (Shipped().parent_path() / "capture.toml").string());
  DaemonConfig defaults;
  defaults.devices.capture = shipped.config.devices.capture;
  defaults.devices.board = shipped.config.devices.board;
  defaults.capture_text = shipped.config.capture_text;
  EXPECT_EQ(NeedsRestart(defaults, shipped.config), std::vector<std::string>());
  EXPECT_EQ(shipped.config.access.operator_group, defaults.access.operator_group);
  EXPECT_EQ(shipped.config.storage.keep_days, defaults.storage.keep_days);
  EXPECT_EQ(shipped.config.service.log_level, defaults.service.log_level);
}

TEST(DaemonConfig, EverythingThatIsWrongIsNamedWithItsLine) {
  const CheckedDaemonConfig checked = CheckDaemonConfigText(
      "[service]\n"
      "socket = 5\n"
      "log_level = \"loud\"\n"
      "[http]\n"
      "streams = 200\n"
      "threads = 0\n"
      "colour = 1\n"
      "[storage]\n"
      "keep_days = -1\n"
      "[food]\n",
      "x.toml");
  EXPECT_EQ(Texts(checked.problems),
            (std::vector<std::string>{
                "x.toml:2: service.socket: is an integer, expected a string",
                "x.toml:7: http.colour: is not known; allowed are header_bytes, body_bytes, "
                "connections, streams, request_ms, write_ms, heartbeat_ms, threads",
                "x.toml:10: food: is not known; allowed are the tables service, access, http, "
                "devices, storage, drift, jobs",
                "x.toml:6: http.threads: is 0, expected 3 to 64",
                "x.toml:9: storage.keep_days: is -1, expected 0 to 36500",
                "x.toml:5: http.streams: is 200, expected less than http.connections, which is 128",
                "x.toml:3: service.log_level: is \"loud\", expected \"debug\", \"info\", "
                "\"warning\" or \"error\""}));
}

TEST(DaemonConfig, TheEndComesAfterTheLastAnswerAndBeforeSystemdKills) {
  EXPECT_EQ(
      Texts(CheckDaemonConfigText("[service]\nstop_ms = 2000\nend_ms = 2000\n", "x").problems),
      (std::vector<std::string>{"x:3: service.end_ms: is 2000, expected more than "
                                "service.stop_ms, which is 2000"}));
  EXPECT_EQ(Texts(CheckDaemonConfigText("[service]\nend_ms = 60000\n", "x").problems),
            (std::vector<std::string>{"x:2: service.end_ms: is 60000, expected 1000 to 55000"}));
  std::ifstream unit(fs::path(ROTUNDA_SOURCE_DIR) / "systemd" / "rotunda.service.in");
  const std::string text(std::istreambuf_iterator<char>(unit), {});
  EXPECT_NE(text.find("\nTimeoutStopSec=60s\n"), std::string::npos);
}

TEST(DaemonConfig, PathsAreAbsoluteOrBesideTheFile) {
  for (const char* text : {"[service]\nsocket = \"x.sock\"\n", "[service]\nstate_folder = \"\"\n",
                           "[devices]\nsimulated_socket = \"x\"\n"}) {
    const auto problems = Texts(CheckDaemonConfigText(text, "x").problems);
    ASSERT_EQ(problems.size(), 1u) << text;
    EXPECT_NE(problems[0].find("expected an absolute path"), std::string::npos) << problems[0];
  }
}

/// A file beside those that it names, of one key that says where something is.
class DaemonConfigPlaces : public testing::Test {
 protected:
  static constexpr char kFolder[] = ", expected a folder that is there or can be made";
  static constexpr char kSocket[] = ", expected a socket or a name that is free";

  DaemonConfigPlaces() {
    for (const char* name : {"capture.toml", "cuboid.toml"}) {
      fs::copy_file(Shipped().parent_path() / name, folder_ / name);
    }
  }
  std::string File() const { return folder_ / "d.toml"; }
  std::vector<std::string> ProblemsOf(const std::string& table, const std::string& key,
                                      const std::string& path) const {
    std::ofstream(File()) << "[" << table << "]\n" << key << " = \"" << path << "\"\n";
    return Texts(CheckDaemonConfig(File()).problems);
  }
  /// What the key is told to be, when it is `path` and `why` says what is wrong.
  std::vector<std::string> Told(const std::string& key, const std::string& path,
                                const std::string& why) const {
    return {File() + ":2: " + key + ": is \"" + path + "\", " + why};
  }

  const test::TemporaryFolder folder_;
};

TEST_F(DaemonConfigPlaces, AreRefusedWhenSomethingElseIsThere) {
  const std::string file = File(), here = folder_.path();
  const std::string no_folder = std::string(" is there and no folder") + kFolder;
  const std::string blocked = "but \"" + file + "\"" + no_folder;
  const std::vector<std::string> nothing;
  EXPECT_EQ(ProblemsOf("service", "state_folder", file),
            Told("service.state_folder", file, "which" + no_folder));
  EXPECT_EQ(ProblemsOf("service", "state_folder", file + "/a/b"),
            Told("service.state_folder", file + "/a/b", blocked));
  EXPECT_EQ(ProblemsOf("service", "state_folder", here), nothing);
  EXPECT_EQ(ProblemsOf("service", "state_folder", here + "/to/be/made"), nothing);
  for (const auto& [table, key] : {std::pair<std::string, std::string>("service", "socket"),
                                   {"devices", "simulated_socket"}}) {
    const std::string name = table + "." + key;
    EXPECT_EQ(ProblemsOf(table, key, here),
              Told(name, here, std::string("which is there and no socket") + kSocket));
    EXPECT_EQ(ProblemsOf(table, key, file + "/s"), Told(name, file + "/s", blocked));
    EXPECT_EQ(ProblemsOf(table, key, here + "/gone/s"), nothing);
  }
}

TEST_F(DaemonConfigPlaces, LinksThatLeadNowhereAreInTheWayOfTheStateFolder) {
  fs::create_symlink("gone", folder_ / "dangling");
  fs::create_symlink("loop", folder_ / "loop");
  fs::create_symlink(folder_ / "d.toml", folder_ / "file");
  fs::create_symlink(folder_.path(), folder_ / "fine");
  for (const auto& [name, why] :
       {std::pair<std::string, std::string>("dangling", "\"gone\" (No such file or directory)"),
        {"loop", "\"loop\" (Too many levels of symbolic links)"},
        {"file", "\"" + File() + "\" and no folder"}}) {
    const std::string link = folder_ / name;
    const std::string found = " is a link to " + why + kFolder;
    EXPECT_EQ(ProblemsOf("service", "state_folder", link),
              Told("service.state_folder", link, "which" + found));
    EXPECT_EQ(ProblemsOf("service", "state_folder", link + "/a/b"),
              Told("service.state_folder", link + "/a/b", "but \"" + link + "\"" + found));
  }
  for (const char* name : {"fine", "fine/to/be/made"}) {
    EXPECT_EQ(ProblemsOf("service", "state_folder", folder_ / name), std::vector<std::string>());
  }
}

/// A client follows a link to the simulator's socket; the daemon binds none.
TEST_F(DaemonConfigPlaces, ALinkIsNoSocketForTheDaemonToMake) {
  const std::string link = folder_ / "link";
  ASSERT_EQ(mknod((folder_ / "socket").c_str(), S_IFSOCK | 0600, 0), 0);
  fs::create_symlink("socket", link);
  EXPECT_EQ(ProblemsOf("service", "socket", folder_ / "socket"), std::vector<std::string>());
  EXPECT_EQ(ProblemsOf("devices", "simulated_socket", link), std::vector<std::string>());
  EXPECT_EQ(ProblemsOf("service", "socket", link),
            Told("service.socket", link,
                 std::string("which is a link to \"socket\" and no socket") + kSocket));
}

TEST_F(DaemonConfigPlaces, AreLocatedInTheTextThatWasChecked) {
  std::ofstream(File()) << "\n[service]\nstate_folder = \"/x\"\n";
  const CheckedDaemonConfig checked = CheckDaemonConfig(File());
  std::ofstream(File()) << "[service]\nstop_ms = 100\n";
  EXPECT_EQ(checked.Located({ErrorCode::kIo, "is full", "service.state_folder"}).ToString(),
            File() + ":3: service.state_folder: is full");
}

TEST_F(DaemonConfigPlaces, AreNotLookedAtOfAFileThatCannotBeParsed) {
  fs::remove(folder_ / "cuboid.toml");
  std::ofstream(File()) << "[service\n";
  const auto problems = Texts(CheckDaemonConfig(File()).problems);
  ASSERT_EQ(problems.size(), 1u);
  EXPECT_TRUE(problems[0].starts_with(File() + ":1")) << problems[0];
}

TEST(DaemonConfig, WhatNoKeyCanBeSaysWhatIsAllowed) {
  EXPECT_EQ(Texts(CheckDaemonConfigText("[[service]]\n", "x").problems),
            (std::vector<std::string>{
                "x:1: service[0]: is a list of tables, [[service]], expected one, [service]"}));
  EXPECT_EQ(Texts(CheckDaemonConfigText("[storage]\nkeep_days = 99999999999\n", "x").problems),
            (std::vector<std::string>{"x:2: storage.keep_days: is 99999999999, expected "
                                      "-2147483648 to 2147483647 at most"}));
}

TEST(DaemonConfig, ANameThatIsTooLongForASocketIsRefused) {
  const std::string longest = "/" + std::string(106, 's');
  for (const auto& [table, key] :
       {std::pair("service", "socket"), {"devices", "simulated_socket"}}) {
    const std::string begin = std::string("[") + table + "]\n" + key + " = \"" + longest;
    EXPECT_EQ(Texts(CheckDaemonConfigText(begin + "\"\n", "x").problems),
              std::vector<std::string>());
    EXPECT_EQ(Texts(CheckDaemonConfigText(begin + "s\"\n", "x").problems),
              (std::vector<std::string>{std::string("x:2: ") + table + "." + key +
                                        ": has 108 bytes, expected at most 107, as the name of a "
                                        "socket"}));
  }
}

TEST(DaemonConfig, TheFilesItNamesAreCheckedToo) {
  const test::TemporaryFolder folder;
  std::ofstream(folder / "d.toml") << "[devices]\ncapture = \"c.toml\"\nboard = \"gone.toml\"\n";
  std::ofstream(folder / "c.toml")
      << "[capture]\nwidth_px = \"wide\"\n[trigger]\nline = \"x\"\n[cameras.a]\nserial = 5\n";
  const auto problems = Texts(CheckDaemonConfig(folder / "d.toml").problems);
  ASSERT_EQ(problems.size(), 5u);
  EXPECT_NE(problems[0].find("c.toml:2: capture.width_px"), std::string::npos) << problems[0];
  EXPECT_NE(problems[1].find("c.toml:4: trigger.line"), std::string::npos) << problems[1];
  EXPECT_NE(problems[2].find("c.toml:6: cameras.a.serial"), std::string::npos) << problems[2];
  EXPECT_NE(problems[3].find("c.toml:5: cameras.a.uplink"), std::string::npos) << problems[3];
  const std::string here = folder.path().string() + "/";
  EXPECT_EQ(problems[4], here + "d.toml:3: devices.board: " + here +
                             "gone.toml: cannot open: No such file or directory");
  EXPECT_EQ(CheckDaemonConfig(folder / "none.toml").problems.size(), 1u);
}

/// Wrong types, values and places in all three files, in one go.
TEST(DaemonConfig, EverythingThatIsWrongInTheOtherFilesIsNamedWithItsLine) {
  const test::TemporaryFolder folder;
  std::ofstream(folder / "d.toml")
      << "[devices]\ncapture = \"c.toml\"\nboard = \"b.toml\"\nready_ms = -1\n";
  std::ofstream(folder / "c.toml") << "[capture]\nwidth_px = -1\narm_ms = \"long\"\n"
                                      "pixel_format = \"YUV\"\nretries = 11\n"
                                      "[trigger]\nline = 5000\n"
                                      "[uplinks.u]\nmbit_per_s = 0\n"
                                      "[cameras.a]\nserial = 5\n[cameras.b]\nuplink = \"v\"\n"
                                      "[cameras.c]\nserial = \"1\"\n[cameras.d]\nserial = \"1\"\n";
  std::ofstream(folder / "b.toml") << "[cuboid]\nrows = 4\n[rig_frame]\nfront_deg = \"x\"\n";
  std::vector<std::string> told;
  for (const std::string& text : Texts(CheckDaemonConfig(folder / "d.toml").problems)) {
    ASSERT_TRUE(text.starts_with(folder.path().string() + "/")) << text;
    told.push_back(text.substr(folder.path().string().size() + 1));
  }
  EXPECT_EQ(told,
            (std::vector<std::string>{
                "d.toml:4: devices.ready_ms: is -1, expected 0 to 3600000",
                "c.toml:3: capture.arm_ms: is a string, expected an integer",
                "c.toml:11: cameras.a.serial: is an integer, expected a string",
                "c.toml:12: cameras.b: has neither serial nor address, expected at least one",
                "c.toml:13: cameras.b.uplink: is \"v\", which is not in [uplinks]",
                "c.toml:16: cameras.d: \"1\" is already that of c",
                "c.toml:9: uplinks.u.mbit_per_s: is 0, expected 10 to 400000",
                "c.toml:5: capture.retries: is 11, expected 0 to 10",
                "c.toml:2: capture.width_px: is -1, expected 0 to 65535",
                "c.toml:4: capture.pixel_format: is \"YUV\", expected Mono8, BayerRG8, BayerGB8, "
                "BayerGR8, BayerBG8 or RGB8",
                "c.toml:7: trigger.line: is 5000, expected 0 to 1023",
                "b.toml:4: rig_frame.front_deg: is a string, expected a number",
                "b.toml:2: cuboid.rows: is 4, allowed is an odd number from 3 to 99 (versions of "
                "OpenCV draw even ones differently)"}));
}

TEST(DaemonConfig, SaysWhatTakesARestart) {
  DaemonConfig running, wanted;
  wanted.service.socket = "/x";
  wanted.service.log_level = "debug";
  wanted.storage.keep_days = 7;
  wanted.storage.keep_count = 8;
  wanted.storage.reserve_mb = 9;
  wanted.service.end_ms = 20000;
  wanted.access.viewer_group = "others";
  wanted.drift.position_mm = 1;
  EXPECT_EQ(NeedsRestart(running, wanted),
            (std::vector<std::string>{"service.socket", "service.end_ms", "drift.position_mm"}));
}

TEST(DaemonConfig, AChangeInTheCamerasFileTakesARestart) {
  const test::TemporaryFolder folder;
  for (const char* name : {"rotundad.toml", "capture.toml", "cuboid.toml"}) {
    fs::copy_file(Shipped().parent_path() / name, folder / name);
  }
  const CheckedDaemonConfig running = CheckDaemonConfig(folder / "rotundad.toml");
  ASSERT_EQ(Texts(running.problems), std::vector<std::string>());
  EXPECT_EQ(NeedsRestart(running.config, CheckDaemonConfig(folder / "rotundad.toml").config),
            std::vector<std::string>());
  std::ofstream(folder / "capture.toml", std::ios::app) << "\n[cameras.one_more]\nserial = \"X\"\n";
  const auto keys =
      NeedsRestart(running.config, CheckDaemonConfig(folder / "rotundad.toml").config);
  ASSERT_EQ(keys.size(), 1u);
  EXPECT_NE(keys[0].find("capture.toml"), std::string::npos) << keys[0];
}

}  // namespace
}  // namespace rotunda::config
