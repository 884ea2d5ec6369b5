#include "config/board_config.h"

#include <Eigen/Geometry>
#include <cmath>
#include <utility>

#include "config/toml_reader.h"
#include "sfm/core/file_io.h"

namespace rotunda::config {
namespace {

constexpr double kMaxSkew = 1e-3;  // |cosine| between right and down: more is a slip of the pen

/// What the file is read into: the target, and what its faces have in common (`drawing`). What the
/// file leaves out keeps the value that these structures give it.
struct BoardText {
  rig::Board board;
  rig::CuboidDrawing drawing;

  /// The tables [board] and [rig_frame].
  std::vector<Section> Fields() {
    rig::RigFrameSetting& frame = board.rig_frame;
    return {{"board",
             {{"name", &board.name},
              {"dictionary", &drawing.dictionary},
              {"square_mm", &drawing.square_m, Unit::kMillimetres},
              {"marker_mm", &drawing.marker_m, Unit::kMillimetres},
              {"margin_mm", &drawing.margin_m, Unit::kMillimetres},
              {"face_position_sigma_mm", &board.face_position_sigma_m, Unit::kMillimetres},
              {"face_rotation_sigma_deg", &board.face_rotation_sigma_rad, Unit::kDegrees},
              {"bow_sigma_mm", &board.bow_sigma_m, Unit::kMillimetres}}},
            {"rig_frame",
             {{"shot", &frame.shot},
              {"board_origin_mm", &frame.board_origin_m, Unit::kMillimetres},
              {"front_deg", &frame.front_rad, Unit::kDegrees}}}};
  }
};

/// One table [[face]].
struct FaceText {
  rig::BoardFace face;
  Eigen::Vector3d right = Eigen::Vector3d::UnitX();
  Eigen::Vector3d down = Eigen::Vector3d::UnitY();

