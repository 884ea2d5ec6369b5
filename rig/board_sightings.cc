#include "rig/board_sightings.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <map>
#include <mutex>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string_view>
#include <utility>

#include "rig/mosaic_detection.h"
#include "rig/png_check.h"
#include "sfm/core/checksum.h"
#include "sfm/core/file_io.h"
#include "sfm/core/frame_set.h"

namespace rotunda::rig {
namespace {

namespace fs = std::filesystem;

/// GenICam names a Bayer format by the first two pixels of the first row, as OpenCV's RGGB codes
/// do.
constexpr std::array<std::pair<std::string_view, int>, 4> kBayerCodes = {{
    {"BayerRG", cv::COLOR_BayerRGGB2GRAY},
    {"BayerGR", cv::COLOR_BayerGRBG2GRAY},
    {"BayerBG", cv::COLOR_BayerBGGR2GRAY},
    {"BayerGB", cv::COLOR_BayerGBRG2GRAY},
}};

struct GreyPicture {
  cv::Mat grey;    // demosaiced
  cv::Mat mosaic;  // as the sensor gave it; empty unless it is a Bayer picture
};

Result<GreyPicture> ReadGrey(const ShotPicture& picture) {
  ROTUNDA_ASSIGN_OR_RETURN(const std::string bytes, ReadFile(picture.file));
  const auto damaged = [&](const std::string& why) {
    return Error{ErrorCode::kBadInput, why, picture.file.string()};
  };
  if (bytes.empty()) return damaged("the file is empty, expected a picture");
  if (const std::string problem = PngProblem(bytes); !problem.empty()) return damaged(problem);
  if (const std::string changed = ChecksumProblem(bytes, picture.xxh3); !changed.empty()) {
    return damaged(changed);
  }
  GreyPicture read;
  try {
    const cv::Mat raw(1, static_cast<int>(bytes.size()), CV_8UC1, const_cast<char*>(bytes.data()));
    read.grey = cv::imdecode(raw, cv::IMREAD_GRAYSCALE | cv::IMREAD_IGNORE_ORIENTATION);
    if (read.grey.empty()) return damaged("is not a picture that can be decoded");
    if (picture.pixel_format.starts_with("Bayer")) {
      const auto code = std::find_if(kBayerCodes.begin(), kBayerCodes.end(), [&](const auto& row) {
        return std::string_view(picture.pixel_format).starts_with(row.first);
      });
      if (code == kBayerCodes.end()) {
        return damaged("pixel format '" + picture.pixel_format +
                       "' is not known; known are BayerRG, BayerGR, BayerBG, BayerGB");
      }
      read.mosaic = read.grey.clone();
      cv::cvtColor(read.mosaic, read.grey, code->second);
    }
  } catch (const cv::Exception& exception) {
    return damaged("cannot be decoded: " + exception.err);
  }
  return read;
}

/// "2" before "10": runs of digits compare as numbers.
bool NaturallyBefore(const std::string& a, const std::string& b) {
  const auto is_digit = [](char c) { return std::isdigit(static_cast<unsigned char>(c)) != 0; };
  size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (!is_digit(a[i]) || !is_digit(b[j])) {
      if (a[i] != b[j]) return a[i] < b[j];
      ++i, ++j;
      continue;
    }
    const auto number = [&](const std::string& text, size_t* at) {
      while (*at + 1 < text.size() && text[*at] == '0' && is_digit(text[*at + 1])) ++*at;
      const size_t first = *at;
      while (*at < text.size() && is_digit(text[*at])) ++*at;
      return std::string_view(text).substr(first, *at - first);
    };
    const std::string_view x = number(a, &i), y = number(b, &j);
    if (x.size() != y.size()) return x.size() < y.size();
    if (x != y) return x < y;
  }
  return a.size() - i < b.size() - j;
}

Result<std::vector<fs::path>> Subfolders(const fs::path& folder) {
  std::vector<fs::path> found;
  std::error_code failed;
  for (fs::directory_iterator i(folder, failed), end; !failed && i != end; i.increment(failed)) {
    if (i->is_directory(failed)) found.push_back(i->path());
  }
  if (failed) return Error{ErrorCode::kNotFound, failed.message(), folder.string()};
  std::sort(found.begin(), found.end(), [](const fs::path& a, const fs::path& b) {
    return NaturallyBefore(a.filename().string(), b.filename().string());
  });
  return found;
}

/// A shot before the cameras of all shots are known.
struct LooseShot {
  BoardShot shot;
  std::map<std::string, ShotPicture> pictures;  // by camera
};

class ShotCollector {
 public:
  Status AddFrameSet(const fs::path& folder) {
    ROTUNDA_RETURN_IF_ERROR(AddPlace(folder));
    ROTUNDA_ASSIGN_OR_RETURN(const FrameSet set, ReadFrameSet(folder));
    LooseShot loose{{set.id, folder}, {}};
    for (const Frame& frame : set.frames) {
      ROTUNDA_RETURN_IF_ERROR(
          AddCamera({frame.camera, frame.serial, frame.width_px, frame.height_px}, folder));
      ShotPicture picture{folder / frame.file, frame.pixel_format, frame.xxh3, ""};
      if (frame.status != "ok") {
        picture = {.missing = "its status in the frame set is " + frame.status};
      }
      loose.pictures[frame.camera] = picture;
    }
    shots_.push_back(std::move(loose));
    return {};
  }

