// Every way the outside world can be wrong gives one clear error, exit code 1 and nothing
// half-written.

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
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

nlohmann::ordered_json ReadJson(const fs::path& file) {
  return nlohmann::ordered_json::parse(std::ifstream(file));
}

void WriteText(const fs::path& file, const std::string& text) {
  std::ofstream(file, std::ios::binary) << text;
}

/// Changes one thing in a JSON file.
void EditJson(const fs::path& file, const std::function<void(nlohmann::ordered_json&)>& edit) {
  nlohmann::ordered_json json = ReadJson(file);
  edit(json);
  WriteText(file, json.dump());
}

fs::path FirstPicture(const fs::path& set) {
  return set / ReadJson(set / "frameset.json")["frames"][0]["file"].get<std::string>();
}

/// A small healthy frame set, simulated once for all tests.
class BadInput : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    shared_ = new TemporaryFolder();
    const ProcessOutcome simulated =
        RunProcess({ROTUNDA_COMMAND, "simulate", *shared_ / "set", "--cameras", "6", "--scale",
                    "0.25", "--background", "plain"});
    ASSERT_EQ(simulated.exit_code, 0) << simulated.errors;
  }
  static void TearDownTestSuite() {
    delete shared_;
    shared_ = nullptr;
  }
  /// A copy of the healthy set, to be spoilt.
  fs::path CopyOfSet(const std::string& name) const {
    fs::copy(*shared_ / "set", folder_ / name, fs::copy_options::recursive);
    return folder_ / name;
  }
  /// Files and folders, hidden ones too, in the folder where the output was to be.
  std::vector<std::string> Listing(const fs::path& parent) const {
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(parent)) {
      names.push_back(entry.path().filename().string());
    }
    std::sort(names.begin(), names.end());
    return names;
  }

  TemporaryFolder folder_;
  static TemporaryFolder* shared_;
};
TemporaryFolder* BadInput::shared_ = nullptr;

/// One line on standard error that begins with the program's name and has every part in it; nothing
/// on standard output.
void ExpectOneError(const ProcessOutcome& outcome, int exit_code,
                    const std::vector<std::string>& parts) {
  EXPECT_EQ(outcome.exit_code, exit_code) << outcome.errors;
  EXPECT_EQ(std::count(outcome.errors.begin(), outcome.errors.end(), '\n'), 1) << outcome.errors;
  EXPECT_EQ(outcome.errors.rfind("rotunda: ", 0), 0U) << outcome.errors;
  EXPECT_EQ(outcome.output, "");
  for (const std::string& part : parts) {
    EXPECT_NE(outcome.errors.find(part), std::string::npos)
        << "'" << part << "' is not in: " << outcome.errors;
  }
}

struct Row {
  std::string name;
  /// Spoils something and gives the arguments after `rotunda reconstruct ... --out out`.
  std::function<std::vector<std::string>(const fs::path& folder, const fs::path& set)> prepare;
  std::vector<std::string> error_parts;
};

