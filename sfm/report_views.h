#pragma once

#include <Eigen/Core>
#include <string>

#include "sfm/report_facts.h"

namespace rotunda::sfm::report {

/// Number of colours a graded figure is divided into; the style has --q0 ... --q6.
inline constexpr int kColourSteps = 7;

/// Step of a value between the quantity's 5th and 95th percentile.
int ColourStep(const Quantity& quantity, double value);

/// A way of looking at the model without perspective: unit vectors of the model frame that run to
/// the right and upwards on paper; their cross product points at the reader.
struct ViewAxes {
  Eigen::Vector3d right;
  Eigen::Vector3d up;
  Eigen::Vector3d Toward() const { return right.cross(up); }
};

struct SceneAxes {
  ViewAxes top;
  ViewAxes side;
  bool rig_frame = false;   // the axes are the rig's: x to the right, z up
  bool encircling = false;  // in the rig frame, with cameras all around: azimuth means something
};

/// The rig's axes when the poses are aligned to one; else principal axes of the camera centres,
/// "up" being the one the pictures' upper edges agree on, or the shortest when they do not.
SceneAxes ChooseAxes(const ReportInput& input);

struct SceneDrawings {
  std::string top;
  std::string side;
  std::string map;  // the cylinder of cameras unrolled; empty when not encircling
};

/// SVG elements. Cameras are links to #cam-<place in poses.cameras>.
SceneDrawings DrawScene(const ReportInput& input, const Facts& facts, const SceneAxes& axes);

/// The opening tag of a camera's drawing, with its name and state as tooltip, and one CSS variable
/// for its colour by each graded figure. Closed by "</a>".
std::string CameraLink(const ReportInput& input, const Facts& facts, size_t camera);

}  // namespace rotunda::sfm::report
