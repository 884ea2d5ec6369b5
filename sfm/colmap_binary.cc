#include <algorithm>
#include <bit>
#include <cstring>
#include <string_view>
#include <type_traits>

#include "sfm/colmap_records.h"

static_assert(std::endian::native == std::endian::little, "COLMAP's files are little-endian");

namespace rotunda::sfm {
namespace {

class ByteWriter {
 public:
  template <typename T>
  void Write(const T& value) {
    static_assert(std::is_arithmetic_v<T>);
    bytes_.append(reinterpret_cast<const char*>(&value), sizeof(T));
  }
  template <typename T, size_t N>
  void Write(const std::array<T, N>& values) {
    for (const T& value : values) Write(value);
  }
  void WriteName(const std::string& name) { bytes_.append(name.c_str(), name.size() + 1); }
  std::string Take() { return std::move(bytes_); }

 private:
  std::string bytes_;
};

/// Reads past the end give zeros and set failed(); the place of the first such read is kept.
class ByteReader {
 public:
  ByteReader(std::string file, std::string_view bytes) : file_(std::move(file)), bytes_(bytes) {}

  template <typename T>
  T Read() {
    static_assert(std::is_arithmetic_v<T>);
    T value = 0;
    if (failed_ || bytes_.size() - place_ < sizeof(T)) {
      failed_ = true;
      return value;
    }
    std::memcpy(&value, bytes_.data() + place_, sizeof(T));
    place_ += sizeof(T);
    return value;
  }
  template <typename T, size_t N>
  void Read(std::array<T, N>& values) {
    for (T& value : values) value = Read<T>();
  }
  std::string ReadName() {
    const size_t end = failed_ ? std::string_view::npos : bytes_.find('\0', place_);
    if (end == std::string_view::npos) {
      failed_ = true;
      return "";
    }
    std::string name(bytes_.substr(place_, end - place_));
    place_ = end + 1;
    return name;
  }
  /// A count of items of at least `min_item_bytes` each; more than the file can hold is a failure,
  /// so that a broken count cannot ask for memory.
  size_t ReadCount(size_t min_item_bytes) {
    const uint64_t count = Read<uint64_t>();
    if (failed_ || count > (bytes_.size() - place_) / min_item_bytes) {
      failed_ = true;
      return 0;
    }
    return count;
  }

  bool failed() const { return failed_; }
  Error Fail(const std::string& record, const std::string& message) const {
    return {ErrorCode::kBadInput, message, file_ + ": " + record};
  }
  Error CutShort(const std::string& record) const {
    return Fail(record, "is cut short or has a count that the file cannot hold (" +
                            std::to_string(bytes_.size()) + " bytes)");
  }
  Status CheckEnd() const {
    if (place_ == bytes_.size()) return {};
    return Error{ErrorCode::kBadInput,
                 std::to_string(bytes_.size() - place_) + " bytes are left after the last record",
                 file_};
  }

