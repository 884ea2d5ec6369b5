#include "config/capture_config.h"

#include <gtest/gtest.h>

namespace rotunda::config {
namespace {

const std::filesystem::path kShipped =
    std::filesystem::path(ROTUNDA_SOURCE_DIR) / "config" / "capture.toml";

// One camera and its uplink; what a test adds stands in front.
constexpr char kOneCamera[] =
    "[uplinks.u]\nmbit_per_s = 1000\n[cameras.c0]\nserial = \"S1\"\naddress = \"10.0.0.1\"\n";

TEST(CaptureConfig, ShippedFileHoldsTheDefaultsAndNinetyCameras) {
  const auto shipped = ReadCaptureOptions(kShipped);
  ASSERT_TRUE(shipped) << shipped.error().ToString();
  EXPECT_EQ(shipped->cameras.size(), 90u);
  EXPECT_EQ(shipped->settings.width_px, 1200);
  EXPECT_EQ(shipped->settings.height_px, 1600);
  const rig::CaptureOptions defaults;
  EXPECT_EQ(shipped->settings.pixel_format, defaults.settings.pixel_format);
  EXPECT_EQ(shipped->settings.exposure_us, defaults.settings.exposure_us);
  EXPECT_EQ(shipped->settings.gain_db, defaults.settings.gain_db);
  EXPECT_EQ(shipped->settings.ptp, defaults.settings.ptp);
  EXPECT_EQ(shipped->settings.packet_size_bytes, defaults.settings.packet_size_bytes);
  EXPECT_EQ(shipped->settings.resend, defaults.settings.resend);
  EXPECT_EQ(shipped->timing.arm_ms, defaults.timing.arm_ms);
  EXPECT_EQ(shipped->timing.deadline_ms, defaults.timing.deadline_ms);
  EXPECT_EQ(shipped->timing.late_ms, defaults.timing.late_ms);
  EXPECT_EQ(shipped->timing.settle_ms, defaults.timing.settle_ms);
  EXPECT_EQ(shipped->skew_limit_us, defaults.skew_limit_us);
  EXPECT_EQ(shipped->retries, defaults.retries);
  EXPECT_EQ(shipped->sets_in_memory, defaults.sets_in_memory);
  EXPECT_EQ(shipped->trigger.gpio.chip, defaults.trigger.gpio.chip);
  EXPECT_EQ(shipped->trigger.gpio.line, defaults.trigger.gpio.line);
  EXPECT_EQ(shipped->trigger.gpio.active_low, defaults.trigger.gpio.active_low);
  EXPECT_EQ(shipped->trigger.pulse_us, defaults.trigger.pulse_us);
  EXPECT_EQ(shipped->trigger.camera_input, defaults.trigger.camera_input);
  ASSERT_EQ(shipped->uplinks.size(), 1u);
  const rig::UplinkOptions uplink;
  EXPECT_EQ(shipped->uplinks[0].mbit_per_s, uplink.mbit_per_s);
  EXPECT_EQ(shipped->uplinks[0].camera_mbit_per_s, uplink.camera_mbit_per_s);
}

TEST(CaptureConfig, ValuesArriveInTheirFields) {
  const auto options = ParseCaptureOptions(
      "[capture]\nexposure_us = 250\nptp = true\npixel_format = \"Mono8\"\n"
      "[trigger]\nchip = \"/dev/gpiochip2\"\nactive_low = true\n"
      "[uplinks.left]\nmbit_per_s = 1000\n[uplinks.right]\n"
      "[cameras.a]\nserial = \"S1\"\nuplink = \"left\"\n"
      "[cameras.b]\naddress = \"10.0.0.2\"\nuplink = \"right\"\n",
      "f");
  ASSERT_TRUE(options) << options.error().ToString();
  EXPECT_EQ(options->settings.exposure_us, 250);
  EXPECT_TRUE(options->settings.ptp);
  EXPECT_EQ(options->settings.pixel_format, "Mono8");
  EXPECT_EQ(options->trigger.gpio.chip, "/dev/gpiochip2");
  EXPECT_TRUE(options->trigger.gpio.active_low);
  ASSERT_EQ(options->cameras.size(), 2u);
  EXPECT_EQ(options->cameras[0].camera, "a");
  EXPECT_EQ(options->cameras[0].serial, "S1");
  EXPECT_EQ(options->cameras[1].address, "10.0.0.2");
  EXPECT_EQ(options->SettingsOf(options->cameras[0]).uplink.Share().share_bits_per_s, 0.9e9);
  EXPECT_EQ(options->SettingsOf(options->cameras[1]).uplink.Share().share_bits_per_s, 0.9e10);
}

TEST(CaptureConfig, TheOnlyUplinkNeedsNoNaming) {
  const auto options = ParseCaptureOptions(kOneCamera, "f");
  ASSERT_TRUE(options) << options.error().ToString();
  EXPECT_EQ(options->cameras[0].uplink, "u");
}

struct BadText {
  const char* text;  // in front of kOneCamera
  const char* where;
  const char* says;
};

class BadCapture : public testing::TestWithParam<BadText> {};

TEST_P(BadCapture, IsRefusedWithFileLineKeyAndWhatIsAllowed) {
  const auto options = ParseCaptureOptions(std::string(GetParam().text) + kOneCamera, "my.toml");
  ASSERT_FALSE(options);
  EXPECT_EQ(options.error().code, ErrorCode::kBadInput) << options.error().ToString();
  EXPECT_EQ(options.error().context, GetParam().where);
  EXPECT_NE(options.error().message.find(GetParam().says), std::string::npos)
      << options.error().message;
}

INSTANTIATE_TEST_SUITE_P(
    Rows, BadCapture,
    testing::Values(
        BadText{"[capture]\nexposure = 5\n", "my.toml:2: capture.exposure",
                "is not known; allowed are width_px"},
        BadText{"[capture]\nptp = 1\n", "my.toml:2: capture.ptp", "expected true or false"},
        BadText{"[capture]\nexposure_us = -5\n", "my.toml:2: capture.exposure_us",
                "is -5, expected 1 to"},
        BadText{"[capture]\npixel_format = \"Mono12\"\n", "my.toml:2: capture.pixel_format",
                "is \"Mono12\", expected Mono8"},
        BadText{"[capture]\nwidth_px = 20000\nheight_px = 20000\n", "my.toml:4: uplinks.u",
                "frames of 400 MB need 3"},
        BadText{"[cameras.x]\nuplink = \"u\"\n", "my.toml:1: cameras.x",
                "neither serial nor address"},
        BadText{"[cameras.x]\naddress = \"localhost\"\nuplink = \"u\"\n",
                "my.toml:2: cameras.x.address", "is \"localhost\", expected an IPv4 address"},
        BadText{"[cameras.x]\naddress = \"10.0.0.256\"\nuplink = \"u\"\n",
                "my.toml:2: cameras.x.address", "is \"10.0.0.256\""},
        BadText{"[cameras.x]\nserial = \"S9\"\nuplink = \"v\"\n", "my.toml:3: cameras.x.uplink",
                "is \"v\", which is not in [uplinks]"}));

TEST(CaptureConfig, NamesThatCouldLeaveTheirFolderAreRefused) {
  for (const char* name : {"..", ".x", "a/b", "a b", "", "\u00e4"}) {
    const auto options = ParseCaptureOptions(
        std::string(kOneCamera) + "[cameras.\"" + name + "\"]\nserial = \"S9\"\nuplink = \"u\"\n",
        "f");
    ASSERT_FALSE(options) << name;
    EXPECT_NE(options.error().message.find("is no name, expected at most 100 letters"),
              std::string::npos)
        << options.error().message;
  }
}

TEST(CaptureConfig, NoTwoCamerasShareASerial) {
  const auto options =
      ParseCaptureOptions(std::string(kOneCamera) + "[cameras.c1]\nserial = \"S1\"\n", "f");
  ASSERT_FALSE(options);
  EXPECT_NE(options.error().message.find("\"S1\" is already that of c0"), std::string::npos)
      << options.error().message;
}

}  // namespace
}  // namespace rotunda::config
