#include "sfm/report.h"

#include <algorithm>

#include "sfm/core/html_text.h"
#include "sfm/report_charts.h"
#include "sfm/report_facts.h"
#include "sfm/report_style.h"
#include "sfm/report_thumbnails.h"
#include "sfm/report_views.h"

namespace rotunda::sfm {
namespace report {
namespace {

std::string WithUnit(double value, int decimals, const std::string& unit) {
  return Fixed(value, decimals) + (unit.empty() || unit == "°" ? unit : " " + unit);
}

Status CheckInput(const ReportInput& input) {
  const auto& frames = input.set.frames;
  const auto& cameras = input.poses.cameras;
  if (frames.size() != cameras.size()) {
    return Error{ErrorCode::kInvalidArgument,
                 "poses of " + Counted(cameras.size(), "camera") + " for a frame set of " +
                     std::to_string(frames.size()),
                 "report"};
  }
  for (size_t i = 0; i < frames.size(); ++i) {
    if (frames[i].camera != cameras[i].camera) {
      return Error{ErrorCode::kInvalidArgument,
                   "camera \"" + cameras[i].camera + "\" of the poses stands where the frame set " +
                       "has \"" + frames[i].camera + "\"",
                   "report"};
    }
  }
  return {};
}

std::string HeaderHtml(const ReportInput& input) {
  std::string line = input.set.subject ? "Subject " + *input.set.subject + " · " : "";
  if (!input.set.captured_at.empty()) line += "captured " + input.set.captured_at + " · ";
  line += "method " + input.poses.method;
  if (input.poses.aligned_to) line += " · aligned to calibration " + *input.poses.aligned_to;
  return "<header><h1>" + Escaped(input.poses.frameset) + "</h1><p>" + Escaped(line) +
         "</p></header>\n";
}

std::string VerdictHtml(const Verdict& verdict) {
  std::string html = "<div class=\"verdict " + std::string(LevelName(verdict.level)) +
                     "\"><div class=\"mark\">" + Escaped(verdict.mark) + "</div><h2>" +
                     Escaped(verdict.headline) + "</h2>";
  for (const std::string& detail : verdict.details) html += "<p>" + Escaped(detail) + "</p>";
  return html + "</div>\n";
}

/// `unit` and `more` are plain text.
std::string Tile(const std::string& label, const std::string& figure, const std::string& unit,
                 const std::string& more) {
  return "<div class=\"tile\"><dt>" + Escaped(label) + "</dt><dd><div class=\"figure\">" +
         Escaped(figure) + "<small>" + Escaped(unit == "°" || unit.empty() ? unit : " " + unit) +
         "</small></div><div class=\"more\">" + Escaped(more) + "</div></dd></div>\n";
}

/// Mean, with median, largest value and whose it is below.
std::string SpreadTile(const ReportInput& input, const Quantity& quantity, double mean) {
  return Tile(quantity.label + ", mean", Significant(mean), quantity.unit,
              "median " + Significant(quantity.median) + ", max " + Significant(quantity.max) +
                  " (" + input.poses.cameras[quantity.worst].camera + ")");
}

std::string TilesHtml(const ReportInput& input, const Facts& facts) {
  const PoseSummary& summary = input.poses.summary;
  const std::string of = "of " + std::to_string(summary.of);
  const double track_length = summary.points > 0 ? static_cast<double>(facts.observations) /
                                                       static_cast<double>(summary.points)
                                                 : 0.0;
  std::string html = "<dl class=\"tiles card\">\n";
  html += Tile(
      "Cameras registered", std::to_string(summary.registered), of,
      Counted(summary.models, "model") +
          (summary.ambiguous_communities > 0
               ? ", " + std::to_string(summary.ambiguous_communities) + " ambiguous communities"
               : ""));
  html += Tile("Residual rms", Significant(summary.rms_px), "px",
               "mean reprojection error " + Significant(summary.mean_reprojection_px) + " px");
  html +=
      Tile("Points", Grouped(summary.points), "",
           Grouped(facts.observations) + " observations, " + Fixed(track_length, 1) + " a point");
  for (const char* key : {"sigma-rotation", "sigma-position"}) {
    const Quantity* quantity = facts.Find(key);
    if (quantity) html += SpreadTile(input, *quantity, quantity->mean);
  }
  // The summary's own means, because they are what poses.json says.
  if (const Quantity* turn = facts.Find("drift-rotation"); turn && summary.mean_rotation_deg) {
    html += SpreadTile(input, *turn, *summary.mean_rotation_deg);
  }
  if (const Quantity* shift = facts.Find("drift-position"); shift && summary.mean_position_mm) {
    html += SpreadTile(input, *shift, *summary.mean_position_mm);
  }
  return html + "</dl>\n";
}

std::string ColourButton(const std::string& key, const std::string& label, bool pressed) {
  return "<button type=\"button\" data-by=\"" + key + "\" aria-pressed=\"" +
         (pressed ? "true" : "false") + "\">" + Escaped(label) + "</button>";
}

std::string ColourControls(const Facts& facts) {
  std::string html = "<div class=\"by\" role=\"group\" aria-label=\"Colour cameras by\">" +
                     ColourButton("state", "State", true);
  for (const Quantity& quantity : facts.quantities) {
    if (quantity.graded) html += ColourButton(quantity.key, quantity.label, false);
  }
  return html + "</div>\n";
}

/// Only the states that occur.
std::string StateLegend(const ReportInput& input, const Facts& facts) {
  const auto entry = [](const std::string& mark, const std::string& text) {
    return "<span><i " + mark + "></i>" + text + "</span>";
  };
  bool look = false, moved = false, swapped = false, wrong_side = false, missing = false;
  for (size_t i = 0; i < facts.cameras.size(); ++i) {
    look = look || facts.cameras[i].level == Level::kLook;
    moved = moved || facts.cameras[i].moved;
    swapped = swapped || facts.cameras[i].swapped;
    wrong_side = wrong_side || facts.cameras[i].wrong_side;
    missing = missing || !input.poses.cameras[i].registered;
  }
  std::string html = "<div class=\"legend state\" data-for=\"state\">" +
                     entry("style=\"--c:var(--accent)\"", "good");
  if (look) html += entry("style=\"--c:var(--look)\"", "worth a look");
  if (moved) {
    html += entry("style=\"--c:var(--bad)\"", "moved (dashed: where the calibration has it)");
  }
  if (swapped) html += entry("style=\"--c:var(--bad)\"", "swapped with another camera");
  if (wrong_side) html += entry("style=\"--c:var(--bad)\"", "on the wrong side");
  if (missing && input.poses.aligned_to) {
    html += entry("class=\"hollow\"", "not registered, drawn where the calibration has it");
  }
  return html + "</div>\n";
}

std::string Legends(const ReportInput& input, const Facts& facts) {
  std::string html = StateLegend(input, facts);
  for (const Quantity& quantity : facts.quantities) {
    if (!quantity.graded) continue;
    html += "<div class=\"legend\" data-for=\"" + quantity.key + "\">≤ " +
            WithUnit(quantity.low, quantity.decimals, quantity.unit) + "<span class=\"ramp\">";
    for (int step = 0; step < kColourSteps; ++step) {
      html += "<i style=\"--c:var(--q" + std::to_string(step) + ")\"></i>";
    }
    html += "</span>≥ " + WithUnit(quantity.high, quantity.decimals, quantity.unit) + "</div>\n";
  }
  return html;
}

/// Rules that show one legend and colour the cameras by the figure chosen; one a graded figure.
std::string ColourRules(const Facts& facts) {
  std::string css = "[data-by=state] .legend.state{display:flex}\n";
  for (const Quantity& quantity : facts.quantities) {
    if (!quantity.graded) continue;
    css += "[data-by=" + quantity.key + "] .legend[data-for=" + quantity.key +
           "]{display:flex}[data-by=" + quantity.key +
           "] .views .cam:not(.hot):not(.missing){--c:var(--" + quantity.key + ",var(--line))}\n";
  }
  return css;
}

std::string Figure(const std::string& css, const std::string& title, const std::string& caption,
                   const std::string& svg) {
  return "<figure class=\"card " + css + "\"><figcaption><b>" + title + "</b> " + caption +
         "</figcaption>" + svg + "</figure>\n";
}

std::string ViewsHtml(const ReportInput& input, const Facts& facts) {
  const SceneAxes axes = ChooseAxes(input);
  const SceneDrawings drawings = DrawScene(input, facts, axes);
  std::string html = "<section><div class=\"head\"><h2>Cameras and points</h2>" +
                     Legends(input, facts) + ColourControls(facts) +
                     "</div><div class=\"views\">\n";
  if (!drawings.map.empty()) {
    html += Figure("wide", "Rig unrolled", "seen from the middle of the rig, by azimuth and height",
                   drawings.map);
  }
  const std::string frame = axes.rig_frame ? "" : ", along principal axes of the cameras";
  html += Figure("", "From above", axes.rig_frame ? "front to the right" : frame.substr(2),
                 drawings.top);
  html += Figure("", "From the side", axes.rig_frame ? "from the subject's right" : frame.substr(2),
                 drawings.side);
  return html + "</div></section>\n";
}

std::string BarsHtml(const ReportInput& input, const Facts& facts) {
  const std::string bars = DrawBars(input, facts);
  if (bars.empty()) return {};
  return "<section><div class=\"head\"><h2>Camera by camera</h2><p>dashed: median</p></div>"
         "<div class=\"card chart\">" +
         bars + "</div></section>\n";
}

std::string HeadCell(const std::string& label, const std::string& unit, bool text, bool down) {
  return "<th" + std::string(text ? " class=\"left\"" : "") + (down ? " data-first=\"down\"" : "") +
         "><button type=\"button\"><span>" + Escaped(label) + "</span><small>" +
         (unit.empty() ? "\u00A0" : Escaped(unit)) + "</small></button></th>";
}

std::string TableHead(const Facts& facts) {
  std::string html = "<thead><tr>" + HeadCell("Camera", "", true, false);
  if (facts.has_sides) html += HeadCell("Side", "", true, false);
  for (const Quantity& quantity : facts.quantities) {
    html += HeadCell(quantity.label, quantity.unit, false, quantity.graded);
  }
  return html + HeadCell("Remarks", "", true, false) + "</tr></thead>\n";
}

std::string QuantityCell(const Quantity& quantity, size_t camera) {
  const auto& value = quantity.values[camera];
  if (!value) return "<td data-v=\"\">–</td>";
  std::string html = "<td data-v=\"" + Fixed(*value, 9) + "\">" + Fixed(*value, quantity.decimals);
  if (quantity.graded && quantity.max > 0) {
    html += "<span class=\"bar\"><i style=\"width:" +
            Fixed(100 * std::clamp(*value / quantity.max, 0.0, 1.0), 0) + "%\"></i></span>";
  }
  return html + "</td>";
}

std::string TableRow(const ReportInput& input, const Facts& facts, size_t camera) {
  const CameraPose& pose = input.poses.cameras[camera];
  const CameraFacts& camera_facts = facts.cameras[camera];
  const std::string number = std::to_string(camera);
  std::string html = "<tr id=\"cam-" + number + "\" data-cam=\"" + number + "\" class=\"" +
                     std::string(LevelName(camera_facts.level)) +
                     (pose.registered ? "" : " missing") + "\"><th scope=\"row\" data-v=\"" +
                     Escaped(pose.camera) + "\"><span class=\"pill\"></span>" +
                     Escaped(pose.camera) + "</th>";
  if (facts.has_sides) {
    html += "<td class=\"left\" data-v=\"" + Escaped(pose.side) + "\">" +
            (pose.side.empty() ? "–" : Escaped(pose.side)) + "</td>";
  }
  for (const Quantity& quantity : facts.quantities) html += QuantityCell(quantity, camera);
  std::string notes;
  for (const std::string& note : camera_facts.notes) notes += (notes.empty() ? "" : "; ") + note;
  return html + "<td class=\"left notes\" data-v=\"" + Escaped(notes) + "\">" + Escaped(notes) +
         "</td></tr>\n";
}

std::string TableHtml(const ReportInput& input, const Facts& facts) {
  std::string html =
      "<section><div class=\"head\"><h2>Table of cameras</h2><p>a click on a heading sorts; σ is "
      "one standard deviation</p></div><div class=\"card scroll\"><table>" +
      TableHead(facts) + "<tbody>\n";
  for (size_t i = 0; i < facts.cameras.size(); ++i) html += TableRow(input, facts, i);
  return html + "</tbody></table></div></section>\n";
}

using JpegOf = std::string Thumbnail::*;

std::string StripHtml(const ReportInput& input, const Facts& facts,
                      const std::vector<Thumbnail>& thumbnails, JpegOf jpeg_of) {
  std::string html = "<div class=\"strip\">\n";
  for (size_t i = 0; i < thumbnails.size(); ++i) {
    const Thumbnail& thumbnail = thumbnails[i];
    const std::string& jpeg = thumbnail.*jpeg_of;
    const std::string name = Escaped(input.poses.cameras[i].camera);
    const std::string number = std::to_string(i);
    html += "<a href=\"#cam-" + number + "\" data-cam=\"" + number + "\" class=\"" +
            std::string(LevelName(facts.cameras[i].level)) + "\">";
    if (jpeg.empty()) {
      html += "<span class=\"none\">" + Escaped(thumbnail.problem) + "</span>";
    } else {
      html += "<img alt=\"" + name + "\" width=\"" + std::to_string(thumbnail.width_px) +
              "\" height=\"" + std::to_string(thumbnail.height_px) +
              "\" src=\"data:image/jpeg;base64," + Base64(jpeg) + "\"/>";
    }
    html += name + "</a>\n";
  }
  return html + "</div>";
}

std::string PicturesHtml(const ReportInput& input, const Facts& facts,
                         const std::vector<Thumbnail>& thumbnails) {
  std::string html =
      "<section><div class=\"head\"><h2>Pictures</h2><p>red: not registered, moved, swapped or "
      "on the wrong side; a click leads to the camera's row</p></div>" +
      StripHtml(input, facts, thumbnails, &Thumbnail::jpeg) + "</section>\n";
  if (!input.segments) return html;
  return html +
         "<section><div class=\"head\"><h2>Communities of tracks</h2><p>one colour: parts that are "
         "seen side by side; dark rim: looks like another part</p></div>" +
         StripHtml(input, facts, thumbnails, &Thumbnail::marked_jpeg) + "</section>\n";
}

/// A page within the page: its style and script are its own.
std::string CalibrationHtml(const std::string& page) {
  if (page.empty()) return "";
  return "<section><div class=\"head\"><h2>Calibration</h2><p>the one these poses are compared "
         "with</p></div><iframe class=\"page\" title=\"Calibration\" srcdoc=\"" +
         Escaped(page) + "\"></iframe></section>\n";
}

std::string FooterHtml(const PoseSet& poses) {
  const auto item = [](const std::string& name, const std::string& value) {
    return "<div><dt>" + Escaped(name) + "</dt> <dd>" + Escaped(value) + "</dd></div>\n";
  };
  std::string html = "<footer><dl>\n" + item("frame set", poses.frameset) +
                     item("method", poses.method) +
                     item("calibration", poses.aligned_to.value_or("none")) +
                     item("scale", poses.metric ? "metric" : "arbitrary");
  for (const auto& [name, value] : poses.options) html += item(name, value);
  return html + "</dl></footer>\n";
}

}  // namespace
}  // namespace report

Result<std::string> BuildReport(const ReportInput& input, RunContext& context) {
  ROTUNDA_RETURN_IF_ERROR(report::CheckInput(input));
  const report::Marks marks =
      input.segments ? report::MarksOf(input.features, *input.segments) : report::Marks();
  ROTUNDA_ASSIGN_OR_RETURN(const auto thumbnails,
                           report::BuildThumbnails(input.set, marks, context));
  const report::Facts facts = report::BuildFacts(input);
  std::string html =
      "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"/>"
      "<meta name=\"viewport\" content=\"width=device-width,initial-scale=1\"/><title>" +
      Escaped(input.poses.frameset) + " – Rotunda</title>\n<style>";
  html += report::StyleSheet();
  html += report::ColourRules(facts) + "</style></head>\n<body data-by=\"state\">\n" +
          report::HeaderHtml(input) + "<main>\n<div class=\"verdicts\">" +
          report::VerdictHtml(facts.shot) + report::VerdictHtml(facts.rig) + "</div>\n" +
          report::TilesHtml(input, facts) + report::ViewsHtml(input, facts) +
          report::BarsHtml(input, facts) + report::TableHtml(input, facts) +
          report::PicturesHtml(input, facts, thumbnails) +
          report::CalibrationHtml(input.calibration_page) + "</main>\n" +
          report::FooterHtml(input.poses) + "<script>";
  html += report::Script();
  return html + "</script></body></html>\n";
}

}  // namespace rotunda::sfm
