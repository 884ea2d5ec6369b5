#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>
#include <system_error>

#include "sfm/colmap_io.h"
#include "sfm/colmap_records.h"
#include "sfm/core/file_io.h"

namespace rotunda::sfm {
namespace {

namespace fs = std::filesystem;

constexpr std::array<const char*, 3> kStems = {"cameras", "images", "points3D"};
constexpr double kMinQuaternionNorm = 1e-6;

const char* Ending(ColmapEncoding encoding) {
  return encoding == ColmapEncoding::kBinary ? ".bin" : ".txt";
}

uint32_t ColmapId(size_t index) { return static_cast<uint32_t>(index + 1); }

// --- Reconstruction -> records

std::vector<ColmapCamera> CameraRecords(const Reconstruction& reconstruction) {
  std::set<size_t> used;
  for (size_t i = 0; i < reconstruction.cam_from_model.size(); ++i) {
    if (reconstruction.cam_from_model[i]) used.insert(reconstruction.intrinsics.lens_of_image[i]);
  }
  std::vector<ColmapCamera> cameras;
  for (size_t lens : used) {
    cameras.push_back({ColmapId(lens), reconstruction.intrinsics.lenses[lens]});
  }
  return cameras;
}

ColmapImage ImageRecord(const Reconstruction& reconstruction, const Features& features,
                        ImageId id) {
  const Rigid3& pose = *reconstruction.cam_from_model[id.index()];
  ColmapImage image;
  image.id = ColmapId(id.index());
  image.rotation_wxyz = {pose.rotation.w(), pose.rotation.x(), pose.rotation.y(),
                         pose.rotation.z()};
  image.translation = {pose.translation.x(), pose.translation.y(), pose.translation.z()};
  image.camera_id = ColmapId(reconstruction.intrinsics.lens_of_image[id.index()]);
  for (const Keypoint& keypoint : features.image(id).keypoints) {
    image.points.push_back({keypoint.x_px, keypoint.y_px, kColmapNoPoint});
  }
  return image;
}

double MeanError_px(const Reconstruction& reconstruction, const Features& features,
                    const Point3& point) {
  double sum_px = 0;
  size_t count = 0;
  for (const Observation& observation : point.observations) {
    const auto error_px = ReprojectionError_px(reconstruction, features, point, observation);
    if (!error_px) continue;
    sum_px += *error_px;
    ++count;
  }
  return count == 0 ? 0.0 : sum_px / static_cast<double>(count);
}

/// Appends the point and enters it in its images. A keypoint belongs to one point: COLMAP stops at
/// a model in which it does not.
Status AddPoint(const Point3& point, double error_px, std::map<ImageId, ColmapImage>& images,
                std::vector<ColmapPoint3>& points) {
  ColmapPoint3 record;
  record.id = points.size() + 1;
  record.position = {point.position.x(), point.position.y(), point.position.z()};
  record.color_rgb = point.color_rgb;
  record.error_px = error_px;
  for (const Observation& observation : point.observations) {
    const auto image = images.find(observation.image);
    if (image == images.end()) continue;
    uint64_t& owner = image->second.points[observation.keypoint.index()].point_id;
    if (owner != kColmapNoPoint) {
      return Error{
          ErrorCode::kInvalidArgument,
          "keypoint " + std::to_string(observation.keypoint.index()) + " belongs to two points",
          image->second.name};
    }
    owner = record.id;
    record.track.push_back({image->second.id, static_cast<uint32_t>(observation.keypoint.index())});
  }
  points.push_back(std::move(record));
  return {};
}

/// COLMAP's name of every picture: the file's, or, where two folders of the set have a file of one
/// name, its path in the set.
std::vector<std::string> ImageNames(const FrameSet& set) {
  std::vector<std::string> paths;
  std::vector<std::string> names;
  std::set<std::string> different;
  bool collide = false;
  for (const Frame& frame : set.frames) {
    const std::string name = fs::path(frame.file).filename().string();
    if (!name.empty() && !different.insert(name).second) collide = true;
    paths.push_back(fs::path(frame.file).lexically_normal().generic_string());
    names.push_back(name);
  }
  return collide ? paths : names;
}

Result<ColmapRecords> RecordsOf(const Reconstruction& reconstruction, const Features& features,
                                const FrameSet& set) {
  ColmapRecords records;
  records.cameras = CameraRecords(reconstruction);
  const std::vector<std::string> names = ImageNames(set);
  std::map<ImageId, ColmapImage> images;
  for (size_t i = 0; i < reconstruction.cam_from_model.size(); ++i) {
    const ImageId id(i);
    if (!reconstruction.Registered(id)) continue;
    ColmapImage image = ImageRecord(reconstruction, features, id);
    image.name = names[i];
    images.emplace(id, std::move(image));
  }
  for (const Point3& point : reconstruction.points) {
    ROTUNDA_RETURN_IF_ERROR(
        AddPoint(point, MeanError_px(reconstruction, features, point), images, records.points));
  }
  for (auto& [id, image] : images) records.images.push_back(std::move(image));
  return records;
}

// --- records -> Reconstruction

Error Bad(const std::string& file, const std::string& what, uint64_t id,
          const std::string& message) {
  return {ErrorCode::kBadInput, message, file + ": " + what + " " + std::to_string(id)};
}

/// Place of every id of a table, in the order of the ids.
template <typename Record>
std::map<uint64_t, size_t> PlacesById(const std::vector<Record>& records) {
  std::map<uint64_t, size_t> places;
  for (const Record& record : records) places.emplace(record.id, 0);
  size_t next = 0;
  for (auto& [id, place] : places) place = next++;
  return places;
}

/// Turns records into the model. Errors name "cameras", "images" and "points3D" with `ending`.
class ModelBuilder {
 public:
  ModelBuilder(const ColmapRecords& records, std::string ending)
      : records_(records),
        ending_(std::move(ending)),
        lenses_(PlacesById(records.cameras)),
        images_(PlacesById(records.images)) {}

