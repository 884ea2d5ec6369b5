#include "rig/calibration_report.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <numeric>

#include "rig/calibration_drawings.h"
#include "sfm/core/html_text.h"

namespace rotunda::rig {
namespace {

constexpr const char* kStyle = R"css(
:root{color-scheme:light dark;--paper:#f6f7f9;--card:#fff;--ink:#14181f;--soft:#5b6472;--line:#e1e5ea;--accent:#2f6bbe;
--good:#13805a;--good-bg:#e7f5ee;--look:#a86500;--look-bg:#fdf3e0;--none:#fdebec;--mark:#c62f35}
@media screen and (prefers-color-scheme:dark){:root{--paper:#0e1116;--card:#161a21;--ink:#e8ebf0;--soft:#98a2b1;--line:#2a303a;
--accent:#7fb0f5;--good:#3fbf8b;--good-bg:#12291f;--look:#e5a63c;--look-bg:#2d2210;--none:#341619;--mark:#ff6b70}}
*{box-sizing:border-box}
body{margin:0;background:var(--paper);color:var(--ink);font:15px/1.5 system-ui,-apple-system,"Segoe UI",Roboto,Arial,sans-serif;font-variant-numeric:tabular-nums}
main,header{max-width:1360px;margin:0 auto;padding:0 28px}
header{padding-top:26px}
h1{font-size:1.45rem;font-weight:650;margin:0}
h2{font-size:1.05rem;font-weight:650;margin:0 0 4px}
header p,section p{margin:0 0 10px;color:var(--soft);font-size:.9rem}
section{margin:30px 0}
.card{background:var(--card);border:1px solid var(--line);border-radius:10px}
.verdict{padding:14px 18px;border-left:6px solid;border-radius:10px;margin:16px 0}
.verdict.good{background:var(--good-bg);border-color:var(--good)}
.verdict.look{background:var(--look-bg);border-color:var(--look)}
.verdict ul{margin:6px 0 0;padding-left:20px}
.tiles{display:flex;flex-wrap:wrap;gap:1px;background:var(--line);overflow:hidden;margin:0}
.tile{flex:1 1 170px;background:var(--card);padding:12px 14px}
.tile dt{color:var(--soft);font-size:.84rem}
.tile dd{margin:0;font-size:1.4rem;font-weight:620}
.tile dd small{display:block;font-size:.84rem;font-weight:400;color:var(--soft)}
.views{display:grid;grid-template-columns:1fr 1fr;gap:14px;align-items:start}
.maps{display:grid;grid-template-columns:repeat(auto-fill,minmax(112px,1fr));gap:10px}
figure{margin:0;padding:8px}
figcaption{font-size:.8rem;color:var(--soft)}
svg{display:block;width:100%;height:auto}
svg text{font-size:12px;fill:var(--soft);font-family:inherit}
.scroll{overflow:auto}
table{border-collapse:collapse;width:100%;font-size:.88rem}
th,td{padding:4px 10px;text-align:right;border-bottom:1px solid var(--line);white-space:nowrap}
th:first-child,td:first-child,.text{text-align:left}
th{color:var(--soft);font-weight:500}
.words td:last-child,.words th:last-child{white-space:normal;text-align:left;min-width:22em}
)css";

using Row = std::vector<std::string>;

/// Cells are text, not markup.
std::string Table(const Row& head, const std::vector<Row>& rows) {
  std::string html = "<div class=\"card scroll\"><table><thead><tr>";
  for (const std::string& cell : head) html += "<th>" + Escaped(cell) + "</th>";
  html += "</tr></thead><tbody>\n";
  for (const Row& row : rows) {
    html += "<tr>";
    for (const std::string& cell : row) html += "<td>" + Escaped(cell) + "</td>";
    html += "</tr>\n";
  }
  return html + "</tbody></table></div>\n";
}

/// A table whose last column has sentences.
std::string WordsTable(const Row& head, const std::vector<Row>& rows) {
  return "<div class=\"words\">" + Table(head, rows) + "</div>\n";
}

std::string Section(const std::string& title, const std::string& explanation,
                    const std::string& content) {
  return "<section><h2>" + title + "</h2><p>" + explanation + "</p>" + content + "</section>\n";
}

std::string Tile(const std::string& name, const std::string& figure, const std::string& more) {
  return "<div class=\"tile\"><dt>" + name + "</dt><dd>" + figure + "<small>" + more +
         "</small></dd></div>\n";
}

std::string Ratio(const std::optional<double>& ratio) { return ratio ? Fixed(*ratio, 2) : "–"; }

std::string HeldOutTile(const CrossValidation& validation) {
  if (!validation.held_out_rms_px) return Tile("Held out", "–", "too few corners to hold some out");
  return Tile("Held out", Fixed(*validation.held_out_rms_px, 3) + " px",
              "RMS; 95 % below " + Fixed(*validation.held_out_p95_px, 3) + " px");
}

std::string TwoHalvesTile(const CrossValidation& validation) {
  if (!validation.position_ratio) return Tile("Two halves", "–", "too few corners to halve them");
  return Tile("Two halves", Fixed(*validation.position_ratio, 2),
              "position, " + Fixed(*validation.rotation_ratio, 2) +
                  " rotation: difference over what sigma says; honest near 1");
}

std::string Tiles(const CalibrationReportInput& input) {
  const CalibrationResiduals& residuals = *input.calibration.residuals;
  double rotation = 0, position = 0, focal = 0;
  for (const CalibratedCamera& camera : input.calibration.cameras) {
    rotation += camera.sigma->rotation_deg;
    position += camera.sigma->position_mm;
    focal += 100 * camera.sigma->focal_px.value_or(0) / camera.intrinsics.MeanFocal_px();
  }
  const auto count = static_cast<double>(input.calibration.cameras.size());
  const double kept =
      100.0 * static_cast<double>(residuals.kept) / static_cast<double>(residuals.corners);
  return "<dl class=\"card tiles\">" +
         Tile("Cameras", std::to_string(input.calibration.cameras.size()),
              "of " + std::to_string(input.sightings.cameras.size())) +
         Tile("Corners", Grouped(residuals.kept), Fixed(kept, 1) + " % of those found") +
         Tile("RMS", Fixed(residuals.rms_px, 3) + " px",
              Fixed(residuals.noise, 2) + " times the detector's sigma") +
         HeldOutTile(input.validation) +
         Tile("Uncertainty", Significant(position / count) + " mm",
              Significant(rotation / count) + " deg, focal length " + Significant(focal / count) +
                  " %, mean of 1 sigma") +
         TwoHalvesTile(input.validation) + "</dl>\n";
}

/// What changed since another calibration comes first.
std::string Verdict(const CalibrationReportInput& input) {
  std::vector<std::string> told;
  if (input.comparison) told = ChangesIn(*input.comparison);
  std::string heading = told.empty() ? "" : Counted(told.size(), "change");
  if (!input.notes.empty()) {
    heading += (told.empty() ? "" : ", ") + Counted(input.notes.size(), "note");
  }
  told.insert(told.end(), input.notes.begin(), input.notes.end());
  if (told.empty()) {
    return std::string("<div class=\"verdict good\"><h2>Every camera is calibrated") +
           (input.result.free.intrinsics ? " and well covered" : "") + "</h2></div>";
  }
  std::string html = "<div class=\"verdict look\"><h2>" + heading + "</h2><ul>";
  for (const std::string& one : told) html += "<li>" + Escaped(one) + "</li>\n";
  return html + "</ul></div>\n";
}

std::string CameraTable(const CalibrationReportInput& input) {
  std::vector<Row> rows;
  for (size_t c = 0; c < input.checks.size(); ++c) {
    const CameraCheck& check = input.checks[c];
    const auto& uncertainty = input.result.uncertainty.cameras[c];
    Row row = {input.sightings.cameras[c].camera, std::to_string(check.pictures),
               std::to_string(check.kept), std::to_string(check.found - check.kept)};
    if (!uncertainty) {
      row.insert(row.end(), {"–", "–", "–", "–", "–", "–", "–", "–"});
    } else {
      const CameraIntrinsics& lens = input.result.model.intrinsics[c];
      row.insert(
          row.end(),
          {Fixed(100 * check.covered, 0), Fixed(check.rms_px, 3),
           Fixed(uncertainty->sigma.rotation_deg, 4), Fixed(uncertainty->sigma.position_mm, 3),
           Fixed(lens.MeanFocal_px(), 2), Fixed(uncertainty->sigma.focal_px.value_or(0), 2),
           Fixed(uncertainty->projection_mean_px, 3), Fixed(uncertainty->projection_max_px, 3)});
    }
    rows.push_back(std::move(row));
  }
  return Table({"camera", "shots", "corners", "outliers", "covered %", "RMS px", "sigma deg",
                "sigma mm", "focal px", "sigma px", "projection px", "worst px"},
               rows);
}

std::string FaceTable(const CalibrationReportInput& input) {
  std::vector<Row> rows;
  for (size_t f = 0; f < input.board.faces.size(); ++f) {
    const BoardFace& drawn = input.board.faces[f];
    const CalibratedFace& found = input.result.model.faces[f];
    const auto& sigma = input.result.uncertainty.faces[f];
    if (!sigma) continue;
    const Eigen::Vector3d middle = FaceMiddle(drawn);
    const double shift_m = (found.board_from_face * middle - drawn.board_from_face * middle).norm();
    const double turn_rad =
        RotationAngle_rad(found.board_from_face.rotation, drawn.board_from_face.rotation);
    rows.push_back({drawn.name, Fixed(1e3 * shift_m, 3), Fixed(sigma->position_mm, 3),
                    Fixed(DegFromRad(turn_rad), 4), Fixed(sigma->rotation_deg, 4),
                    Fixed(1e3 * found.bow_m.x(), 3), Fixed(1e3 * found.bow_m.y(), 3),
                    Fixed(sigma->bow_mm, 3)});
  }
  return Table({"face", "off the drawing mm", "sigma mm", "turned deg", "sigma deg",
                "bow about vertical mm", "about horizontal mm", "sigma mm"},
               rows);
}

std::string ShotTable(const CalibrationReportInput& input) {
  const BoardShape shape = ShapeOf(input.board);
  const size_t shots = input.sightings.shots.size();
  std::vector<size_t> cameras(shots, 0), corners(shots, 0), last(shots, SIZE_MAX);
  std::vector<double> squares(shots, 0);
  for (const FaceView& view : input.result.kept) {  // sorted by camera
    cameras[view.shot] += last[view.shot] != view.camera;
    last[view.shot] = view.camera;
    corners[view.shot] += view.corners.size();
    for (const auto& residual : Residuals_px(input.result.model, shape, view)) {
      squares[view.shot] += residual.squaredNorm();
    }
  }
  std::vector<Row> rows;
  for (size_t s = 0; s < shots; ++s) {
    const std::string rms =
        corners[s] == 0 ? "–" : Fixed(std::sqrt(squares[s] / static_cast<double>(corners[s])), 3);
    rows.push_back({input.sightings.shots[s].id, std::to_string(cameras[s]),
                    std::to_string(corners[s]), rms,
                    input.result.shot_problem[s].empty() ? "used" : input.result.shot_problem[s]});
  }
  return WordsTable({"shot", "cameras", "corners", "RMS px", ""}, rows);
}

/// Of the earlier calibration and of this one; a dash where it does not say.
std::string BothSigmas(const CameraChange& change, double PoseSigma::*sigma, int decimals) {
  const auto text = [&](const std::optional<PoseSigma>& pose) {
    return pose ? Fixed((*pose).*sigma, decimals) : std::string("–");
  };
  return text(change.sigma_before) + ", " + text(change.sigma_after);
}

std::string ComparisonTable(const CalibrationComparison& comparison) {
  std::vector<Row> rows;
  for (const CameraChange& change : comparison.cameras) {
    rows.push_back({change.camera, Fixed(change.position_mm, 3),
                    BothSigmas(change, &PoseSigma::position_mm, 3), Fixed(change.rotation_deg, 4),
                    BothSigmas(change, &PoseSigma::rotation_deg, 4), Fixed(change.sigmas, 2),
                    Fixed(change.focal_percent, 3), Ratio(change.lens_sigmas), VerdictOn(change)});
  }
  std::stable_sort(rows.begin(), rows.end(), [](const Row& a, const Row& b) {
    return !a.back().empty() && b.back().empty();
  });
  return Table({"camera", "mm", "sigma then, now", "deg", "sigma then, now", "sigmas",
                "focal length %", "lens, sigmas", ""},
               rows);
}

std::string ReasonTable(const std::vector<RejectedCount>& rejected) {
  std::vector<Row> rows;
  for (const RejectedCount& count : rejected) {
    rows.push_back({count.text.name, std::to_string(count.count),
                    std::to_string(count.cameras.size()), WorstCameras(count), count.text.remedy});
  }
  return WordsTable({"reason", "count", "cameras", "most", "what to do"}, rows);
}

/// What was looked for in the pictures, markers or corners, and not used.
struct NotUsed {
  std::string title, explanation;
  std::vector<RejectedCount> rejected;
  std::function<size_t(const BoardDetection&)> used;  // of the same, how many were
};

/// By camera, a column for each reason; cameras with none are left out.
std::string RejectedByCamera(const BoardSightings& sightings, const NotUsed& what) {
  Row head = {"camera", "used", "not used"};
  std::map<std::string, std::vector<size_t>> counts;  // by reason
  for (size_t kind = 0; kind < what.rejected.size(); ++kind) {
    head.push_back(what.rejected[kind].text.name);
    for (const auto& [camera, count] : what.rejected[kind].cameras) {
      counts[camera].resize(what.rejected.size(), 0);
      counts[camera][kind] = count;
    }
  }
  std::vector<Row> rows;
  for (size_t c = 0; c < sightings.cameras.size(); ++c) {
    const auto own = counts.find(sightings.cameras[c].camera);
    if (own == counts.end()) continue;
    size_t used = 0;
    for (const auto& shot : sightings.sightings) {
      if (shot[c].detection) used += what.used(*shot[c].detection);
    }
    const size_t all = std::accumulate(own->second.begin(), own->second.end(), size_t{0});
    Row row = {own->first, std::to_string(used), std::to_string(all)};
    for (const size_t count : own->second) row.push_back(std::to_string(count));
    rows.push_back(std::move(row));
  }
  return Table(head, rows);
}

std::string RejectedSection(const BoardSightings& sightings, const NotUsed& what) {
  if (what.rejected.empty()) return Section(what.title, "None: all were used.", "");
  return Section(what.title, what.explanation,
                 ReasonTable(what.rejected) + "<p></p>" + RejectedByCamera(sightings, what));
}

std::string RejectedSections(const BoardSightings& sightings) {
  const NotUsed markers = {
      "Markers not used", "Markers that were read in the pictures and left out, with the reason.",
      CountRejectedMarkers(sightings),
      [](const BoardDetection& d) { return static_cast<size_t>(d.markers_found); }};
  const NotUsed corners = {
      "Corners not used",
      "Corners of the squares that were looked for where the markers put them and are not used, "
      "with the reason. Those that were found and do not fit the result are the cameras' outliers.",
      CountRejectedCorners(sightings), [](const BoardDetection& d) { return d.corners.size(); }};
  return RejectedSection(sightings, markers) + RejectedSection(sightings, corners);
}

double LongestResidual_px(const std::vector<CameraCheck>& checks) {
  double longest_px = 0;
  for (const CameraCheck& check : checks) {
    for (const Eigen::Vector2d& mean : check.mean_px) {
      longest_px = std::max(longest_px, mean.norm());
    }
  }
  return longest_px;
}

std::string Maps(const CalibrationReportInput& input, double longest_px) {
  size_t most = 1;
  for (const CameraCheck& check : input.checks) {
    for (const size_t count : check.cells) most = std::max(most, count);
  }
  std::string html = "<div class=\"maps\">";
  for (size_t c = 0; c < input.checks.size(); ++c) {
    html += "<figure class=\"card\">" +
            DrawCameraMap(input.checks[c], input.result.model.intrinsics[c], most, longest_px) +
            "<figcaption>" + Escaped(input.sightings.cameras[c].camera) +
            "</figcaption></figure>\n";
  }
  return html + "</div>";
}

std::string Heading(const CalibrationReportInput& input) {
  return "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>Calibration " +
         Escaped(input.calibration.id) + "</title><style>" + kStyle + "</style></head><body>\n" +
         "<header><h1>Calibration " + Escaped(input.calibration.id) + "</h1><p>" +
         Escaped(input.calibration.created_at) + ", target " + Escaped(input.board.name) + ", " +
         Counted(input.sightings.shots.size(), "shot") + "</p></header>\n";
}

std::string Layout(const CalibrationReportInput& input) {
  return "<div class=\"views\"><figure class=\"card\">" +
         DrawLayout(input.board, input.result, LayoutView::kTop) +
         "<figcaption>from above, front to the right</figcaption></figure>"
         "<figure class=\"card\">" +
         DrawLayout(input.board, input.result, LayoutView::kSide) +
         "<figcaption>from the side</figcaption></figure></div>";
}

}  // namespace

std::string BuildCalibrationReport(const CalibrationReportInput& input) {
  std::string html = Heading(input) + "<main>" + Verdict(input) + Tiles(input);
  html += Section("Layout",
                  "Cameras and the target of every shot, in the rig frame. A camera's circle grows "
                  "with its position's uncertainty.",
                  Layout(input));
  const double longest_px = LongestResidual_px(input.checks);
  html += Section("Coverage and residuals over the picture",
                  "The darker a cell, the more corners; a red one has none. Bars show the mean "
                  "residual of a cell, all to one scale, the longest " +
                      Significant(longest_px) +
                      " px: in a good calibration they are short and point anywhere.",
                  Maps(input, longest_px));
  html += Section("Cameras",
                  "Sigmas are one standard deviation after the rigid fit of all camera centres "
                  "(roots of the traces). Projection: how far a point of the rig may appear off.",
                  CameraTable(input));
  html += RejectedSections(input.sightings);
  html += Section("Target", "Where each face is and how it bows, found together with the cameras.",
                  FaceTable(input));
  html += Section("Shots", "Corners that the result stands on.", ShotTable(input));
  if (input.comparison) {
    html += Section("Since the calibration compared with",
                    "After the rigid alignment that most cameras agree on; named above " +
                        Fixed(input.comparison->sigmas_limit, 2) + " sigmas.",
                    ComparisonTable(*input.comparison));
  }
  return html + "</main></body></html>\n";
}

}  // namespace rotunda::rig
