#include "tests/bench/calibration_mrcal.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <regex>
#include <sstream>

#include "sfm/core/file_io.h"
#include "tests/bench/bench_process.h"

namespace rotunda::bench {
namespace {

constexpr double kCentreOfPixel = 0.5;  // mrcal, as OpenCV, has it on integers
constexpr const char* kCornersFile = "corners.vnl";

double LeastSigma_px(const std::vector<rig::FaceView>& views) {
  double least = INFINITY;
  for (const rig::FaceView& view : views) {
    for (const rig::SeenCorner& corner : view.corners) least = std::min(least, corner.sigma_px);
  }
  return least;
}

/// A picture's corners row by row; no place where one was not seen.
std::string PictureText(const std::string& name, int corners, const rig::FaceView& view,
                        double unit_sigma_px) {
  std::map<int, const rig::SeenCorner*> seen;
  for (const rig::SeenCorner& corner : view.corners) seen[corner.corner] = &corner;
  std::string text;
  for (int i = 0; i < corners; ++i) {
    const auto corner = seen.find(i);
    if (corner == seen.end()) {
      text += name + " - - -\n";
      continue;
    }
    char place[96];
    const rig::SeenCorner& at = *corner->second;
    std::snprintf(place, sizeof(place), " %.6f %.6f %.6f\n", at.pixel.x() - kCentreOfPixel,
                  at.pixel.y() - kCentreOfPixel, unit_sigma_px / at.sigma_px);
    text += name + place;
  }
  return text;
}

/// mrgingham's format, of all pictures.
std::string CornersText(const rig::Board& board, const rig::BoardSightings& sightings,
                        const std::vector<rig::FaceView>& views) {
  std::map<std::pair<size_t, size_t>, const rig::FaceView*> by_picture;
  for (const rig::FaceView& view : views) by_picture[{view.camera, view.shot}] = &view;
  const double unit_sigma_px = LeastSigma_px(views);
  std::string text = "# filename x y weight\n";
  for (size_t c = 0; c < sightings.cameras.size(); ++c) {
    for (size_t s = 0; s < sightings.shots.size(); ++s) {
      const std::string name = "cam" + std::to_string(c) + "-" + std::to_string(s) + ".png";
      const auto view = by_picture.find({c, s});
      text += view == by_picture.end()
                  ? name + " - - -\n"
                  : PictureText(name, board.faces[0].CornerCount(), *view->second, unit_sigma_px);
    }
  }
  return text;
}

/// The numbers of `'key': [ ... ]` in a .cameramodel, whose format is a Python dictionary.
std::vector<double> Numbers(const std::string& text, const std::string& key) {
  std::smatch match;
  if (!std::regex_search(text, match, std::regex("'" + key + "':\\s*\\[([^\\]]*)\\]"))) {
    Die("mrcal's model has no " + key);
  }
  std::string list = match[1];
  std::replace(list.begin(), list.end(), ',', ' ');
  std::istringstream stream(list);
  std::vector<double> numbers;
  for (double number; stream >> number;) numbers.push_back(number);
  return numbers;
}

std::vector<std::string> Command(const rig::Board& board, const rig::BoardSightings& sightings,
                                 const std::string& lens_model, double focal_px,
                                 const test::TemporaryFolder& folder) {
  const rig::BoardFace& face = board.faces[0];
  const rig::SightedCamera& camera = sightings.cameras[0];
  std::vector<std::string> command = {"mrcal-calibrate-cameras", "--corners-cache-has-weights"};
  const auto add = [&](const std::string& option, const std::vector<std::string>& values) {
    command.push_back(option);
    command.insert(command.end(), values.begin(), values.end());
  };
  add("--corners-cache", {(folder / kCornersFile).string()});
  add("--lensmodel", {lens_model});
  add("--focal", {std::to_string(focal_px)});
  add("--imagersize", {std::to_string(camera.width_px), std::to_string(camera.height_px)});
  add("--object-spacing", {std::to_string(face.square_m)});
  add("--object-width-n", {std::to_string(face.columns - 1)});
  add("--object-height-n", {std::to_string(face.rows - 1)});
  add("--outdir", {folder.path().string()});
  for (size_t c = 0; c < sightings.cameras.size(); ++c) {
    command.push_back("cam" + std::to_string(c) + "-*.png");
  }
  return command;
}

MrcalCamera ReadCamera(const std::filesystem::path& file, const rig::SightedCamera& sighted) {
  const std::string text = OrDie(ReadFile(file));
  const std::vector<double> extrinsics = Numbers(text, "extrinsics");
  MrcalCamera camera;
  camera.intrinsics = {CameraModel::kOpencv, sighted.width_px, sighted.height_px,
                       Numbers(text, "intrinsics")};
  std::vector<double>& params = camera.intrinsics.params;
  params[2] += kCentreOfPixel;
  params[3] += kCentreOfPixel;
  // Its models are the beginnings of OpenCV's full one.
  if (params.size() > CameraParamCount(CameraModel::kOpencv)) {
    camera.intrinsics.model = CameraModel::kFullOpencv;
    params.resize(CameraParamCount(CameraModel::kFullOpencv), 0.0);
  }
  camera.cam_from_first = {
      rig::RotationOf(Eigen::Vector3d(extrinsics[0], extrinsics[1], extrinsics[2])),
      Eigen::Vector3d(extrinsics[3], extrinsics[4], extrinsics[5])};
  return camera;
}

}  // namespace

MrcalOutcome RunMrcal(const rig::Board& board, const rig::BoardSightings& sightings,
                      const std::vector<rig::FaceView>& views, const std::string& lens_model,
                      double focal_px) {
  const test::TemporaryFolder folder;
  OrDie(WriteFileAtomically(folder / kCornersFile, CornersText(board, sightings, views)));
  const test::ProcessOutcome outcome =
      RunOrDie(Command(board, sightings, lens_model, focal_px, folder));
  MrcalOutcome result;
  result.seconds = outcome.seconds;
  std::istringstream lines(outcome.output + outcome.errors);
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with("RMS") || line.starts_with("Noutliers")) result.summary += line + "  ";
  }
  for (size_t c = 0; c < sightings.cameras.size(); ++c) {
    result.cameras.push_back(ReadCamera(folder / ("camera-" + std::to_string(c) + ".cameramodel"),
                                        sightings.cameras[c]));
  }
  const Rigid3 first_from_reference = result.cameras[0].cam_from_first;
  for (MrcalCamera& camera : result.cameras) {
    camera.cam_from_first = camera.cam_from_first * first_from_reference.Inverse();
  }
  return result;
}

}  // namespace rotunda::bench