const std::vector<Row>& Rows() {
  using Folder = const fs::path&;
  using Arguments = std::vector<std::string>;
  static const std::vector<Row> rows = {
      {"NoSuchFolder",
       [](Folder folder, Folder) { return Arguments{folder / "nowhere"}; },
       {"nowhere"}},
      {"EmptyFolder",
       [](Folder folder, Folder) {
         fs::create_directory(folder / "empty");
         return Arguments{folder / "empty"};
       },
       {"empty", "pictures", "found none"}},
      {"OnePicture",
       [](Folder folder, Folder set) {
         fs::create_directory(folder / "one");
         const fs::path frames = set / "frames";
         fs::copy(fs::directory_iterator(frames)->path(), folder / "one" / "a.png");
         return Arguments{folder / "one"};
       },
       {"one", "pictures found: 1", "at least 3"}},
      {"TruncatedPng",
       [](Folder, Folder set) {
         const fs::path picture = FirstPicture(set);
         fs::resize_file(picture, fs::file_size(picture) / 2);
         return Arguments{set};
       },
       {".png", "cut short", "\"status\": \"missing\""}},
      {"NotAPicture",
       [](Folder, Folder set) {
         WriteText(FirstPicture(set), "this is text");
         return Arguments{set};
       },
       {".png", "not a picture"}},
      {"PictureOfAnotherCamera",
       [](Folder, Folder set) {
         const nlohmann::ordered_json frames = ReadJson(set / "frameset.json")["frames"];
         fs::copy_file(set / frames[1]["file"].get<std::string>(), FirstPicture(set),
                       fs::copy_options::overwrite_existing);
         return Arguments{set};
       },
       {".png", "was changed after the capture", "checksum"}},
      {"StagesOfAnotherSet",
       [](Folder folder, Folder set) {
         fs::create_directory(folder / "stages");
         WriteText(folder / "stages" / "frameset.txt", "another\n");
         return Arguments{set, "--stages", folder / "stages", "--start-from", "features"};
       },
       {"stages", "'another'", "expected 'simulated-"}},
      {"MissingPicture",
       [](Folder, Folder set) {
         fs::remove(FirstPicture(set));
         return Arguments{set};
       },
       {".png", "is not there"}},
      {"WrongManifestVersion",
       [](Folder, Folder set) {
         EditJson(set / "frameset.json", [](auto& json) { json["format"] = "rotunda-frameset/2"; });
         return Arguments{set};
       },
       {"frameset.json", "rotunda-frameset/1", "rotunda-frameset/2"}},
      {"ManifestIsNotJson",
       [](Folder, Folder set) {
         WriteText(set / "frameset.json", "{\"format\": ");
         return Arguments{set};
       },
       {"frameset.json"}},
      {"FieldOfWrongType",
       [](Folder, Folder set) {
         EditJson(set / "frameset.json", [](auto& json) { json["frames"][2]["width"] = "wide"; });
         return Arguments{set};
       },
       {"frameset.json", "frames[2].width", "wide"}},
      {"TwoSizesUnderOneCamera",
       [](Folder, Folder set) {
         EditJson(set / "frameset.json", [](auto& json) {
           json["frames"][1]["camera"] = json["frames"][0]["camera"];
           json["frames"][1]["width"] = 77;
         });
         return Arguments{set};
       },
       {"frameset.json", "c00r", "300x400", "77x400"}},
      {"SizeOfPictureDiffersFromManifest",
       [](Folder, Folder set) {
         EditJson(set / "frameset.json", [](auto& json) { json["frames"][1]["width"] = 77; });
         return Arguments{set};
       },
       {".png", "300x400", "77x400"}},
      {"FileOutsideOfTheSet",
       [](Folder, Folder set) {
         EditJson(set / "frameset.json",
                  [](auto& json) { json["frames"][0]["file"] = "../../etc/passwd"; });
         return Arguments{set};
       },
       {"frameset.json", "frames[0].file", "../../etc/passwd"}},
      {"CalibrationLacksACamera",
       [](Folder folder, Folder set) {
         nlohmann::ordered_json json = ReadJson(set / "calibration.json");
         json["cameras"].erase(0);
         WriteText(folder / "poor.json", json.dump());
         return Arguments{set, "--calibration", folder / "poor.json"};
       },
       {"c00r", "calibration", "\"status\": \"missing\""}},
      {"CalibrationAtAnotherSize",
       [](Folder folder, Folder set) {
         nlohmann::ordered_json json = ReadJson(set / "calibration.json");
         json["cameras"][0]["width"] = 1200;
         WriteText(folder / "other.json", json.dump());
         return Arguments{set, "--calibration", folder / "other.json"};
       },
       {"c00r", "1200x400", "300x400"}},
      {"FrontThoughThereIsACalibration",
       [](Folder, Folder set) {
         return Arguments{set, "--front", "c00r0"};
       },
       {"front", "calibration", "leave it out"}},
      {"PriorThoughThereIsNoCalibration",
       [](Folder, Folder set) {
         fs::remove(set / "calibration.json");
         return Arguments{set, "--prior", "calibration"};
       },
       {"prior", "needs a calibration"}},
      {"UnknownSetting",
       [](Folder, Folder set) {
         return Arguments{set, "--set", "wings=on"};
       },
       {"'wings'", "known are", "unfolding"}},
      {"SettingWithoutValue",
       [](Folder, Folder set) {
         return Arguments{set, "--set", "unfolding"};
       },
       {"unfolding", "expected"}},
      {"SwitchSetToANumber",
       [](Folder, Folder set) {
         return Arguments{set, "--set", "unfolding=0.5"};
       },
       {"unfolding", "'0.5'", "expected"}},
      {"NumberSetToAWord",
       [](Folder, Folder set) {
         return Arguments{set, "--set", "obstacles=on", "--set", "reprojection-weight=heavy"};
       },
       {"reprojection-weight", "'heavy'", "expected"}},
      {"PresetForTheMethodThatHasNone",
       [](Folder, Folder set) {
         return Arguments{set, "--method", "plain", "--preset", "literal"};
       },
       {"--preset", "tc-sfm", "plain"}},
      {"SettingOfAnotherMethod",
       [](Folder, Folder set) {
         return Arguments{set,     "--method",     "plain", "--set", "contrast=0.03",
                          "--set", "unfolding=off"};
       },
       {"unfolding", "tc-sfm", "no effect on plain"}},
      {"SettingOfThePublishedMethod",
       [](Folder, Folder set) {
         return Arguments{set, "--set", "literal-mean-cost=on"};
       },
       {"literal-mean-cost", "tc-sfm literal", "no effect on tc-sfm"}},
      {"TracksForAMethodThatBuildsItsOwn",
       [](Folder folder, Folder set) {
         fs::create_directory(folder / "stages");
         return Arguments{set, "--stages", folder / "stages", "--start-from", "tracks"};
       },
       {"tracks", "tc-sfm"}},
      {"StageThatWasNotWritten",
       [](Folder folder, Folder set) {
         fs::create_directory(folder / "stages");
         return Arguments{
             set, "--method", "plain", "--stages", folder / "stages", "--start-from", "tracks"};
       },
       {"features.bin"}},
      {"DatabaseIsNotOne",
       [](Folder folder, Folder set) {
         WriteText(folder / "text.db", "this is text, not a database at all");
         return Arguments{set, "--database", folder / "text.db"};
       },
       {"text.db"}},
  };
  return rows;
}

