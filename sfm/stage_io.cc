#include "sfm/stage_io.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <string>
#include <type_traits>

#include "sfm/core/file_io.h"

namespace rotunda::sfm {
namespace {

static_assert(std::endian::native == std::endian::little, "stage files are little-endian");

constexpr double kMaxQuaternionNormError = 1e-6;

class Writer {
 public:
  explicit Writer(const std::string& kind) : bytes_("rotunda-" + kind + "/1\n") {}

  template <typename T>
  void Put(const T& value) {
    static_assert(std::is_trivially_copyable_v<T>);
    bytes_.append(reinterpret_cast<const char*>(&value), sizeof(T));
  }
  template <typename T>
  void PutAll(const std::vector<T>& values) {
    static_assert(std::is_trivially_copyable_v<T>);
    Put(static_cast<uint64_t>(values.size()));
    bytes_.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
  }
  Status Save(const std::filesystem::path& file) const { return WriteFileAtomically(file, bytes_); }

 private:
  std::string bytes_;
};

/// Reads what Writer wrote; after the first problem every further read gives zeros and `problem` is
/// set.
class Reader {
 public:
  static Result<Reader> Open(const std::filesystem::path& file, const std::string& kind) {
    ROTUNDA_ASSIGN_OR_RETURN(std::string bytes, ReadFile(file));
    const std::string header = "rotunda-" + kind + "/1\n";
    if (!bytes.starts_with(header)) {
      const std::string found = bytes.substr(0, std::min<size_t>(bytes.find('\n'), 40));
      return Error{ErrorCode::kBadInput,
                   "expected a stage file '" + header.substr(0, header.size() - 1) + "', found '" +
                       found + "'",
                   file.string()};
    }
    return Reader(std::move(bytes), header.size(), file.string());
  }

  template <typename T>
  T Get() {
    T value{};
    if (!Has(1, sizeof(T))) return value;
    std::memcpy(&value, bytes_.data() + position_, sizeof(T));
    position_ += sizeof(T);
    return value;
  }
  template <typename T>
  std::vector<T> GetAll() {
    std::vector<T> values;
    const uint64_t count = Get<uint64_t>();
    if (!Has(count, sizeof(T))) return values;
    values.resize(count);
    if (count > 0) std::memcpy(values.data(), bytes_.data() + position_, count * sizeof(T));
    position_ += count * sizeof(T);
    return values;
  }
  /// A count of items that take at least `min_bytes` each.
  uint64_t GetCount(size_t min_bytes) {
    const uint64_t count = Get<uint64_t>();
    return Has(count, min_bytes) ? count : 0;
  }
  void Require(bool fine, const std::string& what) {
    if (!fine && problem_.empty()) problem_ = what;
  }
  bool failed() const { return !problem_.empty(); }
  Status Finish() {
    Require(position_ == bytes_.size(), "has bytes left over at its end");
    if (failed()) return Error{ErrorCode::kBadInput, problem_, context_};
    return {};
  }

 private:
  Reader(std::string bytes, size_t position, std::string context)
      : bytes_(std::move(bytes)), position_(position), context_(std::move(context)) {}
  bool Has(uint64_t count, size_t size) {
    Require(count <= (bytes_.size() - position_) / size,
            "ends early: a count says " + std::to_string(count) + " items, " +
                std::to_string(bytes_.size() - position_) + " bytes are left");
    return !failed();
  }