  Result<ColmapModel> Build() {
    ROTUNDA_RETURN_IF_ERROR(AddLenses());
    ROTUNDA_RETURN_IF_ERROR(AddImages());
    for (const ColmapPoint3& point : records_.points) ROTUNDA_RETURN_IF_ERROR(AddPoint(point));
    return std::move(model_);
  }

 private:
  Status AddLenses() {
    const std::string file = "cameras" + ending_;
    if (lenses_.size() != records_.cameras.size()) {
      return Error{ErrorCode::kBadInput, "a camera's id occurs twice", file};
    }
    Intrinsics& intrinsics = model_.reconstruction.intrinsics;
    intrinsics.lenses.resize(lenses_.size());
    for (const ColmapCamera& camera : records_.cameras) {
      const Status status = camera.intrinsics.Validate();
      if (!status) return status.error().In("camera " + std::to_string(camera.id)).In(file);
      intrinsics.lenses[lenses_.at(camera.id)] = camera.intrinsics;
    }
    return {};
  }

  Status AddImages() {
    const std::string file = "images" + ending_;
    if (images_.size() != records_.images.size()) {
      return Error{ErrorCode::kBadInput, "an image's id occurs twice", file};
    }
    model_.image_names.resize(images_.size());
    model_.features.images.resize(images_.size());
    model_.reconstruction.cam_from_model.resize(images_.size());
    model_.reconstruction.intrinsics.lens_of_image.resize(images_.size());
    std::set<std::string> names;
    for (const ColmapImage& image : records_.images) {
      if (image.name.empty()) return Bad(file, "image", image.id, "has no name");
      if (!names.insert(image.name).second) {
        return Bad(file, "image", image.id, "its name \"" + image.name + "\" occurs twice");
      }
      ROTUNDA_RETURN_IF_ERROR(AddImage(image, file));
    }
    return {};
  }

  Status AddImage(const ColmapImage& image, const std::string& file) {
    const size_t place = images_.at(image.id);
    const auto lens = lenses_.find(image.camera_id);
    if (lens == lenses_.end()) {
      return Bad(file, "image", image.id,
                 "its camera " + std::to_string(image.camera_id) + " is not in cameras" + ending_);
    }
    const auto& q = image.rotation_wxyz;
    const auto& t = image.translation;
    Rigid3 pose{Eigen::Quaterniond(q[0], q[1], q[2], q[3]), Eigen::Vector3d(t[0], t[1], t[2])};
    const double norm = pose.rotation.norm();
    if (!(norm > kMinQuaternionNorm) || !std::isfinite(norm) || !pose.translation.allFinite()) {
      return Bad(file, "image", image.id, "its pose is not a rotation and finite numbers");
    }
    pose.rotation.normalize();
    model_.image_names[place] = image.name;
    model_.reconstruction.cam_from_model[place] = pose;
    model_.reconstruction.intrinsics.lens_of_image[place] = lens->second;
    const CameraIntrinsics& intrinsics = model_.reconstruction.intrinsics.lenses[lens->second];
    ImageFeatures& features = model_.features.images[place];
    features.width_px = intrinsics.width_px;
    features.height_px = intrinsics.height_px;
    for (const ColmapPoint2& point : image.points) {
      if (!std::isfinite(point.x_px) || !std::isfinite(point.y_px)) {
        return Bad(file, "image", image.id, "a keypoint's position is not a finite number");
      }
      Keypoint keypoint;
      keypoint.x_px = static_cast<float>(point.x_px);
      keypoint.y_px = static_cast<float>(point.y_px);
      features.keypoints.push_back(keypoint);
    }
    return {};
  }