TEST_F(BadInput, EveryRowGivesOneErrorAndWritesNothing) {
  for (const Row& row : Rows()) {
    SCOPED_TRACE(row.name);
    const fs::path place = folder_ / row.name;
    fs::create_directory(place);
    const fs::path set = CopyOfSet(row.name + "/set");
    std::vector<std::string> arguments = {ROTUNDA_COMMAND, "reconstruct"};
    const std::vector<std::string> own = row.prepare(place, set);
    arguments.insert(arguments.end(), own.begin(), own.end());
    arguments.insert(arguments.end(), {"--out", place / "out"});
    const std::vector<std::string> before = Listing(place);
    ExpectOneError(RunProcess(arguments), 1, row.error_parts);
    EXPECT_EQ(Listing(place), before);
  }
}

TEST_F(BadInput, OutputFolderThatExistsIsLeftAlone) {
  fs::create_directory(folder_ / "out");
  WriteText(folder_ / "out" / "precious.txt", "keep me");
  for (const std::string command : {"simulate", "reconstruct"}) {
    SCOPED_TRACE(command);
    const std::vector<std::string> arguments =
        command == "simulate" ? std::vector<std::string>{ROTUNDA_COMMAND, command, folder_ / "out"}
                              : std::vector<std::string>{ROTUNDA_COMMAND, command, *shared_ / "set",
                                                         "--out", folder_ / "out"};
    ExpectOneError(RunProcess(arguments), 1, {(folder_ / "out").string(), "exist"});
    EXPECT_EQ(Listing(folder_ / "out"), std::vector<std::string>{"precious.txt"});
    EXPECT_EQ(Listing(folder_.path()), std::vector<std::string>{"out"});
  }
}

TEST_F(BadInput, OutputFolderThatCannotBeWritten) {
  for (const std::string command : {"simulate", "reconstruct"}) {
    SCOPED_TRACE(command);
    const std::vector<std::string> arguments =
        command == "simulate" ? std::vector<std::string>{ROTUNDA_COMMAND, command, "/proc/out"}
                              : std::vector<std::string>{ROTUNDA_COMMAND, command, *shared_ / "set",
                                                         "--out", "/proc/out"};
    ExpectOneError(RunProcess(arguments), 1, {"/proc/out"});
  }
}

