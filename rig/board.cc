#include "rig/board.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/aruco.hpp>
#include <optional>
#include <set>
#include <span>
#include <sstream>
#include <utility>

namespace rotunda::rig {
namespace {

constexpr int kMostSquares = 200;  // along a side: two a millimetre over a hand's breadth
constexpr size_t kMostFaces = 100;

constexpr std::array<std::pair<const char*, cv::aruco::PREDEFINED_DICTIONARY_NAME>, 21>
    kDictionaries = {{
        {"4X4_50", cv::aruco::DICT_4X4_50},
        {"4X4_100", cv::aruco::DICT_4X4_100},
        {"4X4_250", cv::aruco::DICT_4X4_250},
        {"4X4_1000", cv::aruco::DICT_4X4_1000},
        {"5X5_50", cv::aruco::DICT_5X5_50},
        {"5X5_100", cv::aruco::DICT_5X5_100},
        {"5X5_250", cv::aruco::DICT_5X5_250},
        {"5X5_1000", cv::aruco::DICT_5X5_1000},
        {"6X6_50", cv::aruco::DICT_6X6_50},
        {"6X6_100", cv::aruco::DICT_6X6_100},
        {"6X6_250", cv::aruco::DICT_6X6_250},
        {"6X6_1000", cv::aruco::DICT_6X6_1000},
        {"7X7_50", cv::aruco::DICT_7X7_50},
        {"7X7_100", cv::aruco::DICT_7X7_100},
        {"7X7_250", cv::aruco::DICT_7X7_250},
        {"7X7_1000", cv::aruco::DICT_7X7_1000},
        {"ARUCO_ORIGINAL", cv::aruco::DICT_ARUCO_ORIGINAL},
        {"APRILTAG_16h5", cv::aruco::DICT_APRILTAG_16h5},
        {"APRILTAG_25h9", cv::aruco::DICT_APRILTAG_25h9},
        {"APRILTAG_36h10", cv::aruco::DICT_APRILTAG_36h10},
        {"APRILTAG_36h11", cv::aruco::DICT_APRILTAG_36h11},
    }};

/// "4X4_50" is the beginning of "4X4_1000": their ids must not overlap either.
std::string IdSpaceOf(const std::string& dictionary) {
  return dictionary.size() > 3 && dictionary[1] == 'X' ? dictionary.substr(0, 3) : dictionary;
}

Error Refused(const std::string& key, const auto& value, const std::string& allowed) {
  std::ostringstream text;
  text << "is " << value << ", allowed is " << allowed;
  return {ErrorCode::kInvalidArgument, text.str(), key};
}

bool Finite(const Rigid3& transform) {
  return transform.rotation.coeffs().allFinite() && transform.translation.allFinite() &&
         std::abs(transform.rotation.norm() - 1) < 1e-6;
}

/// Lengths in messages are those of the file: millimetres.
void CheckLengths(const BoardFace& face, const std::string& key, std::vector<Error>& problems) {
  if (!(face.square_m >= 1e-4 && face.square_m <= 10)) {
    problems.push_back(Refused(key + ".square_mm", 1e3 * face.square_m, "0.1 to 10000"));
  } else if (!(face.marker_m >= 0.3 * face.square_m && face.marker_m <= 0.95 * face.square_m)) {
    problems.push_back(
        Refused(key + ".marker_mm", 1e3 * face.marker_m, "0.3 to 0.95 of square_mm"));
  }
  if (!(face.margin_m >= 0 && face.margin_m <= 10)) {
    problems.push_back(Refused(key + ".margin_mm", 1e3 * face.margin_m, "0 to 10000"));
  }
}

/// `face` has numbers of squares that are allowed.
Status CheckMarkers(const BoardFace& face, const std::string& key) {
  const Result<MarkerDictionary> dictionary = MarkerDictionary::Named(face.dictionary);
  if (!dictionary) {
    return Error{ErrorCode::kInvalidArgument, dictionary.error().message, key + ".dictionary"};
  }
  const int last = dictionary->Count() - face.MarkerCount();
  if (last < 0) {
    return Refused(key + ".dictionary", face.dictionary,
                   "one with at least the " + std::to_string(face.MarkerCount()) +
                       " markers of this face; it has " + std::to_string(dictionary->Count()));
  }
  if (face.first_id < 0 || face.first_id > last) {
    return Refused(key + ".first_id", face.first_id,
                   "0 to " + std::to_string(last) + ", so that the face's " +
                       std::to_string(face.MarkerCount()) + " ids are in " + face.dictionary);
  }
  return {};
}

/// Each id is on one face: not on `others` too.
Status CheckIds(std::span<const BoardFace> others, const BoardFace& face, const std::string& key) {
  for (const BoardFace& other : others) {
    const int other_end = other.first_id + other.MarkerCount();
    if (IdSpaceOf(other.dictionary) == IdSpaceOf(face.dictionary) && face.first_id < other_end &&
        other.first_id < face.first_id + face.MarkerCount()) {
      return Refused(key + ".first_id", face.first_id,
                     "what leaves the ids " + std::to_string(other.first_id) + " to " +
                         std::to_string(other_end - 1) + " to face '" + other.name + "'");
    }
  }
  return {};
}

/// The face and its ids, which none of `others` (those before it that are right) may have.
void CheckFace(std::span<const BoardFace> others, const BoardFace& face, const std::string& key,
               std::vector<Error>& problems) {
  const std::string count = "2 to " + std::to_string(kMostSquares);
  const auto is_count = [](int squares) { return squares >= 2 && squares <= kMostSquares; };
  if (!is_count(face.columns)) {
    problems.push_back(Refused(key + ".columns", face.columns, count));
  }
  if (!is_count(face.rows)) problems.push_back(Refused(key + ".rows", face.rows, count));
  CheckLengths(face, key, problems);
  if (is_count(face.columns) && is_count(face.rows)) {
    Status markers = CheckMarkers(face, key);
    if (markers) markers = CheckIds(others, face, key);
    if (!markers) problems.push_back(markers.error());
  }
  if (!Finite(face.board_from_face)) {
    problems.push_back({ErrorCode::kInvalidArgument,
                        "is not a rotation and a place in finite numbers", key + ".origin_mm"});
  }
}

void CheckSigmas(const Board& board, std::vector<Error>& problems) {
  const auto check = [&problems](const char* key, double value) {
    if (!(value >= 0)) problems.push_back(Refused(key, value, "0 or more"));
  };
  check("board.face_position_sigma_mm", 1e3 * board.face_position_sigma_m);
  check("board.face_rotation_sigma_deg", DegFromRad(board.face_rotation_sigma_rad));
  check("board.bow_sigma_mm", 1e3 * board.bow_sigma_m);
}

void CheckRigFrame(const RigFrameSetting& frame, std::vector<Error>& problems) {
  if (!frame.board_origin_m.allFinite()) {
    problems.push_back(Refused("rig_frame.board_origin_mm", 1e3 * frame.board_origin_m.transpose(),
                               "three finite numbers"));
  }
  if (!std::isfinite(frame.front_rad)) {
    problems.push_back(
        Refused("rig_frame.front_deg", DegFromRad(frame.front_rad), "a finite number"));
  }
}

/// What two prints differ in first; numbers as messages have them.
struct PrintChange {
  const char* key;
  std::string before, now;
};

std::optional<PrintChange> FirstChange(const FacePrint& before, const FacePrint& now) {
  constexpr double kSame_mm = 1e-6;  // what a file's decimals and metres make of a length
  constexpr int kDigits = 9;         // which tells lengths apart that differ by more
  std::optional<PrintChange> first;
  const auto compare = [&](const char* key, const auto& a, const auto& b, bool same) {
    std::ostringstream was, is;
    was.precision(kDigits);
    is.precision(kDigits);
    was << std::boolalpha << a;
    is << std::boolalpha << b;
    if (!first && !same) first = PrintChange{key, was.str(), is.str()};
  };
  const auto same_mm = [](double a, double b) { return std::abs(a - b) <= kSame_mm; };
  compare("columns", before.columns, now.columns, before.columns == now.columns);
  compare("rows", before.rows, now.rows, before.rows == now.rows);
  compare("square_mm", before.square_mm, now.square_mm, same_mm(before.square_mm, now.square_mm));
  compare("marker_mm", before.marker_mm, now.marker_mm, same_mm(before.marker_mm, now.marker_mm));
  compare("dictionary", before.dictionary, now.dictionary, before.dictionary == now.dictionary);
  compare("first_id", before.first_id, now.first_id, before.first_id == now.first_id);
  compare("legacy_pattern", before.legacy_pattern, now.legacy_pattern,
          before.legacy_pattern == now.legacy_pattern || now.rows % 2 != 0);
  return first;
}

/// Right, down and into the board as the columns of a rotation.
Rigid3 FacePose(const Eigen::Vector3d& right, const Eigen::Vector3d& down,
                const Eigen::Vector3d& origin_m) {
  Eigen::Matrix3d axes;
  axes << right, down, right.cross(down);
  return {Eigen::Quaterniond(axes).normalized(), origin_m};
}

}  // namespace

bool BoardFace::IsBlack(int column, int row) const {
  const bool white_first = legacy_pattern && rows % 2 == 0;
  return ((column + row) % 2 == 0) != white_first;
}

int BoardFace::MarkerCount() const {
  const int squares = columns * rows;  // odd only with odd rows, where black has one more
  return squares / 2;
}

Eigen::Vector2i BoardFace::SquareOfMarker(int id) const {
  const int place = id - first_id;
  // Two rows hold `columns` markers.
  int row = place / columns * 2, left = place % columns;
  const auto white_in_row = [&](int r) { return (columns + (IsBlack(0, r) ? 0 : 1)) / 2; };
  if (left >= white_in_row(row)) left -= white_in_row(row++);
  return {2 * left + (IsBlack(0, row) ? 1 : 0), row};
}

std::vector<Eigen::Vector3d> BoardFace::MarkerInFace(int id) const {
  const Eigen::Vector2i square = SquareOfMarker(id);
  const double before_m = 0.5 * (square_m - marker_m);
  const double x = square.x() * square_m + before_m, y = square.y() * square_m + before_m;
  return {{x, y, 0}, {x + marker_m, y, 0}, {x + marker_m, y + marker_m, 0}, {x, y + marker_m, 0}};
}

Eigen::Vector3d BoardFace::CornerInFace(int corner) const {
  const int across = columns - 1;
  return {(corner % across + 1) * square_m, (corner / across + 1) * square_m, 0};
}

std::vector<Error> Board::Problems() const {
  std::vector<Error> problems;
  if (faces.empty()) {
    problems.push_back(
        {ErrorCode::kInvalidArgument, "the board has no face, expected at least one", "face"});
  }
  if (faces.size() > kMostFaces) {
    return {Refused("face", faces.size(), "at most " + std::to_string(kMostFaces) + " faces")};
  }
  std::set<std::string> names;
  std::vector<BoardFace> right;
  for (size_t i = 0; i < faces.size(); ++i) {
    const BoardFace& face = faces[i];
    const std::string key = "face[" + std::to_string(i) + "]";
    const size_t before = problems.size();
    if (face.name.empty()) {
      problems.push_back(Refused(key + ".name", "empty", "a word of at least one letter"));
    } else if (!names.insert(face.name).second) {
      problems.push_back(
          Refused(key + ".name", "'" + face.name + "'", "what no other face is called"));
    }
    CheckFace(right, face, key, problems);
    if (problems.size() == before) right.push_back(face);
  }
  CheckSigmas(*this, problems);
  CheckRigFrame(rig_frame, problems);
  return problems;
}

Status Board::Validate() const {
  const std::vector<Error> problems = Problems();
  return problems.empty() ? Status() : Status(problems.front());
}

Eigen::Vector2d BowShape(const BoardFace& face, double x_m, double y_m) {
  const double u = 2 * x_m / face.Width_m() - 1, v = 2 * y_m / face.Height_m() - 1;
  return {1 - u * u, 1 - v * v};
}

Eigen::Vector3d PointOnBoard(const BoardFace& face, const CalibratedFace& real,
                             const Eigen::Vector3d& in_face) {
  const double height_m = BowShape(face, in_face.x(), in_face.y()).dot(real.bow_m);
  return real.board_from_face * (in_face - height_m * Eigen::Vector3d::UnitZ());
}

std::vector<CalibratedFace> DrawnFaces(const Board& board) {
  std::vector<CalibratedFace> faces;
  for (const BoardFace& face : board.faces) {
    faces.push_back({face.name, face.board_from_face, Eigen::Vector2d::Zero(), {}});
  }
  return faces;
}

FacePrint PrintOf(const BoardFace& face) {
  return {face.columns,    face.rows,     1e3 * face.square_m, 1e3 * face.marker_m,
          face.dictionary, face.first_id, face.legacy_pattern};
}

Status CheckSameTarget(const Board& board, const Calibration& calibration,
                       const std::string& name) {
  for (const CalibratedFace& earlier : calibration.board) {
    const auto face =
        std::find_if(board.faces.begin(), board.faces.end(),
                     [&](const BoardFace& each) { return each.name == earlier.face; });
    if (face == board.faces.end()) {
      return Error{ErrorCode::kBadInput,
                   "is not there, but " + name +
                       " was made with a target that has it: give that target's board file, or "
                       "leave that calibration out",
                   "face '" + earlier.face + "'"};
    }
    const std::optional<PrintChange> change =
        earlier.print ? FirstChange(*earlier.print, PrintOf(*face)) : std::nullopt;
    if (!change) continue;
    return Error{ErrorCode::kBadInput,
                 "is " + change->now + ", but " + name + " was made with " + change->before +
                     ": give that target's board file, or leave that calibration out",
                 std::string(change->key) + " of face '" + face->name + "'"};
  }
  return {};
}

std::string TargetChange(const Calibration& before, const Calibration& after) {
  for (const CalibratedFace& face : before.board) {
    for (const CalibratedFace& other : after.board) {
      if (face.face != other.face || !face.print || !other.print) continue;
      const std::optional<PrintChange> change = FirstChange(*face.print, *other.print);
      if (!change) continue;
      return std::string(change->key) + " of face '" + face.face + "': " + change->before +
             " before, " + change->now + " after";
    }
  }
  return "";
}

Board CuboidBoard(const CuboidDrawing& drawing) {
  static constexpr std::array<const char*, 5> kNames = {"front", "left", "back", "right", "top"};
  Board board;
  board.name = "cuboid";
  BoardFace face;
  face.columns = drawing.columns;
  face.rows = drawing.rows;
  face.square_m = drawing.square_m;
  face.marker_m = drawing.marker_m;
  face.margin_m = drawing.margin_m;
  face.dictionary = drawing.dictionary;
  const double half_m = 0.5 * face.Width_m();  // of the squares
  const double out_m = half_m + drawing.margin_m;
  const double tall_m = face.Height_m() + 2 * drawing.margin_m;
  for (int side = 0; side < 4; ++side) {
    const Eigen::Quaterniond turn(Eigen::AngleAxisd(0.5 * kPi * side, Eigen::Vector3d::UnitZ()));
    face.name = kNames[static_cast<size_t>(side)];
    face.board_from_face =
        FacePose(turn * Eigen::Vector3d::UnitY(), -Eigen::Vector3d::UnitZ(),
                 turn * Eigen::Vector3d(out_m, -half_m, tall_m - drawing.margin_m));
    board.faces.push_back(face);
    face.first_id += face.MarkerCount();
  }
  if (!drawing.top) return board;
  // Seen from above with the front face at the picture's bottom.
  face.name = kNames[4];
  face.rows = drawing.columns;
  face.board_from_face = FacePose(Eigen::Vector3d::UnitY(), Eigen::Vector3d::UnitX(),
                                  Eigen::Vector3d(-half_m, -half_m, tall_m));
  board.faces.push_back(face);
  return board;
}

Result<int> OpenCvDictionary(const std::string& name) {
  std::string known;
  for (const auto& [candidate, number] : kDictionaries) {
    if (name == candidate) return static_cast<int>(number);
    known += (known.empty() ? "" : ", ") + std::string(candidate);
  }
  return Error{ErrorCode::kInvalidArgument, "is '" + name + "', allowed are " + known,
               "dictionary"};
}

Result<MarkerDictionary> MarkerDictionary::Named(const std::string& name) {
  ROTUNDA_ASSIGN_OR_RETURN(const int number, OpenCvDictionary(name));
  const auto opencv = cv::aruco::getPredefinedDictionary(number);
  MarkerDictionary dictionary;
  dictionary.count_ = opencv->bytesList.rows;
  dictionary.cells_ = opencv->markerSize + 2;
  for (int id = 0; id < dictionary.count_; ++id) {
    const cv::Mat bits =
        cv::aruco::Dictionary::getBitsFromByteList(opencv->bytesList.row(id), opencv->markerSize);
    std::vector<bool> cells(static_cast<size_t>(dictionary.cells_ * dictionary.cells_), true);
    for (int y = 0; y < bits.rows; ++y) {
      for (int x = 0; x < bits.cols; ++x) {
        cells[static_cast<size_t>((y + 1) * dictionary.cells_ + x + 1)] =
            bits.at<uint8_t>(y, x) == 0;
      }
    }
    dictionary.markers_.push_back(std::move(cells));
  }
  return dictionary;
}

Result<std::vector<InkRectangle>> FaceInk(const BoardFace& face) {
  ROTUNDA_ASSIGN_OR_RETURN(const MarkerDictionary dictionary,
                           MarkerDictionary::Named(face.dictionary));
  std::vector<InkRectangle> ink;
  for (int row = 0; row < face.rows; ++row) {
    for (int column = 0; column < face.columns; ++column) {
      if (!face.IsBlack(column, row)) continue;
      ink.push_back({column * face.square_m, row * face.square_m, (column + 1) * face.square_m,
                     (row + 1) * face.square_m});
    }
  }
  const int across = dictionary.CellsAcross();
  const double cell_m = face.marker_m / across;
  for (int id = face.first_id; id < face.first_id + face.MarkerCount(); ++id) {
    const Eigen::Vector3d corner = face.MarkerInFace(id)[0];
    const std::vector<bool>& cells = dictionary.Cells(id);
    for (int y = 0; y < across; ++y) {
      const auto black = [&](int x) { return x < across && cells[y * across + x]; };
      for (int x = 0; x < across; ++x) {
        if (!black(x)) continue;
        const int first = x;
        while (black(x)) ++x;
        ink.push_back({corner.x() + first * cell_m, corner.y() + y * cell_m,
                       corner.x() + x * cell_m, corner.y() + (y + 1) * cell_m});
      }
    }
  }
  return ink;
}

}  // namespace rotunda::rig
