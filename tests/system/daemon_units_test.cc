// What systemd itself says of the units.

#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "sfm/core/calibration.h"
#include "sfm/core/frame_set.h"
#include "tests/support/background_process.h"
#include "tests/support/process.h"

namespace rotunda {
namespace {

namespace fs = std::filesystem;

fs::path Units() { return fs::path(ROTUNDA_SOURCE_DIR) / "systemd"; }

/// The unit as it is installed, but with the daemon that was built.
std::string InstalledUnit() {
  std::string text = test::TextOf(Units() / "rotunda.service.in");
  const std::vector<std::pair<std::string, std::string>> values = {
      {"@prefix@/sbin/rotundad", ROTUNDA_DAEMON},
      {"@prefix@", "/usr"},
      {"@config_dir@", "/etc/rotunda"}};
  for (const auto& [name, value] : values) {
    for (size_t at; (at = text.find(name)) != std::string::npos;) {
      text.replace(at, name.size(), value);
    }
  }
  return text;
}

class SystemdUnits : public testing::Test {
 protected:
  void SetUp() override {
    if (test::RunProcess({"systemd-analyze", "--version"}).exit_code != 0) {
      GTEST_SKIP() << "there is no systemd-analyze here";
    }
    ASSERT_EQ(InstalledUnit().find("@prefix@"), std::string::npos);
    std::ofstream(folder_ / "rotunda.service") << InstalledUnit();
    fs::copy_file(Units() / "rotunda.socket", folder_ / "rotunda.socket");
  }
  test::TemporaryFolder folder_;
};

TEST_F(SystemdUnits, HaveNoKeyThatSystemdDoesNotKnow) {
  const auto verify = test::RunProcess(
      {"systemd-analyze", "verify", folder_ / "rotunda.service", folder_ / "rotunda.socket"});
  EXPECT_EQ(verify.exit_code, 0);
  EXPECT_EQ(verify.errors, "") << "it exits with 0 also when it does not know a key";
}

TEST_F(SystemdUnits, AreHardened) {
  // In tenths of systemd's scale from 0 to 10.
  const auto security =
      test::RunProcess({"systemd-analyze", "security", "--offline=true", "--threshold=20",
                        "--no-pager", folder_ / "rotunda.service"});
  EXPECT_EQ(security.exit_code, 0) << security.output;
  EXPECT_NE(security.output.find("Overall exposure level"), std::string::npos) << security.output;
}

TEST_F(SystemdUnits, MakeTheUsersAndFoldersThatTheyName) {
  if (geteuid() != 0) GTEST_SKIP() << "systemd-sysusers --root needs root";
  const fs::path root = folder_ / "root";
  fs::create_directories(root / "etc");
  const auto users = test::RunProcess(
      {"systemd-sysusers", "--root=" + root.string(), Units() / "sysusers.d" / "rotunda.conf"});
  ASSERT_EQ(users.exit_code, 0) << users.errors;
  EXPECT_NE(test::TextOf(root / "etc" / "passwd").find("rotunda:"), std::string::npos);
  const std::string groups = test::TextOf(root / "etc" / "group");
  for (const char* group : {"rotunda:", "rotunda-operator:", "gpio:"}) {
    EXPECT_NE(groups.find(group), std::string::npos) << groups;
  }
  const auto folders = test::RunProcess({"systemd-tmpfiles", "--create", "--root=" + root.string(),
                                         Units() / "tmpfiles.d" / "rotunda.conf"});
  EXPECT_EQ(folders.exit_code, 0) << folders.errors;
  EXPECT_TRUE(fs::is_directory(root / "var" / "lib" / "rotunda"));
}

/// What udevd does with the rule for a chip that appears, in a testbed: nothing outside of it is
/// changed, but for /dev/char, which udevadm needs and may have to be made.
TEST(UdevRule, GivesTheTriggersChipToItsGroup) {
  if (geteuid() != 0 || test::RunProcess({"unshare", "--mount", "true"}).exit_code != 0) {
    GTEST_SKIP() << "a testbed for udev takes root and a mount namespace";
  }
  const test::TemporaryFolder folder;
  fs::create_directories(folder / "rules.d");
  fs::copy_file(Units() / "udev" / "60-rotunda-gpio.rules",
                folder / "rules.d" / "60-rotunda-gpio.rules");
  std::ofstream(folder / "group") << "gpio:x:4711:\n" << test::TextOf("/etc/group");
  for (const char* chip : {"gpiochip0", "gpiochip12"}) {
    std::ofstream(folder / "device")
        << "P: /devices/platform/mock/" << chip << "\nN: " << chip << "\nE: DEVNAME=/dev/" << chip
        << "\nE: SUBSYSTEM=gpio\nE: MAJOR=254\nE: MINOR=0\n"
           "A: dev=254:0\\n\n\n";
    const auto event = test::RunProcess(
        {"unshare", "--mount", "sh", "-ec",
         "mkdir -p /usr/lib/udev/rules.d /dev/char; cd \"$0\"\n"
         "mount --bind rules.d /usr/lib/udev/rules.d; mount --bind group /etc/group\n"
         "mount -t tmpfs none /run; mount -t tmpfs none /dev/char\n"
         "exec umockdev-run -d device -- udevadm test \"/sys/devices/platform/mock/$1\" 2>&1",
         folder.path(), chip});
    EXPECT_EQ(event.exit_code, 0) << event.output << event.errors;
    // Of each line that speaks of the file, what stands behind its name; problems stand there, too.
    std::vector<std::string> told;
    std::istringstream lines(event.output);
    for (std::string line; std::getline(lines, line);) {
      const size_t name = line.find("60-rotunda-gpio.rules:");
      if (name != std::string::npos) told.push_back(line.substr(line.find(' ', name) + 1));
    }
    EXPECT_EQ(told, (std::vector<std::string>{"GROUP 4711", "MODE 0660"})) << event.output;
  }
}

TEST(SysctlFile, HasNoKeyThatTheKernelDoesNotKnow) {
  if (!fs::exists("/proc/sys/net/core/rmem_max")) {
    GTEST_SKIP() << "this container does not see the kernel's settings of the network";
  }
  const auto checked = test::RunProcess(
      {"sysctl", "--dry-run", "--load=" + (Units() / "sysctl-rotunda.conf").string()});
  EXPECT_EQ(checked.exit_code, 0) << checked.errors;
  EXPECT_EQ(checked.errors, "");
  EXPECT_EQ(checked.output, "net.core.rmem_max = 33554432\nnet.core.netdev_max_backlog = 10000\n");
}

TEST(Install, PutsEverythingInPlace) {
  const test::TemporaryFolder folder;
  const fs::path prefix = folder / "usr";
  const auto installed =
      test::RunProcess({"cmake", "--install", ROTUNDA_BINARY_DIR, "--prefix", prefix.string()});
  ASSERT_EQ(installed.exit_code, 0) << installed.errors;
  for (const char* file :
       {"bin/rotunda", "sbin/rotundad", "etc/rotunda/rotundad.toml", "etc/rotunda/capture.toml",
        "etc/rotunda/cuboid.toml", "lib/systemd/system/rotunda.service",
        "lib/systemd/system/rotunda.socket", "lib/sysusers.d/rotunda.conf",
        "lib/tmpfiles.d/rotunda.conf", "lib/sysctl.d/60-rotunda.conf",
        "lib/udev/rules.d/60-rotunda-gpio.rules", "share/bash-completion/completions/rotunda",
        "share/bash-completion/completions/rotundad", "share/doc/rotunda/README.md",
        "share/doc/rotunda/daemon/README.md"}) {
    EXPECT_TRUE(fs::is_regular_file(prefix / file)) << file;
  }
  const std::string unit = test::TextOf(prefix / "lib/systemd/system/rotunda.service");
  EXPECT_NE(unit.find("ExecStart=" + prefix.string() + "/sbin/rotundad --config " +
                      prefix.string() + "/etc/rotunda/rotundad.toml\n"),
            std::string::npos)
      << unit;
  const auto checked = test::RunProcess({prefix / "sbin/rotundad", "--check-config", "--config",
                                         prefix / "etc/rotunda/rotundad.toml"});
  EXPECT_EQ(checked.exit_code, 0) << checked.errors;
}

/// What bash would offer for the last of the words, sorted as the script gives them.
std::string Completed(const std::string& function, std::vector<std::string> words) {
  const fs::path source = fs::path(ROTUNDA_SOURCE_DIR) / "daemon";
  const std::string script =
      "PATH=" + fs::path(ROTUNDA_COMMAND).parent_path().string() + ":" +
      fs::path(ROTUNDA_DAEMON).parent_path().string() + ":$PATH\n. " +
      (source / "cli/rotunda.bash").string() + "; . " + (source / "rotundad.bash").string() +
      "\nCOMP_WORDS=(\"$@\"); COMP_CWORD=$(($# - 1)); " + function + "; echo \"${COMPREPLY[*]}\"";
  words.insert(words.begin(), {"bash", "-c", script, "bash"});
  const auto said = test::RunProcess(words);
  EXPECT_EQ(said.exit_code, 0) << said.errors;
  EXPECT_EQ(said.errors, "");
  return said.output.substr(0, said.output.size() - 1);
}

TEST(Completion, GivesCommandsOptionsAndTheirValues) {
  const auto complete = [](std::vector<std::string> words) {
    words.insert(words.begin(), "rotunda");
    return Completed("_rotunda", words);
  };
  EXPECT_EQ(complete({"rec"}), "reconstruct");
  EXPECT_EQ(complete({"--v"}), "--version");
  EXPECT_EQ(complete({"board", ""}), "draw");
  EXPECT_EQ(complete({"board", "draw", "--format", ""}), "pdf svg");
  EXPECT_EQ(complete({"export", "--for"}), "--format");
  EXPECT_EQ(complete({"export", "--format", "meta"}), "metashape");
  EXPECT_EQ(complete({"export", "--format", "=", "meta"}), "metashape");
  EXPECT_EQ(complete({"export", "--format", "ply", ""}), "") << "it has its value";
  EXPECT_EQ(complete({"nonsense", "--x"}), "");
  EXPECT_EQ(complete({"nonsense", ""}), "");
  EXPECT_EQ(Completed("_rotundad", {"rotundad", "--c"}), "--config --check-config");
}

/// A daemon of which it is known what it has; the command asks it.
class CompletionOfIds : public testing::Test {
 protected:
  void SetUp() override {
    const auto notify = std::make_unique<test::NotifySocket>(folder_ / "notify");
    for (const char* id : {"a1", "a2"}) AddCapture(id);
    AddCalibration("k1");
    std::ofstream(folder_ / "capture.toml")
        << "[uplinks.u]\n[cameras.c0]\nserial = \"NONE\"\naddress = \"127.42.11.1\"\n";
    std::ofstream(folder_ / "rotundad.toml")
        << "[service]\nsocket = \"" << (folder_ / "api.sock").string() << "\"\nstate_folder = \""
        << (folder_ / "state").string() << "\"\n[devices]\nboard = \"" << ROTUNDA_SOURCE_DIR
        << "/config/cuboid.toml\"\nsimulated_socket = \"" << (folder_ / "none").string() << "\"\n";
    daemon_ = std::make_unique<test::BackgroundProcess>(
        test::BackgroundProcess::Options{{ROTUNDA_DAEMON, "--config", folder_ / "rotundad.toml"},
                                         {{"NOTIFY_SOCKET", folder_ / "notify"}},
                                         std::nullopt,
                                         folder_ / "log"});
    ASSERT_TRUE(notify->WaitFor("READY=1", std::chrono::seconds(60))) << daemon_->Output();
  }
  void AddCapture(const std::string& id) const {
    FrameSet set;
    set.id = id;
    set.captured_at = "2026-01-01T00:00:00Z";
    set.frames.emplace_back().camera = "c0";
    set.frames[0].status = "missing";
    fs::create_directories(folder_ / "state" / "captures" / id);
    std::ofstream(folder_ / "state" / "captures" / id / "frameset.json") << FrameSetToJson(set);
  }
  void AddCalibration(const std::string& id) const {
    Calibration calibration;
    calibration.id = id;
    calibration.created_at = "2026-01-01T00:00:00Z";
    fs::create_directories(folder_ / "state" / "calibrations" / id);
    std::ofstream(folder_ / "state" / "calibrations" / id / "calibration.json")
        << CalibrationToJson(calibration);
  }
  std::string Complete(std::vector<std::string> words) const {
    words.insert(words.begin() + 1, {"--socket", folder_ / "api.sock"});
    words.insert(words.begin(), "rotunda");
    return Completed("_rotunda", words);
  }

