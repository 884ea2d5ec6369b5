#include "sfm/core/evaluate.h"

#include <algorithm>
#include <cmath>

#include "sfm/core/alignment.h"
#include "sfm/core/json_types.h"

namespace rotunda {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kMm = 1000.0;  // millimetres a metre

/// A camera that is in both, each pose in its own frame.
struct Pair {
  std::string camera;
  Rigid3 estimate;
  Rigid3 truth;
  std::optional<PoseSigma> sigma;  // position_mm: thousandths of the estimate's unit
};

struct Pairs {
  std::vector<Pair> pairs;
  std::vector<std::string> not_in_truth;

  void Add(const Calibration& truth, Pair pair) {
    const CalibratedCamera* camera = truth.Find(pair.camera);
    if (camera == nullptr) {
      not_in_truth.push_back(pair.camera);
      return;
    }
    pair.truth = camera->cam_from_rig;
    pairs.push_back(std::move(pair));
  }
};

struct Summary {
  double mean = 0, median = 0, max = 0;
};

/// Median of an even number: mean of the middle two.
Summary Summarize(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  Summary summary;
  for (double value : values) summary.mean += value / static_cast<double>(values.size());
  const size_t half = values.size() / 2;
  summary.median = values.size() % 2 == 1 ? values[half] : 0.5 * (values[half - 1] + values[half]);
  summary.max = values.back();
  return summary;
}

/// Root of the mean of (error / sigma)^2, over the cameras that have a sigma.
class SigmaRatio {
 public:
  void Add(double error, double sigma) {
    if (!(sigma > 0)) return;
    sum_ += (error / sigma) * (error / sigma);
    ++count_;
  }
  std::optional<double> Root() const {
    if (count_ == 0) return std::nullopt;
    return std::sqrt(sum_ / static_cast<double>(count_));
  }

 private:
  double sum_ = 0;
  size_t count_ = 0;
};

Result<Sim3> FitCentres(const std::vector<Pair>& pairs, bool with_scale) {
  if (pairs.size() < 3) {
    return Error{ErrorCode::kBadInput,
                 "expected at least 3 cameras that have a pose and are in the truth, found " +
                     std::to_string(pairs.size()),
                 ""};
  }
  std::vector<Eigen::Vector3d> source, target;
  for (const Pair& pair : pairs) {
    source.push_back(pair.estimate.OriginInSource());
    target.push_back(pair.truth.OriginInSource());
  }
  const Result<Sim3> fit = FitSim3(source, target, with_scale);
  if (!fit) return fit.error().In("camera centres");
  return fit;
}

/// Fills everything but `registered` and `of`.
Result<Evaluation> Evaluate(const Pairs& measured, bool with_scale) {
  const std::vector<Pair>& pairs = measured.pairs;
  ROTUNDA_ASSIGN_OR_RETURN(const Sim3 truth_from_estimate, FitCentres(pairs, with_scale));
  Evaluation evaluation;
  evaluation.not_in_truth = measured.not_in_truth;
  std::vector<double> rotations_deg, positions_mm;
  SigmaRatio rotation_ratio, position_ratio;
  for (const Pair& pair : pairs) {
    const Rigid3 aligned = TransformPose(truth_from_estimate, pair.estimate);
    const double rotation_deg =
        DegFromRad(RotationAngle_rad(aligned.rotation, pair.truth.rotation));
    const double position_mm =
        kMm * (aligned.OriginInSource() - pair.truth.OriginInSource()).norm();
    evaluation.cameras.push_back({pair.camera, rotation_deg, position_mm});
    rotations_deg.push_back(rotation_deg);
    positions_mm.push_back(position_mm);
    evaluation.folded = evaluation.folded || rotation_deg > kFoldedRotation_deg;
    if (!pair.sigma) continue;
    rotation_ratio.Add(rotation_deg, pair.sigma->rotation_deg);
    position_ratio.Add(position_mm, truth_from_estimate.scale * pair.sigma->position_mm);
  }
  const Summary rotation = Summarize(rotations_deg);
  const Summary position = Summarize(positions_mm);
  evaluation.mean_rotation_deg = rotation.mean;
  evaluation.median_rotation_deg = rotation.median;
  evaluation.max_rotation_deg = rotation.max;
  evaluation.mean_position_mm = position.mean;
  evaluation.median_position_mm = position.median;
  evaluation.max_position_mm = position.max;
  evaluation.rotation_error_over_sigma = rotation_ratio.Root();
  evaluation.position_error_over_sigma = position_ratio.Root();
  return evaluation;
}

}  // namespace

Result<Evaluation> EvaluatePoses(const PoseSet& poses, const Calibration& truth) {
  Pairs pairs;
  size_t registered = 0;
  for (const CameraPose& camera : poses.cameras) {
    if (!camera.registered) continue;
    ++registered;
    pairs.Add(truth, {camera.camera, camera.cam_from_rig, {}, camera.sigma});
  }
  ROTUNDA_ASSIGN_OR_RETURN(Evaluation evaluation, Evaluate(pairs, true));
  evaluation.measured_id = poses.frameset;
  evaluation.truth_id = truth.id;
  evaluation.registered = registered;
  evaluation.of = poses.cameras.size();
  return evaluation;
}

Result<Evaluation> EvaluateCalibration(const Calibration& calibration, const Calibration& truth) {
  Pairs pairs;
  for (const CalibratedCamera& camera : calibration.cameras) {
    pairs.Add(truth, {camera.camera, camera.cam_from_rig, {}, camera.sigma});
  }
  ROTUNDA_ASSIGN_OR_RETURN(Evaluation evaluation, Evaluate(pairs, false));
  evaluation.measured_id = calibration.id;
  evaluation.truth_id = truth.id;
  evaluation.registered = pairs.pairs.size();
  evaluation.of = truth.cameras.size();
  return evaluation;
}

std::string EvaluationToJson(const Evaluation& evaluation) {
  Json root;
  root["measured"] = evaluation.measured_id;
  root["truth"] = evaluation.truth_id;
  root["registered"] = evaluation.registered;
  root["of"] = evaluation.of;
  root["mean_rotation_deg"] = evaluation.mean_rotation_deg;
  root["median_rotation_deg"] = evaluation.median_rotation_deg;
  root["max_rotation_deg"] = evaluation.max_rotation_deg;
  root["mean_position_mm"] = evaluation.mean_position_mm;
  root["median_position_mm"] = evaluation.median_position_mm;
  root["max_position_mm"] = evaluation.max_position_mm;
  root["folded"] = evaluation.folded;
  if (evaluation.rotation_error_over_sigma) {
    root["rotation_error_over_sigma"] = *evaluation.rotation_error_over_sigma;
  }
  if (evaluation.position_error_over_sigma) {
    root["position_error_over_sigma"] = *evaluation.position_error_over_sigma;
  }
  if (!evaluation.not_in_truth.empty()) root["not_in_truth"] = evaluation.not_in_truth;
  root["cameras"] = Json::array();
  for (const CameraError& camera : evaluation.cameras) {
    Json object;
    object["camera"] = camera.camera;
    object["rotation_deg"] = camera.rotation_deg;
    object["position_mm"] = camera.position_mm;
    root["cameras"].push_back(object);
  }
  return JsonText(root);
}

}  // namespace rotunda
