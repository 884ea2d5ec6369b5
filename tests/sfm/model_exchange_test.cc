#include "sfm/model_exchange.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

#include "sfm/core/file_io.h"
#include "tests/support/process.h"
#include "tests/support/synthetic_world.h"

// Each format is read back by a few lines that know nothing of the writer, and the points are
// projected by the equations that the format's own documentation gives.

namespace rotunda::sfm {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;
using test::TemporaryFolder;

constexpr uint64_t kSeed = 5;
// Numbers are written with all their digits: what is left is rounding.
constexpr double kRounding_px = 1e-7;

struct Model {
  Reconstruction reconstruction;
  std::vector<std::string> names;
};

/// Cameras with a lens each (or one for all), the third one not registered. fx and fy differ, where
/// the lens model has both.
Model MakeModel(CameraModel lens, bool shared_lens = false) {
  test::SyntheticOptions options;
  options.model = lens;
  options.columns = 6;
  options.points = 300;
  options.shared_lens = shared_lens;
  options.noise_px = 0;
  options.seed = kSeed;
  const test::SyntheticWorld world = test::MakeSyntheticWorld(options);
  Model model{test::TrueReconstruction(world), {}};
  for (CameraIntrinsics& each : model.reconstruction.intrinsics.lenses) {
    if (each.params.size() > 1 && IsFocal(lens, 1)) each.params[1] *= 1.003;
    if (lens == CameraModel::kFullOpencv) {
      each.params[8] = 0.02;
      std::fill_n(each.params.begin() + 9, 3, 0.0);
    }
  }
  for (size_t i = 0; i < model.reconstruction.cam_from_model.size(); ++i) {
    model.names.push_back("c" + std::to_string(100 + i) + ".png");
  }
  model.reconstruction.cam_from_model[2].reset();
  return model;
}

using Projection = std::function<Eigen::Vector2d(const Eigen::Vector3d&)>;

/// Every registered picture is there, no other is, and every observed point is where the
/// reconstruction has it.
void ExpectSameProjections(const Model& model, const std::map<std::string, Projection>& read) {
  EXPECT_EQ(read.size(), RegisteredCount(model.reconstruction));
  size_t compared = 0;
  for (const Point3& point : model.reconstruction.points) {
    for (const Observation& observation : point.observations) {
      if (!model.reconstruction.Registered(observation.image)) continue;
      const std::string stem = fs::path(model.names[observation.image.index()]).stem();
      ASSERT_TRUE(read.contains(stem)) << stem;
      const Rigid3& pose = *model.reconstruction.cam_from_model[observation.image.index()];
      const auto expected =
          model.reconstruction.intrinsics.of(observation.image).Project(pose * point.position);
      ASSERT_TRUE(expected.has_value());
      EXPECT_LT((read.at(stem)(point.position) - *expected).norm(), kRounding_px) << stem;
      ++compared;
    }
  }
  EXPECT_GT(compared, 500u);
}

std::vector<double> Numbers(const std::string& text) {
  std::istringstream words(text);
  std::vector<double> numbers;
  for (std::string word; words >> word;) numbers.push_back(std::strtod(word.c_str(), nullptr));
  return numbers;
}

/// The text after `begin` up to `end`, from `*place` on, which goes behind it; "" and npos when
/// there is none.
std::string Between(const std::string& text, const std::string& begin, const std::string& end,
                    size_t* place) {
  const size_t found = text.find(begin, *place);
  if (found == std::string::npos) {
    *place = found;
    return "";
  }
  const size_t from = found + begin.size();
  *place = text.find(end, from);
  return text.substr(from, *place - from);
}
std::string Between(const std::string& text, const std::string& begin, const std::string& end) {
  size_t place = 0;
  return Between(text, begin, end, &place);
}

std::string Read(const fs::path& file) {
  const auto text = ReadFile(file);
  EXPECT_TRUE(text.ok()) << file;
  return text.ok() ? *text : "";
}

// --- nerfstudio: "Data conventions" (x right, y up, z back; camera to world), lens as in
// camera_utils.py: radial and OpenCV's tangential, on the coordinates of OpenCV's axes.

std::map<std::string, Projection> ReadNerfstudio(const fs::path& folder) {
  std::map<std::string, Projection> read;
  const Json document = Json::parse(Read(folder / "transforms.json"));
  EXPECT_EQ(document["camera_model"], "OPENCV");
  for (const Json& frame : document["frames"]) {
    Eigen::Matrix4d world_from_camera;
    for (int row = 0; row < 4; ++row) {
      for (int column = 0; column < 4; ++column) {
        world_from_camera(row, column) = frame["transform_matrix"][row][column];
      }
    }
    EXPECT_EQ(frame["file_path"].get<std::string>().find("images/"), 0u);
    read[fs::path(frame["file_path"].get<std::string>()).stem()] = [=](const Eigen::Vector3d& X) {
      const Eigen::Vector4d in_camera = world_from_camera.inverse() * X.homogeneous();
      const double x = in_camera.x() / -in_camera.z();
      const double y = -in_camera.y() / -in_camera.z();
      const double r = x * x + y * y;
      const double k1 = frame["k1"], k2 = frame["k2"], k3 = frame["k3"];
      const double p1 = frame["p1"], p2 = frame["p2"];
      const double d = 1 + r * (k1 + r * (k2 + r * k3));
      const double distorted_x = d * x + 2 * p1 * x * y + p2 * (r + 2 * x * x);
      const double distorted_y = d * y + 2 * p2 * x * y + p1 * (r + 2 * y * y);
      return Eigen::Vector2d(frame["fl_x"].get<double>() * distorted_x + frame["cx"].get<double>(),
                             frame["fl_y"].get<double>() * distorted_y + frame["cy"].get<double>());
    };
  }
  return read;
}

// --- Metashape: user manual, appendix "Camera models", frame cameras.

std::map<std::string, Projection> ReadMetashape(const fs::path& folder) {
  const std::string text = Read(folder / "cameras.xml");
  std::map<std::string, std::string> sensors;
  for (size_t place = 0;;) {
    const std::string sensor = Between(text, "<sensor id=", "</sensor>", &place);
    if (place == std::string::npos) break;
    sensors[Between(sensor, "\"", "\"")] = sensor;
  }
  std::map<std::string, Projection> read;
  for (size_t place = 0;;) {
    const std::string camera = Between(text, "<camera id=", "</camera>", &place);
    if (place == std::string::npos) break;
    const std::string& sensor = sensors.at(Between(camera, "sensor_id=\"", "\""));
    const auto value = [&sensor](const std::string& name) {
      return Numbers(Between(sensor, "<" + name + ">", "</" + name + ">")).at(0);
    };
    const double w = Numbers(Between(sensor, "width=\"", "\"")).at(0);
    const double h = Numbers(Between(sensor, "height=\"", "\"")).at(0);
    const double f = value("f"), cx = value("cx"), cy = value("cy"), b1 = value("b1");
    const double b2 = value("b2"), k1 = value("k1"), k2 = value("k2"), k3 = value("k3");
    const double p1 = value("p1"), p2 = value("p2");
    const std::vector<double> numbers = Numbers(Between(camera, "<transform>", "</transform>"));
    EXPECT_EQ(numbers.size(), 16u);
    const Eigen::Matrix4d chunk_from_camera =
        Eigen::Map<const Eigen::Matrix4d>(numbers.data()).transpose();
    read[Between(camera, "label=\"", "\"")] = [=](const Eigen::Vector3d& X) {
      const Eigen::Vector4d in_camera = chunk_from_camera.inverse() * X.homogeneous();
      const double x = in_camera.x() / in_camera.z();
      const double y = in_camera.y() / in_camera.z();
      const double r2 = x * x + y * y;
      const double radial = 1 + k1 * r2 + k2 * r2 * r2 + k3 * r2 * r2 * r2;
      const double x1 = x * radial + (p1 * (r2 + 2 * x * x) + 2 * p2 * x * y);
      const double y1 = y * radial + (p2 * (r2 + 2 * y * y) + 2 * p1 * x * y);
      return Eigen::Vector2d(w * 0.5 + cx + x1 * f + x1 * b1 + y1 * b2, h * 0.5 + cy + y1 * f);
    };
  }
  return read;
}

// --- RealityCapture: "RealityCapture XMP camera math", and its OpenCV export's order of t1, t2.

std::map<std::string, Projection> ReadRealityCapture(const fs::path& folder, double w, double h) {
  std::map<std::string, Projection> read;
  for (const auto& entry : fs::directory_iterator(folder)) {
    EXPECT_EQ(entry.path().extension(), ".xmp");
    const std::string text = Read(entry.path());
    EXPECT_EQ(Between(text, "xcr:DistortionModel=\"", "\""), "brown3t2");
    const auto attribute = [&text](const std::string& name) {
      return Numbers(Between(text, "xcr:" + name + "=\"", "\"")).at(0);
    };
    const auto element = [&text](const std::string& name) {
      return Numbers(Between(text, "<xcr:" + name + ">", "</xcr:" + name + ">"));
    };
    const double scale = std::max(w, h);
    const double f = attribute("FocalLength35mm") / 36 * scale;
    const double fy = f * attribute("AspectRatio");
    const double u0 = w / 2 + scale * attribute("PrincipalPointU");
    const double v0 = h / 2 + scale * attribute("PrincipalPointV");
    const std::vector<double> rotation = element("Rotation"), position = element("Position");
    const std::vector<double> c = element("DistortionCoeficients");
    EXPECT_EQ(rotation.size(), 9u);
    EXPECT_EQ(c.size(), 6u);
    const Eigen::Matrix3d R = Eigen::Map<const Eigen::Matrix3d>(rotation.data()).transpose();
    const Eigen::Vector3d C(position.at(0), position.at(1), position.at(2));
    read[entry.path().stem()] = [=](const Eigen::Vector3d& X) {
      const Eigen::Vector3d in_camera = R * (X - C);
      const double x = in_camera.x() / in_camera.z(), y = in_camera.y() / in_camera.z();
      const double r = x * x + y * y;
      const double radial = 1 + c[0] * r + c[1] * r * r + c[2] * r * r * r + c[3] * r * r * r * r;
      const double t1 = c[4], t2 = c[5];
      const double xd = x * radial + t1 * (r + 2 * x * x) + 2 * t2 * x * y;
      const double yd = y * radial + t2 * (r + 2 * y * y) + 2 * t1 * x * y;
      return Eigen::Vector2d(u0 + f * xd, v0 + fy * yd);
    };
  }
  return read;
}

class ModelExchange : public testing::TestWithParam<CameraModel> {
 protected:
  const TemporaryFolder folder_;
};

TEST_P(ModelExchange, NerfstudioProjectsTheSame) {
  const Model model = MakeModel(GetParam());
  ASSERT_TRUE(WriteNerfstudioModel(model.reconstruction, model.names, folder_.path()).ok());
  ExpectSameProjections(model, ReadNerfstudio(folder_.path()));
  const Json document = Json::parse(Read(folder_ / "transforms.json"));
  EXPECT_EQ(document["applied_transform"],
            Json::parse("[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]"));
  const std::string points = Read(folder_ / document["ply_file_path"].get<std::string>());
  EXPECT_NE(points.find("element vertex " + std::to_string(model.reconstruction.points.size())),
            std::string::npos);
}

TEST_P(ModelExchange, MetashapeProjectsTheSame) {
  for (const bool shared_lens : {false, true}) {
    const Model model = MakeModel(GetParam(), shared_lens);
    ASSERT_TRUE(WriteMetashapeModel(model.reconstruction, model.names, folder_.path()).ok());
    ExpectSameProjections(model, ReadMetashape(folder_.path()));
    const std::string sensors = Between(Read(folder_ / "cameras.xml"), "<sensors next_id=\"", "\"");
    EXPECT_EQ(sensors, shared_lens ? "1" : std::to_string(RegisteredCount(model.reconstruction)));
  }
}

TEST_P(ModelExchange, RealityCaptureProjectsTheSame) {
  const Model model = MakeModel(GetParam());
  ASSERT_TRUE(WriteRealityCaptureModel(model.reconstruction, model.names, folder_.path()).ok());
  ExpectSameProjections(model, ReadRealityCapture(folder_.path(), 1200, 1600));
}

INSTANTIATE_TEST_SUITE_P(Lenses, ModelExchange,
                         testing::Values(CameraModel::kSimplePinhole, CameraModel::kPinhole,
                                         CameraModel::kSimpleRadial, CameraModel::kRadial,
                                         CameraModel::kOpencv, CameraModel::kFullOpencv),
                         [](const auto& lens) { return std::string(CameraModelName(lens.param)); });

/// At (3, 0, 1), looking along -x, its right along +y: what is up in the picture is up in the rig.
Model OneCamera() {
  Eigen::Matrix3d rotation;
  rotation << 0, 1, 0, 0, 0, -1, -1, 0, 0;
  const Eigen::Quaterniond cam_from_rig(rotation);
  Model model;
  model.names = {"c0.png"};
  model.reconstruction.intrinsics.lenses = {
      {CameraModel::kOpencv, 1200, 1600, {1840, 1835, 611, 793, -0.08, 0.03, 8e-4, -5e-4}}};
  model.reconstruction.intrinsics.lens_of_image = {0};
  model.reconstruction.cam_from_model = {
      Rigid3{cam_from_rig, -(cam_from_rig * Eigen::Vector3d(3, 0, 1))}};
  return model;
}

void ExpectNear(const std::vector<double>& found, const std::vector<double>& expected) {
  ASSERT_EQ(found.size(), expected.size());
  for (size_t i = 0; i < found.size(); ++i) EXPECT_NEAR(found[i], expected[i], 1e-12) << i;
}

TEST(ModelExchangeByHand, NerfstudioHasAxesUpAndBack) {
  const Model model = OneCamera();
  const TemporaryFolder folder;
  ASSERT_TRUE(WriteNerfstudioModel(model.reconstruction, model.names, folder.path()).ok());
  const Json frame = Json::parse(Read(folder / "transforms.json"))["frames"].at(0);
  EXPECT_EQ(frame["file_path"], "images/c0.png");
  EXPECT_EQ(frame["w"], 1200);
  EXPECT_EQ(frame["h"], 1600);
  const std::map<std::string, double> lens = {{"fl_x", 1840}, {"fl_y", 1835}, {"cx", 611},
                                              {"cy", 793},    {"k1", -0.08},  {"k2", 0.03},
                                              {"k3", 0},      {"p1", 8e-4},   {"p2", -5e-4}};
  for (const auto& [name, value] : lens) EXPECT_EQ(frame[name], value) << name;
  // Columns: right = +y, up = +z, back = +x, and where it is.
  ExpectNear(frame["transform_matrix"][0].get<std::vector<double>>(), {0, 0, 1, 3});
  ExpectNear(frame["transform_matrix"][1].get<std::vector<double>>(), {1, 0, 0, 0});
  ExpectNear(frame["transform_matrix"][2].get<std::vector<double>>(), {0, 1, 0, 1});
  ExpectNear(frame["transform_matrix"][3].get<std::vector<double>>(), {0, 0, 0, 1});
}

TEST(ModelExchangeByHand, MetashapeHasItsOwnOrder) {
  const Model model = OneCamera();
  const TemporaryFolder folder;
  ASSERT_TRUE(WriteMetashapeModel(model.reconstruction, model.names, folder.path()).ok());
  const std::string text = Read(folder / "cameras.xml");
  for (const char* part : {"<resolution width=\"1200\" height=\"1600\"/>", "<f>1835</f>",
                           "<b1>5</b1>", "<cx>11</cx>", "<cy>-7</cy>", "<k1>-0.08</k1>",
                           "<k2>0.03</k2>", "<p1>-5e-04</p1>", "<p2>8e-04</p2>", "label=\"c0\""}) {
    EXPECT_NE(text.find(part), std::string::npos) << part << "\n" << text;
  }
  const size_t cameras = text.find("<cameras");
  ExpectNear(Numbers(Between(text.substr(cameras), "<transform>", "</transform>")),
             {0, 0, -1, 3, 1, 0, 0, 0, 0, -1, 0, 1, 0, 0, 0, 1});
}

TEST(ModelExchangeByHand, RealityCaptureCountsInTheLongerSide) {
  const Model model = OneCamera();
  const TemporaryFolder folder;
  ASSERT_TRUE(WriteRealityCaptureModel(model.reconstruction, model.names, folder.path()).ok());
  const std::string text = Read(folder / "c0.xmp");
  const std::map<std::string, double> attributes = {{"FocalLength35mm", 36.0 * 1840 / 1600},
                                                    {"AspectRatio", 1835.0 / 1840},
                                                    {"PrincipalPointU", 11.0 / 1600},
                                                    {"PrincipalPointV", -7.0 / 1600}};
  for (const auto& [name, value] : attributes) {
    ExpectNear(Numbers(Between(text, "xcr:" + name + "=\"", "\"")), {value});
  }
  ExpectNear(Numbers(Between(text, "<xcr:Rotation>", "<")), {0, 1, 0, 0, 0, -1, -1, 0, 0});
  ExpectNear(Numbers(Between(text, "<xcr:Position>", "<")), {3, 0, 1});
  ExpectNear(Numbers(Between(text, "<xcr:DistortionCoeficients>", "<")),
             {-0.08, 0.03, 0, 0, -5e-4, 8e-4});
}

TEST(ModelExchangeByHand, WhatAFormatCannotHoldIsRefused) {
  Model rational = OneCamera();
  rational.reconstruction.intrinsics.lenses[0] = {
      CameraModel::kFullOpencv, 1200, 1600, {1840, 1835, 611, 793, 0, 0, 0, 0, 0, 0, 0.01, 0}};
  Model twins = OneCamera();
  twins.names = {"left/1.png", "right/1.png"};
  twins.reconstruction.intrinsics.lens_of_image = {0, 0};
  twins.reconstruction.cam_from_model.push_back(twins.reconstruction.cam_from_model[0]);
  const TemporaryFolder folder;
  for (const auto write : {WriteNerfstudioModel, WriteMetashapeModel, WriteRealityCaptureModel}) {
    const Status status = write(rational.reconstruction, rational.names, folder.path());
    ASSERT_FALSE(status.ok());
    EXPECT_EQ(status.error().code, ErrorCode::kInvalidArgument);
    EXPECT_EQ(status.error().context, "camera c0");
    for (const char* part : {"FULL_OPENCV", "it holds SIMPLE_PINHOLE, PINHOLE"}) {
      EXPECT_NE(status.error().message.find(part), std::string::npos) << status.error().message;
    }
  }
  for (const auto write : {WriteMetashapeModel, WriteRealityCaptureModel}) {
    const Status status = write(twins.reconstruction, twins.names, folder.path());
    ASSERT_FALSE(status.ok());
    EXPECT_EQ(status.error().context, "right/1.png");
    EXPECT_NE(status.error().message.find("left/1.png"), std::string::npos);
  }
  EXPECT_TRUE(fs::is_empty(folder.path()));
  ASSERT_TRUE(WriteNerfstudioModel(twins.reconstruction, twins.names, folder.path()).ok());
  const Json frames = Json::parse(Read(folder / "transforms.json"))["frames"];
  EXPECT_EQ(frames[1]["file_path"], "images/right/1.png");
}

TEST(ModelExchangeByHand, NamesAreEscaped) {
  Model model = OneCamera();
  model.names = {"a<b>&\"c\".png"};
  const TemporaryFolder folder;
  ASSERT_TRUE(WriteMetashapeModel(model.reconstruction, model.names, folder.path()).ok());
  EXPECT_NE(Read(folder / "cameras.xml").find("label=\"a&lt;b&gt;&amp;&quot;c&quot;\""),
            std::string::npos);
}

}  // namespace
}  // namespace rotunda::sfm
