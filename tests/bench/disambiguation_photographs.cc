#include "tests/bench/disambiguation_photographs.h"

#include <Eigen/Core>
#include <algorithm>
#include <cstdio>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "sfm/colmap_io.h"
#include "sfm/frame_pictures.h"
#include "sfm/pipeline.h"
#include "sfm/presets.h"
#include "sfm/report_thumbnails.h"
#include "tests/bench/bench_process.h"
#include "tests/bench/disambiguation_layout.h"

namespace rotunda::bench {
namespace {

namespace fs = std::filesystem;

/// Of a copy's points, in the ball about their middle; the others may be mismatches.
constexpr double kShareInBall = 0.8;
constexpr size_t kMinPoints = 20;    // of a copy; fewer do not tell where it is
constexpr int kPhotograph_px = 330;  // larger side in the drawing: three beside each other

/// Place of the picture with this stem; -1: not there.
int IndexOf(const std::vector<std::string>& names, const std::string& stem) {
  for (size_t i = 0; i < names.size(); ++i) {
    if (fs::path(names[i]).stem() == stem) return static_cast<int>(i);
  }
  return -1;
}

/// The points that are seen within the box.
std::vector<size_t> PointsIn(const PictureBox& box, const sfm::ColmapModel& model) {
  std::vector<size_t> points;
  const int image = IndexOf(model.image_names, box.picture);
  for (size_t p = 0; image >= 0 && p < model.reconstruction.points.size(); ++p) {
    for (const Observation& seen : model.reconstruction.points[p].observations) {
      if (seen.image.index() != static_cast<size_t>(image)) continue;
      const sfm::Keypoint& k = model.features.image(seen.image).keypoints[seen.keypoint.index()];
      if (k.x_px > box.left && k.x_px < box.right && k.y_px > box.top && k.y_px < box.bottom) {
        points.push_back(p);
      }
    }
  }
  return points;
}

/// Where a copy is, in the model's frame.
struct Ball {
  Eigen::Vector3d middle;  // median by coordinate
  double radius = 0;
};

double AtShare(std::vector<double> values, double share) {
  const auto place = static_cast<size_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(place),
                   values.end());
  return values[place];
}

Ball BallOf(const std::vector<size_t>& points, const sfm::Reconstruction& model) {
  Ball ball;
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<double> values;
    for (const size_t p : points) values.push_back(model.points[p].position[axis]);
    ball.middle[axis] = AtShare(values, 0.5);
  }
  std::vector<double> distances;
  for (const size_t p : points)
    distances.push_back((model.points[p].position - ball.middle).norm());
  ball.radius = AtShare(distances, kShareInBall);
  return ball;
}

SceneJudgement Judge(const Scene& scene, const sfm::ColmapModel& model) {
  std::vector<Ball> balls;
  for (const PictureBox& box : scene.copies) {
    const std::vector<size_t> points = PointsIn(box, model);
    if (points.size() < kMinPoints) {
      return {false, "the copy in " + box.picture + " has " + std::to_string(points.size()) +
                         " points in the largest model, expected at least " +
                         std::to_string(kMinPoints)};
    }
    balls.push_back(BallOf(points, model.reconstruction));
  }
  const double apart = (balls[0].middle - balls[1].middle).norm();
  const double radii = balls[0].radius + balls[1].radius;
  char text[160];
  std::snprintf(text, sizeof text,
                "the copies in %s and %s are %.2f times their two radii apart, expected above 1",
                scene.copies[0].picture.c_str(), scene.copies[1].picture.c_str(), apart / radii);
  return {apart > radii, text};
}

/// The communities and the pictures that they are of.
sfm::PipelineResult RunAgain(const Cell& cell, const CaptureFiles& files, RunContext& context) {
  sfm::PipelineOptions options;
  if (cell.method.name == "plain") {
    options.method = sfm::Method::kPlain;
  } else {
    sfm::ApplyPreset(sfm::Preset::kInternet, options);
  }
  options.stages_folder = files.stages;
  options.start_from = sfm::Stage::kTwoViews;
  return OrDie(
      sfm::RunPipeline(OrDie(ReadFrameSet(files.frameset)), std::nullopt, options, context));
}

/// A photograph as small as the drawing has it, with its name and, if any, its marks.
cv::Mat Photograph(const sfm::PipelineResult& result, const sfm::report::Marks& marks,
                   const std::string& name) {
  std::vector<std::string> names;
  for (const Frame& frame : result.set.frames) names.push_back(frame.file);
  const int i = IndexOf(names, name);
  if (i < 0) Die(result.set.folder.string() + ": there is no photograph " + name);
  const cv::Mat whole = OrDie(sfm::ReadFramePicture(result.set, ImageId(static_cast<size_t>(i))));
  const double factor = static_cast<double>(kPhotograph_px) / std::max(whole.cols, whole.rows);
  cv::Mat small;
  cv::resize(whole, small, {}, factor, factor, cv::INTER_AREA);
  if (!marks.empty()) small = sfm::report::WithMarks(small, factor, marks[static_cast<size_t>(i)]);
  cv::putText(small, name, {6, 20}, cv::FONT_HERSHEY_SIMPLEX, 0.6, {255, 255, 255}, 3, cv::LINE_AA);
  cv::putText(small, name, {6, 20}, cv::FONT_HERSHEY_SIMPLEX, 0.6, {0, 0, 0}, 1, cv::LINE_AA);
  return small;
}

/// One row a copy.
cv::Mat Photographs(const Scene& scene, const sfm::PipelineResult& result, int width_px) {
  sfm::report::Marks marks;
  if (result.segments) marks = sfm::report::MarksOf(result.features, *result.segments);
  const int rows = static_cast<int>(scene.pictures.size());
  cv::Mat sheet(rows * kPhotograph_px, width_px, CV_8UC3, cv::Scalar::all(255));
  for (int row = 0; row < rows; ++row) {
    int left = 0;
    for (const std::string& name : scene.pictures[static_cast<size_t>(row)]) {
      const cv::Mat photograph = Photograph(result, marks, name);
      photograph.copyTo(
          sheet(cv::Rect(left, row * kPhotograph_px, photograph.cols, photograph.rows)));
      left += kPhotograph_px;
    }
  }
  return sheet;
}

}  // namespace

SceneJudgement JudgeScene(const Cell& cell, const CaptureFiles& files, const fs::path& model_folder,
                          const fs::path& png) {
  const sfm::ColmapModel model = OrDie(sfm::ReadColmapModel(model_folder));
  ThreadPool threads;
  RunContext context{threads};
  const sfm::PipelineResult result = RunAgain(cell, files, context);
  const Scene& scene = cell.capture.scene;
  const cv::Mat layout = LayoutDrawing(model);
  cv::Mat drawing;
  cv::vconcat(layout, Photographs(scene, result, layout.cols), drawing);
  if (!cv::imwrite(png.string(), drawing)) Die("cannot write " + png.string());
  return Judge(scene, model);
}

}  // namespace rotunda::bench
