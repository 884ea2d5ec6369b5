#include "sfm/presets.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace rotunda::sfm {
namespace {

std::string RefusalOf(std::string_view key, std::string_view value) {
  PipelineOptions options;
  const Status status = SetOption(key, value, options);
  if (status.ok()) return "accepted";
  EXPECT_EQ(status.error().code, ErrorCode::kInvalidArgument);
  return status.error().ToString();
}

TEST(Presets, TheRigIsTheDefault) {
  PipelineOptions options;
  ApplyPreset(Preset::kRig, options);
  const PipelineOptions defaults;
  EXPECT_EQ(options.method, Method::kTcSfm);
  EXPECT_EQ(options.tc_sfm.consistency.least_sure_weight,
            defaults.tc_sfm.consistency.least_sure_weight);
  EXPECT_EQ(options.segments.min_diversity, defaults.segments.min_diversity);
}

TEST(Presets, OnlyARigKnowsThatTheCamerasSurroundTheSubject) {
  PipelineOptions options;
  EXPECT_TRUE(options.tc_sfm.max_gap_deg.has_value());
  ApplyPreset(Preset::kInternet, options);
  EXPECT_FALSE(options.tc_sfm.max_gap_deg.has_value());
  EXPECT_EQ(options.method, Method::kTcSfm);
}

TEST(Presets, LiteralIsThePapersReading) {
  PipelineOptions options;
  ApplyPreset(Preset::kLiteral, options);
  EXPECT_EQ(options.method, Method::kLiteral);
  const LiteralOptions& literal = options.literal;
  EXPECT_TRUE(literal.Validate().ok());
  EXPECT_EQ(literal.min_edge_weight, 0.15);  // tau_w
  EXPECT_FALSE(literal.track_graph.weighted);
  EXPECT_EQ(literal.segments.sign, AmbiguitySign::kDiversity);
  EXPECT_EQ(literal.correction.next, NextImage::kMostPrimaryPoints);
  EXPECT_EQ(literal.correction.place_distance, PlaceDistance::kTranslationAngle);
  EXPECT_TRUE(literal.correction.undecided_is_consistent);
  EXPECT_EQ(literal.merging.reprojection_weight, 0);
  EXPECT_FALSE(literal.merging.mean_cost);
}

TEST(SetOption, SwitchesGoOnAndOff) {
  PipelineOptions options;
  const std::vector<std::pair<const char*, const bool*>> switches = {
      {"consistent-view-graph", &options.tc_sfm.consistent_view_graph},
      {"unfolding", &options.tc_sfm.unfolding},
      {"obstacles", &options.tc_sfm.covisibility.obstacles},
      {"bidirectional", &options.tc_sfm.merging.bidirectional},
      {"literal-weighted-track-graph", &options.literal.track_graph.weighted},
      {"literal-mean-cost", &options.literal.merging.mean_cost},
      {"literal-bidirectional", &options.literal.merging.bidirectional},
  };
  for (const auto& [key, field] : switches) {
    ASSERT_TRUE(SetOption(key, "off", options).ok()) << key;
    EXPECT_FALSE(*field) << key;
    ASSERT_TRUE(SetOption(key, "on", options).ok()) << key;
    EXPECT_TRUE(*field) << key;
    EXPECT_FALSE(SetOption(key, "yes", options).ok()) << key;
    EXPECT_FALSE(SetOption(key, "", options).ok()) << key;
    EXPECT_TRUE(*field) << key << ": a refused value changes nothing";
  }
}

TEST(SetOption, NumbersAreReadToTheirEnd) {
  PipelineOptions options;
  const std::vector<std::pair<const char*, const double*>> numbers = {
      {"reprojection-weight", &options.tc_sfm.merging.reprojection_weight},
      {"literal-reprojection-weight", &options.literal.merging.reprojection_weight},
      {"contrast", &options.features.contrast_threshold},
      {"faint-contrast", &options.features.faint_contrast_threshold},
  };
  for (const auto& [key, field] : numbers) {
    ASSERT_TRUE(SetOption(key, "0.125", options).ok()) << key;
    EXPECT_EQ(*field, 0.125) << key;
    for (const char* bad : {"", "on", "0.5x", "1 2"}) {
      EXPECT_FALSE(SetOption(key, bad, options).ok()) << key << " '" << bad << "'";
    }
    EXPECT_EQ(*field, 0.125) << key;
  }
}

TEST(SetOption, ReadingsOfTheCorrectionHaveTwoStates) {
  PipelineOptions options;
  const CorrectionOptions& correction = options.literal.correction;
  ASSERT_TRUE(SetOption("literal-rejected-undecided", "on", options).ok());
  EXPECT_FALSE(correction.undecided_is_consistent);
  ASSERT_TRUE(SetOption("literal-rejected-undecided", "off", options).ok());
  EXPECT_TRUE(correction.undecided_is_consistent);
  ASSERT_TRUE(SetOption("literal-center-angle", "on", options).ok());
  EXPECT_EQ(correction.place_distance, PlaceDistance::kCenterAngle);
  ASSERT_TRUE(SetOption("literal-center-angle", "off", options).ok());
  EXPECT_EQ(correction.place_distance, PlaceDistance::kTranslationAngle);
  ASSERT_TRUE(SetOption("literal-strongest-link-next", "on", options).ok());
  EXPECT_EQ(correction.next, NextImage::kStrongestLink);
  ASSERT_TRUE(SetOption("literal-strongest-link-next", "off", options).ok());
  EXPECT_EQ(correction.next, NextImage::kMostPrimaryPoints);
}

TEST(SetOption, ARefusedValueChangesNothing) {
  for (const char* key :
       {"literal-rejected-undecided", "literal-center-angle", "literal-strongest-link-next"}) {
    for (const char* before : {"on", "off"}) {
      PipelineOptions options;
      ASSERT_TRUE(SetOption(key, before, options).ok());
      const CorrectionOptions correction = options.literal.correction;
      EXPECT_FALSE(SetOption(key, "maybe", options).ok());
      EXPECT_EQ(options.literal.correction.undecided_is_consistent,
                correction.undecided_is_consistent)
          << key;
      EXPECT_EQ(options.literal.correction.place_distance, correction.place_distance) << key;
      EXPECT_EQ(options.literal.correction.next, correction.next) << key;
    }
  }
}

TEST(SetOption, SaysWhatIsKnownAndWhatIsExpected) {
  const std::string unknown = RefusalOf("unfoldin", "on");
  EXPECT_NE(unknown.find("'unfoldin' is not known"), std::string::npos) << unknown;
  EXPECT_NE(unknown.find("unfolding"), std::string::npos) << unknown;
  EXPECT_NE(unknown.find("contrast"), std::string::npos) << unknown;
  const std::string bad = RefusalOf("unfolding", "perhaps");
  EXPECT_NE(bad.find("unfolding"), std::string::npos) << bad;
  EXPECT_NE(bad.find("'perhaps'"), std::string::npos) << bad;
}

}  // namespace
}  // namespace rotunda::sfm