  Status AddCameraFolders(const fs::path& folder, const std::vector<fs::path>& cameras) {
    ROTUNDA_RETURN_IF_ERROR(AddPlace(folder));
    std::vector<std::vector<std::string>> pictures;
    for (const fs::path& camera : cameras) {
      ROTUNDA_ASSIGN_OR_RETURN(const FrameSet set, ReadFrameSet(camera));
      std::vector<std::string> files;
      for (const Frame& frame : set.frames) files.push_back(frame.file);
      std::sort(files.begin(), files.end(), NaturallyBefore);
      pictures.push_back(std::move(files));
      if (pictures.back().size() != pictures.front().size()) {
        return Error{ErrorCode::kBadInput,
                     "has " + std::to_string(pictures.back().size()) + " pictures and " +
                         cameras.front().filename().string() + " has " +
                         std::to_string(pictures.front().size()) +
                         "; folders of cameras must have one picture of every shot",
                     camera.string()};
      }
      ROTUNDA_RETURN_IF_ERROR(AddCamera({camera.filename().string(), "", 0, 0}, folder));
    }
    for (size_t k = 0; k < pictures.front().size(); ++k) {
      LooseShot loose{{"shot " + std::to_string(k), folder}, {}};
      for (size_t c = 0; c < cameras.size(); ++c) {
        loose.pictures[cameras[c].filename().string()] = {.file = cameras[c] / pictures[c][k]};
      }
      shots_.push_back(std::move(loose));
    }
    return {};
  }

  ShotPictures Finish() {
    ShotPictures all;
    for (const auto& [name, camera] : cameras_) all.cameras.push_back(camera);
    for (LooseShot& loose : shots_) {
      std::vector<ShotPicture> row;
      for (const SightedCamera& camera : all.cameras) {
        const auto picture = loose.pictures.find(camera.camera);
        row.push_back(picture != loose.pictures.end()
                          ? picture->second
                          : ShotPicture{.missing = "this shot has no picture of it"});
      }
      all.pictures.push_back(std::move(row));
      all.shots.push_back(std::move(loose.shot));
    }
    return all;
  }

 private:
  /// kBadInput when its shots are there already.
  Status AddPlace(const fs::path& folder) {
    std::error_code failed;
    const fs::path place = fs::weakly_canonical(fs::absolute(folder, failed), failed);
    const auto [known, is_new] = places_.emplace(place, folder);
    if (is_new) return {};
    return Error{ErrorCode::kBadInput,
                 "is given twice (before as " + known->second.string() +
                     "): give every shot once, it would count as two",
                 folder.string()};
  }

