#include "sfm/presets.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace rotunda::sfm {
namespace {

/// Options of the method that the key acts on.
PipelineOptions OptionsFor(std::string_view key) {
  PipelineOptions options;
  if (key.starts_with("literal-")) ApplyPreset(Preset::kLiteral, options);
  return options;
}

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
  EXPECT_EQ(defaults.method, Method::kTcSfm);
  EXPECT_EQ(defaults.tc_sfm.max_gap_deg, 130.0);
  EXPECT_EQ(options.method, defaults.method);
  EXPECT_EQ(options.tc_sfm.max_gap_deg, defaults.tc_sfm.max_gap_deg);
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
  EXPECT_FALSE(literal.consistent_view_graph);
  EXPECT_FALSE(literal.adaptive_edge_weight);
  EXPECT_FALSE(literal.confirmed_light_edges);
  EXPECT_FALSE(literal.correction.missing_observations);
  EXPECT_FALSE(literal.correction.graph_support);
  EXPECT_FALSE(literal.correction.rotation_loops);
  EXPECT_FALSE(literal.clusters.undo_inconsistent_merges);
  EXPECT_EQ(literal.segments.sign, AmbiguitySign::kDiversity);
  EXPECT_EQ(literal.segments.min_diversity, 0.5);  // tau_gs
  EXPECT_FALSE(literal.segments.diversity_inclusive);
  EXPECT_FALSE(literal.correction.labels_by_track);
  EXPECT_EQ(literal.correction.max_rotation_rad, 0.15);  // epsilon_r
  EXPECT_EQ(literal.correction.max_place_rad, 0.35);     // epsilon_t
  EXPECT_TRUE(std::isinf(literal.correction.max_sigma_share));
  EXPECT_EQ(literal.correction.next, NextImage::kMostPrimaryPoints);
  EXPECT_EQ(literal.correction.place_distance, PlaceDistance::kTranslationAngle);
  EXPECT_TRUE(literal.correction.undecided_is_consistent);
  EXPECT_EQ(literal.merging.reprojection_weight, 0);
  EXPECT_FALSE(literal.merging.mean_cost);
}

TEST(RunChoices, AreTheOptionsOfARun) {
  EXPECT_EQ(OptionsOf({}).method, PipelineOptions().method);
  EXPECT_EQ(OptionsOf({}).preset, PipelineOptions().preset);
  EXPECT_FALSE(OptionsOf({}).refine_intrinsics.has_value());
  const PipelineOptions options =
      OptionsOf({Method::kTcSfm, Preset::kInternet, PairSelection::kNeighbours, true, false});
  EXPECT_EQ(options.preset, "internet");
  EXPECT_FALSE(options.tc_sfm.max_gap_deg.has_value());
  EXPECT_EQ(options.pairs, PairSelection::kNeighbours);
  EXPECT_TRUE(options.calibration_prior);
  EXPECT_EQ(options.refine_intrinsics, false);
  EXPECT_EQ(OptionsOf({Method::kPlain}).method, Method::kPlain);
}

TEST(RunChoices, ThatHaveNoEffectOnTheMethodAreNamed) {
  const auto refused = [](const RunChoices& choices) {
    const Status status = choices.Validate();
    return status.ok() ? "" : status.error().ToString();
  };
  EXPECT_EQ(refused({}), "");
  EXPECT_EQ(refused({Method::kTcSfm, Preset::kInternet, PairSelection::kExhaustive, true}), "");
  EXPECT_EQ(refused({Method::kPlain}), "");
  EXPECT_EQ(refused({Method::kPlain, Preset::kInternet}),
            "preset: has no effect on plain, only on tc-sfm");
  EXPECT_EQ(refused({Method::kPlain, Preset::kRig, PairSelection::kExhaustive, true}),
            "prior: has no effect on plain, only on tc-sfm");
  EXPECT_EQ(refused({Method::kTcSfm, Preset::kLiteral, PairSelection::kExhaustive, true}),
            "prior: has no effect on tc-sfm literal, only on tc-sfm");
}