/// Runs `rotunda` with a file system of `size` mounted on `mount`, in a mount namespace of its own,
/// then lists what is left there.
ProcessOutcome RunOnSmallDisk(const fs::path& mount, const std::string& size,
                              const std::string& command) {
  const std::string script = "mount -t tmpfs -o size=" + size + " tmpfs " + mount.string() +
                             " || exit 77; " + command + "; code=$?; ls -A " + mount.string() +
                             "; exit $code";
  return RunProcess({"unshare", "--user", "--map-root-user", "--mount", "sh", "-c", script});
}

TEST_F(BadInput, DiskFullIsOneErrorAndLeavesNothing) {
  const fs::path disk = folder_ / "disk";
  fs::create_directory(disk);
  const std::string program = ROTUNDA_COMMAND;
  const std::string set = *shared_ / "set";
  const std::vector<std::string> commands = {
      program + " simulate " + (disk / "out").string() + " --cameras 6 --scale 0.25",
      program + " reconstruct " + set + " --out " + (disk / "out").string() + " --stages " +
          (disk / "stages").string()};
  if (RunOnSmallDisk(disk, "64k", "true").exit_code != 0) {
    GTEST_SKIP() << "this user may not mount a tmpfs in a namespace";
  }
  ExpectOneError(RunOnSmallDisk(disk, "64k", commands[0]), 1, {"No space left on device"});
  const ProcessOutcome stages = RunOnSmallDisk(disk, "64k", commands[1]);
  EXPECT_EQ(stages.exit_code, 1);
  EXPECT_EQ(stages.output, "stages\n") << "only the empty folder of the stages may be left";
  EXPECT_NE(stages.errors.find("No space left on device"), std::string::npos) << stages.errors;
}

TEST_F(BadInput, InterruptOfSimulationLeavesNothing) {
  const ProcessOutcome outcome =
      RunProcess({ROTUNDA_COMMAND, "simulate", folder_ / "out", "--cameras", "6"},
                 [&] { return !fs::is_empty(folder_.path()); });
  ExpectOneError(outcome, 130, {"interrupted"});
  EXPECT_EQ(Listing(folder_.path()), std::vector<std::string>{});
}

TEST_F(BadInput, InterruptOfReconstructionLeavesNothing) {
  const fs::path set = folder_ / "set";
  const ProcessOutcome simulated =
      RunProcess({ROTUNDA_COMMAND, "simulate", set, "--cameras", "30", "--scale", "0.5"});
  ASSERT_EQ(simulated.exit_code, 0) << simulated.errors;
  const fs::path stages = folder_ / "stages";
  for (const char* product : {"", "features.bin", "matches.bin", "two_views.bin"}) {
    SCOPED_TRACE(product);
    fs::remove_all(stages);
    const ProcessOutcome outcome = RunProcess(
        {ROTUNDA_COMMAND, "reconstruct", set, "--out", folder_ / "out", "--stages", stages},
        [&] { return fs::exists(stages / product); });
    ExpectOneError(outcome, 130, {"interrupted"});
    EXPECT_EQ(Listing(folder_.path()), (std::vector<std::string>{"set", "stages"}));
  }
}

TEST(WrongUsage, EveryRowExitsWithTwo) {
  const std::vector<std::vector<std::string>> rows = {
      {},
      {"dance"},
      {"reconstruct"},
      {"reconstruct", "somewhere"},
      {"reconstruct", "somewhere", "--out", "x", "--method", "magic"},
      {"reconstruct", "somewhere", "--out", "x", "--preset", "magic"},
      {"reconstruct", "somewhere", "--out", "x", "--set"},
      {"reconstruct", "somewhere", "--out", "x", "--start-from", "tracks"},
      {"reconstruct", "somewhere", "--out", "x", "--stages", "y", "--start-from", "poses"},
      {"reconstruct", "somewhere", "--out", "x", "--fix-intrinsics", "--refine-intrinsics"},
      {"simulate", "out", "--cameras", "many"},
      {"simulate", "out", "--cameras", "0"},
      {"simulate", "out", "--seed", "-1"},
      {"simulate", "out", "--texture", "3"},
      {"simulate", "out", "--cover", "tent"},
      {"reconstruct", "somewhere", "--out", "x", "--prior", "magic"},
      {"reconstruct", "somewhere", "--out", "x", "--front"},
      {"capture", "--preset", "literal"},
      {"capture", "--prior", "magic"},
      {"capture", "--no-reconstruct", "--follow"},
      {"capture", "--no-reconstruct", "--preset", "internet"},
      {"capture", "--no-reconstruct", "--prior", "calibration"},
      {"capture", "--rig", "rig.toml", "--out", "x", "--preset", "internet"},
      {"capture", "--rig", "rig.toml", "--out", "x", "--prior", "calibration"},
      {"export", "somewhere", "--format", "fax", "--out", "x"},
      {"evaluate", "poses.json"},
  };
  for (const auto& row : rows) {
    std::vector<std::string> arguments = {ROTUNDA_COMMAND};
    arguments.insert(arguments.end(), row.begin(), row.end());
    SCOPED_TRACE(testing::PrintToString(row));
    ExpectOneError(RunProcess(arguments), 2, {});
  }
}

