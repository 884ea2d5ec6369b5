#include "tests/bench/calibration_mrcal.h"

#include <algorithm>
#include <cstdio>
#include <map>
#include <regex>
#include <sstream>

#include "sfm/core/file_io.h"
#include "tests/bench/bench_process.h"

namespace rotunda::bench {
namespace {

/// Every corner of every picture, row by row; "-" where it was not seen (mrgingham's format).
std::string CornersText(const rig::Board& board, const rig::BoardSightings& sightings,
                        const std::vector<rig::FaceView>& views) {
  std::map<std::pair<size_t, size_t>, const rig::FaceView*> by_picture;
  for (const rig::FaceView& view : views) by_picture[{view.camera, view.shot}] = &view;
  std::string text = "# filename x y level\n";
  char line[120];
  for (size_t c = 0; c < sightings.cameras.size(); ++c) {
    for (size_t s = 0; s < sightings.shots.size(); ++s) {
      const std::string name = "cam" + std::to_string(c) + "-" + std::to_string(s) + ".png";
      const auto place = by_picture.find({c, s});
      if (place == by_picture.end()) {
        text += name + " - - -\n";
        continue;
      }
      std::map<int, Eigen::Vector2d> seen;
      for (const auto& corner : place->second->corners) seen[corner.corner] = corner.pixel;
      for (int corner = 0; corner < board.faces[0].CornerCount(); ++corner) {
        const auto found = seen.find(corner);
        if (found == seen.end()) {
          text += name + " - - -\n";
          continue;
        }
        std::snprintf(line, sizeof(line), "%s %.6f %.6f 0\n", name.c_str(), found->second.x() - 0.5,
                      found->second.y() - 0.5);
        text += line;
      }
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

}  // namespace

MrcalOutcome RunMrcal(const rig::Board& board, const rig::BoardSightings& sightings,
                      const std::vector<rig::FaceView>& views, const std::string& lens_model,
                      double focal_px) {
  const test::TemporaryFolder folder;
  OrDie(WriteFileAtomically(folder / "corners.vnl", CornersText(board, sightings, views)));
  const rig::BoardFace& face = board.faces[0];
  std::vector<std::string> command = {"mrcal-calibrate-cameras",
                                      "--corners-cache",
                                      (folder / "corners.vnl").string(),
                                      "--lensmodel",
                                      lens_model,
                                      "--focal",
                                      std::to_string(focal_px),
                                      "--imagersize",
                                      std::to_string(sightings.cameras[0].width_px),
                                      std::to_string(sightings.cameras[0].height_px),
                                      "--object-spacing",
                                      std::to_string(face.square_m),
                                      "--object-width-n",
                                      std::to_string(face.columns - 1),
                                      "--object-height-n",
                                      std::to_string(face.rows - 1),
                                      "--outdir",
                                      folder.path().string()};
  for (size_t c = 0; c < sightings.cameras.size(); ++c) {
    command.push_back("cam" + std::to_string(c) + "-*.png");
  }
  const test::ProcessOutcome outcome = RunOrDie(command);
  MrcalOutcome result;
  result.seconds = outcome.seconds;
  std::istringstream lines(outcome.output + outcome.errors);
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with("RMS") || line.starts_with("Noutliers")) result.summary += line + "  ";
  }
  for (size_t c = 0; c < sightings.cameras.size(); ++c) {
    const std::string text =
        OrDie(ReadFile(folder / ("camera-" + std::to_string(c) + ".cameramodel")));
    const std::vector<double> extrinsics = Numbers(text, "extrinsics");
    const std::vector<double> intrinsics = Numbers(text, "intrinsics");
    const Eigen::Vector3d turn(extrinsics[0], extrinsics[1], extrinsics[2]);
    const Eigen::Vector3d shift(extrinsics[3], extrinsics[4], extrinsics[5]);
    result.cameras.push_back({intrinsics, {rig::RotationOf(turn), shift}});
  }
  const Rigid3 first_from_reference = result.cameras[0].cam_from_first;
  for (MrcalCamera& camera : result.cameras) {
    camera.cam_from_first = camera.cam_from_first * first_from_reference.Inverse();
  }
  return result;
}

}  // namespace rotunda::bench
