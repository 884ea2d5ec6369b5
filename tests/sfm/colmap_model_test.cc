#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cstring>
#include <fstream>
#include <map>
#include <random>
#include <sstream>

#include "sfm/colmap_io.h"
#include "sfm/colmap_records.h"
#include "sfm/core/file_io.h"
#include "tests/support/process.h"

namespace rotunda::sfm {
namespace {

namespace fs = std::filesystem;
using test::RunProcess;
using test::TemporaryFolder;

constexpr uint64_t kSeed = 17;
constexpr size_t kImages = 6;
constexpr size_t kPoints = 80;

double Uniform(std::mt19937_64& random, double low, double high) {
  return low + (high - low) * static_cast<double>(random() >> 11) * 0x1p-53;
}

/// Points in a box, seen by cameras on an arc with two lenses; keypoints are off by up to a pixel;
/// every picture also has keypoints without a point.
struct World {
  Reconstruction reconstruction;
  Features features;
  FrameSet set;
};

Rigid3 CamFromRig(size_t image) {
  const double azimuth = 0.4 * static_cast<double>(image);
  const Eigen::Vector3d centre(3 * std::cos(azimuth), 3 * std::sin(azimuth), 0.5);
  Eigen::Matrix3d rotation;  // rows: camera axes in the rig frame
  rotation.row(2) = -centre.normalized();
  rotation.row(0) = rotation.row(2).cross(Eigen::RowVector3d(0, 0, 1)).normalized();
  rotation.row(1) = rotation.row(2).cross(rotation.row(0));
  const Eigen::Quaterniond cam_from_rig = Eigen::Quaterniond(rotation).normalized();
  return {cam_from_rig, -(cam_from_rig * centre)};
}

void AddLenses(World& world) {
  world.reconstruction.intrinsics.lenses = {
      {CameraModel::kOpencv, 1200, 1600, {1840, 1835, 611, 793, -0.08, 0.03, 8e-4, -5e-4}},
      {CameraModel::kSimpleRadial, 1000, 1400, {1700, 500, 700, -0.05}},
  };
}

void AddImage(size_t image, World& world) {
  const size_t lens = image % 2;
  Frame frame;
  frame.camera = "c" + std::string(1, static_cast<char>('0' + image));
  frame.file = "frames/" + frame.camera + ".png";
  world.set.frames.push_back(frame);
  world.reconstruction.intrinsics.lens_of_image.push_back(lens);
  world.reconstruction.cam_from_model.push_back(CamFromRig(image));
  ImageFeatures features;
  features.width_px = world.reconstruction.intrinsics.lenses[lens].width_px;
  features.height_px = world.reconstruction.intrinsics.lenses[lens].height_px;
  features.keypoints.push_back({12.5F, 7.25F, 2.0F, 0.5F});
  world.features.images.push_back(features);
}

World MakeWorld() {
  std::mt19937_64 random(kSeed);
  World world;
  AddLenses(world);
  for (size_t i = 0; i < kImages; ++i) AddImage(i, world);
  for (size_t i = 0; i < kPoints; ++i) {
    Point3 point;
    point.position = {Uniform(random, -0.4, 0.4), Uniform(random, -0.4, 0.4),
                      Uniform(random, 0.2, 0.8)};
    point.color_rgb = {static_cast<uint8_t>(random()), static_cast<uint8_t>(random()), 255};
    for (size_t image = i % 3; image < kImages; ++image) {
      const auto pixel = world.reconstruction.intrinsics.of(ImageId(image))
                             .Project(*world.reconstruction.cam_from_model[image] * point.position);
      auto& keypoints = world.features.images[image].keypoints;
      point.observations.push_back({ImageId(image), KeypointId(keypoints.size())});
      keypoints.push_back({static_cast<float>(pixel->x() + Uniform(random, -1, 1)),
                           static_cast<float>(pixel->y() + Uniform(random, -1, 1)), 2.0F, 0.0F});
    }
    world.reconstruction.points.push_back(point);
  }
  return world;
}

/// The poses' bits are compared up to the quaternion's normalisation on reading.
void ExpectSame(const ColmapModel& model, const World& world) {
  const Reconstruction& expected = world.reconstruction;
  ASSERT_EQ(model.reconstruction.cam_from_model.size(), expected.cam_from_model.size());
  ASSERT_EQ(model.reconstruction.intrinsics.lenses.size(), expected.intrinsics.lenses.size());
  EXPECT_EQ(model.reconstruction.intrinsics.lens_of_image, expected.intrinsics.lens_of_image);
  for (size_t i = 0; i < expected.intrinsics.lenses.size(); ++i) {
    EXPECT_EQ(model.reconstruction.intrinsics.lenses[i].model, expected.intrinsics.lenses[i].model);
    EXPECT_EQ(model.reconstruction.intrinsics.lenses[i].params,
              expected.intrinsics.lenses[i].params);
  }
  for (size_t i = 0; i < kImages; ++i) {
    EXPECT_EQ(model.image_names[i], world.set.frames[i].camera + ".png");
    EXPECT_EQ(model.reconstruction.cam_from_model[i]->translation,
              expected.cam_from_model[i]->translation);
    EXPECT_LT(RotationAngle_rad(model.reconstruction.cam_from_model[i]->rotation,
                                expected.cam_from_model[i]->rotation),
              1e-15);
    const auto& keypoints = world.features.images[i].keypoints;
    EXPECT_EQ(model.features.images[i].width_px, world.features.images[i].width_px);
    ASSERT_EQ(model.features.images[i].keypoints.size(), keypoints.size());
    for (size_t k = 0; k < keypoints.size(); ++k) {
      EXPECT_EQ(model.features.images[i].keypoints[k].x_px, keypoints[k].x_px);
      EXPECT_EQ(model.features.images[i].keypoints[k].y_px, keypoints[k].y_px);
    }
  }
  ASSERT_EQ(model.reconstruction.points.size(), expected.points.size());
  for (size_t i = 0; i < expected.points.size(); ++i) {
    EXPECT_EQ(model.reconstruction.points[i].position, expected.points[i].position);
    EXPECT_EQ(model.reconstruction.points[i].color_rgb, expected.points[i].color_rgb);
    EXPECT_EQ(model.reconstruction.points[i].observations, expected.points[i].observations);
  }
}

Status Write(const World& world, const fs::path& folder, ColmapEncoding encoding) {
  fs::create_directories(folder);
  return WriteColmapModel(world.reconstruction, world.features, world.set, folder, encoding);
}

/// "Points: 80" and the like of `colmap model_analyzer`.
std::map<std::string, double> Analyze(const fs::path& folder) {
  const auto outcome = RunProcess({"colmap", "model_analyzer", "--path", folder.string()});
  EXPECT_EQ(outcome.exit_code, 0) << outcome.errors;
  std::map<std::string, double> figures;
  std::istringstream lines(outcome.output);
  for (std::string line; std::getline(lines, line);) {
    const size_t colon = line.find(": ");
    if (colon != std::string::npos) {
      figures[line.substr(0, colon)] = std::strtod(line.c_str() + colon + 2, nullptr);
    }
  }
  return figures;
}

bool HasColmap() { return RunProcess({"colmap", "help"}).exit_code == 0; }

TEST(ColmapModel, ReadsWhatItWrites) {
  const World world = MakeWorld();
  for (const auto encoding : {ColmapEncoding::kBinary, ColmapEncoding::kText}) {
    const TemporaryFolder folder;
    ASSERT_TRUE(Write(world, folder.path(), encoding).ok());
    const auto model = ReadColmapModel(folder.path());
    ASSERT_TRUE(model.ok()) << model.error().ToString();
    ExpectSame(*model, world);
  }
}

TEST(ColmapModel, FilesOfOneNameKeepTheirFolder) {
  World world = MakeWorld();
  world.set.frames[1].file = "left/1.png";
  world.set.frames[4].file = "right/1.png";
  const TemporaryFolder folder;
  ASSERT_TRUE(Write(world, folder.path(), ColmapEncoding::kBinary).ok());
  const auto model = ReadColmapModel(folder.path());
  ASSERT_TRUE(model.ok()) << model.error().ToString();
  EXPECT_EQ(model->image_names,
            (std::vector<std::string>{"frames/c0.png", "left/1.png", "frames/c2.png",
                                      "frames/c3.png", "right/1.png", "frames/c5.png"}));
}

TEST(ColmapModel, LeavesOutUnregisteredImagesAndTheirLens) {
  World world = MakeWorld();
  for (const size_t image : {1, 3, 5}) world.reconstruction.cam_from_model[image].reset();
  for (Point3& point : world.reconstruction.points) {
    std::erase_if(point.observations,
                  [](const Observation& o) { return o.image.index() % 2 == 1; });
  }
  const TemporaryFolder folder;
  ASSERT_TRUE(Write(world, folder.path(), ColmapEncoding::kBinary).ok());
  const auto model = ReadColmapModel(folder.path());
  ASSERT_TRUE(model.ok()) << model.error().ToString();
  EXPECT_EQ(model->image_names, (std::vector<std::string>{"c0.png", "c2.png", "c4.png"}));
  EXPECT_EQ(model->reconstruction.intrinsics.lenses.size(), 1u);
  const auto records =
      DecodeColmapBinary({*ReadFile(folder / "cameras.bin"), *ReadFile(folder / "images.bin"),
                          *ReadFile(folder / "points3D.bin")});
  ASSERT_TRUE(records.ok());
  EXPECT_EQ(records->images[2].id, 5u) << "ImageId + 1";
  EXPECT_EQ(records->cameras[0].id, 1u) << "lens + 1";
}

TEST(ColmapModel, ColmapAgreesOnCountsAndMeanError) {
  if (!HasColmap()) GTEST_SKIP() << "colmap is not installed";
  const World world = MakeWorld();
  const ReprojectionSummary expected = SummarizeReprojection(world.reconstruction, world.features);
  for (const auto encoding : {ColmapEncoding::kBinary, ColmapEncoding::kText}) {
    const TemporaryFolder folder;
    ASSERT_TRUE(Write(world, folder.path(), encoding).ok());
    auto figures = Analyze(folder.path());
    EXPECT_EQ(figures["Cameras"], 2);
    EXPECT_EQ(figures["Images"], kImages);
    EXPECT_EQ(figures["Registered images"], kImages);
    EXPECT_EQ(figures["Points"], kPoints);
    EXPECT_EQ(figures["Observations"], static_cast<double>(expected.observations));
    EXPECT_NEAR(figures["Mean reprojection error"], expected.mean_over_points_px, 1e-6)
        << "printed to six places";
  }
}

TEST(ColmapModel, ColmapsOwnProjectionGivesOurResiduals) {
  if (!HasColmap()) GTEST_SKIP() << "colmap is not installed";
  // The initial cost of colmap's bundle adjuster comes from its own projection of our numbers.
  const World world = MakeWorld();
  const TemporaryFolder folder;
  ASSERT_TRUE(Write(world, folder / "in", ColmapEncoding::kBinary).ok());
  fs::create_directory(folder / "out");
  const auto outcome = RunProcess(
      {"colmap", "bundle_adjuster", "--input_path", (folder / "in").string(), "--output_path",
       (folder / "out").string(), "--BundleAdjustment.max_num_iterations", "1"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.errors;
  const std::string text = outcome.output + outcome.errors;
  const size_t place = text.find("Initial cost :");
  ASSERT_NE(place, std::string::npos) << text;
  // Its figure is sqrt(cost / residuals) with cost = half the sum of squares and two residuals an
  // observation, so rms = 2 * figure.
  const double figure_px = std::strtod(text.c_str() + place + 14, nullptr);
  const double rms_px = SummarizeReprojection(world.reconstruction, world.features).rms_px;
  EXPECT_NEAR(2 * figure_px, rms_px, 1e-5 * rms_px);
}

TEST(ColmapModel, ReadsWhatColmapConverts) {
  if (!HasColmap()) GTEST_SKIP() << "colmap is not installed";
  const World world = MakeWorld();
  const TemporaryFolder folder;
  ASSERT_TRUE(Write(world, folder / "bin", ColmapEncoding::kBinary).ok());
  const std::vector<std::array<std::string, 3>> steps = {{"bin", "txt", "TXT"},
                                                         {"txt", "bin2", "BIN"}};
  for (const auto& [from, to, type] : steps) {
    fs::create_directory(folder / to);
    const auto outcome =
        RunProcess({"colmap", "model_converter", "--input_path", (folder / from).string(),
                    "--output_path", (folder / to).string(), "--output_type", type});
    ASSERT_EQ(outcome.exit_code, 0) << outcome.errors;
    const auto model = ReadColmapModel(folder / to);
    ASSERT_TRUE(model.ok()) << model.error().ToString();
    // COLMAP orders points by hash and prints 17 digits: compare what does not depend on order.
    EXPECT_EQ(model->image_names.size(), kImages);
    const auto read = SummarizeReprojection(model->reconstruction, model->features);
    const auto expected = SummarizeReprojection(world.reconstruction, world.features);
    EXPECT_EQ(read.observations, expected.observations);
    EXPECT_NEAR(read.rms_px, expected.rms_px, 1e-9);
    EXPECT_NEAR(read.mean_over_points_px, expected.mean_over_points_px, 1e-9);
  }
}

TEST(ColmapModel, EveryCutIsNoticed) {
  const World world = MakeWorld();
  const TemporaryFolder folder;
  ASSERT_TRUE(Write(world, folder.path(), ColmapEncoding::kBinary).ok());
  for (const char* name : {"cameras.bin", "images.bin", "points3D.bin"}) {
    const std::string whole = *ReadFile(folder / name);
    for (size_t size = 0; size < whole.size(); size += 1 + whole.size() / 60) {
      std::ofstream(folder / name, std::ios::trunc) << whole.substr(0, size);
      const auto model = ReadColmapModel(folder.path());
      ASSERT_FALSE(model.ok()) << name << " of " << size << " bytes";
      EXPECT_EQ(model.error().code, ErrorCode::kBadInput);
      EXPECT_NE(model.error().ToString().find(name), std::string::npos) << model.error().ToString();
    }
    std::ofstream(folder / name, std::ios::trunc) << whole << "x";
    EXPECT_NE(ReadColmapModel(folder.path())
                  .error()
                  .ToString()
                  .find("1 bytes are left after the last record"),
              std::string::npos);
    std::ofstream(folder / name, std::ios::trunc) << whole;
  }
  EXPECT_TRUE(ReadColmapModel(folder.path()).ok());
}

TEST(ColmapModel, ABrokenCountAsksForNoMemory) {
  const TemporaryFolder folder;
  ASSERT_TRUE(Write(MakeWorld(), folder.path(), ColmapEncoding::kBinary).ok());
  std::string bytes = *ReadFile(folder / "points3D.bin");
  std::memset(bytes.data(), 0xFE, 8);
  std::ofstream(folder / "points3D.bin", std::ios::trunc) << bytes;
  EXPECT_NE(
      ReadColmapModel(folder.path()).error().ToString().find("points3D.bin: number of points"),
      std::string::npos);
}

/// A model of one image and one point, changed by `change`, and what reading it says.
template <typename Change>
std::string ErrorOfChanged(Change change) {
  const World world = MakeWorld();
  const TemporaryFolder folder;
  EXPECT_TRUE(Write(world, folder.path(), ColmapEncoding::kBinary).ok());
  ColmapRecords records =
      *DecodeColmapBinary({*ReadFile(folder / "cameras.bin"), *ReadFile(folder / "images.bin"),
                           *ReadFile(folder / "points3D.bin")});
  change(records);
  const ColmapFiles files = EncodeColmapBinary(records);
  std::ofstream(folder / "cameras.bin", std::ios::trunc) << files.cameras;
  std::ofstream(folder / "images.bin", std::ios::trunc) << files.images;
  std::ofstream(folder / "points3D.bin", std::ios::trunc) << files.points;
  const auto model = ReadColmapModel(folder.path());
  if (model.ok()) return "ok";
  return model.error().ToString().substr(folder.path().string().size() + 2);
}

TEST(ColmapModel, NamesTheRecordThatDoesNotFit) {
  EXPECT_EQ(ErrorOfChanged([](ColmapRecords&) {}), "ok");
  EXPECT_EQ(ErrorOfChanged([](ColmapRecords& r) { r.images[1].camera_id = 9; }),
            "images.bin: image 2: its camera 9 is not in cameras.bin");
  EXPECT_EQ(ErrorOfChanged([](ColmapRecords& r) {
              r.images[1].rotation_wxyz = {0, 0, 0, 0};
            }),
            "images.bin: image 2: its pose is not a rotation and finite numbers");
  EXPECT_EQ(ErrorOfChanged([](ColmapRecords& r) { r.images[1].points[3].x_px = NAN; }),
            "images.bin: image 2: a keypoint's position is not a finite number");
  EXPECT_EQ(ErrorOfChanged([](ColmapRecords& r) { r.images[1].name = r.images[0].name; }),
            "images.bin: image 2: its name \"c0.png\" occurs twice");
  EXPECT_EQ(ErrorOfChanged([](ColmapRecords& r) { r.images[1].id = r.images[0].id; }),
            "images.bin: an image's id occurs twice");
  EXPECT_EQ(ErrorOfChanged([](ColmapRecords& r) { r.cameras[1].id = r.cameras[0].id; }),
            "cameras.bin: a camera's id occurs twice");
  EXPECT_EQ(ErrorOfChanged([](ColmapRecords& r) { r.cameras[0].intrinsics.params[0] = -1; }),
            "cameras.bin: camera 1: OPENCV: the focal length is not positive");
  EXPECT_EQ(ErrorOfChanged([](ColmapRecords& r) { r.points[4].track[0].image_id = 77; }),
            "points3D.bin: point 5: its image 77 is not in images.bin");
  EXPECT_EQ(ErrorOfChanged([](ColmapRecords& r) { r.points[0].track[0].point_index = 5000; }),
            "points3D.bin: point 1: keypoint 5000 of image 1 does not exist, it has 28");
  EXPECT_EQ(ErrorOfChanged([](ColmapRecords& r) { r.points[0].position[2] = INFINITY; }),
            "points3D.bin: point 1: its position is not finite numbers");
}

TEST(ColmapModel, NamesTheLineOfTextThatDoesNotFit) {
  const auto error = [](const ColmapFiles& files) {
    const auto records = DecodeColmapText(files);
    return records.ok() ? "ok" : records.error().ToString();
  };
  const std::string cameras = "# comment\n\n1 PINHOLE 100 80 50 50 50 40\n";
  const std::string images = "1 1 0 0 0 0 0 0 1 a.png\n1.5 2.5 -1 3 4 7\n";
  const std::string points = "7 0 0 1 10 20 30 0.5 1 1\n";
  EXPECT_EQ(error({cameras, images, points}), "ok");
  EXPECT_EQ(error({"1 FOV 100 80 1 2 3 4 5\n", images, points})
                .find("cameras.txt: line 1: camera "
                      "model 'FOV' is not known"),
            0u);
  EXPECT_EQ(error({"# c\n1 PINHOLE wide 80 50\n", images, points}),
            "cameras.txt: line 2: expected a width, found \"wide\"");
  EXPECT_EQ(error({cameras, "1 1 0 0 0 0 0 0\n", points}),
            "images.txt: line 1: expected a camera's id, the line ends");
  EXPECT_EQ(error({cameras, "1 1 0 0 0 0 0 0 1 a.png", points}),
            "images.txt: line 1: the line with the image's points is missing");
  EXPECT_EQ(error({cameras, "1 1 0 0 0 0 0 0 1 a.png\n1.5 2.5\n", points}),
            "images.txt: line 2: expected a point's id, the line ends");
  EXPECT_EQ(error({cameras, images, "7 0 0 1 10 20 300 0.5 1 1\n"}),
            "points3D.txt: line 1: expected a colour from 0 to 255, found \"300\"");
  EXPECT_EQ(error({cameras, images, "7 0 0 1 10 20 30 0.5 1\n"}),
            "points3D.txt: line 1: expected the index of an image's point, the line ends");
}

TEST(ColmapModel, KeepsOneObservationOfAPicture) {
  World world = MakeWorld();
  const TemporaryFolder folder;
  ASSERT_TRUE(Write(world, folder.path(), ColmapEncoding::kBinary).ok());
  ColmapRecords records =
      *DecodeColmapBinary({*ReadFile(folder / "cameras.bin"), *ReadFile(folder / "images.bin"),
                           *ReadFile(folder / "points3D.bin")});
  records.points[0].track.push_back({records.points[0].track[0].image_id, 0});
  std::ofstream(folder / "points3D.bin", std::ios::trunc) << EncodeColmapBinary(records).points;
  const auto model = ReadColmapModel(folder.path());
  ASSERT_TRUE(model.ok());
  const auto& observations = model->reconstruction.points[0].observations;
  EXPECT_EQ(observations.size(), world.reconstruction.points[0].observations.size());
  EXPECT_EQ(observations[0].keypoint, KeypointId(0));
}

TEST(ColmapModel, RefusesToWriteWhatColmapCannotRead) {
  World world = MakeWorld();
  const TemporaryFolder folder;
  world.reconstruction.points[1].observations[0] = world.reconstruction.points[0].observations[1];
  const Status twice = Write(world, folder.path(), ColmapEncoding::kBinary);
  ASSERT_FALSE(twice.ok());
  EXPECT_EQ(twice.error().code, ErrorCode::kInvalidArgument);
  world = MakeWorld();
  world.set.frames[2].file = "frames/left camera.png";
  EXPECT_TRUE(Write(world, folder.path(), ColmapEncoding::kBinary).ok());
  EXPECT_EQ(Write(world, folder.path(), ColmapEncoding::kText).error().ToString(),
            "left camera.png: COLMAP's text format cannot hold a name with white space in it");
}

TEST(ColmapModel, SaysWhatIsMissing) {
  const TemporaryFolder folder;
  const auto model = ReadColmapModel(folder.path());
  ASSERT_FALSE(model.ok());
  EXPECT_EQ(model.error().code, ErrorCode::kNotFound);
  EXPECT_EQ(model.error().ToString(),
            folder.path().string() +
                ": expected cameras.bin, images.bin and points3D.bin (or the same as .txt)");
  const World world = MakeWorld();
  EXPECT_EQ(WriteColmapModel(world.reconstruction, world.features, world.set, folder / "none",
                             ColmapEncoding::kBinary)
                .error()
                .code,
            ErrorCode::kIo);
}

TEST(Ply, HoldsEveryPoint) {
  const World world = MakeWorld();
  const TemporaryFolder folder;
  ASSERT_TRUE(WritePly(world.reconstruction, folder / "points.ply").ok());
  const std::string bytes = *ReadFile(folder / "points.ply");
  const std::string end = "end_header\n";
  const size_t body = bytes.find(end) + end.size();
  EXPECT_EQ(bytes.find("ply\nformat binary_little_endian 1.0\nelement vertex 80\n"), 0u);
  ASSERT_EQ(bytes.size() - body, kPoints * 15);
  for (size_t i = 0; i < kPoints; ++i) {
    float position[3];
    std::memcpy(position, bytes.data() + body + 15 * i, sizeof(position));
    const Point3& point = world.reconstruction.points[i];
    for (int axis = 0; axis < 3; ++axis) {
      EXPECT_EQ(position[axis], static_cast<float>(point.position[axis]));
      EXPECT_EQ(static_cast<uint8_t>(bytes[body + 15 * i + 12 + axis]), point.color_rgb[axis]);
    }
  }
}

}  // namespace
}  // namespace rotunda::sfm
