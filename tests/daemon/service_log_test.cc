#include "daemon/service_log.h"

#include <gtest/gtest.h>
#include <spdlog/sinks/ostream_sink.h>

#include <memory>
#include <sstream>
#include <string>

namespace rotunda::daemon {
namespace {

std::string LevelOf(const EventRecord& event) {
  std::ostringstream text;
  spdlog::logger log("test", std::make_shared<spdlog::sinks::ostream_sink_mt>(text));
  log.set_pattern("%l");
  LogEvent(log, event);
  return text.str();
}

TEST(ServiceLog, WarnsOfResultsThatAreNotSureAndOfCamerasThatAreNotInPlace) {
  const auto stored = [](const std::string& data) {
    return LevelOf({1, "", "reconstruction_stored", "x-r1", data});
  };
  EXPECT_EQ(stored("{\"verdict\":\"sure\"}"), "info\n");
  EXPECT_EQ(stored("{\"verdict\":\"\"}"), "info\n");
  EXPECT_EQ(stored("{\"verdict\":\"unsure\"}"), "warning\n");
  EXPECT_EQ(stored("{\"verdict\":\"folded\"}"), "warning\n");
  EXPECT_EQ(LevelOf({1, "", "camera_moved", "c0", "{}"}), "warning\n");
  EXPECT_EQ(LevelOf({1, "", "camera_unregistered", "c0", "{}"}), "warning\n");
  EXPECT_EQ(LevelOf({1, "", "camera_back", "c0", "{}"}), "info\n");
  EXPECT_EQ(LevelOf({1, "", "capture_waits", "x", "{}"}), "warning\n");
  EXPECT_EQ(LevelOf({1, "", "capture_lost", "x", "{}"}), "error\n");
  EXPECT_EQ(LevelOf({1, "", "job_progress", "1", "{}"}), "");
}

}  // namespace
}  // namespace rotunda::daemon
