#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "sfm/core/calibration.h"
#include "sfm/core/camera.h"
#include "sfm/core/result.h"
#include "sfm/core/rigid3.h"

namespace rotunda {

/// How far a pose is from the one in the calibration in force. `moved` and `wrong_side` exclude
/// each other, and either excludes `swapped_with`.
struct VsCalibration {
  double rotation_deg = 0.0;
  double position_mm = 0.0;
  bool moved = false;
  /// The camera whose place in the calibration this one has, when cameras have changed places.
  std::optional<std::string> swapped_with = std::nullopt;
  /// The model is folded, and what looks alike put this camera there. Of a folded model no camera
  /// is `moved`: nothing tells.
  bool wrong_side = false;
  /// The larger of rotation and position, in predicted sigmas of pose and calibration together.
  double sigmas = 0.0;
  /// Turned by more than kFoldedRotation_deg, or so far away that nobody pushed it there by
  /// accident. Never of swapped cameras.
  bool far_off = false;
};

/// Where matches that contradict a camera's pose would put it, and the log-likelihoods (natural) of
/// what it misses there: by how much they speak for its own pose, and for that one.
struct OtherPose {
  double rotation_deg = 0;  // from the camera's own
  double against = 0;
  double in_favour = 0;
};

/// What was found of a camera where parts of the subject look alike (tc-sfm).
struct PoseEvidence {
  /// Log-likelihood (natural) by which what it sees puts it on its side and on no other; absent: no
  /// draft of the reconstruction was folded.
  std::optional<double> certainty;
  std::optional<OtherPose> other_pose;  // absent: no match contradicts its pose
  bool doubtful = false;                // it may belong there
  bool late = false;                    // placed after the others, against their poses
};

/// One camera of a reconstruction.
struct CameraPose {
  std::string camera;
  bool registered = false;
  std::string reason;  // why it is not registered; empty when it is
  CameraIntrinsics intrinsics;
  Rigid3 cam_from_rig;             // metres when the set's scale is metric, else model units
  std::optional<PoseSigma> sigma;  // position_mm is in 1/1000 model units when not metric
  std::string side;                // "front", "back", "left", "right"; empty when not known
  std::vector<uint32_t> segments;  // ids of segments whose tracks it sees
  size_t observations = 0;
  double rms_px = 0.0;
  std::optional<VsCalibration> vs_calibration;
  std::optional<PoseEvidence> evidence;
};

/// A track community, as reported.
struct SegmentSummary {
  uint32_t id = 0;
  uint32_t community = 0;
  bool ambiguous = false;
  std::string side;
  size_t tracks = 0;
  size_t cameras = 0;
  std::vector<uint32_t> look_alikes;  // ids of segments, the most alike first; itself when periodic
};

/// Whether half of the cameras that were compared, or more, are off the calibration beyond
/// `sigmas`: then it is not theirs, or the rig has changed as a whole, and no camera is odd.
bool DisagreesAsAWhole(const std::vector<CameraPose>& cameras, double sigmas);

/// Calibrated cameras that the set has no frame of, in the calibration's order.
std::vector<std::string> CamerasWithoutFrame(const Calibration& calibration,
                                             const std::vector<CameraPose>& cameras);

struct PoseSummary {
  size_t registered = 0;
  size_t of = 0;
  double rms_px = 0.0;
  /// Mean over points of the mean reprojection error of the point's observations (COLMAP's figure).
  double mean_reprojection_px = 0.0;
  size_t points = 0;
  size_t models = 1;  // > 1: pieces that could not be joined; the largest is given
  /// Against the calibration, when there is one; without swapped cameras.
  std::optional<double> mean_rotation_deg;
  std::optional<double> mean_position_mm;
  size_t ambiguous_communities = 0;
  std::optional<bool> folded;  // absent: nothing was at hand to tell
  std::string verdict;         // "sure", "unsure", "folded"; empty: neither method nor calibration
                               // give one
  std::string verdict_reason;  // one line; empty with the verdict
  /// What the pictures alone say, before the calibration is looked at, which can only make it
  /// worse; empty: the method gives none, the calibration was a prior, or the file is older.
  std::string verdict_of_pictures;
  /// Log-likelihood (natural) that speaks against everything that looks alike; absent when nothing
  /// does.
  std::optional<double> margin;
  /// Weight of the lightest pair that holds the view graph together / of the heaviest that
  /// contradicts it; absent when nothing does, or the pairs alone were not judged. From about 1.2
  /// on the pairs tell by themselves. Captures whose front and back look the same are below (0.88
  /// to 1.15 measured), right or folded: the verdict does not rest on it.
  std::optional<double> view_graph_margin;
};

/// What a reconstruction gives: poses.json. Cameras are sorted by name; all cameras of the frame
/// set are there.
struct PoseSet {
  std::string frameset;  // id of the frame set
  std::string method;    // "plain", "tc-sfm"
  std::map<std::string, std::string> options;
  bool metric = false;
  std::optional<std::string> aligned_to;  // calibration id
  std::vector<CameraPose> cameras;
  std::vector<SegmentSummary> segments;
  PoseSummary summary;
};

/// A reconstruction with a camera farther off than this is folded: look-alike sides of the subject
/// were taken for one (TC-SfM, section IV).
inline constexpr double kFoldedRotation_deg = 10.0;

inline constexpr char kPosesFormat[] = "rotunda-poses/1";

std::string PoseSetToJson(const PoseSet& poses);
Result<PoseSet> PoseSetFromJson(const std::string& text, const std::string& source);
Result<PoseSet> ReadPoseSet(const std::filesystem::path& file);

}  // namespace rotunda
