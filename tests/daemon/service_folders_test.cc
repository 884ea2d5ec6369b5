#include "daemon/service_folders.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <string>
#include <vector>

#include "daemon/http_listener.h"
#include "tests/support/as_nobody.h"
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
    fs::permissions(Locked(), fs::perms(0555));
  }
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
  fs::permissions(Locked(), fs::perms(0755));
  const auto listening = ListenOn(Locked() / "api.sock");
  ASSERT_TRUE(listening.ok()) << listening.error().ToString();
  fs::permissions(Locked(), fs::perms(0555));
  EXPECT_EQ(Told(folder_.path(), Locked() / "api.sock"), std::vector<std::string>());
  ::close(*listening);
  fs::permissions(Locked(), fs::perms(0755));  // so that it can be removed
}

TEST_F(ServiceFolders, ThatSystemdMakesAreNotMissed) {
  const config::DaemonConfig::Service usual;
  if (fs::exists(usual.state_folder)) GTEST_SKIP() << usual.state_folder << " is there";
  EXPECT_EQ(Told(usual.state_folder, usual.socket), std::vector<std::string>());
}

}  // namespace
}  // namespace rotunda::daemon
