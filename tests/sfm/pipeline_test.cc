#include "sfm/pipeline.h"

#include <gtest/gtest.h>

#include <functional>
#include <string>
#include <vector>

#include "sfm/presets.h"

namespace rotunda::sfm {
namespace {

/// Three frames whose pictures are not there: whoever reads one fails with another error.
FrameSet WithoutPictures() {
  FrameSet set;
  set.folder = "/nonexistent";
  for (const char* camera : {"a", "b", "c"}) {
    Frame frame;
    frame.camera = camera;
    frame.file = std::string(camera) + ".png";
    set.frames.push_back(frame);
  }
  return set;
}

ErrorCode RefusalOf(const FrameSet& set, const PipelineOptions& options) {
  ThreadPool threads(1);
  RunContext context{threads};
  const auto refused = RunPipeline(set, std::nullopt, options, context);
  EXPECT_FALSE(refused);
  return refused.error().code;
}

TEST(RunPipeline, RefusesBadOptionsBeforeItReadsAPicture) {
  using Spoil = std::function<void(PipelineOptions&)>;
  const std::vector<Spoil> of_all = {
      [](PipelineOptions& o) { o.features.max_keypoints = 0; },
      [](PipelineOptions& o) { o.matching.max_ratio = 0; },
      [](PipelineOptions& o) { o.two_view.min_inliers = 0; },
      [](PipelineOptions& o) { o.incremental.min_model_images = 0; },
      [](PipelineOptions& o) { o.start_from = Stage::kFeatures; },
  };
  const std::vector<Spoil> of_tc_sfm = {
      [](PipelineOptions& o) { o.tc_sfm.min_gain = 0; },
      [](PipelineOptions& o) { o.superpixels.count = 0; },
      [](PipelineOptions& o) { o.track_graph.min_track_length = 1; },
      [](PipelineOptions& o) { o.communities.resolution = 0; },
      [](PipelineOptions& o) { o.segments.min_link_matches = 0; },
  };
  const std::vector<Spoil> of_literal = {
      [](PipelineOptions& o) { o.literal.superpixels.count = 0; },
      [](PipelineOptions& o) { o.literal.track_graph.min_track_length = 1; },
      [](PipelineOptions& o) { o.literal.communities.resolution = 0; },
      [](PipelineOptions& o) { o.literal.min_edge_weight = -1; },
  };
  const FrameSet set = WithoutPictures();
  for (const Method method : {Method::kTcSfm, Method::kLiteral, Method::kPlain}) {
    const auto expect = [&](const std::vector<Spoil>& spoils, bool refused) {
      for (size_t i = 0; i < spoils.size(); ++i) {
        PipelineOptions options;
        options.method = method;
        spoils[i](options);
        EXPECT_EQ(RefusalOf(set, options) == ErrorCode::kInvalidArgument, refused)
            << MethodName(method) << ", field " << i;
      }
    };
    expect(of_all, true);
    expect(of_tc_sfm, method == Method::kTcSfm);
    expect(of_literal, method == Method::kLiteral);
  }
}

TEST(RunPipeline, APriorNeedsACalibrationAndAMethodThatUsesIt) {
  PipelineOptions options;
  options.calibration_prior = true;
  EXPECT_EQ(RefusalOf(WithoutPictures(), options), ErrorCode::kInvalidArgument);
  EXPECT_TRUE(options.Validate().ok());
  for (const Method method : {Method::kLiteral, Method::kPlain}) {
    options.method = method;
    const Status refused = options.Validate();
    ASSERT_FALSE(refused.ok());
    EXPECT_EQ(refused.error().context, "prior") << MethodName(method);
  }
}

TEST(RunPipeline, TheFrontIsACameraOfASetWithoutCalibration) {
  PipelineOptions options;
  options.front_camera = "nobody";
  EXPECT_EQ(RefusalOf(WithoutPictures(), options), ErrorCode::kInvalidArgument);
  options.front_camera = WithoutPictures().frames.back().camera;
  EXPECT_NE(RefusalOf(WithoutPictures(), options), ErrorCode::kInvalidArgument);
  ThreadPool threads(1);
  RunContext context{threads};
  const auto refused = RunPipeline(WithoutPictures(), Calibration{}, options, context);
  ASSERT_FALSE(refused.ok());
  EXPECT_EQ(refused.error().context, "--front");
}

TEST(RunPipeline, TracksToStartFromAreThePlainMethods) {
  PipelineOptions options;
  options.stages_folder = "/nonexistent";
  options.start_from = Stage::kTracks;
  EXPECT_FALSE(options.Validate().ok());
  options.method = Method::kPlain;
  EXPECT_TRUE(options.Validate().ok());
  options.database = "/nonexistent/database.db";
  EXPECT_TRUE(options.Validate().ok());
  options.start_from = Stage::kMatches;
  EXPECT_FALSE(options.Validate().ok()) << "matches come from one place";
}

TEST(RunPipeline, FeaturesThatAreThereAreNotMadeByASetting) {
  for (const char* key : {"contrast", "faint-contrast"}) {
    PipelineOptions options;
    options.stages_folder = "/nonexistent";
    ASSERT_TRUE(SetOption(key, "0.01", options).ok()) << key;
    EXPECT_TRUE(options.Validate().ok()) << key;
    PipelineOptions of_database = options;
    of_database.database = "/nonexistent/database.db";
    const Status refused = of_database.Validate();
    ASSERT_FALSE(refused.ok()) << key;
    EXPECT_EQ(refused.error().ToString(),
              std::string(key) +
                  ": has no effect on features that are taken from a database; leave it out, or "
                  "make the features anew");
    for (const Stage stage : {Stage::kFeatures, Stage::kMatches, Stage::kTwoViews}) {
      options.start_from = stage;
      EXPECT_FALSE(options.Validate().ok()) << key;
    }
    options.settings.clear();
    ASSERT_TRUE(SetOption("unfolding", "off", options).ok());
    EXPECT_TRUE(options.Validate().ok());
  }
}

TEST(RunPipeline, NeedsThreePictures) {
  FrameSet set = WithoutPictures();
  set.frames.pop_back();
  EXPECT_EQ(RefusalOf(set, {}), ErrorCode::kBadInput);
}

}  // namespace
}  // namespace rotunda::sfm
