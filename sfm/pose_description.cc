#include "sfm/pose_description.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include "sfm/camera_ring.h"
#include "sfm/core/html_text.h"

namespace rotunda::sfm {
namespace {

/// "front" within 45 degrees of azimuth 0, and so on counter-clockwise. In (-180, 180].
std::string SideAt(double azimuth_deg) {
  if (std::abs(azimuth_deg) <= 45) return "front";
  if (std::abs(azimuth_deg) >= 135) return "back";
  return azimuth_deg > 0 ? "left" : "right";
}

std::string SideOf(const Rigid3& cam_from_rig) {
  const Eigen::Vector3d center_m = cam_from_rig.OriginInSource();
  return SideAt(DegFromRad(std::atan2(center_m.y(), center_m.x())));
}

/// A fold takes cameras along in numbers; one or two may have been mounted elsewhere.
constexpr size_t kFewestFolded = 3;

/// Cameras, swapped ones apart, that are not near their calibrated places.
struct FarOff {
  size_t compared = 0;
  std::vector<size_t> cameras;   // turned by more than kFoldedRotation_deg, or far away
  std::vector<size_t> opposite;  // both
  /// Without a majority in place nobody knows which cameras are.
  bool NoneFits() const { return 2 * opposite.size() > compared; }
};

FarOff FindFarOff(const RigAlignment& alignment) {
  FarOff far_off;
  for (size_t i = 0; i < alignment.vs_calibration.size(); ++i) {
    const std::optional<VsCalibration>& off = alignment.vs_calibration[i];
    if (!off || off->swapped_with) continue;
    const bool turned = off->rotation_deg > kFoldedRotation_deg;
    const bool away = off->position_mm > alignment.far_mm;
    ++far_off.compared;
    if (turned || away) far_off.cameras.push_back(i);
    if (turned && away) far_off.opposite.push_back(i);
  }
  return far_off;
}

std::string FoldedReason(const FarOff& far_off) {
  if (far_off.NoneFits()) {
    return "not even half of the cameras stand to one another as calibrated (folded into several "
           "layers, or the calibration is another rig's)";
  }
  return Counted(far_off.opposite.size(), "camera") +
         " on the wrong side, far from where the calibration has them";
}

bool Contains(const std::vector<ImageId>& images, ImageId image) {
  return std::find(images.begin(), images.end(), image) != images.end();
}

void MakeUnsure(const std::string& reason, PoseSummary& summary) {
  if (!summary.verdict.empty() && summary.verdict != VerdictName(Verdict::kSure)) return;
  summary.verdict = VerdictName(Verdict::kUnsure);
  summary.verdict_reason = reason;
}

/// What the calibration says of the verdict of the pictures: it makes it worse, never better. What
/// is sure becomes unsure at worst: cameras or the calibration may be others.
void JudgeFarOff(const FarOff& far_off, bool disagrees, PoseSummary& summary) {
  if (far_off.opposite.size() >= kFewestFolded && summary.verdict != VerdictName(Verdict::kSure)) {
    summary.folded = true;
    summary.margin.reset();
    summary.verdict = VerdictName(Verdict::kFolded);
    summary.verdict_reason = FoldedReason(far_off);
  } else if (!far_off.cameras.empty()) {
    if (summary.verdict != VerdictName(Verdict::kFolded)) summary.folded.reset();
    MakeUnsure(Counted(far_off.cameras.size(), "camera") +
                   " far from where the calibration has them: mounted elsewhere, calibrated "
                   "otherwise, or on the wrong side",
               summary);
  } else {
    if (!summary.folded) summary.folded = false;
    if (disagrees) {
      MakeUnsure(
          "half of the cameras or more are off the calibration beyond their uncertainties: it is "
          "another rig's, or the rig has changed as a whole",
          summary);
    }
  }
}

void MarkFarOff(const FarOff& far_off, std::vector<CameraPose>& cameras) {
  for (const size_t i : far_off.cameras) {
    if (cameras[i].vs_calibration) cameras[i].vs_calibration->far_off = true;
  }
}

void MarkFolded(const FarOff& far_off, std::vector<CameraPose>& cameras) {
  for (CameraPose& camera : cameras) {
    if (camera.vs_calibration) camera.vs_calibration->moved = false;
  }
  if (far_off.NoneFits()) return;
  for (const size_t i : far_off.opposite) {
    if (cameras[i].vs_calibration) cameras[i].vs_calibration->wrong_side = true;
  }
}

}  // namespace

PoseSet DescribePoses(const FrameSet& set, const IncrementalResult& models,
                      const Reconstruction& reconstruction, const Features& features) {
  PoseSet poses;
  poses.frameset = set.id;
  const ReprojectionSummary residuals = SummarizeReprojection(reconstruction, features);
  poses.summary.of = set.frames.size();
  poses.summary.registered = RegisteredCount(reconstruction);
  poses.summary.rms_px = residuals.rms_px;
  poses.summary.mean_reprojection_px = residuals.mean_over_points_px;
  poses.summary.points = reconstruction.points.size();
  poses.summary.models = models.models.size();
  for (size_t i = 0; i < set.frames.size(); ++i) {
    CameraPose& pose = poses.cameras.emplace_back();
    pose.camera = set.frames[i].camera;
    pose.observations = residuals.images[i].observations;
    pose.rms_px = residuals.images[i].rms_px;
    pose.registered = reconstruction.Registered(ImageId(i));
    const std::string& status = set.frames[i].status;
    if (pose.registered || (reconstruction.intrinsics.known && status == "ok")) {
      pose.intrinsics = reconstruction.intrinsics.of(ImageId(i));
    }
    if (pose.registered) {
      pose.cam_from_rig = *reconstruction.cam_from_model[i];
    } else {
      pose.reason =
          "is in another piece of the reconstruction, which could not be joined to this one";
    }
  }
  for (const UnregisteredImage& image : models.unregistered) {
    poses.cameras[image.image.index()].reason = image.reason;
  }
  for (size_t i = 0; i < set.frames.size(); ++i) {
    const std::string& status = set.frames[i].status;
    CameraPose& pose = poses.cameras[i];
    if (status != "ok" && !pose.registered) {
      pose.reason = "no usable picture: the frame is " + status;
    }
  }
  return poses;
}

void AddSigmas(const PoseCovariances& covariances, const Intrinsics& intrinsics, PoseSet& poses) {
  for (size_t i = 0; i < poses.cameras.size(); ++i) {
    if (!covariances.images[i]) continue;
    poses.cameras[i].sigma = SigmaOf(*covariances.images[i]);
    poses.cameras[i].sigma->focal_px = covariances.focal_sigma_px[intrinsics.lens_of_image[i]];
  }
}

void AddCalibrationFigures(const RigAlignment& alignment, const Calibration& calibration,
                           PoseSet& poses) {
  poses.metric = true;
  poses.aligned_to = calibration.id;
  double rotation_sum_deg = 0, position_sum_mm = 0;
  size_t compared = 0;
  for (size_t i = 0; i < poses.cameras.size(); ++i) {
    CameraPose& pose = poses.cameras[i];
    if (!pose.registered) continue;
    pose.side = SideOf(pose.cam_from_rig);
    pose.vs_calibration = alignment.vs_calibration[i];
    if (!pose.vs_calibration || pose.vs_calibration->swapped_with) continue;
    rotation_sum_deg += pose.vs_calibration->rotation_deg;
    position_sum_mm += pose.vs_calibration->position_mm;
    ++compared;
  }
  const FarOff far_off = FindFarOff(alignment);
  MarkFarOff(far_off, poses.cameras);
  JudgeFarOff(far_off, DisagreesAsAWhole(poses.cameras, kMovedSigmas), poses.summary);
  if (poses.summary.folded.value_or(false)) MarkFolded(far_off, poses.cameras);
  if (compared == 0) return;
  poses.summary.mean_rotation_deg = rotation_sum_deg / static_cast<double>(compared);
  poses.summary.mean_position_mm = position_sum_mm / static_cast<double>(compared);
}

void AddVerdict(const TcSfmResult& result, PoseSet& poses) {
  poses.summary.verdict = poses.summary.verdict_of_pictures = VerdictName(result.verdict);
  poses.summary.verdict_reason = result.reason;
  if (std::isfinite(result.evidence)) poses.summary.margin = result.evidence;
  poses.summary.view_graph_margin = result.view_graph_margin;
  if (result.verdict != Verdict::kUnsure) {
    poses.summary.folded = result.verdict == Verdict::kFolded;
  }
}

void AddEvidence(const TcSfmResult& result, PoseSet& poses) {
  for (size_t i = 0; i < poses.cameras.size(); ++i) {
    if (!poses.cameras[i].registered) continue;
    PoseEvidence& evidence = poses.cameras[i].evidence.emplace();
    if (std::isfinite(result.certainty[i])) evidence.certainty = result.certainty[i];
    evidence.doubtful = Contains(result.doubtful, ImageId(i));
    evidence.late = Contains(result.late, ImageId(i));
  }
  for (const AlternativePose& other : result.alternatives) {
    poses.cameras[other.image.index()].evidence->other_pose =
        OtherPose{DegFromRad(other.rotation_rad), other.evidence_against, other.evidence_for};
  }
}

bool AddSides(const Reconstruction& model, ImageId front, PoseSet& poses) {
  const std::optional<CameraRing> ring = FindCameraRing(model);
  if (!ring || !ring->upright || !model.Registered(front)) return false;
  const std::vector<std::optional<double>> azimuths_rad = AzimuthsAround(*ring, model);
  for (size_t i = 0; i < poses.cameras.size(); ++i) {
    if (!azimuths_rad[i]) continue;
    const double from_front_rad = *azimuths_rad[i] - *azimuths_rad[front.index()];
    poses.cameras[i].side = SideAt(DegFromRad(std::remainder(from_front_rad, 2 * kPi)));
  }
  return true;
}

void AddSegments(const Segments& segments, PoseSet& poses) {
  for (size_t s = 0; s < segments.segments.size(); ++s) {
    const Segment& segment = segments.segments[s];
    if (segment.images.empty()) continue;
    SegmentSummary& summary = poses.segments.emplace_back();
    summary.id = static_cast<uint32_t>(s);
    summary.community = summary.id;
    summary.ambiguous = segment.ambiguous;
    summary.tracks = segment.tracks;
    summary.cameras = segment.images.size();
    for (const uint32_t other : segment.look_alikes) {
      if (!segments.segments[other].images.empty()) summary.look_alikes.push_back(other);
    }
    std::map<std::string, size_t> sides;
    for (const ImageId image : segment.images) {
      CameraPose& camera = poses.cameras[image.index()];
      camera.segments.push_back(summary.id);
      if (!camera.side.empty()) ++sides[camera.side];
    }
    size_t most = 0;
    for (const auto& [side, cameras] : sides) {
      if (cameras > most) most = cameras, summary.side = side;
    }
    poses.summary.ambiguous_communities += segment.ambiguous;
  }
}

}  // namespace rotunda::sfm
