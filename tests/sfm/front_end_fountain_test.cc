#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "sfm/features.h"
#include "sfm/image_io.h"
#include "sfm/intrinsics.h"
#include "sfm/matching.h"
#include "sfm/tracks.h"
#include "sfm/two_view.h"
#include "sfm/view_graph.h"
#include "tests/support/strecha.h"

namespace rotunda::sfm {
namespace {

namespace fs = std::filesystem;

constexpr double kReduction = 0.25;

/// Five neighbouring pictures of fountain-P11 (Strecha et al., CVPR 2008) at a quarter of their
/// size, with the truth at that size.
struct Fountain {
  FrameSet set;
  Calibration truth;
};

Fountain ReduceFountain(const fs::path& source, const fs::path& folder) {
  Fountain fountain;
  fountain.set.folder = folder;
  fountain.truth = test::ReadStrechaTruth(source);
  for (CalibratedCamera& camera : fountain.truth.cameras) {
    camera.intrinsics = ScaledIntrinsics(camera.intrinsics, kReduction);
  }
  for (const char* camera : {"0003", "0004", "0005", "0006", "0007"}) {
    const auto picture = ReadPicture(source / "images" / (std::string(camera) + ".jpg"), "");
    if (!picture.ok()) {
      ADD_FAILURE() << picture.error().ToString();
      continue;
    }
    cv::Mat reduced;
    cv::resize(*picture, reduced, {}, kReduction, kReduction, cv::INTER_AREA);
    Frame frame;
    frame.camera = camera;
    frame.file = frame.camera + ".png";
    cv::imwrite((folder / frame.file).string(), reduced);
    fountain.set.frames.push_back(frame);
  }
  return fountain;
}

class FountainTest : public testing::Test {
 protected:
  void SetUp() override {
    const auto shared = test::SharedFolder();
    if (!shared || !fs::exists(*shared / "data/strecha/fountain-P11")) {
      GTEST_SKIP() << "no fountain-P11 in the shared folder (set ROTUNDA_SHARED)";
    }
    folder_ = fs::temp_directory_path() / ("rotunda_fountain_" + std::to_string(::getpid()));
    fs::create_directories(folder_);
    fountain_ = ReduceFountain(*shared / "data/strecha/fountain-P11", folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  Rigid3 TrueSecondFromFirst(const ImagePair& pair) const {
    const auto pose = [&](ImageId id) {
      return fountain_.truth.Find(fountain_.set.frame(id).camera)->cam_from_rig;
    };
    return pose(pair.second) * pose(pair.first).Inverse();
  }

  fs::path folder_;
  Fountain fountain_;
};

TEST_F(FountainTest, EveryPairHasTheTruePose) {
  ThreadPool pool(2);
  RunContext context{pool};
  const auto features = BuildFeatures(fountain_.set, {}, context);
  ASSERT_TRUE(features.ok()) << features.error().ToString();
  std::vector<ImagePair> pairs;
  for (size_t i = 0; i < 5; ++i) {
    for (size_t j = i + 1; j < 5; ++j) pairs.push_back({ImageId(i), ImageId(j)});
  }
  const auto matches = BuildMatches(*features, pairs, {}, context);
  ASSERT_TRUE(matches.ok());
  const auto known = BuildIntrinsics(fountain_.set, *features, fountain_.truth);
  ASSERT_TRUE(known.ok()) << known.error().ToString();
  const auto guessed = BuildIntrinsics(fountain_.set, *features, {});
  ASSERT_TRUE(guessed.ok());

  const auto views = BuildTwoViews(*features, *known, *matches, {}, context);
  ASSERT_TRUE(views.ok());
  EXPECT_EQ(views->pairs.size(), pairs.size());
  for (const TwoView& view : views->pairs) {
    const Rigid3 truth = TrueSecondFromFirst(view.pair);
    const double rotation_deg =
        DegFromRad(RotationAngle_rad(truth.rotation, view.second_from_first.rotation));
    const double direction_deg = DegFromRad(
        std::acos(truth.translation.normalized().dot(view.second_from_first.translation)));
    // 0.3 px of 690 px focal length over 100 and more inliers.
    EXPECT_LT(rotation_deg, 0.3) << view.pair.first.index() << "-" << view.pair.second.index();
    EXPECT_LT(direction_deg, 0.8) << view.pair.first.index() << "-" << view.pair.second.index();
  }

  const Tracks tracks = BuildTracks(*features, *views, BuildViewGraph(*features, *views));
  ASSERT_FALSE(tracks.tracks.empty());
  EXPECT_EQ(tracks.tracks.front().observations.size(), 5U);

  // Without a calibration the same matches are verified.
  const auto uncalibrated = BuildTwoViews(*features, *guessed, *matches, {}, context);
  ASSERT_TRUE(uncalibrated.ok());
  ASSERT_EQ(uncalibrated->pairs.size(), views->pairs.size());
  for (size_t i = 0; i < views->pairs.size(); ++i) {
    EXPECT_GT(static_cast<double>(uncalibrated->pairs[i].inliers.size()),
              0.9 * static_cast<double>(views->pairs[i].inliers.size()));
  }
}

}  // namespace
}  // namespace rotunda::sfm
