// What systemd itself says of the units.

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <string>
#include <utility>
#include <vector>

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
        "share/doc/rotunda/README.md"}) {
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

TEST(Completion, GivesCommandsOptionsAndTheirValues) {
  const fs::path programs = fs::path(ROTUNDA_COMMAND).parent_path();
  const std::string script =
      "PATH=" + programs.string() + ":$PATH; . " + ROTUNDA_SOURCE_DIR +
      "/daemon/cli/rotunda.bash; "
      "COMP_WORDS=(\"$@\"); COMP_CWORD=$(($# - 1)); _rotunda; echo \"${COMPREPLY[*]}\"";
  const auto complete = [&](std::vector<std::string> words) {
    words.insert(words.begin(), {"bash", "-c", script, "bash", "rotunda"});
    const auto said = test::RunProcess(words);
    EXPECT_EQ(said.exit_code, 0) << said.errors;
    return said.output;
  };
  EXPECT_EQ(complete({"rec"}), "reconstruct\n");
  EXPECT_EQ(complete({"export", "--for"}), "--format\n");
  EXPECT_EQ(complete({"export", "--format", "meta"}), "metashape\n");
  EXPECT_EQ(complete({"nonsense", "--x"}), "\n");
}

}  // namespace
}  // namespace rotunda