  Status AddPoint(const ColmapPoint3& point) {
    const std::string file = "points3D" + ending_;
    Point3 result;
    result.position = {point.position[0], point.position[1], point.position[2]};
    result.color_rgb = point.color_rgb;
    if (!result.position.allFinite()) {
      return Bad(file, "point", point.id, "its position is not finite numbers");
    }
    for (const ColmapTrackElement& element : point.track) {
      const auto image = images_.find(element.image_id);
      if (image == images_.end()) {
        return Bad(file, "point", point.id,
                   "its image " + std::to_string(element.image_id) + " is not in images" + ending_);
      }
      const size_t keypoints = model_.features.images[image->second].keypoints.size();
      if (element.point_index >= keypoints) {
        return Bad(file, "point", point.id,
                   "keypoint " + std::to_string(element.point_index) + " of image " +
                       std::to_string(element.image_id) + " does not exist, it has " +
                       std::to_string(keypoints));
      }
      result.observations.push_back({ImageId(image->second), KeypointId(element.point_index)});
    }
    KeepOnePerImage(result.observations);
    model_.reconstruction.points.push_back(std::move(result));
    return {};
  }

  /// COLMAP may see a point twice in one picture; here it is seen at the first of the keypoints.
  static void KeepOnePerImage(std::vector<Observation>& observations) {
    std::sort(observations.begin(), observations.end());
    const auto same_image = [](const Observation& a, const Observation& b) {
      return a.image == b.image;
    };
    observations.erase(std::unique(observations.begin(), observations.end(), same_image),
                       observations.end());
  }

  const ColmapRecords& records_;
  std::string ending_;
  std::map<uint64_t, size_t> lenses_;
  std::map<uint64_t, size_t> images_;
  ColmapModel model_;
};

/// Binary when all its files are there, else text.
Result<ColmapEncoding> FindEncoding(const fs::path& folder) {
  for (const ColmapEncoding encoding : {ColmapEncoding::kBinary, ColmapEncoding::kText}) {
    const bool is_whole = std::all_of(kStems.begin(), kStems.end(), [&](const char* stem) {
      std::error_code error;
      return fs::exists(folder / (std::string(stem) + Ending(encoding)), error);
    });
    if (is_whole) return encoding;
  }
  return Error{ErrorCode::kNotFound,
               "expected cameras.bin, images.bin and points3D.bin (or the same as .txt)",
               folder.string()};
}

}  // namespace

Result<ColmapModel> ModelOfRecords(const ColmapRecords& records, const std::string& ending) {
  return ModelBuilder(records, ending).Build();
}

Status WriteColmapModel(const Reconstruction& reconstruction, const Features& features,
                        const FrameSet& set, const fs::path& folder, ColmapEncoding encoding) {
  ROTUNDA_ASSIGN_OR_RETURN(const ColmapRecords records, RecordsOf(reconstruction, features, set));
  ColmapFiles files;
  if (encoding == ColmapEncoding::kBinary) {
    files = EncodeColmapBinary(records);
  } else {
    ROTUNDA_ASSIGN_OR_RETURN(files, EncodeColmapText(records));
  }
  const std::array<const std::string*, 3> bytes = {&files.cameras, &files.images, &files.points};
  for (size_t i = 0; i < kStems.size(); ++i) {
    const fs::path file = folder / (std::string(kStems[i]) + Ending(encoding));
    ROTUNDA_RETURN_IF_ERROR(WriteFileAtomically(file, *bytes[i]));
  }
  return {};
}

Result<ColmapModel> ReadColmapModel(const fs::path& folder) {
  ROTUNDA_ASSIGN_OR_RETURN(const ColmapEncoding encoding, FindEncoding(folder));
  const std::string ending = Ending(encoding);
  ColmapFiles files;
  const std::array<std::string*, 3> bytes = {&files.cameras, &files.images, &files.points};
  for (size_t i = 0; i < kStems.size(); ++i) {
    ROTUNDA_ASSIGN_OR_RETURN(*bytes[i], ReadFile(folder / (kStems[i] + ending)));
  }
  const Result<ColmapRecords> records =
      encoding == ColmapEncoding::kBinary ? DecodeColmapBinary(files) : DecodeColmapText(files);
  if (!records) return records.error().In(folder.string());
  Result<ColmapModel> model = ModelOfRecords(*records, ending);
  if (!model) return model.error().In(folder.string());
  return model;
}

}  // namespace rotunda::sfm