  Status AddCamera(const SightedCamera& camera, const fs::path& folder) {
    const auto [place, is_new] = cameras_.emplace(camera.camera, camera);
    SightedCamera& known = place->second;
    if (is_new) return {};
    const auto refused = [&](const std::string& what, const std::string& here,
                             const std::string& before) {
      return Error{ErrorCode::kBadInput,
                   "camera " + camera.camera + " has " + what + " " + here + " here and " + before +
                       " in an earlier shot; are they of one rig?",
                   folder.string()};
    };
    if (!camera.serial.empty() && !known.serial.empty() && camera.serial != known.serial) {
      return refused("serial", camera.serial, known.serial);
    }
    const auto size = [](const SightedCamera& c) {
      return std::to_string(c.width_px) + "x" + std::to_string(c.height_px);
    };
    if (camera.width_px > 0 && known.width_px > 0 && size(camera) != size(known)) {
      return refused("pictures of", size(camera), size(known));
    }
    if (known.serial.empty()) known.serial = camera.serial;
    if (known.width_px == 0) {
      known.width_px = camera.width_px;
      known.height_px = camera.height_px;
    }
    return {};
  }

  std::map<fs::path, fs::path> places_;  // as given, by what it is
  std::map<std::string, SightedCamera> cameras_;
  std::vector<LooseShot> shots_;
};

Status AddFolder(const fs::path& folder, ShotCollector* shots) {
  std::error_code failed;
  if (!fs::is_directory(folder, failed)) {
    return Error{ErrorCode::kNotFound, "is not a folder", folder.string()};
  }
  if (fs::exists(folder / "frameset.json", failed)) return shots->AddFrameSet(folder);
  ROTUNDA_ASSIGN_OR_RETURN(const std::vector<fs::path> below, Subfolders(folder));
  const auto is_frame_set = [&](const fs::path& sub) {
    return fs::exists(sub / "frameset.json", failed);
  };
  if (std::any_of(below.begin(), below.end(), is_frame_set)) {
    for (const fs::path& sub : below) {
      if (is_frame_set(sub)) ROTUNDA_RETURN_IF_ERROR(shots->AddFrameSet(sub));
    }
    return {};
  }
  const bool plain = std::any_of(below.begin(), below.end(), [](auto& p) {
    return p.filename() == "frames" || p.filename() == "images";
  });
  // One folder beside pictures is not a camera's.
  const bool own_pictures = below.size() == 1 && ReadFrameSet(folder).ok();
  if (below.empty() || plain || own_pictures) return shots->AddFrameSet(folder);  // one shot
  return shots->AddCameraFolders(folder, below);
}

BoardSighting Sight(const ShotPicture& picture, const Board& board,
                    const BoardDetectionOptions& options, cv::Size* size, Status* status) {
  BoardSighting sighting;
  sighting.missing = picture.missing;
  if (picture.file.empty()) return sighting;
  sighting.picture = picture.file;
  const Result<GreyPicture> read = ReadGrey(picture);
  if (!read) {
    sighting.missing = "cannot be read: " + read.error().message;
    return sighting;
  }
  *size = read->grey.size();
  Result<BoardDetection> detection =
      read->mosaic.empty() ? DetectBoard(read->grey, board, options)
                           : DetectBoardInMosaic(read->mosaic, read->grey, board, options);
  if (!detection) {
    *status = detection.error().In(picture.file.string());
    return sighting;
  }
  sighting.detection = *std::move(detection);
  return sighting;
}

/// The camera's size is that of its frame sets, or of its first picture; others are refused.
void CheckSizes(const std::vector<cv::Size>& sizes, size_t camera, BoardSightings* all) {
  SightedCamera& sighted = all->cameras[camera];
  for (size_t shot = 0; shot < all->shots.size(); ++shot) {
    const cv::Size& size = sizes[shot * all->cameras.size() + camera];
    if (size.width == 0) continue;
    if (sighted.width_px == 0) {
      sighted.width_px = size.width;
      sighted.height_px = size.height;
    }
    if (size.width == sighted.width_px && size.height == sighted.height_px) continue;
    BoardSighting& sighting = all->sightings[shot][camera];
    sighting.detection.reset();
    sighting.missing = "the picture has " + std::to_string(size.width) + "x" +
                       std::to_string(size.height) + " pixels, expected " +
                       std::to_string(sighted.width_px) + "x" + std::to_string(sighted.height_px);
  }
}

/// `list`: what was rejected in a picture.
template <typename Rejected>
std::vector<RejectedCount> CountByKind(const BoardSightings& sightings,
                                       std::vector<Rejected> BoardDetection::*list) {
  std::map<decltype(Rejected::kind), std::map<std::string, size_t>> kinds;
  for (const auto& row : sightings.sightings) {
    for (size_t c = 0; c < row.size(); ++c) {
      if (!row[c].detection) continue;
      for (const Rejected& rejected : (*row[c].detection).*list) {
        ++kinds[rejected.kind][sightings.cameras[c].camera];
      }
    }
  }
  std::vector<RejectedCount> counts;
  for (const auto& [kind, cameras] : kinds) {
    RejectedCount& count = counts.emplace_back(RejectedCount{TextOf(kind), 0, {}});
    count.cameras.assign(cameras.begin(), cameras.end());
    for (const auto& [camera, some] : cameras) count.count += some;
    std::stable_sort(count.cameras.begin(), count.cameras.end(),
                     [](const auto& a, const auto& b) { return a.second > b.second; });
  }
  std::stable_sort(counts.begin(), counts.end(),
                   [](const auto& a, const auto& b) { return a.count > b.count; });
  return counts;
}

}  // namespace

