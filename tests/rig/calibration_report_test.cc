#include "rig/calibration_report.h"

#include <gtest/gtest.h>

#include <set>

#include "rig/calibration_result.h"
#include "sfm/core/html_text.h"
#include "tests/support/projected_corners.h"

namespace rotunda::rig {
namespace {

std::string ReportOf(const test::ProjectedRig& world) {
  ThreadPool pool(1);
  RunContext context{pool};
  const auto result = CalibrateRig(world.board, world.sightings, {}, context);
  EXPECT_TRUE(result.ok()) << result.error().ToString();
  if (!result) return "";
  const CrossValidation validation;
  return BuildCalibrationReport({world.board,
                                 world.sightings,
                                 *result,
                                 ToCalibration(world.board, world.sightings, *result, &validation),
                                 CheckCameras(world.board, world.sightings, *result, {}),
                                 validation,
                                 std::nullopt,
                                 {}});
}

test::ProjectedRig SmallWorld() {
  test::ProjectedOptions options;
  options.cameras = 6;
  options.shots = 4;
  return test::ProjectCorners(options);
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
  const auto row = [](const std::vector<std::string>& cells) {
    std::string text = "<tr>";
    for (const std::string& cell : cells) text += "<td>" + Escaped(cell) + "</td>";
    return text;
  };
  EXPECT_NE(html.find(row({"seen twice", "9", "2", first + " 7, " + second + " 2",
                           TextOf(Rejection::kSeenTwice).remedy})),
            std::string::npos);
  EXPECT_NE(html.find(row({"alone", "1", "1", first + " 1", TextOf(Rejection::kAlone).remedy})),
            std::string::npos);
  // Camera, used, not used, then by reason, the most frequent one first.
  EXPECT_NE(html.find(row({first, "80", "8", "7", "1"})), std::string::npos);
  EXPECT_NE(html.find(row({second, "40", "2", "2", "0"})), std::string::npos);
  EXPECT_EQ(html.find(row({world.sightings.cameras[0].camera, "0", "0"})), std::string::npos);
  EXPECT_EQ(html.find("Every marker that was read was used"), std::string::npos);
}

TEST(CalibrationReport, SaysSoWhenEveryMarkerWasUsed) {
  EXPECT_NE(ReportOf(SmallWorld()).find("Every marker that was read was used"), std::string::npos);
}

TEST(CalibrationReport, EveryReasonHasANameAndARemedyOfItsOwn) {
  std::set<std::string> names, remedies;
  for (const Rejection kind :
       {Rejection::kAlone, Rejection::kMisplaced, Rejection::kOnNoFace, Rejection::kSeenTwice}) {
    EXPECT_TRUE(names.insert(TextOf(kind).name).second);
    EXPECT_TRUE(remedies.insert(TextOf(kind).remedy).second);
  }
}

}  // namespace
}  // namespace rotunda::rig
