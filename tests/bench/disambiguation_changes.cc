#include "tests/bench/disambiguation_changes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <random>

#include "sfm/core/calibration.h"
#include "sfm/core/file_io.h"
#include "sfm/core/frame_set.h"
#include "sfm/stage_io.h"
#include "tests/bench/bench_process.h"

namespace rotunda::bench {
namespace {

namespace fs = std::filesystem;
using Names = std::vector<std::string>;

constexpr double kMissingShare = 0.05;
constexpr double kMoved_m = 0.020;

/// What one changed capture is made of and where it is put.
struct Making {
  FrameSet set;
  Calibration calibration;
  CaptureFiles from;
  fs::path frameset;  // folders being written
  fs::path stages;
  std::mt19937_64 random;
  Names moved, swapped;  // what a reconstruction should find
};

void Link(const fs::path& file, const fs::path& as) {
  std::error_code failure;
  fs::create_hard_link(file, as, failure);
  if (failure) Die(as.string() + ": " + failure.message());
}

void LinkStages(const Making& making, const std::vector<const char*>& files) {
  for (const char* file : files) Link(making.from.stages / file, making.stages / file);
}

sfm::Features ReadBaseFeatures(const Making& making) {
  return OrDie(sfm::ReadFeatures(making.from.stages / "features.bin"));
}

sfm::ImageFeatures Thinned(const sfm::ImageFeatures& image, uint64_t one_of,
                           std::mt19937_64& random) {
  sfm::ImageFeatures thinned;
  thinned.width_px = image.width_px;
  thinned.height_px = image.height_px;
  for (size_t k = 0; k < image.keypoints.size(); ++k) {
    if (random() % one_of != 0) continue;
    const uint8_t* descriptor = &image.descriptors[k * sfm::kDescriptorSize];
    thinned.keypoints.push_back(image.keypoints[k]);
    thinned.descriptors.insert(thinned.descriptors.end(), descriptor,
                               descriptor + sfm::kDescriptorSize);
    thinned.colors_rgb.push_back(image.colors_rgb[k]);
  }
  return thinned;
}

void Thin(Making& making, uint64_t one_of) {
  sfm::Features features = ReadBaseFeatures(making);
  for (sfm::ImageFeatures& image : features.images) image = Thinned(image, one_of, making.random);
  OrDie(sfm::WriteFeatures(features, making.stages / "features.bin"));
}

/// The pictures that stay get new ids without gaps.
class Renumbering {
 public:
  Renumbering(size_t count, size_t dropped, std::mt19937_64& random) : new_id_(count) {
    std::vector<bool> gone(count, false);
    while (dropped > 0) {
      const size_t i = random() % count;
      if (!gone[i]) --dropped;
      gone[i] = true;
    }
    size_t next = 0;
    for (size_t i = 0; i < count; ++i) {
      if (!gone[i]) new_id_[i] = ImageId(next++);
    }
  }
  template <typename T>
  std::vector<T> Kept(const std::vector<T>& items) const {
    std::vector<T> kept;
    for (size_t i = 0; i < items.size(); ++i) {
      if (new_id_[i]) kept.push_back(items[i]);
    }
    return kept;
  }
  /// Items with a pair.
  template <typename T>
  std::vector<T> KeptPairs(const std::vector<T>& items) const {
    std::vector<T> kept;
    for (const T& item : items) {
      const auto& first = new_id_[item.pair.first.index()];
      const auto& second = new_id_[item.pair.second.index()];
      if (!first || !second) continue;
      kept.push_back(item);
      kept.back().pair = {*first, *second};
    }
    return kept;
  }

