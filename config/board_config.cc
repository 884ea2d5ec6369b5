#include "config/board_config.h"

#include <Eigen/Geometry>
#include <cmath>

#include "config/toml_reader.h"
#include "sfm/core/file_io.h"

namespace rotunda::config {
namespace {

constexpr double kMaxSkew = 1e-3;  // |cosine| between right and down: more is a slip of the pen

/// The table [board]: what its faces have in common. Lengths as in the file.
struct Common {
  std::string name = "board";
  std::string dictionary = "APRILTAG_36h11";
  double square_mm = 60;
  double marker_mm = 45;
  double margin_mm = 20;
  double face_position_sigma_mm = 1;
  double face_rotation_sigma_deg = 0.2;
  double bow_sigma_mm = 0.5;

  Section Fields() {
    return {"board",
            {{"name", &name},
             {"dictionary", &dictionary},
             {"square_mm", &square_mm},
             {"marker_mm", &marker_mm},
             {"margin_mm", &margin_mm},
             {"face_position_sigma_mm", &face_position_sigma_mm},
             {"face_rotation_sigma_deg", &face_rotation_sigma_deg},
             {"bow_sigma_mm", &bow_sigma_mm}}};
  }
};

/// The table [rig_frame].
struct FrameText {
  std::string shot;
  Eigen::Vector3d board_origin_mm = Eigen::Vector3d::Zero();
  double front_deg = 0;

  Section Fields() {
    return {"rig_frame",
            {{"shot", &shot}, {"board_origin_mm", &board_origin_mm}, {"front_deg", &front_deg}}};
  }
};

/// One table [[face]].
struct FaceText {
  rig::BoardFace face;
  double square_mm, marker_mm, margin_mm;
  Eigen::Vector3d origin_mm = Eigen::Vector3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::UnitX();
  Eigen::Vector3d down = Eigen::Vector3d::UnitY();

  explicit FaceText(const Common& common)
      : square_mm(common.square_mm), marker_mm(common.marker_mm), margin_mm(common.margin_mm) {
    face.dictionary = common.dictionary;
  }
  Section Fields(const std::string& section) {
    return {section,
            {{"name", &face.name},
             {"columns", &face.columns},
             {"rows", &face.rows},
             {"dictionary", &face.dictionary},
             {"first_id", &face.first_id},
             {"legacy_pattern", &face.legacy_pattern},
             {"square_mm", &square_mm},
             {"marker_mm", &marker_mm},
             {"margin_mm", &margin_mm},
             {"origin_mm", &origin_mm},
             {"right", &right},
             {"down", &down}}};
  }
};

Error Refused(const std::string& key, const std::string& message) {
  return {ErrorCode::kInvalidArgument, message, key};
}

Result<rig::BoardFace> FaceOf(const FaceText& text, const std::string& key) {
  rig::BoardFace face = text.face;
  face.square_m = 1e-3 * text.square_mm;
  face.marker_m = 1e-3 * text.marker_mm;
  face.margin_m = 1e-3 * text.margin_mm;
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
  face.board_from_face = {Eigen::Quaterniond(axes).normalized(), 1e-3 * text.origin_mm};
  return face;
}

Status ReadCuboid(const TomlFile& file, Common* common, FrameText* frame, rig::Board* board) {
  rig::CuboidDrawing drawing;
  ROTUNDA_RETURN_IF_ERROR(file.Read(
      {common->Fields(),
       frame->Fields(),
       {"cuboid",
        {{"columns", &drawing.columns}, {"rows", &drawing.rows}, {"top", &drawing.top}}}}));
  const auto is_odd = [](int count) { return count >= 3 && count <= 99 && count % 2 == 1; };
  for (const auto& [key, count] :
       {std::pair("cuboid.columns", drawing.columns), {"cuboid.rows", drawing.rows}}) {
    if (is_odd(count)) continue;
    return Refused(key, "is " + std::to_string(count) +
                            ", allowed is an odd number from 3 to 99 (versions of OpenCV draw even "
                            "ones differently)");
  }
  drawing.dictionary = common->dictionary;
  drawing.square_m = 1e-3 * common->square_mm;
  drawing.marker_m = 1e-3 * common->marker_mm;
  drawing.margin_m = 1e-3 * common->margin_mm;
  *board = rig::CuboidBoard(drawing);
  return {};
}

Status ReadFaces(const TomlFile& file, Common* common, FrameText* frame, rig::Board* board) {
  const auto key = [](size_t i) { return "face[" + std::to_string(i) + "]"; };
  // Twice: the faces' defaults are what [board] says.
  std::vector<FaceText> faces(file.Count("face"), FaceText(*common));
  for (int pass = 0; pass < 2; ++pass) {
    faces.assign(faces.size(), FaceText(*common));
    std::vector<Section> sections = {common->Fields(), frame->Fields()};
    for (size_t i = 0; i < faces.size(); ++i) sections.push_back(faces[i].Fields(key(i)));
    ROTUNDA_RETURN_IF_ERROR(file.Read(sections));
  }
  for (size_t i = 0; i < faces.size(); ++i) {
    ROTUNDA_ASSIGN_OR_RETURN(const rig::BoardFace face, FaceOf(faces[i], key(i)));
    if (face.rows % 2 == 0 && !file.Has(key(i) + ".legacy_pattern")) {
      return Refused(key(i) + ".legacy_pattern",
                     "is missing, and the number of rows is even: say true when the top-left "
                     "square is white (OpenCV before 4.6), false when it is black");
    }
    board->faces.push_back(face);
  }
  return {};
}

Result<rig::Board> BoardOf(const TomlFile& file) {
  Common common;
  FrameText frame;
  rig::Board board;
  if (file.Has("cuboid") && file.Has("face")) {
    return Refused("cuboid", "and [[face]] are in one file, expected one of them");
  }
  ROTUNDA_RETURN_IF_ERROR(file.Count("face") > 0 ? ReadFaces(file, &common, &frame, &board)
                                                 : ReadCuboid(file, &common, &frame, &board));
  board.rig_frame = {frame.shot, 1e-3 * frame.board_origin_mm, RadFromDeg(frame.front_deg)};
  board.name = common.name;
  board.face_position_sigma_m = 1e-3 * common.face_position_sigma_mm;
  board.face_rotation_sigma_rad = RadFromDeg(common.face_rotation_sigma_deg);
  board.bow_sigma_m = 1e-3 * common.bow_sigma_mm;
  ROTUNDA_RETURN_IF_ERROR(board.Validate());
  return board;
}

}  // namespace

Result<rig::Board> ParseBoard(const std::string& text, const std::string& source) {
  ROTUNDA_ASSIGN_OR_RETURN(const TomlFile file, TomlFile::Parse(text, source));
  Result<rig::Board> board = BoardOf(file);
  // What TomlFile refuses already has its line.
  if (!board && board.error().code == ErrorCode::kInvalidArgument) {
    return file.Located(board.error());
  }
  return board;
}

Result<rig::Board> ReadBoard(const std::filesystem::path& file) {
  ROTUNDA_ASSIGN_OR_RETURN(const std::string text, ReadFile(file));
  return ParseBoard(text, file.string());
}

}  // namespace rotunda::config
