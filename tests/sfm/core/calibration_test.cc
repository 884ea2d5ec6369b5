#include "sfm/core/calibration.h"

#include <gtest/gtest.h>

#include <bit>
#include <nlohmann/json.hpp>
#include <random>

#include "sfm/core/file_io.h"
#include "tests/support/process.h"

namespace rotunda {
namespace {

using nlohmann::json;

CalibratedCamera MakeCamera(const std::string& name, std::mt19937_64& random) {
  const auto uniform = [&] { return static_cast<double>(random() >> 11) * 0x1p-53 - 0.5; };
  CalibratedCamera camera;
  camera.camera = name;
  camera.serial = "SN-" + name;
  camera.intrinsics = {CameraModel::kOpencv,
                       1200,
                       1600,
                       {1840 + uniform(), 1841 + uniform(), 600 + uniform(), 800 + uniform(),
                        0.1 * uniform(), 0.01 * uniform(), 1e-4 * uniform(), 1e-9 * uniform()}};
  camera.cam_from_rig.rotation =
      Eigen::Quaterniond(uniform(), uniform(), uniform(), uniform()).normalized();
  camera.cam_from_rig.translation = {uniform(), uniform(), 1.7 + uniform()};
  return camera;
}

Calibration MakeCalibration() {
  std::mt19937_64 random(4);
  Calibration calibration;
  calibration.id = "cal-7";
  calibration.created_at = "2024-06-10T06:13:20Z";
  calibration.source = CalibrationSource::kTruth;
  calibration.cameras = {MakeCamera("a", random), MakeCamera("b", random), MakeCamera("c", random)};
  calibration.cameras[0].sigma = PoseSigma{0.003, 0.2, 0.31};
  calibration.cameras[1].sigma = PoseSigma{0.004, 0.25, std::nullopt};
  return calibration;
}

uint64_t Bits(double value) { return std::bit_cast<uint64_t>(value); }

TEST(Calibration, ReadsTheSameBitsThatItWrites) {
  const Calibration calibration = MakeCalibration();
  const auto read = CalibrationFromJson(CalibrationToJson(calibration), "text");
  ASSERT_TRUE(read.ok()) << read.error().ToString();
  EXPECT_EQ(read->id, calibration.id);
  EXPECT_EQ(read->created_at, calibration.created_at);
  EXPECT_EQ(read->source, CalibrationSource::kTruth);
  ASSERT_EQ(read->cameras.size(), 3u);
  for (size_t i = 0; i < 3; ++i) {
    const CalibratedCamera& a = calibration.cameras[i];
    const CalibratedCamera& b = read->cameras[i];
    EXPECT_EQ(a.camera, b.camera);
    EXPECT_EQ(a.serial, b.serial);
    EXPECT_EQ(a.intrinsics.model, b.intrinsics.model);
    EXPECT_EQ(a.intrinsics.width_px, b.intrinsics.width_px);
    EXPECT_EQ(a.intrinsics.height_px, b.intrinsics.height_px);
    for (size_t k = 0; k < 8; ++k) {
      EXPECT_EQ(Bits(a.intrinsics.params[k]), Bits(b.intrinsics.params[k]));
    }
    EXPECT_TRUE(a.cam_from_rig.rotation.coeffs() == b.cam_from_rig.rotation.coeffs());
    EXPECT_TRUE(a.cam_from_rig.translation == b.cam_from_rig.translation);
    ASSERT_EQ(a.sigma.has_value(), b.sigma.has_value());
    if (!a.sigma) continue;
    EXPECT_EQ(a.sigma->rotation_deg, b.sigma->rotation_deg);
    EXPECT_EQ(a.sigma->position_mm, b.sigma->position_mm);
    EXPECT_EQ(a.sigma->focal_px, b.sigma->focal_px);
  }
  EXPECT_EQ(CalibrationToJson(*read), CalibrationToJson(calibration));
}

TEST(Calibration, PutsNumbersOnOneLine) {
  const std::string text = CalibrationToJson(MakeCalibration());
  EXPECT_NE(text.find("\n   \"params\": [1840."), std::string::npos);
  EXPECT_EQ(text.back(), '\n');
}

TEST(Calibration, WritesAndReadsFiles) {
  const test::TemporaryFolder folder;
  ASSERT_TRUE(WriteCalibration(MakeCalibration(), folder / "calibration.json").ok());
  const auto read = ReadCalibration(folder / "calibration.json");
  ASSERT_TRUE(read.ok()) << read.error().ToString();
  EXPECT_EQ(CalibrationToJson(*read), CalibrationToJson(MakeCalibration()));
  EXPECT_EQ(ReadCalibration(folder / "none.json").error().code, ErrorCode::kNotFound);
}

TEST(Calibration, FindsByNameInAnyOrderOfTheText) {
  Calibration calibration = MakeCalibration();
  std::swap(calibration.cameras[0], calibration.cameras[2]);
  const auto read = CalibrationFromJson(CalibrationToJson(calibration), "text");
  ASSERT_TRUE(read.ok());
  for (const char* name : {"a", "b", "c"}) {
    ASSERT_NE(read->Find(name), nullptr);
    EXPECT_EQ(read->Find(name)->camera, name);
  }
  EXPECT_EQ(read->Find("d"), nullptr);
  EXPECT_EQ(read->Find(""), nullptr);
}

TEST(Calibration, IgnoresFieldsOfOthers) {
  json text = json::parse(CalibrationToJson(MakeCalibration()));
  text["weather"] = {{"sunny", true}};
  text["cameras"][0]["colour"] = "black";
  EXPECT_TRUE(CalibrationFromJson(text.dump(), "text").ok());
}

/// With all that a calibration from boards says beside the cameras.
Calibration MakeWhole() {
  Calibration calibration = MakeCalibration();
  CalibratedCamera& camera = calibration.cameras[0];
  const auto size = static_cast<Eigen::Index>(6 + camera.intrinsics.params.size());
  camera.covariance = 1e-6 * Eigen::MatrixXd::Identity(size, size);
  (*camera.covariance)(1, 0) = (*camera.covariance)(0, 1) = 2e-7;
  camera.fit = CameraFit{120, 118, 0.05, 0.02, 0.06};
  CalibratedFace face;
  face.face = "front";
  face.board_from_face.translation = {0.2, 0, 1.5};
  face.bow_m = {1e-4, -3e-4};
  face.sigma = FaceSigma{0.01, 0.02, 0.03};
  face.print = FacePrint{7, 24, 60.5, 45, "APRILTAG_36h11", 87, true};
  calibration.board = {face};
  CalibrationResiduals residuals;
  residuals.corners = 120;
  residuals.kept = 118;
  residuals.rms_px = 0.05;
  residuals.noise = 1.1;
  residuals.held_out_rms_px = 0.06;
  calibration.residuals = residuals;
  return calibration;
}

TEST(Calibration, KeepsCovariancesTheTargetAndResiduals) {
  const Calibration whole = MakeWhole();
  const auto read = CalibrationFromJson(CalibrationToJson(whole), "text");
  ASSERT_TRUE(read.ok()) << read.error().ToString();
  EXPECT_EQ(CalibrationToJson(*read), CalibrationToJson(whole));
  EXPECT_EQ(*read->cameras[0].covariance, *whole.cameras[0].covariance);
  EXPECT_EQ(read->cameras[0].fit->kept, 118u);
  ASSERT_EQ(read->board.size(), 1u);
  EXPECT_EQ(read->board[0].bow_m, whole.board[0].bow_m);
  const FacePrint& print = *read->board[0].print;
  EXPECT_EQ(print.columns, 7);
  EXPECT_EQ(print.rows, 24);
  EXPECT_EQ(print.square_mm, 60.5);
  EXPECT_EQ(print.marker_mm, 45);
  EXPECT_EQ(print.dictionary, "APRILTAG_36h11");
  EXPECT_EQ(print.first_id, 87);
  EXPECT_TRUE(print.legacy_pattern);
  EXPECT_EQ(read->residuals->held_out_rms_px, 0.06);
  EXPECT_FALSE(read->residuals->held_out_p95_px.has_value());
}

TEST(Calibration, WhatIsPrintedNeedNotBeSaidButMustBeWhole) {
  json text = json::parse(CalibrationToJson(MakeWhole()));
  text["board"]["faces"][0]["print"]["rows"] = -3;
  const auto negative = CalibrationFromJson(text.dump(), "text");
  ASSERT_FALSE(negative.ok());
  EXPECT_NE(negative.error().ToString().find("board.faces[0].print.rows"), std::string::npos)
      << negative.error().ToString();
  text["board"]["faces"][0].erase("print");
  const auto without = CalibrationFromJson(text.dump(), "text");
  ASSERT_TRUE(without.ok()) << without.error().ToString();
  EXPECT_FALSE(without->board[0].print.has_value());
}

TEST(Calibration, RefusesABrokenCovarianceAndAFaceTwice) {
  const json whole = json::parse(CalibrationToJson(MakeWhole()));
  json text = whole;
  text["cameras"][0]["covariance"] = {1, 2, 3};
  const auto covariance = CalibrationFromJson(text.dump(), "text");
  ASSERT_FALSE(covariance.ok());
  EXPECT_NE(covariance.error().ToString().find("cameras[0].covariance"), std::string::npos)
      << covariance.error().ToString();
  text = whole;
  text["board"]["faces"].push_back(text["board"]["faces"][0]);
  const auto face = CalibrationFromJson(text.dump(), "text");
  ASSERT_FALSE(face.ok());
  EXPECT_NE(face.error().ToString().find("\"front\" is already"), std::string::npos)
      << face.error().ToString();
}

TEST(Calibration, NormalizesARoughlyRoundedRotation) {
  json text = json::parse(CalibrationToJson(MakeCalibration()));
  text["cameras"][0]["cam_from_rig"]["rotation_wxyz"] = {0.7071068, 0, 0, 0.7071068};
  const auto read = CalibrationFromJson(text.dump(), "text");
  ASSERT_TRUE(read.ok());
  EXPECT_NEAR(read->cameras[0].cam_from_rig.rotation.norm(), 1.0, 1e-15);
}

struct BadField {
  const char* pointer;
  json value;
  const char* error;
};

TEST(Calibration, NamesTheFieldWhatWasFoundAndWhatWasExpected) {
  const std::vector<BadField> table = {
      {"/format", "rotunda-calibration/9",
       "format: expected \"rotunda-calibration/1\", found \"rotunda-calibration/9\""},
      {"/source", "guess", "source: expected \"charuco\", \"sfm\" or \"truth\", found \"guess\""},
      {"/cameras/1/model", "FOV",
       "cameras[1].model: camera model 'FOV' is not known; known are SIMPLE_PINHOLE, PINHOLE, "
       "SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV"},
      {"/cameras/1/params",
       {1840, 1840, 600, 800},
       "cameras[1].params: expected an array of 8 numbers, found an array of 4"},
      {"/cameras/1/params/3", "x", "cameras[1].params[3]: expected a number, found \"x\""},
      {"/cameras/1/params/0", -1840, "cameras[1].params: the focal length is not positive"},
      {"/cameras/1/width", 0, "cameras[1].width: expected an integer from 1 to 100000, found 0"},
      {"/cameras/2/cam_from_rig/rotation_wxyz",
       {1, 0, 0, 0.01},
       "cameras[2].cam_from_rig.rotation_wxyz: expected a quaternion of norm 1, found norm "
       "1.00004999875"},
      {"/cameras/2/cam_from_rig/translation_m",
       {1, 2},
       "cameras[2].cam_from_rig.translation_m: expected an array of 3 numbers, found an array of "
       "2"},
      {"/cameras/2/cam_from_rig", nullptr,
       "cameras[2].cam_from_rig: expected an object, found null"},
      {"/cameras/0/sigma/position_mm", true,
       "cameras[0].sigma.position_mm: expected a number, found true"},
      {"/cameras/0/sigma/position_mm", -0.1,
       "cameras[0].sigma.position_mm: expected a number of at least 0, found -0.1"},
      {"/cameras/2/camera", "a", "cameras[2].camera: camera \"a\" is already cameras[0]"},
  };
  for (const BadField& bad : table) {
    json text = json::parse(CalibrationToJson(MakeCalibration()));
    text[json::json_pointer(bad.pointer)] = bad.value;
    const auto read = CalibrationFromJson(text.dump(), "calibration.json");
    ASSERT_FALSE(read.ok()) << bad.error;
    EXPECT_EQ(read.error().code, ErrorCode::kBadInput);
    EXPECT_EQ(read.error().ToString().find(std::string("calibration.json: ") + bad.error), 0u)
        << read.error().ToString() << "\nexpected " << bad.error;
  }
}

TEST(Calibration, RefusesNumbersThatDoNotFit) {
  std::string text = CalibrationToJson(MakeCalibration());
  const size_t place = text.find("\"params\": [") + 11;
  text.insert(place, "1e999, ");
  EXPECT_FALSE(CalibrationFromJson(text, "text").ok());
}

}  // namespace
}  // namespace rotunda
