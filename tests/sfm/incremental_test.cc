#include "sfm/incremental.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "sfm/covariance.h"
#include "sfm/model_builder.h"
#include "tests/support/reconstruction_near.h"
#include "tests/support/synthetic_world.h"

namespace rotunda::sfm {
namespace {

using test::Disconnect;
using test::ErrorsOf;
using test::MakeSyntheticWorld;
using test::NotNear;
using test::SyntheticOptions;
using test::SyntheticWorld;

/// Keypoints are stored as floats: half a unit in the last place at 1600 px.
constexpr double kKeypointRounding_px = 6.1e-5;
constexpr double kFocal_px = 1840.0;
constexpr double kDistance_m = 1.7;

class IncrementalTest : public ::testing::Test {
 protected:
  Result<IncrementalResult> Build(const SyntheticWorld& world, const IncrementalOptions& options) {
    return BuildReconstructions(world.Input(), options, context_);
  }
  ThreadPool threads_{2};
  RunContext context_{threads_};
};

std::vector<ImageId> ImagesBelow(size_t count) {
  std::vector<ImageId> images;
  for (size_t i = 0; i < count; ++i) images.push_back(ImageId(i));
  return images;
}

TEST_F(IncrementalTest, IsExactWithoutNoise) {
  SyntheticOptions options;
  options.noise_px = 0.0;
  const SyntheticWorld world = MakeSyntheticWorld(options);
  const auto result = Build(world, {});
  ASSERT_TRUE(result) << result.error().ToString();
  ASSERT_EQ(result->models.size(), 1u);
  EXPECT_TRUE(result->unregistered.empty());
  const double angle_rad = kKeypointRounding_px / kFocal_px;
  EXPECT_EQ(NotNear(result->models[0], world.cam_from_world, 10 * angle_rad,
                    10 * kDistance_m * angle_rad),
            "");
}

TEST_F(IncrementalTest, ErrorIsWhatTheNoiseAllows) {
  constexpr int kSeeds = 8;
  double rotation = 0, position = 0;
  size_t cameras = 0;
  for (uint64_t seed = 1; seed <= kSeeds; ++seed) {
    SyntheticOptions options;
    options.seed = seed;
    const SyntheticWorld world = MakeSyntheticWorld(options);
    const auto result = Build(world, {});
    ASSERT_TRUE(result && result->models.size() == 1 && result->unregistered.empty());
    const Reconstruction& model = result->models[0];
    const auto covariances = BuildPoseCovariances(model, world.features, false, context_);
    ASSERT_TRUE(covariances) << covariances.error().ToString();
    const test::PoseErrors errors = ErrorsOf(model, world.cam_from_world);
    for (size_t k = 0; k < errors.images.size(); ++k) {
      const PoseSigma sigma = SigmaOf(*covariances->images[errors.images[k].index()]);
      const double position_mm = sigma.position_mm * errors.truth_from_model.scale;
      rotation += std::pow(DegFromRad(errors.rotation_rad[k]) / sigma.rotation_deg, 2);
      position += std::pow(1000.0 * errors.position[k] / position_mm, 2);
    }
    cameras += errors.images.size();
  }
  // Cameras of one ring err together, so that a seed is worth a few independent ones: the mean
  // square over 8 seeds has a standard deviation of about sqrt(2 / (8 * 6)) = 0.2.
  EXPECT_NEAR(rotation / cameras, 1.0, 0.5);
  EXPECT_NEAR(position / cameras, 1.0, 0.5);
}

TEST_F(IncrementalTest, BearsMismatchesInTracks) {
  SyntheticOptions options;
  options.wrong_match_share = 0.3;
  options.points = 1500;
  const SyntheticWorld world = MakeSyntheticWorld(options);
  const auto result = Build(world, {});
  ASSERT_TRUE(result) << result.error().ToString();
  ASSERT_EQ(result->models.size(), 1u);
  // Tracks are shorter and fewer than without mismatches; the poses stay free of gross errors.
  EXPECT_EQ(NotNear(result->models[0], world.cam_from_world, RadFromDeg(0.3), 0.008), "");
}

TEST_F(IncrementalTest, GivesGroupsThatShareNothingAModelEach) {
  SyntheticWorld world = MakeSyntheticWorld({});
  Disconnect(world, ImagesBelow(10));
  const auto result = Build(world, {});
  ASSERT_TRUE(result) << result.error().ToString();
  ASSERT_EQ(result->models.size(), 2u);
  EXPECT_TRUE(result->unregistered.empty());
  for (size_t i = 0; i < world.cam_from_world.size(); ++i) {
    EXPECT_EQ(result->models[0].Registered(ImageId(i)), i >= 10) << "image " << i;
    EXPECT_EQ(result->models[1].Registered(ImageId(i)), i < 10) << "image " << i;
  }
  for (const Reconstruction& model : result->models) {
    EXPECT_LT(ErrorsOf(model, world.cam_from_world).max_rotation_rad, RadFromDeg(0.3));
  }
}

TEST_F(IncrementalTest, SaysWhyAnImageIsNotRegistered) {
  SyntheticWorld world = MakeSyntheticWorld({});
  Disconnect(world, {ImageId(5)});
  world.features.images[7].keypoints.clear();
  world.point_of_keypoint[7].clear();
  std::erase_if(world.two_views.pairs, [](const TwoView& pair) {
    return pair.pair.first == ImageId(7) || pair.pair.second == ImageId(7);
  });
  Disconnect(world, {ImageId(7)});
  const auto result = Build(world, {});
  ASSERT_TRUE(result) << result.error().ToString();
  ASSERT_EQ(result->unregistered.size(), 2u);
  EXPECT_EQ(result->unregistered[0].image, ImageId(5));
  EXPECT_EQ(result->unregistered[0].reason, "matches no other picture");
  EXPECT_EQ(result->unregistered[1].image, ImageId(7));
  EXPECT_EQ(result->unregistered[1].reason, "no keypoints");
}

TEST_F(IncrementalTest, RefusesAnImageWhoseMatchesAreAllWrong) {
  SyntheticWorld world = MakeSyntheticWorld({});
  const ImageId wrong(4);
  test::NormalRandom random(9);
  for (Keypoint& keypoint : world.features.images[wrong.index()].keypoints) {
    keypoint.x_px = static_cast<float>(1200 * random.Uniform());
    keypoint.y_px = static_cast<float>(1600 * random.Uniform());
  }
  const auto result = Build(world, {});
  ASSERT_TRUE(result) << result.error().ToString();
  ASSERT_EQ(result->unregistered.size(), 1u);
  EXPECT_EQ(result->unregistered[0].image, wrong);
  EXPECT_NE(result->unregistered[0].reason.find("its best pose fits"), std::string::npos)
      << result->unregistered[0].reason;
  EXPECT_LT(ErrorsOf(result->models[0], world.cam_from_world).max_rotation_rad, RadFromDeg(0.3));
}

TEST_F(IncrementalTest, TakesAnImageOutThatTooFewObservationsHold) {
  SyntheticWorld world = MakeSyntheticWorld({});
  const ImageId loose(4);
  // Fifty points that enough others see, so that they do not give way to its keypoints.
  size_t kept = 0;
  std::erase_if(world.tracks.tracks, [&](const Track& track) {
    const bool has = std::any_of(track.observations.begin(), track.observations.end(),
                                 [&](const Observation& o) { return o.image == loose; });
    return has && (track.observations.size() < 5 || kept++ >= 50);
  });
  // It comes last.
  for (ViewGraphEdge& edge : world.view_graph.edges) {
    if (edge.pair.first != loose && edge.pair.second != loose) continue;
    edge.weight = 0.0;
    world.two_views.pairs[edge.two_view].median_angle_rad = 0.0;
  }
  // PnP bears errors of 10 px, observations are dropped above 4 px.
  test::NormalRandom random(9);
  std::vector<Keypoint>& keypoints = world.features.images[loose.index()].keypoints;
  for (size_t k = 0; k < keypoints.size(); ++k) {
    const double angle_rad = 2.0 * kPi * random.Uniform();
    keypoints[k].x_px += static_cast<float>(10.0 * std::cos(angle_rad));
    keypoints[k].y_px += static_cast<float>(10.0 * std::sin(angle_rad));
  }
  const auto result = Build(world, {});
  ASSERT_TRUE(result) << result.error().ToString();
  ASSERT_EQ(result->models.size(), 1u);
  const Reconstruction& model = result->models[0];
  ASSERT_EQ(result->unregistered.size(), 1u)
      << SummarizeReprojection(model, world.features).images[loose.index()].observations;
  EXPECT_EQ(result->unregistered[0].image, loose);
  EXPECT_TRUE(result->unregistered[0].reason.starts_with("only ") &&
              result->unregistered[0].reason.ends_with(" observations hold after adjustment"))
      << result->unregistered[0].reason;
  EXPECT_FALSE(model.Registered(loose));
  for (const Point3& point : model.points) {
    EXPECT_GE(point.observations.size(), 2u);
    for (const Observation& o : point.observations) EXPECT_TRUE(model.Registered(o.image));
  }
  EXPECT_LT(ErrorsOf(model, world.cam_from_world).max_rotation_rad, RadFromDeg(0.3));
  const auto covariances = BuildPoseCovariances(model, world.features, false, context_);
  EXPECT_TRUE(covariances) << covariances.error().ToString();
}

TEST_F(IncrementalTest, UnregistersUntilEveryImageHasEnough) {
  const SyntheticWorld world = MakeSyntheticWorld({});
  const IncrementalInput input = world.Input();
  const IncrementalOptions options;
  const TwoView& pair = world.two_views.pairs.front();
  ModelBuilder builder(input, options, std::vector<bool>(world.tracks.tracks.size(), true),
                       context_);
  ASSERT_TRUE(builder.Initialize(pair, 10, 0.0).ok());
  const size_t points = builder.PointCount();
  EXPECT_TRUE(builder.UnregisterWeak(points).empty());
  const std::vector<WeakImage> gone = builder.UnregisterWeak(points + 1);
  ASSERT_EQ(gone.size(), 2u);
  EXPECT_EQ(gone[0].observations, points);
  EXPECT_EQ(builder.Registered(), 0u);
  EXPECT_EQ(builder.PointCount(), 0u);
  for (const ImageId image : ImagesBelow(world.cam_from_world.size())) {
    EXPECT_EQ(builder.VisiblePoints(image), 0u) << "image " << image.index();
  }
}

TEST_F(IncrementalTest, ImagesOfOneBatchSetTheirSharedFocalLengthOnce) {
  SyntheticOptions synthetic;
  synthetic.noise_px = 0.0;
  synthetic.shared_lens = true;
  SyntheticWorld world = MakeSyntheticWorld(synthetic);
  const TwoView pair = world.two_views.pairs.front();
  // All pictures but the first pair's come from a second lens that is guessed 1.3 times too long.
  CameraIntrinsics guessed = world.intrinsics.lenses[0];
  const double truth_px = guessed.MeanFocal_px();
  for (size_t p = 0; p < guessed.params.size(); ++p) {
    if (IsFocal(guessed.model, p)) guessed.params[p] *= 1.3;
  }
  world.intrinsics.lenses.push_back(guessed);
  world.intrinsics.lens_of_image.assign(world.cam_from_world.size(), 1);
  world.intrinsics.lens_of_image[pair.pair.first.index()] = 0;
  world.intrinsics.lens_of_image[pair.pair.second.index()] = 0;
  const IncrementalInput input = world.Input();
  IncrementalOptions options;
  options.refine_intrinsics = true;
  ModelBuilder builder(input, options, std::vector<bool>(world.tracks.tracks.size(), true),
                       context_);
  ASSERT_TRUE(builder.Initialize(pair, 10, 0.0).ok());
  std::vector<ImageId> batch;
  for (const ImageId image : ImagesBelow(world.cam_from_world.size())) {
    if (!builder.IsRegistered(image)) batch.push_back(image);
  }
  std::stable_sort(batch.begin(), batch.end(), [&](ImageId a, ImageId b) {
    return builder.VisiblePoints(a) > builder.VisiblePoints(b);
  });
  const auto first = builder.EstimatePose(batch[0], 15);
  const auto second = builder.EstimatePose(batch[1], 15);
  ASSERT_TRUE(first && second);
  builder.Register(batch[0], *first);
  builder.Register(batch[1], *second);
  // The distortion was taken off for the wrong focal length, which costs some per cent.
  EXPECT_NEAR(builder.Take().intrinsics.lenses[1].MeanFocal_px() / truth_px, 1.0, 0.03);
}

TEST_F(IncrementalTest, SmallModelsKeepTheirLenses) {
  SyntheticOptions synthetic;
  synthetic.columns = 12;
  synthetic.rows = 1;
  synthetic.points = 1200;
  synthetic.shared_lens = true;
  SyntheticWorld world = MakeSyntheticWorld(synthetic);
  Disconnect(world, ImagesBelow(3));
  IncrementalOptions options;
  options.refine_intrinsics = true;
  const auto result = Build(world, options);
  ASSERT_TRUE(result) << result.error().ToString();
  ASSERT_EQ(result->models.size(), 2u);
  EXPECT_TRUE(RefinesIntrinsics(RegisteredCount(result->models[0]), options));
  EXPECT_FALSE(RefinesIntrinsics(RegisteredCount(result->models[1]), options));
  const Reconstruction& small = result->models[1];
  EXPECT_NE(result->models[0].intrinsics.lenses[0].params, world.intrinsics.lenses[0].params);
  const std::vector<double>& truth = world.intrinsics.lenses[0].params;
  const std::vector<double>& held = small.intrinsics.lenses[0].params;
  for (size_t p = 0; p < held.size(); ++p) {
    if (IsFocal(small.intrinsics.lenses[0].model, p)) continue;
    EXPECT_EQ(held[p], truth[p]) << "parameter " << p;
  }
}

TEST_F(IncrementalTest, RefinesLensesThatStartWrong) {
  SyntheticOptions options;
  options.model = CameraModel::kSimpleRadial;
  options.shared_lens = true;
  options.points = 1200;
  SyntheticWorld world = MakeSyntheticWorld(options);
  const std::vector<double> truth = world.intrinsics.lenses[0].params;
  CameraIntrinsics& lens = world.intrinsics.lenses[0];
  lens.params[0] *= 1.06;
  lens.params[3] = 0.0;
  world.intrinsics.known = false;
  IncrementalOptions incremental;
  incremental.refine_intrinsics = true;
  const auto result = Build(world, incremental);
  ASSERT_TRUE(result) << result.error().ToString();
  ASSERT_TRUE(result->models.size() == 1 && result->unregistered.empty());
  const Reconstruction& model = result->models[0];
  const auto covariances = BuildPoseCovariances(model, world.features, true, context_);
  ASSERT_TRUE(covariances && covariances->focal_sigma_px[0]);
  EXPECT_NEAR(model.intrinsics.lenses[0].params[0], truth[0], 4 * *covariances->focal_sigma_px[0]);
  EXPECT_LT(*covariances->focal_sigma_px[0], 5.0);
  EXPECT_LT(ErrorsOf(model, world.cam_from_world).max_rotation_rad, RadFromDeg(0.3));
}

TEST_F(IncrementalTest, ADraftIsNearTheTruthButNotAdjustedToTheEnd) {
  const SyntheticWorld world = MakeSyntheticWorld({});
  const auto finished = Build(world, {});
  IncrementalOptions options;
  options.draft = true;
  const auto draft = Build(world, options);
  ASSERT_TRUE(finished && draft);
  ASSERT_EQ(draft->models.size(), 1u);
  EXPECT_TRUE(draft->unregistered.empty());
  const Reconstruction &rough = draft->models[0], &fine = finished->models[0];
  // Good enough to judge matches by: 0.1 degrees are 3 px.
  EXPECT_LT(ErrorsOf(rough, world.cam_from_world).max_rotation_rad, RadFromDeg(0.3));
  const ReprojectionSummary rough_residuals = SummarizeReprojection(rough, world.features);
  const ReprojectionSummary fine_residuals = SummarizeReprojection(fine, world.features);
  EXPECT_GT(rough_residuals.rms_px, fine_residuals.rms_px);
  // All tracks are triangulated all the same.
  EXPECT_GT(static_cast<double>(rough_residuals.observations),
            0.99 * static_cast<double>(fine_residuals.observations));
}

/// A draft from the images that `in_start` is true for: the others are taken out.
Reconstruction StartWith(const Reconstruction& draft,
                         const std::function<bool(ImageId)>& in_start) {
  Reconstruction start = draft;
  for (size_t i = 0; i < start.cam_from_model.size(); ++i) {
    if (!in_start(ImageId(i))) start.cam_from_model[i].reset();
  }
  for (Point3& point : start.points) {
    std::erase_if(point.observations,
                  [&](const Observation& o) { return !start.Registered(o.image); });
  }
  std::erase_if(start.points, [](const Point3& p) { return p.observations.size() < 2; });
  return start;
}

TEST_F(IncrementalTest, ExtendingADraftIsAsGoodAsBuildingAtOnce) {
  const SyntheticWorld world = MakeSyntheticWorld({});
  const auto at_once = Build(world, {});
  IncrementalOptions draft_options;
  draft_options.draft = true;
  const auto draft = Build(world, draft_options);
  ASSERT_TRUE(at_once && draft);
  // Of the whole, of two thirds of the ring, and of the whole a little out of place.
  const Reconstruction whole = draft->models[0];
  const Reconstruction part = StartWith(whole, [](ImageId image) { return image.index() < 16; });
  Reconstruction shaken = whole;
  test::NormalRandom random(5);
  for (auto& pose : shaken.cam_from_model) {
    const Eigen::Vector3d turn(random.Normal(), random.Normal(), random.Normal());
    pose->rotation = Eigen::AngleAxisd(RadFromDeg(0.1), turn.normalized()) * pose->rotation;
  }
  const test::PoseErrors expected = ErrorsOf(at_once->models[0], world.cam_from_world);
  for (const Reconstruction& start : {whole, part, shaken}) {
    const auto extended = ExtendReconstruction(world.Input(), start, {}, context_);
    ASSERT_TRUE(extended) << extended.error().ToString();
    ASSERT_EQ(extended->models.size(), 1u);
    EXPECT_TRUE(extended->unregistered.empty());
    EXPECT_EQ(NotNear(extended->models[0], world.cam_from_world, 1.2 * expected.max_rotation_rad,
                      1.2 * expected.max_position),
              "");
  }
}

TEST_F(IncrementalTest, ExtendingKeepsOutWhatDoesNotFitAndSaysWhy) {
  SyntheticWorld world = MakeSyntheticWorld({});
  IncrementalOptions draft_options;
  draft_options.draft = true;
  const auto draft = Build(world, draft_options);
  ASSERT_TRUE(draft);
  const ImageId wrong(4), alone(9);
  const Reconstruction start =
      StartWith(draft->models[0], [&](ImageId image) { return image != wrong && image != alone; });
  test::NormalRandom random(9);
  for (Keypoint& keypoint : world.features.images[wrong.index()].keypoints) {
    keypoint.x_px = static_cast<float>(1200 * random.Uniform());
    keypoint.y_px = static_cast<float>(1600 * random.Uniform());
  }
  Disconnect(world, {alone});
  const auto extended = ExtendReconstruction(world.Input(), start, {}, context_);
  ASSERT_TRUE(extended) << extended.error().ToString();
  ASSERT_EQ(extended->unregistered.size(), 2u);
  EXPECT_EQ(extended->unregistered[0].image, wrong);
  EXPECT_NE(extended->unregistered[0].reason.find("its best pose fits"), std::string::npos)
      << extended->unregistered[0].reason;
  EXPECT_EQ(extended->unregistered[1].image, alone);
  EXPECT_EQ(extended->unregistered[1].reason, "matches no other picture");
  EXPECT_FALSE(extended->models[0].Registered(wrong));
  EXPECT_LT(ErrorsOf(extended->models[0], world.cam_from_world).max_rotation_rad, RadFromDeg(0.3));
}

TEST_F(IncrementalTest, ExtendingFailsWhenTooFewImagesAreLeft) {
  SyntheticWorld world = MakeSyntheticWorld({});
  const auto built = Build(world, {});
  ASSERT_TRUE(built);
  world.two_views.pairs.clear();
  Disconnect(world, {});
  const auto extended = ExtendReconstruction(world.Input(), built->models[0], {}, context_);
  ASSERT_FALSE(extended);
  EXPECT_EQ(extended.error().code, ErrorCode::kFailed);
  std::stop_source stop;
  stop.request_stop();
  RunContext stopped{threads_, stop.get_token()};
  const SyntheticWorld whole = MakeSyntheticWorld({});
  const auto cancelled = ExtendReconstruction(whole.Input(), built->models[0], {}, stopped);
  ASSERT_FALSE(cancelled);
  EXPECT_EQ(cancelled.error().code, ErrorCode::kCancelled);
}

TEST_F(IncrementalTest, GivesTheSameBytesOnAnyNumberOfThreads) {
  SyntheticOptions options;
  options.wrong_match_share = 0.05;
  const SyntheticWorld world = MakeSyntheticWorld(options);
  const auto two = Build(world, {});
  ThreadPool single(1);
  RunContext alone{single};
  const auto one = BuildReconstructions(world.Input(), {}, alone);
  ASSERT_TRUE(one && two);
  EXPECT_EQ(test::Difference(one->models, two->models), "");
}

TEST_F(IncrementalTest, SaysWhatTheBestPairLackedWhenNoneStarts) {
  SyntheticWorld world = MakeSyntheticWorld({});
  for (TwoView& pair : world.two_views.pairs) pair.median_angle_rad = RadFromDeg(1.0);
  const auto result = Build(world, {});
  ASSERT_FALSE(result);
  EXPECT_EQ(result.error().code, ErrorCode::kFailed);
  EXPECT_NE(result.error().message.find("1.0"), std::string::npos) << result.error().message;
  world.two_views.pairs.clear();
  Disconnect(world, {});
  const auto none = Build(world, {});
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().message, "no two pictures match");
}

TEST_F(IncrementalTest, StopsWhenAskedToAndRefusesBadOptions) {
  const SyntheticWorld world = MakeSyntheticWorld({});
  std::stop_source stop;
  stop.request_stop();
  RunContext stopped{threads_, stop.get_token()};
  const auto cancelled = BuildReconstructions(world.Input(), {}, stopped);
  ASSERT_FALSE(cancelled);
  EXPECT_EQ(cancelled.error().code, ErrorCode::kCancelled);
  IncrementalOptions bad;
  bad.global_ba_growth = 1.0;
  const auto refused = Build(world, bad);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().context, "global_ba_growth");
  IncrementalOptions two;
  two.min_model_images = 2;
  EXPECT_EQ(two.Validate().error().context, "min_model_images");
}

}  // namespace
}  // namespace rotunda::sfm
