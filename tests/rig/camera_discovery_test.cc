#include "rig/camera_discovery.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "tests/support/simulated_rig.h"

namespace rotunda::rig {
namespace {

using std::chrono::milliseconds;

CameraIdentity Found(const std::string& address, const std::string& serial) {
  return {address, serial, "vendor", "model", "1.0"};
}

TEST(MatchCameras, FillsInAddressesAndNamesWhatIsWrong) {
  const std::vector<CameraPlace> wanted = {{"a", "S1", "10.0.0.1", ""}, {"b", "S2", "", ""},
                                           {"c", "S3", "10.0.0.3", ""}, {"d", "S4", "10.0.0.4", ""},
                                           {"e", "S5", "", ""},         {"f", "", "10.0.0.6", ""}};
  const CameraMatch match = MatchCameras(
      wanted, {Found("10.0.0.1", "S1"), Found("10.0.0.2", "S2"), Found("10.0.0.3", "S1b"),
               Found("10.0.0.6", "S6"), Found("10.0.0.7", "S4"), Found("10.0.0.8", "S8")});
  ASSERT_EQ(match.places.size(), wanted.size());
  EXPECT_EQ(match.places[1].address, "10.0.0.2");
  ASSERT_EQ(match.problems.size(), 3u);
  EXPECT_EQ(match.problems[0].ToString(), "c: serial S3 expected at 10.0.0.3, found S1b");
  EXPECT_EQ(match.problems[1].ToString(),
            "d: serial S4 is at 10.0.0.7, but configured at 10.0.0.4, where nobody answers");
  EXPECT_EQ(match.problems[1].code, ErrorCode::kBadInput);
  EXPECT_EQ(match.problems[2].ToString(), "e: serial S5 was not found on any network");
  ASSERT_EQ(match.unused.size(), 1u) << "S4 is in the configuration, at another address";
  EXPECT_EQ(match.unused[0].serial, "S8");
}

TEST(MatchCameras, SeesSwappedCables) {
  const CameraMatch match = MatchCameras({{"a", "S1", "10.0.0.1", ""}, {"b", "S2", "10.0.0.2", ""}},
                                         {Found("10.0.0.1", "S2"), Found("10.0.0.2", "S1")});
  ASSERT_EQ(match.problems.size(), 2u);
  EXPECT_EQ(match.problems[0].message,
            "serial S1 expected at 10.0.0.1, found S2 (which belongs to b)");
}

TEST(DiscoverCameras, SortsByTheAddressesNumbers) {
  test::SimulatedRig::Options options;
  options.block = "127.43.10";
  options.cameras = 11;
  const test::SimulatedRig rig(options);
  const auto found = DiscoverCameras(milliseconds(1000));
  ASSERT_TRUE(found) << found.error().ToString();
  std::vector<std::string> ours;  // other tests' cameras answer too
  for (const CameraIdentity& camera : *found) {
    if (camera.address.starts_with(options.block + ".")) ours.push_back(camera.address);
  }
  ASSERT_EQ(ours.size(), 11u);
  for (size_t i = 0; i < ours.size(); ++i) {
    EXPECT_EQ(ours[i], options.block + "." + std::to_string(i + 1));
  }
}

TEST(ProbeCamera, SaysWhatIsWrong) {
  const auto silent = ProbeCamera("127.43.9.1", milliseconds(500));
  ASSERT_FALSE(silent);
  EXPECT_EQ(silent.error().code, ErrorCode::kNotFound);
  EXPECT_EQ(ProbeCamera("camera7", milliseconds(1)).error().ToString(),
            "camera7: is not an IPv4 address");
}

}  // namespace
}  // namespace rotunda::rig
