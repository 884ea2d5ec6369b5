#include "rig/sim/simulate.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <filesystem>
#include <opencv2/aruco.hpp>
#include <opencv2/aruco/charuco.hpp>
#include <opencv2/imgproc.hpp>

#include "sfm/core/file_io.h"
#include "sfm/core/frame_set.h"

namespace rotunda::sim {
namespace {

namespace fs = std::filesystem;

fs::path Fresh(const std::string& name) {
  const fs::path folder = fs::path(testing::TempDir()) / name;
  fs::remove_all(folder);
  return folder;
}

SimulateOptions SmallCuboid() {
  SimulateOptions options;
  options.target = Target::kCuboid;
  options.cameras = 5;
  options.picture_scale = 0.25;
  options.seed = 3;
  return options;
}

std::string AllBytes(const fs::path& folder) {
  std::vector<fs::path> files;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file()) files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  std::string bytes;
  for (const fs::path& file : files) {
    bytes += fs::relative(file, folder).string() + "\n" + ReadFile(file).value();
  }
  return bytes;
}

TEST(SimulateFrameSet, SameBytesOnOneAndOnThreeThreads) {
  SimulateOptions options;
  options.cameras = 4;
  options.picture_scale = 0.1;
  options.seed = 5;
  std::string bytes[2];
  for (int i = 0; i < 2; ++i) {
    ThreadPool threads(i == 0 ? 1 : 3);
    RunContext context{threads};
    const fs::path out = Fresh("threads" + std::to_string(i));
    const Status status = SimulateFrameSet({}, options, out, context);
    ASSERT_TRUE(status) << status.error().ToString();
    bytes[i] = AllBytes(out);
  }
  EXPECT_GT(bytes[0].size(), 20000u);
  EXPECT_EQ(bytes[0], bytes[1]);
}

TEST(SimulateFrameSet, ReadsBackAsAFrameSetWithTruth) {
  ThreadPool threads(2);
  RunContext context{threads};
  const fs::path out = Fresh("readback");
  ASSERT_TRUE(SimulateFrameSet({}, SmallCuboid(), out, context));
  const auto set = ReadFrameSet(out);
  ASSERT_TRUE(set) << set.error().ToString();
  const auto truth = ReadCalibration(out / "truth.json");
  ASSERT_TRUE(truth) << truth.error().ToString();
  ASSERT_EQ(set->frames.size(), 5u);
  for (size_t i = 0; i < set->frames.size(); ++i) {
    EXPECT_EQ(set->frames[i].camera, truth->cameras[i].camera);
    const auto picture = ReadPicture(set->PicturePath(ImageId(i)));
    ASSERT_TRUE(picture);
    EXPECT_EQ(picture->width, truth->cameras[i].intrinsics.width_px);
    EXPECT_EQ(picture->height, truth->cameras[i].intrinsics.height_px);
  }
  EXPECT_EQ(truth->source, CalibrationSource::kTruth);
  EXPECT_EQ(set->id, "simulated-3");
  EXPECT_EQ(truth->id, "simulated-3");
  EXPECT_EQ(set->trigger.at("source"), TriggerValue("simulated"));
}

TEST(SimulateFrameSet, RefusesBadOptionsAndLeavesNothing) {
  ThreadPool threads(1);
  RunContext context{threads};
  const fs::path out = Fresh("refused");
  SimulateOptions options;
  options.cameras = 91;
  Status status = SimulateFrameSet({}, options, out, context);
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().ToString(), "number of cameras is 91, expected 2 to 90 (the rig's)");
  options.cameras = 3;
  options.height_m = 3;
  status = SimulateFrameSet({}, options, out, context);
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().ToString(), "height of the body is 3, expected 0.8 to 2.2 m");
  options.height_m = 1.7;
  options.picture_scale = 0;
  status = SimulateFrameSet({}, options, out, context);
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().ToString(),
            "scale of the pictures is 0, expected more than 0.05, at most 2");
  options.picture_scale = 1;
  options.texture = GarmentTexture::kOwn;
  status = SimulateFrameSet({}, options, out, context);
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().context, "texture");
  EXPECT_FALSE(fs::exists(out));
}

