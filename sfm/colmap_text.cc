#include <algorithm>
#include <charconv>
#include <string_view>
#include <system_error>
#include <utility>

#include "sfm/colmap_records.h"

namespace rotunda::sfm {
namespace {

constexpr std::string_view kWhiteSpace = " \t\r\n\v\f";
constexpr size_t kNumberLength = 32;

template <typename T>
void AppendNumber(T value, std::string& text) {
  char digits[kNumberLength];
  const auto [end, error] = std::to_chars(digits, digits + sizeof(digits), value);
  text.append(digits, error == std::errc() ? end : digits);
}

template <typename Values>
void AppendNumbers(const Values& values, std::string& text) {
  for (const auto& value : values) {
    text += ' ';
    AppendNumber(value, text);
  }
}

/// The lines that carry data, one after the other, with their numbers for messages.
class LineReader {
 public:
  LineReader(std::string file, std::string_view text) : file_(std::move(file)), text_(text) {}

  /// The next line, trimmed of white space; false at the end of the file.
  bool Next(std::string_view& line) {
    if (place_ >= text_.size()) return false;
    const size_t end = std::min(text_.find('\n', place_), text_.size());
    line = text_.substr(place_, end - place_);
    place_ = end + 1;
    ++number_;
    const size_t first = std::min(line.find_first_not_of(kWhiteSpace), line.size());
    line.remove_prefix(first);
    line = line.substr(0, line.find_last_not_of(kWhiteSpace) + 1);
    return true;
  }
  /// Skips comments and empty lines.
  bool NextRecord(std::string_view& line) {
    while (Next(line)) {
      if (!line.empty() && line.front() != '#') return true;
    }
    return false;
  }
  Error Fail(const std::string& message) const {
    return {ErrorCode::kBadInput, message, file_ + ": line " + std::to_string(number_)};
  }

 private:
  std::string file_;
  std::string_view text_;
  size_t place_ = 0;
  size_t number_ = 0;
};

/// Words of a line. A word that is missing or is not the number asked for sets problem().
class Words {
 public:
  explicit Words(std::string_view line) : rest_(line) {}

  bool empty() const { return rest_.empty(); }
  const std::string& problem() const { return problem_; }

  std::string_view Word(const char* what) {
    const size_t end = std::min(rest_.find_first_of(kWhiteSpace), rest_.size());
    const std::string_view word = rest_.substr(0, end);
    rest_.remove_prefix(end);
    rest_.remove_prefix(std::min(rest_.find_first_not_of(kWhiteSpace), rest_.size()));
    if (word.empty()) SetProblem(std::string("expected ") + what + ", the line ends");
    return word;
  }
  template <typename T>
  T Number(const char* what) {
    const std::string_view word = Word(what);
    T value = 0;
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
    if (error != std::errc() || end != word.data() + word.size()) {
      SetProblem(std::string("expected ") + what + ", found \"" + std::string(word) + "\"");
      return 0;
    }
    return value;
  }
  template <typename T, size_t N>
  void Numbers(const char* what, std::array<T, N>& values) {
    for (T& value : values) value = Number<T>(what);
  }
  std::string_view Rest() { return std::exchange(rest_, std::string_view()); }