Result<ShotPictures> FindShots(const std::vector<fs::path>& folders) {
  ShotCollector shots;
  for (const fs::path& folder : folders) {
    ROTUNDA_RETURN_IF_ERROR(AddFolder(folder, &shots));
  }
  return shots.Finish();
}

Result<BoardSightings> DetectBoards(const ShotPictures& shots, const Board& board,
                                    const BoardDetectionOptions& options, RunContext& context) {
  ROTUNDA_RETURN_IF_ERROR(board.Validate());
  BoardSightings all;
  all.cameras = shots.cameras;
  all.shots = shots.shots;
  all.sightings.assign(shots.shots.size(), std::vector<BoardSighting>(shots.cameras.size()));
  const size_t count = shots.shots.size() * shots.cameras.size();
  std::vector<cv::Size> sizes(count);
  std::vector<Status> statuses(count);
  std::mutex progress;
  size_t done = 0;
  context.Report("board", 0, count);
  context.threads.ParallelFor(
      count,
      [&](size_t i) {
        const size_t shot = i / shots.cameras.size(), camera = i % shots.cameras.size();
        all.sightings[shot][camera] =
            Sight(shots.pictures[shot][camera], board, options, &sizes[i], &statuses[i]);
        const std::scoped_lock lock(progress);
        context.Report("board", ++done, count);
      },
      context.stop);
  if (context.Stopped()) return Error{ErrorCode::kCancelled, "stopped while detecting", ""};
  for (const Status& status : statuses) ROTUNDA_RETURN_IF_ERROR(status);
  for (size_t camera = 0; camera < all.cameras.size(); ++camera) CheckSizes(sizes, camera, &all);
  return all;
}

std::vector<RejectedCount> CountRejectedMarkers(const BoardSightings& sightings) {
  return CountByKind(sightings, &BoardDetection::rejected);
}

std::vector<RejectedCount> CountRejectedCorners(const BoardSightings& sightings) {
  return CountByKind(sightings, &BoardDetection::rejected_corners);
}

std::string WorstCameras(const RejectedCount& rejected) {
  constexpr size_t kMostNamed = 5;
  std::string worst;
  for (size_t i = 0; i < std::min(kMostNamed, rejected.cameras.size()); ++i) {
    const auto& [camera, count] = rejected.cameras[i];
    worst += (worst.empty() ? "" : ", ") + camera + " " + std::to_string(count);
  }
  return worst;
}

}  // namespace rotunda::rig