  test::TemporaryFolder folder_;
  std::unique_ptr<test::BackgroundProcess> daemon_;
};

TEST_F(CompletionOfIds, GivesThoseThatTheDaemonHas) {
  EXPECT_EQ(Complete({"captures", ""}), "a2 a1");
  EXPECT_EQ(Complete({"captures", "--json", "a2"}), "a2") << "behind a flag";
  EXPECT_EQ(Complete({"calibrations", ""}), "k1");
  EXPECT_EQ(Complete({"calibrations", "--from", ""}), "a2 a1");
  EXPECT_EQ(Complete({"calibrations", "--from", "a1", ""}), "a2 a1") << "it takes several";
  EXPECT_EQ(Complete({"calibrations", "--from", "a1", "--compare", ""}), "k1");
  EXPECT_EQ(Complete({"captures", "a1", "--reconstruct", "--calibration", "k"}), "k1");
  EXPECT_EQ(Complete({"jobs", ""}), "");
  ASSERT_EQ(test::RunProcess({"curl", "-s", "--unix-socket", folder_ / "api.sock", "-X", "POST",
                              "http://localhost/v1/captures/a1/reconstructions"})
                .exit_code,
            0);
  EXPECT_EQ(Complete({"jobs", ""}), "1");
  EXPECT_EQ(Complete({"drift", ""}), "c0");
}

}  // namespace
}  // namespace rotunda
