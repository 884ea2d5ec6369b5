#include "rig/calibration_report.h"

#include <gtest/gtest.h>

#include <set>

#include "rig/calibration_result.h"
#include "sfm/core/html_text.h"
#include "tests/support/projected_corners.h"

namespace rotunda::rig {
namespace {

std::string ReportOf(const test::ProjectedRig& world,
                     const std::optional<Calibration>& earlier = std::nullopt) {
  ThreadPool pool(1);
  RunContext context{pool};
  const auto result = CalibrateRig(world.board, world.sightings, {}, context);
  EXPECT_TRUE(result.ok()) << result.error().ToString();
  if (!result) return "";
  const CrossValidation validation;
  const Calibration found = ToCalibration(world.board, world.sightings, *result, &validation);
  std::optional<CalibrationComparison> comparison;
  if (earlier) comparison = CompareCalibrations(*earlier, found, {}).value();
  return BuildCalibrationReport({world.board,
                                 world.sightings,
                                 *result,
                                 found,
                                 CheckCameras(world.board, world.sightings, *result, {}),
                                 validation,
                                 comparison,
                                 {}});
}

test::ProjectedRig SmallWorld() {
  test::ProjectedOptions options;
  options.cameras = 6;
  options.shots = 4;
  return test::ProjectCorners(options);
}

/// The beginning of a table's row.
std::string RowOf(const std::vector<std::string>& cells) {
  std::string text = "<tr>";
  for (const std::string& cell : cells) text += "<td>" + Escaped(cell) + "</td>";
  return text;
}

TEST(CalibrationReport, MarkersNotUsedAreCountedByReasonAndCameraWithWhatToDo) {
  test::ProjectedRig world = SmallWorld();
  const auto reject = [&](size_t shot, size_t camera, Rejection kind, int count) {
    BoardDetection& detection = *world.sightings.sightings[shot][camera].detection;
    detection.markers_found = 40;
    for (int i = 0; i < count; ++i)
      detection.rejected.push_back({"", i, Eigen::Vector2d::Zero(), kind, ""});
  };
  reject(0, 1, Rejection::kSeenTwice, 3);
  reject(2, 1, Rejection::kSeenTwice, 4);
  reject(2, 1, Rejection::kAlone, 1);
  reject(3, 4, Rejection::kSeenTwice, 2);
  const std::string& first = world.sightings.cameras[1].camera;
  const std::string& second = world.sightings.cameras[4].camera;
  const std::string html = ReportOf(world);
  EXPECT_NE(html.find(RowOf({"seen twice", "9", "2", first + " 7, " + second + " 2",
                             TextOf(Rejection::kSeenTwice).remedy})),
            std::string::npos);
  EXPECT_NE(html.find(RowOf({"alone", "1", "1", first + " 1", TextOf(Rejection::kAlone).remedy})),
            std::string::npos);
  // Camera, used, not used, then by reason, the most frequent one first.
  EXPECT_NE(html.find(RowOf({first, "80", "8", "7", "1"})), std::string::npos);
  EXPECT_NE(html.find(RowOf({second, "40", "2", "2", "0"})), std::string::npos);
  EXPECT_EQ(html.find(RowOf({world.sightings.cameras[0].camera, "0", "0"})), std::string::npos);
}

TEST(CalibrationReport, CornersNotUsedAreCountedLikewise) {
  test::ProjectedRig world = SmallWorld();
  const auto reject = [&](size_t shot, size_t camera, CornerRejection kind, int count) {
    BoardDetection& detection = *world.sightings.sightings[shot][camera].detection;
    for (int i = 0; i < count; ++i) detection.rejected_corners.push_back({0, i, kind});
  };
  reject(0, 2, CornerRejection::kUnclear, 5);
  reject(1, 2, CornerRejection::kAtEdge, 2);
  reject(1, 5, CornerRejection::kUnclear, 1);
  const std::string& first = world.sightings.cameras[2].camera;
  const std::string& second = world.sightings.cameras[5].camera;
  const auto used = [&](size_t camera) {
    size_t corners = 0;
    for (const auto& shot : world.sightings.sightings) {
      corners += shot[camera].detection->corners.size();
    }
    return std::to_string(corners);
  };
  const std::string html = ReportOf(world);
  EXPECT_NE(html.find(RowOf({"no clear corner", "6", "2", first + " 5, " + second + " 1",
                             TextOf(CornerRejection::kUnclear).remedy})),
            std::string::npos);
  EXPECT_NE(html.find(RowOf({first, used(2), "7", "5", "2"})), std::string::npos);
  EXPECT_NE(html.find(RowOf({second, used(5), "1", "1", "0"})), std::string::npos);
}

TEST(CalibrationReport, SaysSoWhenEveryMarkerAndCornerWasUsed) {
  const std::string html = ReportOf(SmallWorld());
  for (const char* what : {"Markers", "Corners"}) {
    EXPECT_NE(html.find("<h2>" + std::string(what) + " not used</h2><p>None: all were used."),
              std::string::npos)
        << what;
  }
}

TEST(CalibrationReport, EveryReasonHasANameAndARemedyOfItsOwn) {
  std::set<std::string> names, remedies;
  const auto expect_new = [&](const RejectionText& text) {
    EXPECT_TRUE(names.insert(text.name).second) << text.name;
    EXPECT_TRUE(remedies.insert(text.remedy).second) << text.remedy;
  };
  for (const Rejection kind :
       {Rejection::kAlone, Rejection::kMisplaced, Rejection::kOnNoFace, Rejection::kSeenTwice}) {
    expect_new(TextOf(kind));
  }
  for (const CornerRejection kind :
       {CornerRejection::kAtEdge, CornerRejection::kSmall, CornerRejection::kFaint,
        CornerRejection::kUnclear, CornerRejection::kOffPattern}) {
    expect_new(TextOf(kind));
  }
}

TEST(CalibrationReport, WhatWasNotHeldOutHasNoFigure) {
  const std::string html = ReportOf(SmallWorld());
  EXPECT_NE(html.find("<dt>Held out</dt><dd>–<small>too few corners"), std::string::npos);
  EXPECT_NE(html.find("<dt>Two halves</dt><dd>–<small>too few corners"), std::string::npos);
}

TEST(CalibrationReport, WhatMovedStandsOnTopAndWithTheSigmasOfBothInTheTable) {
  const test::ProjectedRig world = SmallWorld();
  Calibration earlier = world.truth;
  for (CalibratedCamera& camera : earlier.cameras) camera.sigma = PoseSigma{0.0125, 0.625, 1.0};
  const std::string moved = earlier.cameras[2].camera;
  earlier.cameras[2].cam_from_rig.translation += Eigen::Vector3d(0.05, 0, 0);
  earlier.cameras.push_back(earlier.cameras[0]);
  earlier.cameras.back().camera = "z-gone";
  const std::string html = ReportOf(world, earlier);
  const size_t verdict = html.find("verdict look"), tiles = html.find("card tiles");
  ASSERT_NE(verdict, std::string::npos);
  for (const std::string& told :
       {moved + " moved by ", std::string("z-gone is only in the earlier calibration")}) {
    const size_t place = html.find(told, verdict);
    EXPECT_LT(place, tiles) << told;
  }
  EXPECT_NE(html.find("<h2>2 changes</h2>"), std::string::npos) << "there are no notes";
  EXPECT_NE(html.find("<td>0.625, "), std::string::npos);
  EXPECT_NE(html.find("<td>0.0125, "), std::string::npos);
}

}  // namespace
}  // namespace rotunda::rig