  std::string bytes_;
  size_t position_;
  std::string context_;
  std::string problem_;
};

bool IsFinite(const Keypoint& keypoint) {
  return std::isfinite(keypoint.x_px) && std::isfinite(keypoint.y_px) &&
         std::isfinite(keypoint.scale_px) && std::isfinite(keypoint.orientation_rad);
}

bool ValidPair(const ImagePair& pair, const Features& features) {
  return pair.first < pair.second && pair.second.index() < features.images.size();
}

bool ValidObservation(const Observation& observation, const Features& features) {
  return observation.image.index() < features.images.size() &&
         observation.keypoint.index() < features.image(observation.image).keypoints.size();
}

bool ValidMatches(const std::vector<Match>& matches, const ImagePair& pair,
                  const Features& features) {
  for (const Match& match : matches) {
    if (!ValidObservation({pair.first, match.first}, features) ||
        !ValidObservation({pair.second, match.second}, features)) {
      return false;
    }
  }
  return true;
}

bool ValidPose(const Rigid3& pose) {
  return pose.translation.allFinite() &&
         std::abs(pose.rotation.norm() - 1.0) <= kMaxQuaternionNormError;  // false for NaN
}

/// What is wrong with a track; empty when nothing is.
std::string TrackProblem(const Track& track, const Features& features) {
  const std::vector<Observation>& observations = track.observations;
  if (observations.size() < 2) {
    return "has " + std::to_string(observations.size()) + " observations, expected 2 or more";
  }
  for (size_t i = 0; i < observations.size(); ++i) {
    if (!ValidObservation(observations[i], features)) return "names a keypoint that is not there";
    if (i == 0 || observations[i - 1].image < observations[i].image) continue;
    return observations[i - 1].image == observations[i].image
               ? "has two observations in one picture"
               : "is not sorted by picture";
  }
  return "";
}

constexpr char kBadMatch[] = "a match names a keypoint that is not there";
constexpr char kBadPair[] =
    "a pair names a picture that is not there, or its pictures are not in order";

}  // namespace

Status WriteFeatures(const Features& features, const std::filesystem::path& file) {
  Writer writer("features");
  writer.Put(static_cast<uint64_t>(features.images.size()));
  for (const ImageFeatures& image : features.images) {
    writer.Put(image.width_px);
    writer.Put(image.height_px);
    writer.PutAll(image.keypoints);
    writer.PutAll(image.descriptors);
    writer.PutAll(image.colors_rgb);
  }
  return writer.Save(file);
}

Result<Features> ReadFeatures(const std::filesystem::path& file) {
  ROTUNDA_ASSIGN_OR_RETURN(Reader reader, Reader::Open(file, "features"));
  Features features;
  const uint64_t images = reader.GetCount(2 * sizeof(int) + 3 * sizeof(uint64_t));
  for (uint64_t i = 0; i < images && !reader.failed(); ++i) {
    ImageFeatures& image = features.images.emplace_back();
    image.width_px = reader.Get<int>();
    image.height_px = reader.Get<int>();
    image.keypoints = reader.GetAll<Keypoint>();
    image.descriptors = reader.GetAll<uint8_t>();
    image.colors_rgb = reader.GetAll<std::array<uint8_t, 3>>();
    const size_t count = image.keypoints.size();
    reader.Require(std::all_of(image.keypoints.begin(), image.keypoints.end(), IsFinite),
                   "a keypoint of picture " + std::to_string(i) + " is not finite numbers");
    reader.Require(
        image.descriptors.size() == count * kDescriptorSize && image.colors_rgb.size() == count,
        "keypoints, descriptors and colours of picture " + std::to_string(i) + " differ in number");
  }
  ROTUNDA_RETURN_IF_ERROR(reader.Finish());
  return features;
}

Status WriteMatches(const Matches& matches, const std::filesystem::path& file) {
  Writer writer("matches");
  writer.Put(static_cast<uint64_t>(matches.pairs.size()));
  for (const PairMatches& pair : matches.pairs) {
    writer.Put(pair.pair);
    writer.PutAll(pair.matches);
  }
  return writer.Save(file);
}

Result<Matches> ReadMatches(const std::filesystem::path& file, const Features& features) {
  ROTUNDA_ASSIGN_OR_RETURN(Reader reader, Reader::Open(file, "matches"));
  Matches matches;
  const uint64_t pairs = reader.GetCount(sizeof(ImagePair) + sizeof(uint64_t));
  for (uint64_t i = 0; i < pairs && !reader.failed(); ++i) {
    PairMatches& pair = matches.pairs.emplace_back();
    pair.pair = reader.Get<ImagePair>();
    pair.matches = reader.GetAll<Match>();
    reader.Require(ValidPair(pair.pair, features), kBadPair);
    if (!reader.failed()) {
      reader.Require(ValidMatches(pair.matches, pair.pair, features), kBadMatch);
    }
  }
  ROTUNDA_RETURN_IF_ERROR(reader.Finish());
  return matches;
}

Status WriteTwoViews(const TwoViews& two_views, const std::filesystem::path& file) {
  Writer writer("two-views");
  writer.Put(static_cast<uint64_t>(two_views.pairs.size()));
  for (const TwoView& view : two_views.pairs) {
    writer.Put(view.pair);
    writer.Put(static_cast<uint32_t>(view.kind));
    for (double value : view.second_from_first.rotation.coeffs()) writer.Put(value);
    for (double value : view.second_from_first.translation) writer.Put(value);
    writer.Put(view.median_angle_rad);
    writer.PutAll(view.inliers);
  }
  return writer.Save(file);
}

Result<TwoViews> ReadTwoViews(const std::filesystem::path& file, const Features& features) {
  ROTUNDA_ASSIGN_OR_RETURN(Reader reader, Reader::Open(file, "two-views"));
  TwoViews two_views;
  const uint64_t pairs = reader.GetCount(sizeof(ImagePair) + 8 * sizeof(double));
  for (uint64_t i = 0; i < pairs && !reader.failed(); ++i) {
    TwoView& view = two_views.pairs.emplace_back();
    view.pair = reader.Get<ImagePair>();
    const uint32_t kind = reader.Get<uint32_t>();
    view.kind = static_cast<TwoViewKind>(kind);
    for (double& value : view.second_from_first.rotation.coeffs()) value = reader.Get<double>();
    for (double& value : view.second_from_first.translation) value = reader.Get<double>();
    view.median_angle_rad = reader.Get<double>();
    view.inliers = reader.GetAll<Match>();
    reader.Require(kind <= static_cast<uint32_t>(TwoViewKind::kPanoramic),
                   "the kind of a pair is out of range");
    reader.Require(
        ValidPose(view.second_from_first) && std::isfinite(view.median_angle_rad),
        "pair " + std::to_string(i) + ": expected a quaternion of norm 1 and finite numbers");
    reader.Require(ValidPair(view.pair, features), kBadPair);
    if (!reader.failed()) {
      reader.Require(ValidMatches(view.inliers, view.pair, features), kBadMatch);
    }
  }
  ROTUNDA_RETURN_IF_ERROR(reader.Finish());
  return two_views;
}

Status WriteTracks(const Tracks& tracks, const std::filesystem::path& file) {
  Writer writer("tracks");
  writer.Put(static_cast<uint64_t>(tracks.tracks.size()));
  for (const Track& track : tracks.tracks) writer.PutAll(track.observations);
  return writer.Save(file);
}

Result<Tracks> ReadTracks(const std::filesystem::path& file, const Features& features) {
  ROTUNDA_ASSIGN_OR_RETURN(Reader reader, Reader::Open(file, "tracks"));
  Tracks tracks;
  const uint64_t count = reader.GetCount(sizeof(uint64_t));
  for (uint64_t i = 0; i < count && !reader.failed(); ++i) {
    Track& track = tracks.tracks.emplace_back();
    track.observations = reader.GetAll<Observation>();
    const std::string problem = TrackProblem(track, features);
    reader.Require(problem.empty(), "track " + std::to_string(i) + " " + problem);
  }
  ROTUNDA_RETURN_IF_ERROR(reader.Finish());
  return tracks;
}

}  // namespace rotunda::sfm