TEST(SimulateFrameSet, StoppingLeavesNothing) {
  ThreadPool threads(1);
  std::stop_source stop;
  RunContext context{threads};
  context.stop = stop.get_token();
  context.progress = [&](std::string_view stage, size_t done, size_t) {
    if (stage == "pictures" && done == 2) stop.request_stop();
  };
  const fs::path parent = Fresh("stopped");
  fs::create_directory(parent);
  const Status status = SimulateFrameSet({}, SmallCuboid(), parent / "set", context);
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().code, ErrorCode::kCancelled);
  EXPECT_TRUE(fs::is_empty(parent));
}

cv::Mat GrayOf(const Picture& picture) {
  cv::Mat gray(picture.height, picture.width, CV_8UC1);
  for (int y = 0; y < picture.height; ++y) {
    for (int x = 0; x < picture.width; ++x) gray.at<uint8_t>(y, x) = picture.at(x, y)[1];
  }
  return gray;
}

/// Full-size pictures of the cuboid by cameras of DrawRig, without noise that matters.
class CuboidPictures : public testing::Test {
 protected:
  CuboidPictures() {
    options_.target = Target::kCuboid;
    options_.placement = 4;
    options_.background = Background::kPlain;
    rig_.sensor.full_well_e = 1e6;
    rig_.sensor.read_noise_e = 0;
    truth_ = DrawRig(rig_, 17, 4, 1.0);
    world_ = BuildWorld(rig_, options_, context_).value();
    scene_ = std::make_unique<RayScene>(RayScene::Build(world_, false).value());
  }
  cv::Mat Render(const CalibratedCamera& camera) {
    return GrayOf(RenderPicture(world_, *scene_, camera, rig_.sensor, options_));
  }

  ThreadPool threads_{2};
  RunContext context_{threads_};
  RigOptions rig_;
  SimulateOptions options_;
  Calibration truth_;
  World world_;
  std::unique_ptr<RayScene> scene_;
};

TEST_F(CuboidPictures, ChessboardCornersLieWhereTheTruthProjectsThem) {
  const Rigid3 rig_from_cuboid = CuboidPlacement(options_.placement);
  const CuboidOptions& cuboid = options_.cuboid;
  for (const CalibratedCamera& camera : truth_.cameras) {
    const cv::Mat gray = Render(camera);
    std::vector<cv::Point2f> predicted;
    for (int face = 0; face < kCuboidFaces; ++face) {
      const CuboidFaceFrame frame = FaceOf(cuboid, static_cast<CuboidFace>(face));
      const Eigen::Vector3d normal = rig_from_cuboid.rotation * frame.down.cross(frame.right);
      for (int row = 1; row < frame.rows; ++row) {
        for (int column = 1; column < frame.columns; ++column) {
          const double x_m = 1e-3 * (cuboid.margin_mm + column * cuboid.square_mm);
          const double y_m = 1e-3 * (cuboid.margin_mm + row * cuboid.square_mm);
          const Eigen::Vector3d corner = rig_from_cuboid * frame.At(x_m, y_m);
          const Eigen::Vector3d view = (camera.cam_from_rig.OriginInSource() - corner).normalized();
          if (view.dot(normal) < 0.5) continue;  // well visible ones
          const auto at = camera.intrinsics.Project(camera.cam_from_rig * corner);
          if (!at || at->x() < 40 || at->y() < 40 || at->x() > 1160 || at->y() > 1560) continue;
          // OpenCV's pixel centres lie on integers.
          predicted.emplace_back(static_cast<float>(at->x() - 0.5),
                                 static_cast<float>(at->y() - 0.5));
        }
      }
    }
    ASSERT_GT(predicted.size(), 60u);
    std::vector<cv::Point2f> found = predicted;
    cv::cornerSubPix(gray, found, {5, 5}, {-1, -1},
                     {cv::TermCriteria::EPS + cv::TermCriteria::COUNT, 50, 1e-4});
    cv::Point2f mean(0, 0);
    double squares = 0;
    for (size_t i = 0; i < found.size(); ++i) {
      mean += (found[i] - predicted[i]) / static_cast<float>(found.size());
      squares += (found[i] - predicted[i]).dot(found[i] - predicted[i]);
    }
    EXPECT_LT(cv::norm(mean), 0.02) << camera.camera;
    EXPECT_LT(std::sqrt(squares / static_cast<double>(found.size())), 0.10) << camera.camera;
  }
}