 private:
  std::string file_;
  std::string_view bytes_;
  size_t place_ = 0;
  bool failed_ = false;
};

constexpr size_t kMinCameraBytes = 4 + 4 + 8 + 8 + 3 * 8;
constexpr size_t kMinImageBytes = 4 + 7 * 8 + 4 + 1 + 8;
constexpr size_t kPoint2Bytes = 8 + 8 + 8;
constexpr size_t kMinPoint3Bytes = 8 + 3 * 8 + 3 + 8 + 8;
constexpr size_t kTrackElementBytes = 4 + 4;

std::string Place(const char* what, size_t index, size_t count) {
  return std::string(what) + " " + std::to_string(index + 1) + " of " + std::to_string(count);
}

Result<ColmapCamera> ReadCamera(ByteReader& reader, const std::string& place) {
  ColmapCamera camera;
  camera.id = reader.Read<uint32_t>();
  const auto model_id = reader.Read<int32_t>();
  const auto width_px = reader.Read<uint64_t>();
  const auto height_px = reader.Read<uint64_t>();
  if (reader.failed()) return reader.CutShort(place);
  const Result<CameraModel> model = CameraModelFromColmapId(model_id);
  if (!model) return reader.Fail(place, model.error().message);
  if (std::max(width_px, height_px) > uint64_t{kMaxPictureSide_px}) {
    return reader.Fail(place, "picture size " + std::to_string(width_px) + "x" +
                                  std::to_string(height_px) + " is too large");
  }
  camera.intrinsics.model = *model;
  camera.intrinsics.width_px = static_cast<int>(width_px);
  camera.intrinsics.height_px = static_cast<int>(height_px);
  for (size_t i = 0; i < CameraParamCount(*model); ++i) {
    camera.intrinsics.params.push_back(reader.Read<double>());
  }
  if (reader.failed()) return reader.CutShort(place);
  return camera;
}

Result<std::vector<ColmapCamera>> ReadCameras(const std::string& bytes) {
  ByteReader reader("cameras.bin", bytes);
  const size_t count = reader.ReadCount(kMinCameraBytes);
  if (reader.failed()) return reader.CutShort("number of cameras");
  std::vector<ColmapCamera> cameras;
  for (size_t i = 0; i < count; ++i) {
    ROTUNDA_ASSIGN_OR_RETURN(ColmapCamera camera, ReadCamera(reader, Place("camera", i, count)));
    cameras.push_back(std::move(camera));
  }
  ROTUNDA_RETURN_IF_ERROR(reader.CheckEnd());
  return cameras;
}

ColmapImage ReadImage(ByteReader& reader) {
  ColmapImage image;
  image.id = reader.Read<uint32_t>();
  reader.Read(image.rotation_wxyz);
  reader.Read(image.translation);
  image.camera_id = reader.Read<uint32_t>();
  image.name = reader.ReadName();
  image.points.resize(reader.ReadCount(kPoint2Bytes));
  for (ColmapPoint2& point : image.points) {
    point.x_px = reader.Read<double>();
    point.y_px = reader.Read<double>();
    point.point_id = reader.Read<uint64_t>();
  }
  return image;
}

Result<std::vector<ColmapImage>> ReadImages(const std::string& bytes) {
  ByteReader reader("images.bin", bytes);
  const size_t count = reader.ReadCount(kMinImageBytes);
  if (reader.failed()) return reader.CutShort("number of images");
  std::vector<ColmapImage> images;
  for (size_t i = 0; i < count; ++i) {
    images.push_back(ReadImage(reader));
    if (reader.failed()) return reader.CutShort(Place("image", i, count));
  }
  ROTUNDA_RETURN_IF_ERROR(reader.CheckEnd());
  return images;
}

ColmapPoint3 ReadPoint(ByteReader& reader) {
  ColmapPoint3 point;
  point.id = reader.Read<uint64_t>();
  reader.Read(point.position);
  reader.Read(point.color_rgb);
  point.error_px = reader.Read<double>();
  point.track.resize(reader.ReadCount(kTrackElementBytes));
  for (ColmapTrackElement& element : point.track) {
    element.image_id = reader.Read<uint32_t>();
    element.point_index = reader.Read<uint32_t>();
  }
  return point;
}

Result<std::vector<ColmapPoint3>> ReadPoints(const std::string& bytes) {
  ByteReader reader("points3D.bin", bytes);
  const size_t count = reader.ReadCount(kMinPoint3Bytes);
  if (reader.failed()) return reader.CutShort("number of points");
  std::vector<ColmapPoint3> points;
  for (size_t i = 0; i < count; ++i) {
    points.push_back(ReadPoint(reader));
    if (reader.failed()) return reader.CutShort(Place("point", i, count));
  }
  ROTUNDA_RETURN_IF_ERROR(reader.CheckEnd());
  return points;
}

std::string CameraBytes(const std::vector<ColmapCamera>& cameras) {
  ByteWriter writer;
  writer.Write<uint64_t>(cameras.size());
  for (const ColmapCamera& camera : cameras) {
    writer.Write(camera.id);
    writer.Write<int32_t>(ColmapModelId(camera.intrinsics.model));
    writer.Write<uint64_t>(camera.intrinsics.width_px);
    writer.Write<uint64_t>(camera.intrinsics.height_px);
    for (double param : camera.intrinsics.params) writer.Write(param);
  }
  return writer.Take();
}

std::string ImageBytes(const std::vector<ColmapImage>& images) {
  ByteWriter writer;
  writer.Write<uint64_t>(images.size());
  for (const ColmapImage& image : images) {
    writer.Write(image.id);
    writer.Write(image.rotation_wxyz);
    writer.Write(image.translation);
    writer.Write(image.camera_id);
    writer.WriteName(image.name);
    writer.Write<uint64_t>(image.points.size());
    for (const ColmapPoint2& point : image.points) {
      writer.Write(point.x_px);
      writer.Write(point.y_px);
      writer.Write(point.point_id);
    }
  }
  return writer.Take();
}

std::string PointBytes(const std::vector<ColmapPoint3>& points) {
  ByteWriter writer;
  writer.Write<uint64_t>(points.size());
  for (const ColmapPoint3& point : points) {
    writer.Write(point.id);
    writer.Write(point.position);
    writer.Write(point.color_rgb);
    writer.Write(point.error_px);
    writer.Write<uint64_t>(point.track.size());
    for (const ColmapTrackElement& element : point.track) {
      writer.Write(element.image_id);
      writer.Write(element.point_index);
    }
  }
  return writer.Take();
}

}  // namespace

ColmapFiles EncodeColmapBinary(const ColmapRecords& records) {
  return {CameraBytes(records.cameras), ImageBytes(records.images), PointBytes(records.points)};
}

Result<ColmapRecords> DecodeColmapBinary(const ColmapFiles& files) {
  ColmapRecords records;
  ROTUNDA_ASSIGN_OR_RETURN(records.cameras, ReadCameras(files.cameras));
  ROTUNDA_ASSIGN_OR_RETURN(records.images, ReadImages(files.images));
  ROTUNDA_ASSIGN_OR_RETURN(records.points, ReadPoints(files.points));
  return records;
}

}  // namespace rotunda::sfm