TEST(WrongUsage, NamesTheWordThatIsNotKnown) {
  const std::vector<std::pair<std::string, std::vector<std::string>>> rows = {
      {"'reconstrct' is not known", {"reconstrct", "somewhere", "--out", "x"}},
      {"'reconstructions' is not known", {"reconstructions", "--help"}},
      {"'--ot' is not known", {"reconstruct", "somewhere", "--ot", "x"}},
      {"'--thruth' is not known", {"evaluate", "poses.json", "--thruth", "truth.json"}},
      {"--truth is required", {"evaluate", "poses.json", "truth.json"}},
      {"--out is required", {"reconstruct", "--", "somewhere"}},
      {"--json", {"--json", "status"}},
  };
  for (const auto& [error, row] : rows) {
    std::vector<std::string> arguments = {ROTUNDA_COMMAND};
    arguments.insert(arguments.end(), row.begin(), row.end());
    ExpectOneError(RunProcess(arguments), 2, {error});
  }
}

TEST(WrongUsage, ThreadsAreOfCommandsThatCompute) {
  for (const char* command : {"evaluate", "compare", "export", "cameras", "status", "jobs",
                              "captures", "calibrations", "drift", "events"}) {
    SCOPED_TRACE(command);
    ExpectOneError(RunProcess({ROTUNDA_COMMAND, command, "--threads", "2"}), 2, {"--threads"});
  }
  ExpectOneError(RunProcess({ROTUNDA_COMMAND, "capture", "--threads", "2"}), 2, {"--rig"});
  for (const char* command : {"simulate", "calibrate", "reconstruct", "capture"}) {
    EXPECT_NE(RunProcess({ROTUNDA_COMMAND, command, "--help"}).output.find("--threads"),
              std::string::npos)
        << command;
  }
}

TEST(WrongUsage, ASubjectIsPlainText) {
  const std::string expected =
      "--subject: expected at most 200 bytes of UTF-8 without control "
      "characters, found ";
  const std::vector<std::pair<std::string, std::string>> rows = {
      {"Anna\nBerta", "the control character U+000A at byte 4"},
      {"caf\xE9", "bytes that are not UTF-8"},
      {std::string(201, 'a'), "201 bytes"}};
  for (const auto& [subject, found] : rows) {
    for (const std::vector<std::string>& where :
         {std::vector<std::string>{"--socket", "none"},
          std::vector<std::string>{"--rig", "none", "--out", "none"}}) {
      std::vector<std::string> arguments = {ROTUNDA_COMMAND, "capture", "--subject", subject};
      arguments.insert(arguments.end(), where.begin(), where.end());
      ExpectOneError(RunProcess(arguments), 2, {expected + found});
    }
  }
}

TEST(Help, EveryCommandShowsAnExample) {
  for (const std::string command :
       {"simulate", "calibrate", "reconstruct", "evaluate", "compare", "export"}) {
    const ProcessOutcome outcome = RunProcess({ROTUNDA_COMMAND, command, "--help"});
    EXPECT_EQ(outcome.exit_code, 0);
    EXPECT_NE(outcome.output.find("Example:\n  rotunda " + command), std::string::npos)
        << outcome.output;
  }
}

}  // namespace
}  // namespace rotunda
