#include "rig/board_drawing.h"

#include <algorithm>
#include <cstdarg>
#include <cstdio>
#include <vector>

namespace rotunda::rig {
namespace {

constexpr double kPointsPerMetre = 72 / 25.4e-3;
constexpr double kText_m = 0.003;     // height of letters
constexpr double kRulerUp_m = 0.004;  // of the ruler's line above the page's lower edge
constexpr double kTick_m = 0.002;
constexpr double kHairline_m = 0.0001;

__attribute__((format(printf, 1, 2))) std::string Format(const char* format, ...) {
  char text[512];
  va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(text, sizeof(text), format, arguments);
  va_end(arguments);
  return text;
}

/// What stands on the page besides the ink; metres from its top-left corner, y down.
struct Page {
  double width_m, height_m;
  double face_height_m;
  double left_m;  // where caption and ruler begin
  double ruler_m;
  std::string caption, ruler_caption;
};

Page PageOf(const BoardFace& face, const std::string& board_name) {
  Page page;
  page.width_m = face.Width_m() + 2 * face.margin_m;
  page.face_height_m = face.Height_m() + 2 * face.margin_m;
  page.height_m = page.face_height_m + kCaptionStrip_m;
  page.left_m = 0.002;
  page.ruler_m = 0.001;
  for (double length_m : {0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0}) {
    if (length_m <= 0.5 * page.width_m) page.ruler_m = length_m;
  }
  page.caption =
      Format("%s / %s: %dx%d squares of %.4g mm, %s ids %d to %d", board_name.c_str(),
             face.name.c_str(), face.columns, face.rows, 1e3 * face.square_m,
             face.dictionary.c_str(), face.first_id, face.first_id + face.MarkerCount() - 1);
  page.ruler_caption = Format("%.4g mm: measure it on the print", 1e3 * page.ruler_m);
  return page;
}

/// Letters a name may have in any XML or PDF string.
std::string Plain(std::string text) {
  for (char& c : text) {
    const bool fine =
        c >= ' ' && c <= '~' && std::string("<>&\"'()\\").find(c) == std::string::npos;
    if (!fine) c = '_';
  }
  return text;
}

/// The cross-reference table needs the place of every object.
std::string PdfFile(const std::vector<std::string>& objects) {
  std::string pdf = "%PDF-1.4\n";
  std::vector<size_t> places;
  for (size_t i = 0; i < objects.size(); ++i) {
    places.push_back(pdf.size());
    pdf += std::to_string(i + 1) + " 0 obj\n" + objects[i] + "\nendobj\n";
  }
  const size_t table = pdf.size();
  pdf += "xref\n0 " + std::to_string(objects.size() + 1) + "\n0000000000 65535 f \n";
  for (size_t place : places) pdf += Format("%010zu 00000 n \n", place);
  pdf += "trailer\n<< /Size " + std::to_string(objects.size() + 1) +
         " /Root 1 0 R >>\nstartxref\n" + std::to_string(table) + "\n%%EOF\n";
  return pdf;
}

/// PDF measures in points from the bottom left.
std::string PdfContent(const BoardFace& face, const Page& page,
                       const std::vector<InkRectangle>& ink) {
  const auto x = [](double m) { return m * kPointsPerMetre; };
  const auto y = [&](double m) { return (page.height_m - m) * kPointsPerMetre; };
  std::string content = "0 g\n";
  for (const InkRectangle& r : ink) {
    content +=
        Format("%.5f %.5f %.5f %.5f re\n", x(face.margin_m + r.left_m),
               y(face.margin_m + r.bottom_m), x(r.right_m - r.left_m), x(r.bottom_m - r.top_m));
  }
  content += "f\n";  // one path: no seams between cells
  const double ruler_y = page.height_m - kRulerUp_m;
  content += Format("%.5f w\n", x(kHairline_m));
  content += Format("0 %.5f %.5f %.5f re S\n", y(page.face_height_m), x(page.width_m),
                    x(page.face_height_m));
  content += Format("%.5f %.5f m %.5f %.5f l S\n", x(page.left_m), y(ruler_y),
                    x(page.left_m + page.ruler_m), y(ruler_y));
  for (double end_m : {page.left_m, page.left_m + page.ruler_m}) {
    content += Format("%.5f %.5f m %.5f %.5f l S\n", x(end_m), y(ruler_y - kTick_m), x(end_m),
                      y(ruler_y + kTick_m));
  }
  content += Format("BT /F1 %.3f Tf %.5f %.5f Td (", x(kText_m), x(page.left_m),
                    y(page.face_height_m + 1.5 * kText_m)) +
             Plain(page.caption) + ") Tj ET\n";
  content += Format("BT /F1 %.3f Tf %.5f %.5f Td (", x(kText_m),
                    x(page.left_m + page.ruler_m + kText_m), y(ruler_y + 0.3 * kText_m)) +
             Plain(page.ruler_caption) + ") Tj ET\n";
  return content;
}

}  // namespace

Result<std::string> FaceSvg(const BoardFace& face, const std::string& board_name) {
  ROTUNDA_ASSIGN_OR_RETURN(const std::vector<InkRectangle> ink, FaceInk(face));
  const Page page = PageOf(face, board_name);
  const auto mm = [](double m) { return 1e3 * m; };
  std::string svg = Format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"%.5fmm\" height=\"%.5fmm\" "
      "viewBox=\"0 0 %.5f %.5f\">\n<path fill=\"#000\" d=\"\n",
      mm(page.width_m), mm(page.height_m), mm(page.width_m), mm(page.height_m));
  for (const InkRectangle& r : ink) {
    svg += Format("M%.5f %.5fH%.5fV%.5fH%.5fZ\n", mm(face.margin_m + r.left_m),
                  mm(face.margin_m + r.top_m), mm(face.margin_m + r.right_m),
                  mm(face.margin_m + r.bottom_m), mm(face.margin_m + r.left_m));
  }
  const double ruler_y = mm(page.height_m - kRulerUp_m), left = mm(page.left_m);
  const double right = left + mm(page.ruler_m), tick = mm(kTick_m), text = mm(kText_m);
  svg += Format("\"/>\n<path fill=\"none\" stroke=\"#000\" stroke-width=\"%.5f\" d=\"",
                mm(kHairline_m));
  svg += Format("M0 0H%.5fV%.5fH0Z M%.5f %.5fH%.5f ", mm(page.width_m), mm(page.face_height_m),
                left, ruler_y, right);
  for (double end : {left, right}) {
    svg += Format("M%.5f %.5fV%.5f ", end, ruler_y - tick, ruler_y + tick);
  }
  svg += "\"/>\n";
  const std::string font = Format("\" font-family=\"sans-serif\" font-size=\"%.3f\">", text);
  svg += Format("<text x=\"%.5f\" y=\"%.5f", left, mm(page.face_height_m) + 1.5 * text) + font +
         Plain(page.caption) + "</text>\n";
  svg += Format("<text x=\"%.5f\" y=\"%.5f", right + text, ruler_y + 0.3 * text) + font +
         Plain(page.ruler_caption) + "</text>\n</svg>\n";
  return svg;
}

Result<std::string> FacePdf(const BoardFace& face, const std::string& board_name) {
  ROTUNDA_ASSIGN_OR_RETURN(const std::vector<InkRectangle> ink, FaceInk(face));
  const Page page = PageOf(face, board_name);
  const std::string content = PdfContent(face, page, ink);
  return PdfFile(
      {"<< /Type /Catalog /Pages 2 0 R >>", "<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
       Format("<< /Type /Page /Parent 2 0 R /MediaBox [0 0 %.5f %.5f] /Contents 4 0 R /Resources "
              "<< /Font << /F1 5 0 R >> >> >>",
              page.width_m * kPointsPerMetre, page.height_m * kPointsPerMetre),
       "<< /Length " + std::to_string(content.size()) + " >>\nstream\n" + content + "endstream",
       "<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>"});
}

}  // namespace rotunda::rig
