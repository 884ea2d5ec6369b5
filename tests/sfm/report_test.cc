#include "sfm/report.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <random>
#include <regex>
#include <set>

#include "sfm/core/html_text.h"
#include "sfm/report_facts.h"
#include "sfm/report_thumbnails.h"
#include "sfm/report_views.h"

namespace rotunda::sfm {
namespace {

constexpr double kRadius_m = 1.7;

/// A ring of cameras that look at the axis, pictures of one colour each, and a column of points.
class ReportTest : public testing::Test {
 protected:
  void SetUp() override {
    const auto* test = testing::UnitTest::GetInstance()->current_test_info();
    folder_ = std::filesystem::temp_directory_path() /
              ("rotunda_report_" + std::string(test->name()) + std::to_string(getpid()));
    std::filesystem::create_directories(folder_);
    set_.folder = folder_;
    set_.id = poses_.frameset = "shot-1";
    set_.captured_at = "2024-05-14T10:22:31Z";
    poses_.method = "plain";
    poses_.options = {{"pairs", "exhaustive"}};
    poses_.metric = true;
    poses_.aligned_to = "cal-1";
    calibration_.emplace();
    calibration_->id = "cal-1";
    for (int i = 0; i < 6; ++i) AddCamera("c0" + std::to_string(i), i);
    AddPoints();
    Summarize();
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  /// Camera `i` stands at azimuth i x 60 degrees, 1.2 m high, level.
  void AddCamera(const std::string& name, int i) {
    const double azimuth = i * kPi / 3;
    const Eigen::Vector3d forward(-std::cos(azimuth), -std::sin(azimuth), 0);
    const Eigen::Vector3d down = -Eigen::Vector3d::UnitZ();
    Eigen::Matrix3d cam_from_rig;
    cam_from_rig << down.cross(forward).transpose(), down.transpose(), forward.transpose();
    CameraPose pose;
    pose.camera = name;
    pose.registered = true;
    pose.intrinsics = {CameraModel::kPinhole, 60, 80, {90, 90, 30, 40}};
    pose.cam_from_rig.rotation = Eigen::Quaterniond(cam_from_rig);
    const Eigen::Vector3d centre = -kRadius_m * forward + Eigen::Vector3d(0, 0, 1.2);
    pose.cam_from_rig.translation = -(pose.cam_from_rig.rotation * centre);
    pose.sigma = PoseSigma{0.004 + 0.0001 * i, 0.3 + 0.01 * i, std::nullopt};
    pose.side = i == 0 ? "front" : "back";
    pose.observations = 1000 + 10 * static_cast<size_t>(i);
    pose.rms_px = 0.5 + 0.01 * i;
    pose.vs_calibration = VsCalibration{0.01, 0.4, false, std::nullopt, false, 1.2};
    poses_.cameras.push_back(pose);
    calibration_->cameras.push_back(
        {name, "serial", pose.intrinsics, pose.cam_from_rig, std::nullopt});
    Frame frame;
    frame.camera = name;
    frame.file = std::to_string(i) + ".png";
    frame.width_px = 60;
    frame.height_px = 80;
    frame.pixel_format = "RGB8";
    set_.frames.push_back(frame);
    cv::imwrite((folder_ / frame.file).string(), cv::Mat(80, 60, CV_8UC3, Colour(i)));
  }

  static cv::Scalar Colour(int i) { return {40.0 * i, 200.0 - 30 * i, 100}; }

  void AddPoints() {
    std::mt19937_64 random(5);
    const auto uniform = [&] { return static_cast<double>(random() >> 11) * 0x1p-53; };
    for (int i = 0; i < 500; ++i) {
      const double azimuth = 2 * kPi * uniform();
      Point3 point;
      point.position = {0.2 * std::cos(azimuth), 0.2 * std::sin(azimuth), 1.8 * uniform()};
      point.color_rgb = {200, static_cast<uint8_t>(i % 256), 30};
      reconstruction_.points.push_back(point);
    }
  }

  void Summarize() {
    PoseSummary& summary = poses_.summary;
    summary.of = poses_.cameras.size();
    summary.registered = 0;
    for (const CameraPose& pose : poses_.cameras) summary.registered += pose.registered;
    summary.rms_px = 0.53;
    summary.mean_reprojection_px = 0.41;
    summary.points = reconstruction_.points.size();
    summary.mean_rotation_deg = 0.01;
    summary.mean_position_mm = 0.4;
    summary.folded = false;
  }

  void Unregister(size_t camera, const std::string& reason) {
    CameraPose& pose = poses_.cameras[camera];
    pose.registered = false;
    pose.reason = reason;
    pose.sigma.reset();
    pose.vs_calibration.reset();
    Summarize();
  }

  void MakeArbitrary() {
    poses_.metric = false;
    poses_.aligned_to.reset();
    calibration_.reset();
    for (CameraPose& pose : poses_.cameras) pose.vs_calibration.reset();
    poses_.summary.folded.reset();
    poses_.summary.mean_rotation_deg.reset();
    poses_.summary.mean_position_mm.reset();
  }

  ReportInput Input() const {
    return {set_, poses_, reconstruction_, calibration_, features_, segments_, calibration_page_};
  }

  std::string Build(int threads = 2) const {
    ThreadPool pool(threads);
    RunContext context{pool};
    const Result<std::string> html = BuildReport(Input(), context);
    EXPECT_TRUE(html.ok()) << html.error().ToString();
    return html.ok() ? *html : "";
  }

  std::filesystem::path folder_;
  FrameSet set_;
  PoseSet poses_;
  Reconstruction reconstruction_;
  Features features_;
  std::optional<Segments> segments_;
  std::string calibration_page_;
  std::optional<Calibration> calibration_;
};

size_t Count(const std::string& text, const std::string& what) {
  size_t count = 0;
  for (size_t at = text.find(what); at != std::string::npos; at = text.find(what, at + 1)) ++count;
  return count;
}

/// Empty when every tag is closed in order, attributes are quoted and unique, and no bare "<" or
/// "&" is left; else what is wrong.
std::string WellFormednessProblem(std::string html) {
  const std::string doctype = "<!DOCTYPE html>\n";
  if (html.rfind(doctype, 0) != 0) return "no doctype";
  html.erase(0, doctype.size());
  const std::regex tag("^<(/?)([a-zA-Z0-9]+)((?: [a-zA-Z-]+=\"[^\"<]*\")*)(/?)>");
  const std::regex attribute(" ([a-zA-Z-]+)=");
  const std::regex entity("^&(amp|lt|gt|quot|#39);");
  std::vector<std::string> open;
  for (size_t i = 0; i < html.size();) {
    const std::string window = html.substr(i, std::min<size_t>(80, html.size() - i));
    std::smatch match;
    if (html[i] == '&') {
      if (!std::regex_search(window, match, entity)) return "bare & at " + window;
      ++i;
    } else if (html[i] == '<') {
      const size_t end = html.find('>', i);
      if (end == std::string::npos) return "unclosed tag at " + window;
      // The long value of a data URI would overflow the regex's stack; it is plain base64.
      std::string text = html.substr(i, end - i + 1);
      const size_t data = text.find("base64,");
      if (data != std::string::npos) {
        const size_t quote = text.find('"', data);
        text.erase(data, quote - data);
      }
      const size_t path = text.find(" d=\"");
      if (path != std::string::npos) text.erase(path + 4, text.find('"', path + 4) - path - 4);
      if (!std::regex_search(text, match, tag)) return "malformed tag " + text;
      std::set<std::string> names;
      const std::string attributes = match[3];
      for (std::sregex_iterator a(attributes.begin(), attributes.end(), attribute), none; a != none;
           ++a) {
        if (!names.insert((*a)[1]).second) return "attribute twice in " + text;
      }
      if (match[1] == "/") {
        if (open.empty() || open.back() != match[2]) return "closing tag without opening " + text;
        open.pop_back();
      } else if (match[4] != "/") {
        open.push_back(match[2]);
      }
      i = end + 1;
    } else {
      ++i;
    }
  }
  return open.empty() ? "" : "never closed: " + open.back();
}

std::string Row(const std::string& html, size_t camera) {
  const size_t start = html.find("<tr id=\"cam-" + std::to_string(camera) + "\"");
  if (start == std::string::npos) return "";
  return html.substr(start, html.find("</tr>", start) - start);
}

/// Corners of the first triangle of a camera's frustum in a view: its centre and the picture's
/// upper corners, in pixels of the drawing.
struct Triangle {
  Eigen::Vector2d apex, left, right;
  Eigen::Vector2d Forward() const { return 0.5 * (left + right) - apex; }
};
Triangle Frustum(const std::string& svg, size_t camera) {
  const std::string number = "(-?[0-9.]+) (-?[0-9.]+)";
  const std::regex path("data-cam=\"" + std::to_string(camera) + "\"[^>]*><title>[^<]*</title>" +
                        "<path d=\"M" + number + "L" + number + "L" + number);
  std::smatch match;
  if (!std::regex_search(svg, match, path)) {
    ADD_FAILURE() << "no frustum of camera " << camera;
    return {};
  }
  const auto at = [&](int i) {
    return Eigen::Vector2d(std::stod(match[i]), std::stod(match[i + 1]));
  };
  return {at(1), at(3), at(5)};
}

report::SceneDrawings Draw(const ReportInput& input) {
  return report::DrawScene(input, report::BuildFacts(input), report::ChooseAxes(input));
}

TEST_F(ReportTest, IsWellFormedAndNamesEveryCameraEverywhere) {
  const std::string html = Build();
  EXPECT_EQ(WellFormednessProblem(html), "");
  const report::SceneDrawings drawings = Draw(Input());
  for (size_t i = 0; i < poses_.cameras.size(); ++i) {
    EXPECT_NE(Row(html, i).find(poses_.cameras[i].camera), std::string::npos) << i;
    const std::string link = "<a class=\"cam good\" href=\"#cam-" + std::to_string(i) + "\"";
    EXPECT_EQ(Count(drawings.top, link), 1u) << i;
    EXPECT_EQ(Count(drawings.side, link), 1u) << i;
    EXPECT_EQ(Count(drawings.map, link), 1u) << i;
    EXPECT_EQ(Count(html, "<img alt=\"" + poses_.cameras[i].camera + "\""), 1u) << i;
  }
  EXPECT_NE(html.find("6 of 6 cameras registered, not folded; scale metric"), std::string::npos);
  EXPECT_NE(html.find("No camera has moved"), std::string::npos);
}

TEST_F(ReportTest, NeedsNoNetwork) {
  const std::string html = Build();
  EXPECT_EQ(html.find("http:"), std::string::npos);
  EXPECT_EQ(html.find("https:"), std::string::npos);
  EXPECT_EQ(html.find("@import"), std::string::npos);
  EXPECT_EQ(html.find("url("), std::string::npos);
  // Whatever is loaded is in the file.
  const std::regex source("src=\"(.{5})");
  for (std::sregex_iterator i(html.begin(), html.end(), source), none; i != none; ++i) {
    EXPECT_EQ((*i)[1], "data:");
  }
}

TEST_F(ReportTest, SameBytesOnAnyNumberOfThreads) {
  const std::string once = Build(1);
  EXPECT_EQ(once, Build(1));
  EXPECT_EQ(once, Build(3));
}

TEST_F(ReportTest, HostileTextStaysText) {
  const std::string hostile = "\"><script>alert('1')</script>&\x01\xFF";
  poses_.cameras[0].camera = set_.frames[0].camera = hostile;
  Unregister(1, "<b>bad</b> & worse");
  poses_.options["</style>"] = "</dl><script>";
  set_.subject = "<i>";
  poses_.cameras[2].side = "\" onclick=\"x";
  const std::string html = Build();
  EXPECT_EQ(WellFormednessProblem(html), "");
  EXPECT_EQ(Count(html, "<script>"), 1u);  // the report's own
  EXPECT_EQ(html.find("<b>bad"), std::string::npos);
  EXPECT_EQ(html.find("\" onclick"), std::string::npos);
  EXPECT_NE(Row(html, 0).find("&quot;&gt;&lt;script&gt;alert(&#39;1&#39;)&lt;/script&gt;&amp;"
                              "\xEF\xBF\xBD\xEF\xBF\xBD"),
            std::string::npos);
  EXPECT_NE(Row(html, 1).find("not registered: &lt;b&gt;bad&lt;/b&gt; &amp; worse"),
            std::string::npos);
}

TEST_F(ReportTest, SaysWhichCameraIsMissingAndWhy) {
  Unregister(4, "9 of 41 matches agree, 30 are needed");
  const std::string html = Build();
  EXPECT_NE(html.find("5 of 6 cameras registered"), std::string::npos);
  EXPECT_NE(html.find("Without a pose: c04 (9 of 41 matches agree, 30 are needed)."),
            std::string::npos);
  EXPECT_NE(Row(html, 4).find("class=\"bad missing\""), std::string::npos);
  EXPECT_NE(Row(html, 4).find("not registered: 9 of 41 matches agree"), std::string::npos);
  EXPECT_NE(html.find("5 of 6 cameras could be checked"), std::string::npos);
  // Drawn where the calibration has it, and marked.
  const report::SceneDrawings drawings = Draw(Input());
  EXPECT_NE(drawings.top.find("cam bad missing\" href=\"#cam-4\""), std::string::npos);
  // Without a calibration nothing is known of its place, and nothing is drawn.
  MakeArbitrary();
  EXPECT_EQ(Draw(Input()).top.find("#cam-4"), std::string::npos);
}

/// Two communities, the second of which looks like another; the marks are the test's, the pictures
/// show them at their places.
TEST_F(ReportTest, ShowsTheCommunitiesOverThePictures) {
  EXPECT_EQ(Build().find("Communities of tracks"), std::string::npos);
  Segments segments;
  segments.segments.resize(2);
  segments.segments[1].ambiguous = true;
  features_.images.resize(set_.frames.size());
  segments.of_keypoint.resize(set_.frames.size());
  features_.images[0].keypoints.resize(3);
  features_.images[0].keypoints[1].x_px = 40;
  features_.images[0].keypoints[2].x_px = 80;
  segments.of_keypoint[0] = {0u, std::nullopt, 1u};
  segments_ = segments;
  const report::Marks marks = report::MarksOf(features_, *segments_);
  ASSERT_EQ(marks[0].size(), 2u);
  EXPECT_FALSE(marks[0][0].ambiguous);
  EXPECT_TRUE(marks[0][1].ambiguous);
  EXPECT_EQ(marks[0][1].place.x(), 80);
  const std::string html = Build();
  EXPECT_NE(html.find("Communities of tracks"), std::string::npos);
  EXPECT_EQ(Count(html, "<img alt=\"" + poses_.cameras[0].camera + "\""), 2u);
}

TEST_F(ReportTest, ShowsThePageOfTheCalibration) {
  EXPECT_EQ(Build().find("<iframe"), std::string::npos);
  calibration_page_ = "<html lang=\"en\"><body>12 shots & 90 cameras</body></html>";
  EXPECT_NE(Build().find("srcdoc=\"&lt;html lang=&quot;en&quot;&gt;&lt;body&gt;12 shots &amp; 90 "
                         "cameras&lt;/body&gt;&lt;/html&gt;\""),
            std::string::npos);
}

TEST_F(ReportTest, SaysWhichCameraHasMoved) {
  poses_.cameras[3].vs_calibration = VsCalibration{0.61, 63.2, true, std::nullopt, false, 141.9};
  poses_.cameras[3].cam_from_rig.translation += Eigen::Vector3d(0.05, 0, 0.03);
  const std::string html = Build();
  EXPECT_NE(html.find("Camera c03 has moved"), std::string::npos);
  EXPECT_NE(html.find("c03 by 63.2 mm and 0.610° (141.9 sigmas)."), std::string::npos);
  EXPECT_NE(Row(html, 3).find("class=\"bad\""), std::string::npos);
  EXPECT_EQ(Count(Draw(Input()).top, "class=\"before\""), 1u);
  EXPECT_EQ(report::BuildFacts(Input()).rig.level, report::Level::kBad);
  EXPECT_EQ(report::BuildFacts(Input()).shot.level, report::Level::kGood);
}

TEST_F(ReportTest, SaysWhichCamerasAreSwapped) {
  poses_.cameras[1].vs_calibration = VsCalibration{120, 2900, false, "c04"};
  poses_.cameras[4].vs_calibration = VsCalibration{120, 2900, false, "c01"};
  const std::string html = Build();
  EXPECT_NE(html.find("Cameras c01 and c04 are swapped"), std::string::npos);
  EXPECT_NE(html.find("c01 stands where the calibration has c04."), std::string::npos);
  EXPECT_NE(Row(html, 4).find("swapped: stands where the calibration has c01"), std::string::npos);
  EXPECT_NE(Row(html, 4).find("class=\"bad\""), std::string::npos);
  const report::Facts facts = report::BuildFacts(Input());
  EXPECT_EQ(facts.rig.level, report::Level::kBad);
  EXPECT_EQ(facts.shot.level, report::Level::kGood);
  EXPECT_EQ(facts.Find("drift-position")->max, 0.4) << "of the cameras that are not swapped";

  poses_.cameras[3].vs_calibration = VsCalibration{0.61, 63.2, true};
  EXPECT_EQ(report::BuildFacts(Input()).rig.headline, "Camera c03 has moved, 2 are swapped");
}

TEST_F(ReportTest, AFoldedModelSaysNothingOfMovedCameras) {
  poses_.summary.folded = true;
  poses_.summary.verdict = "folded";
  for (const size_t i : {1, 4}) {
    poses_.cameras[i].vs_calibration = VsCalibration{170, 3391, false, std::nullopt, true, 999};
  }
  const report::Facts facts = report::BuildFacts(Input());
  EXPECT_EQ(facts.rig.mark, "Rig not checked");
  EXPECT_EQ(facts.shot.level, report::Level::kBad);
  const std::string html = Build();
  EXPECT_NE(html.find("On the wrong side: c01, c04."), std::string::npos);
  EXPECT_NE(Row(html, 4).find("on the wrong side"), std::string::npos);
  EXPECT_EQ(html.find("has moved"), std::string::npos);
}

TEST_F(ReportTest, UnsureIsNotSaidToBeUnfolded) {
  poses_.summary.folded.reset();
  poses_.summary.verdict = "unsure";
  poses_.summary.verdict_reason = "nothing tells them apart";
  EXPECT_EQ(report::BuildFacts(Input()).shot.headline, "6 of 6 cameras registered; scale metric");
}

TEST_F(ReportTest, NamesACameraThatIsFartherOffThanErrorsAre) {
  poses_.cameras[2].vs_calibration = VsCalibration{0.01, 1.25, false, std::nullopt, false, 3.9};
  const report::Facts near = report::BuildFacts(Input());
  EXPECT_EQ(near.rig.level, report::Level::kGood);
  ASSERT_FALSE(near.rig.details.empty());
  EXPECT_NE(near.rig.details[0].find("c02 by 1.25 mm and 0.0100° (3.9 sigmas)."), std::string::npos)
      << near.rig.details[0];
  poses_.cameras[2].vs_calibration->sigmas = 4.1;
  const report::Facts doubtful = report::BuildFacts(Input());
  EXPECT_EQ(doubtful.rig.level, report::Level::kLook);
  EXPECT_EQ(doubtful.rig.headline, "No camera is seen to have moved");
  EXPECT_NE(doubtful.rig.details.back().find("c02."), std::string::npos);
  EXPECT_EQ(doubtful.cameras[2].level, report::Level::kLook);
}

TEST_F(ReportTest, SaysWhatACamerasPlaceRestsOnWhereItIsNotSure) {
  poses_.cameras[1].evidence = PoseEvidence{40.0, OtherPose{179.5, 300, -290}, false, false};
  poses_.cameras[2].evidence = PoseEvidence{1.5, OtherPose{179.5, -4.5, 3.25}, true, false};
  poses_.cameras[3].evidence = PoseEvidence{std::nullopt, std::nullopt, true, true};
  const report::Facts facts = report::BuildFacts(Input());
  EXPECT_EQ(facts.cameras[1].level, report::Level::kGood) << "it was told apart";
  ASSERT_EQ(facts.cameras[2].notes.size(), 1u);
  EXPECT_EQ(facts.cameras[2].level, report::Level::kLook);
  EXPECT_EQ(facts.cameras[2].notes[0],
            "may be on the look-alike side; matches would turn it by 180°, log-likelihood -4.50 "
            "against that and 3.25 for it");
  EXPECT_EQ(facts.cameras[3].notes,
            (std::vector<std::string>{"may be on the look-alike side",
                                      "weakly tied: placed after all others"}));
  EXPECT_NE(facts.shot.details.back().find("c02, c03"), std::string::npos);
}

TEST_F(ReportTest, PosesThatHadTheCalibrationAsPriorShowNothingOfTheRig) {
  poses_.options["prior"] = "calibration";
  const report::Facts facts = report::BuildFacts(Input());
  EXPECT_EQ(facts.rig.level, report::Level::kUnknown);
  EXPECT_EQ(facts.rig.mark, "Rig not checked");
  poses_.cameras[2].vs_calibration->moved = true;
  EXPECT_EQ(report::BuildFacts(Input()).rig.mark, "Rig changed") << "a prior cannot hide that";
}

TEST_F(ReportTest, SaysThatTheCalibrationIsNotTheRigs) {
  for (const size_t i : {1, 3, 5}) poses_.cameras[i].vs_calibration->sigmas = 30;
  const report::Facts facts = report::BuildFacts(Input());
  EXPECT_EQ(facts.rig.mark, "Rig differs");
  EXPECT_EQ(facts.rig.level, report::Level::kBad);
}

TEST_F(ReportTest, SaysWhatThePresetCannotSee) {
  poses_.summary.verdict = "sure";
  poses_.options["preset"] = "internet";
  EXPECT_NE(report::BuildFacts(Input()).shot.details[0].find("Preset internet"), std::string::npos);
}

TEST_F(ReportTest, NamesCalibratedCamerasWithoutAFrame) {
  CalibratedCamera absent = calibration_->cameras[0];
  absent.camera = "c09";
  calibration_->cameras.push_back(absent);
  const report::Facts facts = report::BuildFacts(Input());
  EXPECT_EQ(facts.rig.mark, "Rig partly checked");
  EXPECT_EQ(facts.rig.details.back(), "Calibrated, but not in this frame set: c09.");
}

TEST_F(ReportTest, AMethodThatDoesNotJudgeIsNotTakenForGood) {
  poses_.summary.folded.reset();
  EXPECT_EQ(report::BuildFacts(Input()).shot.mark, "Shot not judged");
  EXPECT_EQ(report::BuildFacts(Input()).shot.level, report::Level::kLook);
  poses_.summary.folded = false;  // the calibration tells
  EXPECT_EQ(report::BuildFacts(Input()).shot.level, report::Level::kGood);
}

TEST_F(ReportTest, VerdictFollowsTheWorstFinding) {
  using report::Level;
  EXPECT_EQ(report::BuildFacts(Input()).shot.level, Level::kGood);
  poses_.summary.models = 2;
  EXPECT_EQ(report::BuildFacts(Input()).shot.level, Level::kLook);
  poses_.summary.folded = true;
  const report::Facts folded = report::BuildFacts(Input());
  EXPECT_EQ(folded.shot.level, Level::kBad);
  EXPECT_EQ(folded.shot.headline, "6 of 6 cameras registered, folded; scale metric");
  poses_.summary.folded = false;
  poses_.summary.models = 1;
  Unregister(0, "");
  EXPECT_EQ(report::BuildFacts(Input()).shot.level, Level::kLook);  // 5 of 6
  Unregister(1, "");
  EXPECT_EQ(report::BuildFacts(Input()).shot.level, Level::kBad);  // 4 of 6
  MakeArbitrary();
  EXPECT_EQ(report::BuildFacts(Input()).rig.level, Level::kUnknown);
}

TEST_F(ReportTest, OnlyTheOddCameraStandsOut) {
  poses_.cameras[2].rms_px = 1.4;
  poses_.cameras[5].observations = 100;
  const report::Facts facts = report::BuildFacts(Input());
  for (size_t i = 0; i < facts.cameras.size(); ++i) {
    const bool odd = i == 2 || i == 5;
    EXPECT_EQ(facts.cameras[i].level, odd ? report::Level::kLook : report::Level::kGood) << i;
  }
  ASSERT_EQ(facts.cameras[2].notes.size(), 1u);
  // Median of 0.50 0.51 0.53 0.54 0.55 1.40 is 0.535; 1.40 / 0.535 = 2.617.
  EXPECT_EQ(facts.cameras[2].notes[0], "high residual: 2.6 × the median");
  EXPECT_EQ(facts.cameras[5].notes[0], "few observations");
  EXPECT_EQ(facts.Find("rms")->worst, 2u);
  EXPECT_EQ(facts.observations, 5u * 1000 + 10 + 20 + 30 + 40 + 100);
}

TEST_F(ReportTest, ViewsPutCamerasWhereTheyAre) {
  const report::SceneDrawings drawings = Draw(Input());
  // Cameras 0 and 3 face one another along x: 3.4 m apart, drawn from right to left.
  const Triangle front = Frustum(drawings.top, 0), back = Frustum(drawings.top, 3);
  const double px_per_m = (front.apex.x() - back.apex.x()) / (2 * kRadius_m);
  EXPECT_GT(px_per_m, 100);
  EXPECT_NEAR(front.apex.y(), back.apex.y(), 0.11);
  EXPECT_LT(front.Forward().x(), 0);
  EXPECT_GT(back.Forward().x(), 0);
  // Azimuth runs counter-clockwise: camera 1 (60 degrees) is above, y is down on paper.
  const Triangle left = Frustum(drawings.top, 1);
  EXPECT_NEAR(front.apex.x() - left.apex.x(), 0.5 * kRadius_m * px_per_m, 0.25);
  EXPECT_NEAR(front.apex.y() - left.apex.y(), std::sin(kPi / 3) * kRadius_m * px_per_m, 0.25);
  // From the side: same height, front to the right, and the picture's upper edge is up.
  const Triangle side_front = Frustum(drawings.side, 0), side_back = Frustum(drawings.side, 3);
  EXPECT_NEAR(side_front.apex.y(), side_back.apex.y(), 0.11);
  EXPECT_GT(side_front.apex.x(), side_back.apex.x());
  EXPECT_LT(side_front.Forward().y(), 0);
}

TEST_F(ReportTest, AStrayCameraOrPointDoesNotSpoilTheScale) {
  const report::SceneDrawings before = Draw(Input());
  reconstruction_.points[7].position = {5000, -3000, 800};
  EXPECT_EQ(Frustum(Draw(Input()).top, 0).apex, Frustum(before.top, 0).apex);
  poses_.cameras[4].cam_from_rig.translation *= 100;
  const report::SceneDrawings after = Draw(Input());
  const auto width = [](const std::string& svg) {
    return Frustum(svg, 0).apex.x() - Frustum(svg, 3).apex.x();
  };
  EXPECT_NEAR(width(after.top), width(before.top), 0.05 * width(before.top));
  EXPECT_EQ(Count(after.top, "class=\"astray\""), 1u);
}

TEST_F(ReportTest, WithoutARigTheViewsFollowTheCameras) {
  const Sim3 model_from_rig{0.37, Eigen::Quaterniond(0.3, 0.5, -0.7, 0.2).normalized(), {1, 2, 3}};
  for (CameraPose& pose : poses_.cameras) {
    pose.cam_from_rig = TransformPose(model_from_rig, pose.cam_from_rig);
  }
  for (Point3& point : reconstruction_.points) point.position = model_from_rig * point.position;
  MakeArbitrary();
  const report::SceneAxes axes = report::ChooseAxes(Input());
  EXPECT_FALSE(axes.rig_frame);
  EXPECT_FALSE(axes.encircling);
  const Eigen::Vector3d up = model_from_rig.rotation * Eigen::Vector3d::UnitZ();
  EXPECT_NEAR(axes.side.up.dot(up), 1.0, 1e-9);
  EXPECT_NEAR(axes.top.Toward().dot(up), 1.0, 1e-9);
  EXPECT_NEAR(axes.side.right.dot(axes.top.right), 1.0, 1e-9);
  const std::string html = Build();
  EXPECT_EQ(WellFormednessProblem(html), "");
  EXPECT_NE(html.find("scale arbitrary"), std::string::npos);
  EXPECT_NE(html.find("model units</text>"), std::string::npos);
  EXPECT_EQ(html.find("Rig unrolled"), std::string::npos);
  // Sigmas are kept in 1/1000 units.
  EXPECT_DOUBLE_EQ(*report::BuildFacts(Input()).Find("sigma-position")->values[0], 0.3e-3);
}

std::string Decoded(const std::string& base64) {
  const std::string alphabet = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string bytes;
  uint32_t bits = 0;
  int have = 0;
  for (const char c : base64) {
    if (c == '=') break;
    bits = bits << 6 | static_cast<uint32_t>(alphabet.find(c));
    have += 6;
    if (have >= 8) bytes += static_cast<char>(bits >> (have -= 8) & 255);
  }
  return bytes;
}

TEST_F(ReportTest, ThumbnailsShowThePictures) {
  cv::imwrite((folder_ / "5.png").string(), cv::Mat(1600, 1200, CV_8UC3, Colour(5)));
  const std::string html = Build();
  const std::string mark = "data:image/jpeg;base64,";
  size_t at = 0;
  for (int i = 0; i < 6; ++i) {
    at = html.find(mark, at);
    ASSERT_NE(at, std::string::npos) << i;
    at += mark.size();
    const std::string jpeg = Decoded(html.substr(at, html.find('"', at) - at));
    const cv::Mat picture =
        cv::imdecode(std::vector<uint8_t>(jpeg.begin(), jpeg.end()), cv::IMREAD_COLOR);
    ASSERT_FALSE(picture.empty()) << i;
    EXPECT_EQ(picture.cols * 4, picture.rows * 3) << i;
    EXPECT_LE(picture.rows, 200) << i;
    const cv::Scalar mean = cv::mean(picture);
    for (int channel = 0; channel < 3; ++channel) {
      EXPECT_NEAR(mean[channel], Colour(i)[channel], 3.0) << i;  // JPEG rounds chroma
    }
  }
}

TEST_F(ReportTest, APictureThatCannotBeReadIsNamedAndTheRestStands) {
  std::ofstream(folder_ / "2.png") << "not a picture";
  set_.frames[3].status = "missing";
  const std::string html = Build();
  EXPECT_EQ(WellFormednessProblem(html), "");
  EXPECT_EQ(Count(html, "data:image/jpeg"), 4u);
  EXPECT_NE(html.find("<span class=\"none\">2.png: "), std::string::npos);
  EXPECT_NE(html.find("<span class=\"none\">missing</span>"), std::string::npos);
  EXPECT_NE(Row(html, 3).find("frame: missing"), std::string::npos);
}

TEST_F(ReportTest, NothingRegisteredStillGivesAReport) {
  for (size_t i = 0; i < poses_.cameras.size(); ++i) Unregister(i, "no matches");
  MakeArbitrary();
  reconstruction_.points.clear();
  poses_.summary = PoseSummary();
  poses_.summary.of = poses_.cameras.size();
  const std::string html = Build();
  EXPECT_EQ(WellFormednessProblem(html), "");
  const report::SceneDrawings drawings = Draw(Input());
  for (const std::string& text : {drawings.top, drawings.side, Row(html, 0)}) {
    EXPECT_EQ(text.find("nan"), std::string::npos);
    EXPECT_EQ(text.find("inf"), std::string::npos);
  }
  EXPECT_EQ(report::BuildFacts(Input()).shot.level, report::Level::kBad);
}

TEST_F(ReportTest, RefusesPosesOfAnotherSet) {
  ThreadPool pool(1);
  RunContext context{pool};
  poses_.cameras[2].camera = "c99";
  const Result<std::string> renamed = BuildReport(Input(), context);
  ASSERT_FALSE(renamed.ok());
  EXPECT_EQ(renamed.error().code, ErrorCode::kInvalidArgument);
  EXPECT_NE(renamed.error().message.find("\"c99\""), std::string::npos);
  EXPECT_NE(renamed.error().message.find("\"c02\""), std::string::npos);
  poses_.cameras.pop_back();
  EXPECT_EQ(BuildReport(Input(), context).error().code, ErrorCode::kInvalidArgument);
}

TEST_F(ReportTest, StopsWhenAsked) {
  ThreadPool pool(1);
  std::stop_source source;
  source.request_stop();
  RunContext context{pool, source.get_token()};
  const Result<std::string> html = BuildReport(Input(), context);
  ASSERT_FALSE(html.ok());
  EXPECT_EQ(html.error().code, ErrorCode::kCancelled);
}

TEST(ReportHtmlTest, EscapesMarkupControlCharactersAndBrokenUtf8) {
  using rotunda::Escaped;
  EXPECT_EQ(Escaped("a<b>&\"'"), "a&lt;b&gt;&amp;&quot;&#39;");
  EXPECT_EQ(Escaped("σ° \xF0\x9F\x93\xB7"), "σ° \xF0\x9F\x93\xB7");
  const std::string unknown = "\xEF\xBF\xBD";
  EXPECT_EQ(Escaped(std::string_view("\0\n\x7F", 3)), unknown + unknown + unknown);
  EXPECT_EQ(Escaped("\xC3"), unknown);                              // cut short
  EXPECT_EQ(Escaped("\xC0\xBC"), unknown + unknown);                // overlong "<"
  EXPECT_EQ(Escaped("\xE0\x80\xBC"), unknown + unknown + unknown);  // overlong "<"
  EXPECT_EQ(Escaped("\xED\xA0\x80"), unknown + unknown + unknown);  // surrogate
  EXPECT_EQ(Escaped("\xEF\xBF\xBF"), unknown);                      // no character of XML
}

TEST(ReportHtmlTest, WritesFigures) {
  EXPECT_EQ(rotunda::Fixed(-1.005, 1), "-1.0");
  EXPECT_EQ(rotunda::Fixed(std::nan(""), 2), "–");
  EXPECT_EQ(rotunda::Significant(0.004123), "0.00412");
  EXPECT_EQ(rotunda::Significant(41.23), "41.2");
  EXPECT_EQ(rotunda::Significant(4123.4), "4123");
  EXPECT_EQ(rotunda::Significant(0), "0");
  EXPECT_EQ(rotunda::Grouped(0), "0");
  EXPECT_EQ(rotunda::Grouped(1234567), "1\u202F234\u202F567");
  EXPECT_EQ(rotunda::Coordinate(-0.04), "0");
  EXPECT_EQ(rotunda::Coordinate(12.96), "13");
  EXPECT_EQ(rotunda::Coordinate(-3.14), "-3.1");
}

TEST(ReportHtmlTest, Base64IsThatOfRfc4648) {
  const std::pair<const char*, const char*> vectors[] = {{"", ""},
                                                         {"f", "Zg=="},
                                                         {"fo", "Zm8="},
                                                         {"foo", "Zm9v"},
                                                         {"foob", "Zm9vYg=="},
                                                         {"fooba", "Zm9vYmE="},
                                                         {"foobar", "Zm9vYmFy"}};
  for (const auto& [plain, encoded] : vectors) EXPECT_EQ(rotunda::Base64(plain), encoded);
  EXPECT_EQ(rotunda::Base64("\xFF\xFE\xFD"), "//79");
}

}  // namespace
}  // namespace rotunda::sfm