 private:
  std::vector<std::optional<ImageId>> new_id_;  // by old id; nullopt: dropped
};

void DropCameras(Making& making) {
  const size_t count = making.set.frames.size();
  const auto dropped = static_cast<size_t>(std::lround(kMissingShare * static_cast<double>(count)));
  const Renumbering renumbering(count, dropped, making.random);
  const sfm::Features features = ReadBaseFeatures(making);
  const fs::path& from = making.from.stages;
  sfm::Matches matches = OrDie(sfm::ReadMatches(from / "matches.bin", features));
  sfm::TwoViews two_views = OrDie(sfm::ReadTwoViews(from / "two_views.bin", features));
  matches.pairs = renumbering.KeptPairs(matches.pairs);
  two_views.pairs = renumbering.KeptPairs(two_views.pairs);
  making.set.frames = renumbering.Kept(making.set.frames);
  OrDie(sfm::WriteFeatures({renumbering.Kept(features.images)}, making.stages / "features.bin"));
  OrDie(sfm::WriteMatches(matches, making.stages / "matches.bin"));
  OrDie(sfm::WriteTwoViews(two_views, making.stages / "two_views.bin"));
}

/// Sideways in the camera's own frame: t = -R c, so t changes by the opposite.
void MoveCamera(Making& making) {
  auto& cameras = making.calibration.cameras;
  CalibratedCamera& camera = cameras[making.random() % cameras.size()];
  camera.cam_from_rig.translation.x() -= kMoved_m;
  making.moved = {camera.camera};
  LinkStages(making, {"features.bin", "matches.bin", "two_views.bin"});
}

/// As when two cables are swapped: picture A was taken by the camera that the calibration calls B,
/// lens and all, so that two-view geometry has to be made anew.
void SwapCameras(Making& making) {
  auto& cameras = making.calibration.cameras;
  const size_t first = making.random() % cameras.size();
  const size_t second = (first + cameras.size() / 3) % cameras.size();
  std::swap(cameras[first].intrinsics, cameras[second].intrinsics);
  std::swap(cameras[first].cam_from_rig, cameras[second].cam_from_rig);
  std::swap(cameras[first].sigma, cameras[second].sigma);
  making.swapped = {cameras[first].camera, cameras[second].camera};
  std::sort(making.swapped.begin(), making.swapped.end());
  LinkStages(making, {"features.bin", "matches.bin"});
}

void Apply(Change change, Making& making) {
  switch (change) {
    case Change::kNone:
      return;
    case Change::kThinnedToHalf:
      return Thin(making, 2);
    case Change::kThinnedToQuarter:
      return Thin(making, 4);
    case Change::kMissing:
      return DropCameras(making);
    case Change::kMoved:
      return MoveCamera(making);
    case Change::kSwapped:
      return SwapCameras(making);
  }
}

void WriteFrameSet(const Making& making) {
  OrDie(WriteFileAtomically(making.frameset / "frameset.json", FrameSetToJson(making.set)));
  OrDie(WriteCalibration(making.calibration, making.frameset / "calibration.json"));
  Link(making.from.truth, making.frameset / "truth.json");
  for (const Frame& frame : making.set.frames) {
    fs::create_directories((making.frameset / frame.file).parent_path());
    Link(making.from.frameset / frame.file, making.frameset / frame.file);
  }
  const nlohmann::ordered_json expected = {{"moved", making.moved}, {"swapped", making.swapped}};
  OrDie(WriteFileAtomically(making.frameset / "expected.json", expected.dump(1) + "\n"));
}

}  // namespace

void MakeChanged(const Capture& capture, const CaptureFiles& from, const CaptureFiles& to) {
  if (fs::exists(to.frameset)) return;
  // The stages without their frame set are what an interrupted run left.
  fs::remove_all(to.stages);
  fs::create_directories(to.frameset.parent_path());
  OutputFolder frameset = OrDie(OutputFolder::Begin(to.frameset));
  OutputFolder stages = OrDie(OutputFolder::Begin(to.stages));
  const std::string seed_text = capture.name;
  std::seed_seq seed(seed_text.begin(), seed_text.end());
  Making making{OrDie(ReadFrameSet(from.frameset)),
                OrDie(ReadCalibration(from.frameset / "calibration.json")),
                from,
                frameset.path(),
                stages.path(),
                std::mt19937_64(seed),
                {},
                {}};
  Apply(capture.change, making);
  WriteFrameSet(making);
  OrDie(stages.Commit());
  OrDie(frameset.Commit());
}

}  // namespace rotunda::bench