  explicit FaceText(const rig::CuboidDrawing& common) {
    face.dictionary = common.dictionary;
    face.square_m = common.square_m;
    face.marker_m = common.marker_m;
    face.margin_m = common.margin_m;
  }
  Section Fields(const std::string& section) {
    return {section,
            {{"name", &face.name},
             {"columns", &face.columns},
             {"rows", &face.rows},
             {"dictionary", &face.dictionary},
             {"first_id", &face.first_id},
             {"legacy_pattern", &face.legacy_pattern},
             {"square_mm", &face.square_m, Unit::kMillimetres},
             {"marker_mm", &face.marker_m, Unit::kMillimetres},
             {"margin_mm", &face.margin_m, Unit::kMillimetres},
             {"origin_mm", &face.board_from_face.translation, Unit::kMillimetres},
             {"right", &right},
             {"down", &down}}};
  }
};

Error Refused(const std::string& key, const std::string& message) {
  return {ErrorCode::kInvalidArgument, message, key};
}

Result<rig::BoardFace> FaceOf(const FaceText& text, const std::string& key) {
  const double lengths = text.right.norm() * text.down.norm();
  if (!(lengths > 0 && std::isfinite(lengths))) {
    return Refused(key + ".right", "and down must be two directions, found one of no length");
  }
  if (!(std::abs(text.right.dot(text.down)) <= kMaxSkew * lengths)) {
    return Refused(key + ".right", "is not at a right angle to down");
  }
  Eigen::Matrix3d axes;
  axes.col(0) = text.right.normalized();
  axes.col(2) = axes.col(0).cross(text.down).normalized();
  axes.col(1) = axes.col(2).cross(axes.col(0));
  rig::BoardFace face = text.face;
  face.board_from_face.rotation = Eigen::Quaterniond(axes).normalized();
  return face;
}

/// Faces as [cuboid] has them; none when the drawing is not right.
void ReadCuboid(const TomlFile& file, BoardText& text, std::vector<Error>& problems) {
  rig::CuboidDrawing& drawing = text.drawing;
  std::vector<Section> sections = text.Fields();
  sections.push_back(
      {"cuboid", {{"columns", &drawing.columns}, {"rows", &drawing.rows}, {"top", &drawing.top}}});
  problems = file.ReadAll(sections);
  const auto is_odd = [](int count) { return count >= 3 && count <= 99 && count % 2 == 1; };
  std::vector<Error> even;
  for (const auto& [key, count] :
       {std::pair("cuboid.columns", drawing.columns), {"cuboid.rows", drawing.rows}}) {
    if (is_odd(count)) continue;
    even.push_back(Refused(key, "is " + std::to_string(count) +
                                    ", allowed is an odd number from 3 to 99 (versions of OpenCV "
                                    "draw even ones differently)"));
  }
  file.AddLocated(even, problems);
  if (even.empty()) text.board.faces = rig::CuboidBoard(drawing).faces;
}

/// Faces as the list [[face]] has them.
void ReadFaces(const TomlFile& file, BoardText& text, std::vector<Error>& problems) {
  const auto key = [](size_t i) { return "face[" + std::to_string(i) + "]"; };
  // Twice: the faces' defaults are what [board] says.
  std::vector<FaceText> faces;
  for (int pass = 0; pass < 2; ++pass) {
    faces.assign(file.Count("face"), FaceText(text.drawing));
    std::vector<Section> sections = text.Fields();
    for (size_t i = 0; i < faces.size(); ++i) sections.push_back(faces[i].Fields(key(i)));
    problems = file.ReadAll(sections);
  }
  std::vector<Error> wrong;
  for (size_t i = 0; i < faces.size(); ++i) {
    const Result<rig::BoardFace> face = FaceOf(faces[i], key(i));
    if (!face) wrong.push_back(face.error());
    if (faces[i].face.rows % 2 == 0 && !file.Has(key(i) + ".legacy_pattern")) {
      wrong.push_back(
          Refused(key(i) + ".legacy_pattern",
                  "is missing, and the number of rows is even: say true when the top-left "
                  "square is white (OpenCV before 4.6), false when it is black"));
    }
    // In its place in the list also when it stands nowhere: problems name faces by their number.
    text.board.faces.push_back(face ? *face : faces[i].face);
  }
  file.AddLocated(wrong, problems);
}

/// What faces leave out is that of [board]: its place when a face's key is not in the file.
std::vector<Error> AsWritten(const TomlFile& file, std::vector<Error> problems) {
  for (Error& problem : problems) {
    const size_t dot = problem.context.rfind('.');
    if (dot == std::string::npos || !problem.context.starts_with("face[") ||
        file.Has(problem.context)) {
      continue;
    }
    const std::string common = "board" + problem.context.substr(dot);
    if (file.Has(common)) problem.context = common;
  }
  return problems;
}

}  // namespace

CheckedBoard CheckBoard(const std::string& text, const std::string& source) {
  const Result<TomlFile> file = TomlFile::Parse(text, source);
  if (!file) return {{}, {file.error()}};
  CheckedBoard checked;
  if (file->Has("cuboid") && file->Has("face")) {
    file->AddLocated({Refused("cuboid", "and [[face]] are in one file, expected one of them")},
                     checked.problems);
    return checked;
  }
  BoardText board;
  const bool has_faces = file->Count("face") > 0;
  has_faces ? ReadFaces(*file, board, checked.problems)
            : ReadCuboid(*file, board, checked.problems);
  // A cuboid that could not be drawn was refused already.
  if (!board.board.faces.empty()) {
    file->AddLocated(AsWritten(*file, board.board.Problems()), checked.problems);
  }
  checked.board = std::move(board.board);
  return checked;
}

Result<rig::Board> ParseBoard(const std::string& text, const std::string& source) {
  CheckedBoard checked = CheckBoard(text, source);
  if (!checked.problems.empty()) return checked.problems.front();
  return std::move(checked.board);
}

Result<rig::Board> ReadBoard(const std::filesystem::path& file) {
  ROTUNDA_ASSIGN_OR_RETURN(const std::string text, ReadFile(file));
  return ParseBoard(text, file.string());
}

}  // namespace rotunda::config