TEST(SetOption, IsToldWithTheResult) {
  PipelineOptions options;
  ApplyPreset(Preset::kInternet, options);
  ASSERT_TRUE(SetOption("unfolding", "off", options).ok());
  EXPECT_FALSE(SetOption("unfolding", "perhaps", options).ok());
  EXPECT_EQ(options.preset, "internet");
  EXPECT_EQ(options.settings, (std::map<std::string, std::string>{{"unfolding", "off"}}));
}

TEST(SetOption, SwitchesGoOnAndOff) {
  using Field = bool& (*)(PipelineOptions&);
  const std::vector<std::pair<const char*, Field>> switches = {
      {"consistent-view-graph",
       [](PipelineOptions& o) -> bool& { return o.tc_sfm.consistent_view_graph; }},
      {"unfolding", [](PipelineOptions& o) -> bool& { return o.tc_sfm.unfolding; }},
      {"obstacles", [](PipelineOptions& o) -> bool& { return o.tc_sfm.covisibility.obstacles; }},
      {"bidirectional", [](PipelineOptions& o) -> bool& { return o.tc_sfm.merging.bidirectional; }},
      {"piece-consensus",
       [](PipelineOptions& o) -> bool& { return o.tc_sfm.consistency.piece_consensus; }},
      {"matches-brought-back",
       [](PipelineOptions& o) -> bool& { return o.tc_sfm.matches_brought_back; }},
      {"single-image-doubt",
       [](PipelineOptions& o) -> bool& { return o.tc_sfm.single_image_doubt; }},
      {"literal-consistent-view-graph",
       [](PipelineOptions& o) -> bool& { return o.literal.consistent_view_graph; }},
      {"literal-diversity-inclusive",
       [](PipelineOptions& o) -> bool& { return o.literal.segments.diversity_inclusive; }},
      {"literal-labels-by-track",
       [](PipelineOptions& o) -> bool& { return o.literal.correction.labels_by_track; }},
      {"literal-weighted-track-graph",
       [](PipelineOptions& o) -> bool& { return o.literal.track_graph.weighted; }},
      {"literal-adaptive-edge-weight",
       [](PipelineOptions& o) -> bool& { return o.literal.adaptive_edge_weight; }},
      {"literal-confirmed-light-edges",
       [](PipelineOptions& o) -> bool& { return o.literal.confirmed_light_edges; }},
      {"literal-missing-observations",
       [](PipelineOptions& o) -> bool& { return o.literal.correction.missing_observations; }},
      {"literal-graph-support",
       [](PipelineOptions& o) -> bool& { return o.literal.correction.graph_support; }},
      {"literal-rotation-loops",
       [](PipelineOptions& o) -> bool& { return o.literal.correction.rotation_loops; }},
      {"literal-undone-merges",
       [](PipelineOptions& o) -> bool& { return o.literal.clusters.undo_inconsistent_merges; }},
      {"literal-mean-cost",
       [](PipelineOptions& o) -> bool& { return o.literal.merging.mean_cost; }},
      {"literal-bidirectional",
       [](PipelineOptions& o) -> bool& { return o.literal.merging.bidirectional; }},
  };
  for (const auto& [key, field] : switches) {
    PipelineOptions options = OptionsFor(key);
    ASSERT_TRUE(SetOption(key, "off", options).ok()) << key;
    EXPECT_FALSE(field(options)) << key;
    ASSERT_TRUE(SetOption(key, "on", options).ok()) << key;
    EXPECT_TRUE(field(options)) << key;
    EXPECT_FALSE(SetOption(key, "yes", options).ok()) << key;
    EXPECT_FALSE(SetOption(key, "", options).ok()) << key;
    EXPECT_TRUE(field(options)) << key << ": a refused value changes nothing";
  }
}

