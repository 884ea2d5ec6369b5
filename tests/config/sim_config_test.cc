#include "config/sim_config.h"

#include <gtest/gtest.h>

namespace rotunda::config {
namespace {

const std::filesystem::path kConfig = std::filesystem::path(ROTUNDA_SOURCE_DIR) / "config";

TEST(SimConfig, ShippedRigHoldsTheDefaults) {
  const auto rig = ReadRigOptions(kConfig / "rig-90.toml");
  ASSERT_TRUE(rig) << rig.error().ToString();
  const Calibration shipped = sim::DrawRig(*rig, 5, 90, 1.0);
  EXPECT_EQ(shipped.cameras.size(), 90u);
  EXPECT_EQ(CalibrationToJson(shipped), CalibrationToJson(sim::DrawRig({}, 5, 90, 1.0)));
  const sim::RigSensor defaults;
  EXPECT_EQ(rig->sensor.vignetting, defaults.vignetting);
  EXPECT_EQ(rig->sensor.gain_spread_percent, defaults.gain_spread_percent);
  EXPECT_EQ(rig->sensor.colour_spread_percent, defaults.colour_spread_percent);
  EXPECT_EQ(rig->sensor.full_well_e, defaults.full_well_e);
  EXPECT_EQ(rig->sensor.read_noise_e, defaults.read_noise_e);
  EXPECT_EQ(rig->sensor.blur_px, defaults.blur_px);
  EXPECT_EQ(rig->sensor.exposure_us, defaults.exposure_us);
}

TEST(SimConfig, ValuesArriveInTheirFields) {
  const auto rig =
      ParseRigOptions("[rig]\nrows = 3\nradius_mm = 2000\n[jitter]\nroll_deg=0.5\n", "f");
  ASSERT_TRUE(rig) << rig.error().ToString();
  EXPECT_EQ(rig->geometry.rows, 3);
  EXPECT_EQ(rig->geometry.radius_mm, 2000);
  EXPECT_EQ(rig->jitter.roll_deg, 0.5);
}

struct BadText {
  const char* text;
  const char* where;
  const char* says;
};

class BadRig : public testing::TestWithParam<BadText> {};

TEST_P(BadRig, IsRefusedWithFileLineKeyAndWhatIsAllowed) {
  const auto rig = ParseRigOptions(GetParam().text, "my.toml");
  ASSERT_FALSE(rig);
  EXPECT_EQ(rig.error().code, ErrorCode::kBadInput);
  EXPECT_EQ(rig.error().context, GetParam().where);
  EXPECT_NE(rig.error().message.find(GetParam().says), std::string::npos) << rig.error().message;
}

INSTANTIATE_TEST_SUITE_P(
    SimConfig, BadRig,
    testing::Values(
        BadText{"[rig]\nradius = 3\n", "my.toml:2: rig.radius", "allowed are columns, rows"},
        BadText{"[rigg]\nrows = 3\n", "my.toml:1: rigg", "allowed are the tables rig, camera"},
        BadText{"[rig]\nrows = 3.5\n", "my.toml:2: rig.rows", "expected an integer"},
        BadText{"\n[rig]\n\nrows = \"six\"\n", "my.toml:4: rig.rows", "is a string"},
        BadText{"[camera]\nfocal_px = true\n", "my.toml:2: camera.focal_px", "expected a number"},
        BadText{"[rig]\nradius_mm = 5\n", "my.toml:2: rig.radius_mm", "is 5, allowed is 800 to"},
        BadText{"[sensor]\nblur_px = nan\n", "my.toml:2: sensor.blur_px",
                "is nan, allowed is 0 to"},
        BadText{"rig = 3\n", "my.toml:1: rig", "expected a table"},
        BadText{"[rig]\nrows = = 3\n", "my.toml:2", ""}));

TEST(SimConfig, MissingFileIsNamed) {
  const auto rig = ReadRigOptions("/nonexistent/rig.toml");
  ASSERT_FALSE(rig);
  EXPECT_EQ(rig.error().code, ErrorCode::kNotFound);
}

}  // namespace
}  // namespace rotunda::config
