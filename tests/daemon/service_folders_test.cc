#include "daemon/service_folders.h"

#include <gtest/gtest.h>
#include <poll.h>
#include <sys/mount.h>
#include <unistd.h>

#include <filesystem>
#include <iostream>
#include <string>
#include <vector>

#include "daemon/http_listener.h"
#include "tests/support/as_nobody.h"
#include "tests/support/own_disk.h"
#include "tests/support/process.h"

namespace rotunda::daemon {
namespace {

namespace fs = std::filesystem;

/// What nobody is told of these folders.
std::vector<std::string> Told(const std::string& state_folder, const std::string& socket) {
  config::DaemonConfig::Service service;
  service.state_folder = state_folder;
  service.socket = socket;
  std::vector<std::string> texts;
  test::AsNobody([&] {
    for (const Error& doubt : FolderDoubts(service)) texts.push_back(doubt.ToString());
  });
  return texts;
}

/// A folder that anybody may write, and one that nobody may.
class ServiceFolders : public testing::Test {
 protected:
  ServiceFolders() {
    fs::permissions(folder_.path(), fs::perms(0777));
    fs::create_directory(Locked());
    Allow(0555);
  }
  ~ServiceFolders() override { Allow(0755); }  // so that it can be removed
  /// To its owner and to others alike, `bits` of the locked one.
  void Allow(unsigned bits) const { fs::permissions(Locked(), fs::perms(bits)); }
  fs::path Locked() const { return folder_ / "locked"; }
  /// In a text: the place, whose it is, and who cannot write it.
  void ExpectNotWritable(const std::string& text, const std::string& begin) const {
    EXPECT_TRUE(text.starts_with(begin + Locked().string() + " is of ")) << text;
    EXPECT_NE(text.find(", mode 0555, and "), std::string::npos) << text;
    EXPECT_TRUE(
        text.ends_with(" cannot write it: expected a folder that the daemon's user can write"))
        << text;
  }

  const test::TemporaryFolder folder_;
};

TEST_F(ServiceFolders, ThatCanBeWrittenOrMadeAreFine) {
  EXPECT_EQ(Told(folder_.path(), folder_ / "api.sock"), std::vector<std::string>());
  EXPECT_EQ(Told(folder_ / "to/be/made", folder_ / "api.sock"), std::vector<std::string>());
}

TEST_F(ServiceFolders, ThatCannotBeWrittenOrMadeAreTold) {
  const auto there = Told(Locked(), Locked() / "api.sock");
  ASSERT_EQ(there.size(), 2u);
  ExpectNotWritable(there[0], "service.state_folder: ");
  ExpectNotWritable(there[1], "service.socket: ");
  const auto missing = Told(Locked() / "a/b", folder_ / "api.sock");
  ASSERT_EQ(missing.size(), 1u);
  ExpectNotWritable(missing[0],
                    "service.state_folder: " + (Locked() / "a/b").string() + " is not there; ");
}

TEST_F(ServiceFolders, OfASocketMustBeThereUnlessSomebodyListens) {
  const auto told = Told(folder_.path(), folder_ / "gone/api.sock");
  ASSERT_EQ(told.size(), 1u);
  EXPECT_TRUE(
      told[0].starts_with("service.socket: " + (folder_ / "gone").string() + ": is not there"))
      << told[0];
  Allow(0755);
  const fs::path socket = Locked() / "api.sock";
  const auto listening = ListenOn(socket);
  ASSERT_TRUE(listening.ok()) << listening.error().ToString();
  fs::permissions(socket, fs::perms(0666));
  Allow(0555);
  EXPECT_EQ(Told(folder_.path(), socket), std::vector<std::string>());
  pollfd waiting{*listening, POLLIN, 0};
  EXPECT_EQ(::poll(&waiting, 1, 0), 0) << "systemd would start the service for a connection";
  ::close(*listening);
  const auto dead = Told(folder_.path(), socket);
  ASSERT_EQ(dead.size(), 1u);
  ExpectNotWritable(dead[0], "service.socket: ");
}

TEST_F(ServiceFolders, NeedNotBeReadForASocketNorToMakeOne) {
  Allow(0333);
  EXPECT_EQ(Told(Locked() / "a/b", Locked() / "api.sock"), std::vector<std::string>());
  const auto told = Told(Locked(), Locked() / "api.sock");
  ASSERT_EQ(told.size(), 1u);
  EXPECT_TRUE(told[0].starts_with("service.state_folder: ")) << told[0];
}

TEST_F(ServiceFolders, ThatCannotBeSeenAreToldSo) {
  Allow(0755);
  const std::string inner = Locked() / "inner", link = folder_ / "link";
  fs::create_directory(inner);
  fs::create_symlink(inner, link);
  Allow(0000);
  const auto told = Told(inner, inner + "/api.sock");
  ASSERT_EQ(told.size(), 2u);
  for (const std::string& text : told) {
    EXPECT_NE(text.find(": " + inner + " cannot be seen by "), std::string::npos) << text;
    EXPECT_NE(text.find("; " + Locked().string() + " is of "), std::string::npos) << text;
    EXPECT_TRUE(text.ends_with(", mode 0000: expected a folder that the daemon's user can write"))
        << text;
  }
  const auto linked = Told(link, folder_ / "api.sock");
  ASSERT_EQ(linked.size(), 1u);
  EXPECT_TRUE(linked[0].starts_with("service.state_folder: " + link + " cannot be seen by "))
      << linked[0];
  EXPECT_EQ(linked[0].find(" is of "), std::string::npos) << linked[0];
}

TEST_F(ServiceFolders, OfAReadOnlyMountAreToldSo) {
  const std::string here = folder_.path();
  const std::string why = here +
                          ": cannot be written: Read-only file system; if it is only so for the "
                          "service, give that ReadWritePaths=" +
                          here + " (systemctl edit rotunda)";
  const auto code = test::OnOwnDisk(here, MS_RDONLY, "", [&] {
    const std::vector<std::string> told = Told(here, here + "/api.sock");
    for (const std::string& text : told) std::cerr << text << "\n";
    return told == std::vector{"service.state_folder: " + why, "service.socket: " + why} ? 0 : 1;
  });
  if (!code) GTEST_SKIP() << "this machine does not allow to mount a file system";
  EXPECT_EQ(*code, 0);
}

TEST_F(ServiceFolders, ThatSystemdMakesAreNotMissed) {
  const config::DaemonConfig::Service usual;
  if (fs::exists(usual.state_folder)) GTEST_SKIP() << usual.state_folder << " is there";
  EXPECT_EQ(Told(usual.state_folder, usual.socket), std::vector<std::string>());
}

}  // namespace
}  // namespace rotunda::daemon