 private:
  void SetProblem(const std::string& problem) {
    if (problem_.empty()) problem_ = problem;
  }
  std::string_view rest_;
  std::string problem_;
};

/// "-1" stands for no point.
uint64_t ReadPointId(Words& words) {
  const auto id = words.Number<int64_t>("a point's id");
  return id < 0 ? kColmapNoPoint : static_cast<uint64_t>(id);
}

Result<std::vector<ColmapCamera>> ReadCameras(const std::string& text) {
  LineReader reader("cameras.txt", text);
  std::vector<ColmapCamera> cameras;
  std::string_view line;
  while (reader.NextRecord(line)) {
    Words words(line);
    ColmapCamera camera;
    camera.id = words.Number<uint32_t>("a camera's id");
    const Result<CameraModel> model = CameraModelFromName(words.Word("a camera model"));
    camera.intrinsics.width_px = words.Number<int>("a width");
    camera.intrinsics.height_px = words.Number<int>("a height");
    while (!words.empty()) {
      camera.intrinsics.params.push_back(words.Number<double>("a parameter"));
    }
    if (!words.problem().empty()) return reader.Fail(words.problem());
    if (!model) return reader.Fail(model.error().message);
    if (std::max(camera.intrinsics.width_px, camera.intrinsics.height_px) > kMaxPictureSide_px) {
      return reader.Fail("the picture size is too large");
    }
    camera.intrinsics.model = *model;
    cameras.push_back(std::move(camera));
  }
  return cameras;
}

Result<std::vector<ColmapImage>> ReadImages(const std::string& text) {
  LineReader reader("images.txt", text);
  std::vector<ColmapImage> images;
  std::string_view line;
  while (reader.NextRecord(line)) {
    Words pose(line);
    ColmapImage image;
    image.id = pose.Number<uint32_t>("an image's id");
    pose.Numbers("a quaternion's number", image.rotation_wxyz);
    pose.Numbers("a translation's number", image.translation);
    image.camera_id = pose.Number<uint32_t>("a camera's id");
    image.name = pose.Rest();
    if (!pose.problem().empty()) return reader.Fail(pose.problem());
    if (!reader.Next(line)) return reader.Fail("the line with the image's points is missing");
    Words words(line);
    while (!words.empty() && words.problem().empty()) {
      ColmapPoint2 point;
      point.x_px = words.Number<double>("a point's x");
      point.y_px = words.Number<double>("a point's y");
      point.point_id = ReadPointId(words);
      image.points.push_back(point);
    }
    if (!words.problem().empty()) return reader.Fail(words.problem());
    images.push_back(std::move(image));
  }
  return images;
}

Result<std::vector<ColmapPoint3>> ReadPoints(const std::string& text) {
  LineReader reader("points3D.txt", text);
  std::vector<ColmapPoint3> points;
  std::string_view line;
  while (reader.NextRecord(line)) {
    Words words(line);
    ColmapPoint3 point;
    point.id = words.Number<uint64_t>("a point's id");
    words.Numbers("a coordinate", point.position);
    words.Numbers("a colour from 0 to 255", point.color_rgb);
    point.error_px = words.Number<double>("an error");
    while (!words.empty() && words.problem().empty()) {
      ColmapTrackElement element;
      element.image_id = words.Number<uint32_t>("an image's id");
      element.point_index = words.Number<uint32_t>("the index of an image's point");
      point.track.push_back(element);
    }
    if (!words.problem().empty()) return reader.Fail(words.problem());
    points.push_back(std::move(point));
  }
  return points;
}

std::string CameraLines(const std::vector<ColmapCamera>& cameras) {
  std::string text =
      "# Camera list with one line of data per camera:\n"
      "#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"
      "# Number of cameras: ";
  text += std::to_string(cameras.size()) + "\n";
  for (const ColmapCamera& camera : cameras) {
    text += std::to_string(camera.id) + " ";
    text += CameraModelName(camera.intrinsics.model);
    AppendNumbers(std::array{camera.intrinsics.width_px, camera.intrinsics.height_px}, text);
    AppendNumbers(camera.intrinsics.params, text);
    text += '\n';
  }
  return text;
}

std::string ImageLines(const std::vector<ColmapImage>& images) {
  std::string text =
      "# Image list with two lines of data per image:\n"
      "#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n"
      "#   POINTS2D[] as (X, Y, POINT3D_ID)\n"
      "# Number of images: ";
  text += std::to_string(images.size()) + "\n";
  for (const ColmapImage& image : images) {
    text += std::to_string(image.id);
    AppendNumbers(image.rotation_wxyz, text);
    AppendNumbers(image.translation, text);
    text += ' ' + std::to_string(image.camera_id) + ' ' + image.name + '\n';
    for (const ColmapPoint2& point : image.points) {
      AppendNumber(point.x_px, text);
      text += ' ';
      AppendNumber(point.y_px, text);
      text += ' ';
      AppendNumber(static_cast<int64_t>(point.point_id), text);
      text += ' ';
    }
    text += '\n';
  }
  return text;
}

std::string PointLines(const std::vector<ColmapPoint3>& points) {
  std::string text =
      "# 3D point list with one line of data per point:\n"
      "#   POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n"
      "# Number of points: ";
  text += std::to_string(points.size()) + "\n";
  for (const ColmapPoint3& point : points) {
    text += std::to_string(point.id);
    AppendNumbers(point.position, text);
    for (const int channel : point.color_rgb) text += ' ' + std::to_string(channel);
    AppendNumbers(std::array{point.error_px}, text);
    for (const ColmapTrackElement& element : point.track) {
      AppendNumbers(std::array{element.image_id, element.point_index}, text);
    }
    text += '\n';
  }
  return text;
}

}  // namespace

Result<ColmapFiles> EncodeColmapText(const ColmapRecords& records) {
  for (const ColmapImage& image : records.images) {
    if (image.name.empty() || image.name.find_first_of(kWhiteSpace) != std::string::npos) {
      return Error{ErrorCode::kInvalidArgument,
                   "COLMAP's text format cannot hold a name with white space in it", image.name};
    }
  }
  return ColmapFiles{CameraLines(records.cameras), ImageLines(records.images),
                     PointLines(records.points)};
}

Result<ColmapRecords> DecodeColmapText(const ColmapFiles& files) {
  ColmapRecords records;
  ROTUNDA_ASSIGN_OR_RETURN(records.cameras, ReadCameras(files.cameras));
  ROTUNDA_ASSIGN_OR_RETURN(records.images, ReadImages(files.images));
  ROTUNDA_ASSIGN_OR_RETURN(records.points, ReadPoints(files.points));
  return records;
}

}  // namespace rotunda::sfm