TEST(SetOption, NumbersAreReadToTheirEnd) {
  using Field = double& (*)(PipelineOptions&);
  const std::vector<std::pair<const char*, Field>> numbers = {
      {"reprojection-weight",
       [](PipelineOptions& o) -> double& { return o.tc_sfm.merging.reprojection_weight; }},
      {"literal-min-edge-weight",
       [](PipelineOptions& o) -> double& { return o.literal.min_edge_weight; }},
      {"literal-min-diversity",
       [](PipelineOptions& o) -> double& { return o.literal.segments.min_diversity; }},
      {"literal-max-sigma-share",
       [](PipelineOptions& o) -> double& { return o.literal.correction.max_sigma_share; }},
      {"literal-reprojection-weight",
       [](PipelineOptions& o) -> double& { return o.literal.merging.reprojection_weight; }},
      {"contrast", [](PipelineOptions& o) -> double& { return o.features.contrast_threshold; }},
      {"faint-contrast",
       [](PipelineOptions& o) -> double& { return o.features.faint_contrast_threshold; }},
  };
  for (const auto& [key, field] : numbers) {
    PipelineOptions options = OptionsFor(key);
    ASSERT_TRUE(SetOption(key, "0.125", options).ok()) << key;
    EXPECT_EQ(field(options), 0.125) << key;
    for (const char* bad : {"", "on", "0.5x", "1 2"}) {
      EXPECT_FALSE(SetOption(key, bad, options).ok()) << key << " '" << bad << "'";
    }
    EXPECT_EQ(field(options), 0.125) << key;
  }
}

TEST(SetOption, AnOptionThatDoesNotActOnTheMethodIsRefused) {
  const auto accepts = [](Method method, const char* key) {
    PipelineOptions options;
    options.method = method;
    return SetOption(key, std::string_view(key).ends_with("contrast") ? "0.01" : "off", options)
        .ok();
  };
  for (const char* key : {"unfolding", "consistent-view-graph", "obstacles", "bidirectional"}) {
    EXPECT_TRUE(accepts(Method::kTcSfm, key)) << key;
    EXPECT_FALSE(accepts(Method::kLiteral, key)) << key;
    EXPECT_FALSE(accepts(Method::kPlain, key)) << key;
  }
  for (const char* key : {"literal-mean-cost", "literal-center-angle"}) {
    EXPECT_FALSE(accepts(Method::kTcSfm, key)) << key;
    EXPECT_TRUE(accepts(Method::kLiteral, key)) << key;
    EXPECT_FALSE(accepts(Method::kPlain, key)) << key;
  }
  for (const Method method : {Method::kTcSfm, Method::kLiteral, Method::kPlain}) {
    EXPECT_TRUE(accepts(method, "contrast")) << MethodName(method);
    EXPECT_TRUE(accepts(method, "faint-contrast")) << MethodName(method);
  }
}

TEST(SetOption, ReadingsOfTheCorrectionHaveTwoStates) {
  PipelineOptions options = OptionsFor("literal-");
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

TEST(SetOption, TheSignOfAmbiguityHasTwoStates) {
  PipelineOptions options = OptionsFor("literal-");
  ASSERT_TRUE(SetOption("literal-rejected-links", "on", options).ok());
  EXPECT_EQ(options.literal.segments.sign, AmbiguitySign::kRejectedLinks);
  ASSERT_TRUE(SetOption("literal-rejected-links", "off", options).ok());
  EXPECT_EQ(options.literal.segments.sign, AmbiguitySign::kDiversity);
}

TEST(SetOption, TheGapInTheRingIsTheRigs) {
  PipelineOptions options;
  ASSERT_TRUE(SetOption("ring-gap", "off", options).ok());
  EXPECT_FALSE(options.tc_sfm.max_gap_deg.has_value());
  ASSERT_TRUE(SetOption("ring-gap", "on", options).ok());
  EXPECT_EQ(options.tc_sfm.max_gap_deg, TcSfmOptions().max_gap_deg);
}

TEST(SetOption, ARefusedValueChangesNothing) {
  for (const char* key :
       {"literal-rejected-undecided", "literal-center-angle", "literal-strongest-link-next"}) {
    for (const char* before : {"on", "off"}) {
      PipelineOptions options = OptionsFor(key);
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
