#include "rig/calibration_drawings.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "sfm/core/html_text.h"

namespace rotunda::rig {
namespace {

constexpr double kViewWidth = 620, kViewMargin = 24;  // drawing units
constexpr double kViewDirection = 22;                 // length of a camera's line
constexpr double kLeastRadius = 2.5, kRadiusPerMm = 20, kMostRadius = 14;

/// Rig coordinates to a drawing; y grows downward there.
struct Canvas {
  Eigen::AlignedBox2d box;  // metres
  double scale = 1;
  double height = 0;

  Eigen::Vector2d At(const Eigen::Vector2d& p) const {
    return {kViewMargin + scale * (p.x() - box.min().x()),
            height - kViewMargin - scale * (p.y() - box.min().y())};
  }
};

Eigen::Vector2d Flat(const Eigen::Vector3d& x, LayoutView view) {
  return view == LayoutView::kTop ? Eigen::Vector2d(x.x(), x.y()) : Eigen::Vector2d(x.y(), x.z());
}

std::string Attribute(const char* name, double value) {
  return std::string(" ") + name + "=\"" + Coordinate(value) + "\"";
}

std::vector<Eigen::Vector3d> Outline(const BoardFace& face, const Rigid3& rig_from_face) {
  return {rig_from_face * Eigen::Vector3d(0, 0, 0),
          rig_from_face * Eigen::Vector3d(face.Width_m(), 0, 0),
          rig_from_face * Eigen::Vector3d(face.Width_m(), face.Height_m(), 0),
          rig_from_face * Eigen::Vector3d(0, face.Height_m(), 0)};
}

/// Outlines of all faces in all shots.
std::vector<std::vector<Eigen::Vector3d>> Outlines(const Board& board, const RigModel& model) {
  std::vector<std::vector<Eigen::Vector3d>> outlines;
  for (const auto& rig_from_board : model.rig_from_board) {
    if (!rig_from_board) continue;
    for (size_t f = 0; f < board.faces.size(); ++f) {
      outlines.push_back(Outline(board.faces[f], *rig_from_board * model.faces[f].board_from_face));
    }
  }
  return outlines;
}

Canvas Fit(const RigModel& model, const std::vector<std::vector<Eigen::Vector3d>>& outlines,
           LayoutView view) {
  Canvas canvas;
  for (const auto& pose : model.cam_from_rig) {
    if (pose) canvas.box.extend(Flat(pose->OriginInSource(), view));
  }
  for (const auto& outline : outlines) {
    for (const Eigen::Vector3d& x : outline) canvas.box.extend(Flat(x, view));
  }
  constexpr double kLeastSize_m = 1e-3;
  const Eigen::Vector2d size = canvas.box.sizes().cwiseMax(kLeastSize_m);
  canvas.scale = (kViewWidth - 2 * kViewMargin) / size.maxCoeff();
  canvas.height = canvas.scale * size.y() + 2 * kViewMargin;
  return canvas;
}

}  // namespace

std::string DrawLayout(const Board& board, const RigCalibration& result, LayoutView view) {
  const auto outlines = Outlines(board, result.model);
  const Canvas canvas = Fit(result.model, outlines, view);
  std::string svg =
      "<svg viewBox=\"0 0 " + Coordinate(kViewWidth) + " " + Coordinate(canvas.height) + "\">\n";
  for (const auto& outline : outlines) {
    svg += "<polygon fill=\"none\" stroke=\"var(--soft)\" stroke-width=\"0.6\" points=\"";
    for (const Eigen::Vector3d& x : outline) {
      const Eigen::Vector2d p = canvas.At(Flat(x, view));
      svg += Coordinate(p.x()) + "," + Coordinate(p.y()) + " ";
    }
    svg += "\"/>\n";
  }
  for (size_t c = 0; c < result.model.cam_from_rig.size(); ++c) {
    const auto& pose = result.model.cam_from_rig[c];
    if (!pose) continue;
    const Eigen::Vector2d at = canvas.At(Flat(pose->OriginInSource(), view));
    const Eigen::Vector2d ahead =
        Flat(pose->rotation.conjugate() * Eigen::Vector3d::UnitZ(), view) * kViewDirection;
    const double radius =
        std::min(kMostRadius,
                 kLeastRadius + kRadiusPerMm * result.uncertainty.cameras[c]->sigma.position_mm);
    svg += "<line stroke=\"var(--accent)\"" + Attribute("x1", at.x()) + Attribute("y1", at.y()) +
           Attribute("x2", at.x() + ahead.x()) + Attribute("y2", at.y() - ahead.y()) + "/>" +
           "<circle fill=\"var(--accent)\" fill-opacity=\"0.6\"" + Attribute("cx", at.x()) +
           Attribute("cy", at.y()) + Attribute("r", radius) + "/>\n";
  }
  return svg + "</svg>";
}

std::string DrawCameraMap(const CameraCheck& check, const CameraIntrinsics& intrinsics, size_t most,
                          double longest_px) {
  constexpr double kWidth = 120;
  constexpr double kFaintest = 0.12;  // opacity of a cell with one corner
  const CalibrationCheckOptions grid;
  const double cell_x = kWidth / grid.cells_across;
  const double height = kWidth * intrinsics.height_px / std::max(1, intrinsics.width_px);
  const double cell_y = height / grid.cells_down;
  std::string svg = "<svg viewBox=\"0 0 " + Coordinate(kWidth) + " " + Coordinate(height) + "\">\n";
  for (size_t i = 0; i < check.cells.size(); ++i) {
    const auto column = static_cast<double>(i % static_cast<size_t>(grid.cells_across));
    const auto row = static_cast<double>(i / static_cast<size_t>(grid.cells_across));
    const double share = std::sqrt(static_cast<double>(check.cells[i]) / static_cast<double>(most));
    svg += "<rect" + Attribute("x", column * cell_x) + Attribute("y", row * cell_y) +
           Attribute("width", cell_x) + Attribute("height", cell_y);
    svg += check.cells[i] == 0 ? std::string(" fill=\"var(--none)\"/>")
                               : " fill=\"var(--accent)\" fill-opacity=\"" +
                                     Fixed(kFaintest + (1 - kFaintest) * 0.7 * share, 2) + "\"/>";
    if (check.cells[i] == 0 || !(longest_px > 0)) continue;
    const Eigen::Vector2d middle((column + 0.5) * cell_x, (row + 0.5) * cell_y);
    const Eigen::Vector2d tip = middle + 0.5 * cell_x / longest_px * check.mean_px[i];
    svg += "<line stroke=\"var(--mark)\"" + Attribute("x1", middle.x()) +
           Attribute("y1", middle.y()) + Attribute("x2", tip.x()) + Attribute("y2", tip.y()) +
           "/>\n";
  }
  return svg + "</svg>";
}

}  // namespace rotunda::rig
