#include "sfm/calibration_prior.h"

#include <algorithm>
#include <string>

namespace rotunda::sfm {
namespace {

/// Whether an edge's rotation is that of the calibration; nullopt without one.
std::optional<bool> Agrees(const TwoView& view, const CalibratedPoses& calibrated,
                           double max_rotation_rad) {
  const std::optional<Rigid3>& first = calibrated[view.pair.first.index()];
  const std::optional<Rigid3>& second = calibrated[view.pair.second.index()];
  if (!first || !second) return std::nullopt;
  const Eigen::Quaterniond expected = second->rotation * first->rotation.conjugate();
  return RotationAngle_rad(expected, view.second_from_first.rotation) <= max_rotation_rad;
}

/// Sorts the images into those whose edges agree with their calibrated pose, by enough of their
/// weight, and those whose edges do not.
void JudgeImages(const ViewGraph& graph, const std::vector<std::optional<bool>>& agrees,
                 double min_agreeing_share, CalibrationPrior& prior) {
  std::vector<double> agreeing(graph.images, 0.0), judged = agreeing;
  for (size_t e = 0; e < graph.edges.size(); ++e) {
    if (!agrees[e]) continue;
    for (const ImageId image : {graph.edges[e].pair.first, graph.edges[e].pair.second}) {
      judged[image.index()] += graph.edges[e].weight;
      if (*agrees[e]) agreeing[image.index()] += graph.edges[e].weight;
    }
  }
  prior.placed.assign(graph.images, false);
  for (size_t i = 0; i < graph.images; ++i) {
    if (judged[i] == 0) continue;
    prior.placed[i] = agreeing[i] >= min_agreeing_share * judged[i];
    if (!prior.placed[i]) prior.contradicted.push_back(ImageId(i));
  }
}

Status CheckThatItIsTheirs(const CalibrationPrior& prior) {
  const size_t contradicted = prior.contradicted.size();
  const size_t judged = contradicted + static_cast<size_t>(std::count(prior.placed.begin(),
                                                                      prior.placed.end(), true));
  if (2 * contradicted < judged) return {};
  return Error{ErrorCode::kBadInput,
               "cannot be a prior: the pictures of " + std::to_string(contradicted) + " of " +
                   std::to_string(judged) +
                   " calibrated cameras contradict it; expected fewer than half (is it of this "
                   "rig?)",
               "calibration"};
}

}  // namespace

Status CalibrationPriorOptions::Validate() const {
  if (!(max_rotation_rad > 0)) {
    return Error{ErrorCode::kInvalidArgument,
                 std::to_string(max_rotation_rad) + " is out of range, expected > 0",
                 "max_rotation_rad"};
  }
  if (!(min_agreeing_share > 0 && min_agreeing_share <= 1)) {
    return Error{ErrorCode::kInvalidArgument,
                 std::to_string(min_agreeing_share) + " is out of range, expected above 0 to 1",
                 "min_agreeing_share"};
  }
  return {};
}

Result<CalibrationPrior> BuildCalibrationPrior(const ViewGraph& graph, const TwoViews& two_views,
                                               const CalibratedPoses& calibrated,
                                               const CalibrationPriorOptions& options) {
  ROTUNDA_RETURN_IF_ERROR(options.Validate());
  std::vector<std::optional<bool>> agrees;
  for (const ViewGraphEdge& edge : graph.edges) {
    agrees.push_back(Agrees(two_views.pairs[edge.two_view], calibrated, options.max_rotation_rad));
  }
  CalibrationPrior prior;
  JudgeImages(graph, agrees, options.min_agreeing_share, prior);
  ROTUNDA_RETURN_IF_ERROR(CheckThatItIsTheirs(prior));
  for (size_t e = 0; e < graph.edges.size(); ++e) {
    const ImagePair& pair = graph.edges[e].pair;
    prior.refuted.push_back(agrees[e] && !*agrees[e] && prior.placed[pair.first.index()] &&
                            prior.placed[pair.second.index()]);
  }
  return prior;
}

}  // namespace rotunda::sfm