TEST_F(CuboidPictures, OpenCvReadsTheTagsOfTheRightFaces) {
  const Rigid3 rig_from_cuboid = CuboidPlacement(options_.placement);
  const auto dictionary = cv::aruco::getPredefinedDictionary(cv::aruco::DICT_APRILTAG_36h11);
  const CalibratedCamera& camera = truth_.cameras[1];
  std::vector<int> ids;
  std::vector<std::vector<cv::Point2f>> corners;
  cv::aruco::detectMarkers(Render(camera), dictionary, corners, ids);
  ASSERT_GT(ids.size(), 30u);
  // OpenCV's own board of each face says where a tag with this id is.
  for (int face = 0; face < kCuboidFaces; ++face) {
    const CuboidFaceFrame frame = FaceOf(options_.cuboid, static_cast<CuboidFace>(face));
    const auto board = cv::aruco::CharucoBoard::create(
        frame.columns, frame.rows, static_cast<float>(1e-3 * options_.cuboid.square_mm),
        static_cast<float>(1e-3 * options_.cuboid.marker_mm), dictionary);
    const double margin_m = 1e-3 * options_.cuboid.margin_mm;
    for (size_t i = 0; i < ids.size(); ++i) {
      const int local = ids[i] - frame.first_id;
      if (local < 0 || local >= static_cast<int>(board->ids.size())) continue;
      for (int k = 0; k < 4; ++k) {
        const cv::Point3f& p = board->objPoints[local][k];
        const Eigen::Vector3d corner = rig_from_cuboid * frame.At(margin_m + p.x, margin_m + p.y);
        const Eigen::Vector2d at = *camera.intrinsics.Project(camera.cam_from_rig * corner);
        EXPECT_LT((at - Eigen::Vector2d(corners[i][k].x + 0.5, corners[i][k].y + 0.5)).norm(), 2.0)
            << "id " << ids[i];
      }
    }
  }
}

TEST(Cuboid, FacesMeetAtTheEdgesAndIdsAreDisjoint) {
  const CuboidOptions options;
  int next_id = 0;
  for (int face = 0; face < kCuboidFaces; ++face) {
    const CuboidFaceFrame frame = FaceOf(options, static_cast<CuboidFace>(face));
    EXPECT_EQ(frame.first_id, next_id);
    next_id += frame.columns * frame.rows / 2;
    const Eigen::Vector3d outward = frame.down.cross(frame.right);
    const Eigen::Vector3d middle =
        frame.At(0.5 * frame.width_m, 0.5 * frame.height_m) - Eigen::Vector3d(0, 0, 0.77);
    EXPECT_GT(outward.dot(middle), 0.2) << face;
    if (face == static_cast<int>(CuboidFace::kTop)) continue;
    // The right edge is the next side's left edge.
    const CuboidFaceFrame next = FaceOf(options, static_cast<CuboidFace>((face + 1) % 4));
    EXPECT_LT((frame.At(frame.width_m, 0) - next.origin).norm(), 1e-12) << face;
  }
  EXPECT_LE(next_id, 587);
  const CuboidFaceFrame top = FaceOf(options, CuboidFace::kTop);
  const CuboidFaceFrame front = FaceOf(options, CuboidFace::kFront);
  EXPECT_LT((top.At(0, top.height_m) - front.origin).norm(), 1e-12);
}

}  // namespace
}  // namespace rotunda::sim
