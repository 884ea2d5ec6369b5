#include "sfm/two_view.h"

#include <Eigen/Dense>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <span>
#include <string>

#include "sfm/core/statistics.h"
#include "sfm/epipolar.h"
#include "sfm/lo_ransac.h"
#include "sfm/two_view_solvers.h"

namespace rotunda::sfm {
namespace {

/// With assumed focal lengths an essential matrix is taken when it explains this share of what the
/// fundamental matrix does (COLMAP's min_E_F_inlier_ratio).
constexpr double kMinEssentialShare = 0.95;
constexpr int kLocalIterations = 5;
constexpr int kFinalIterations = 30;
/// Local optimisation sees at most this many inliers, evenly taken; the final one sees all.
constexpr size_t kMaxLocalInliers = 300;

using Data = std::vector<Correspondence>;

Data Subset(std::span<const Correspondence> data, const std::vector<size_t>& places,
            size_t limit = SIZE_MAX) {
  const size_t step = places.size() <= limit ? 1 : (places.size() + limit - 1) / limit;
  Data subset;
  for (size_t i = 0; i < places.size(); i += step) subset.push_back(data[places[i]]);
  return subset;
}

template <size_t N>
std::array<Correspondence, N> Gather(std::span<const Correspondence> data,
                                     std::span<const size_t, N> sample) {
  std::array<Correspondence, N> gathered;
  for (size_t i = 0; i < N; ++i) gathered[i] = data[sample[i]];
  return gathered;
}

/// What the epipolar estimators share; `max_error` is in normalised units.
struct EpipolarEstimator {
  using Model = Eigen::Matrix3d;
  std::span<const Correspondence> data;
  double max_error = 0;

  size_t size() const { return data.size(); }
  RansacScore Score(const Model& model, double bail) const {
    return ScoreEpipolar(model, data, max_error, bail);
  }
};

struct EssentialEstimator : EpipolarEstimator {
  static constexpr size_t kSampleSize = 5;

  void Solve(std::span<const size_t, kSampleSize> sample, std::vector<Model>& models) const {
    SolveFivePoint(Gather(data, sample), models);
  }
  Model Refine(const Model& model) const {
    const Data inliers = Subset(data, EpipolarInliers(model, data, max_error), kMaxLocalInliers);
    if (inliers.size() <= kSampleSize) return model;
    const Rigid3 pose = PoseInFront(model, inliers, max_error);
    return EssentialFromPose(RefinePose(pose, inliers, kLocalIterations));
  }
};

struct FundamentalEstimator : EpipolarEstimator {
  static constexpr size_t kSampleSize = 7;

  void Solve(std::span<const size_t, kSampleSize> sample, std::vector<Model>& models) const {
    SolveSevenPoint(Gather(data, sample), models);
  }
  /// One step of iteratively reweighted least squares on the Sampson distance.
  Model Refine(const Model& model) const {
    const Data inliers = Subset(data, EpipolarInliers(model, data, max_error));
    std::vector<double> weights;
    for (const Correspondence& c : inliers) {
      const Eigen::Vector2d line = (model * c.first.homogeneous()).head<2>();
      const Eigen::Vector2d back = (model.transpose() * c.second.homogeneous()).head<2>();
      weights.push_back(1.0 / (line.squaredNorm() + back.squaredNorm()));
    }
    return FitFundamental(inliers, weights).value_or(model);
  }
};

double SquaredTransfer(const Eigen::Matrix3d& homography, const Correspondence& c) {
  return ((homography * c.first.homogeneous()).hnormalized() - c.second).squaredNorm();
}

struct HomographyEstimator {
  using Model = Eigen::Matrix3d;
  static constexpr size_t kSampleSize = 4;
  std::span<const Correspondence> data;
  double max_error = 0;

  size_t size() const { return data.size(); }
  void Solve(std::span<const size_t, kSampleSize> sample, std::vector<Model>& models) const {
    const std::array<Correspondence, kSampleSize> four = Gather(data, sample);
    if (const std::optional<Model> model = FitHomography(four)) models.push_back(*model);
  }
  RansacScore Score(const Model& model, double bail) const {
    const double limit = max_error * max_error;
    RansacScore score{0.0, 0};
    for (const Correspondence& c : data) {
      const double squared = SquaredTransfer(model, c);
      score.inliers += squared < limit;
      score.cost += squared < limit ? squared : limit;
      if (score.cost > bail) break;
    }
    return score;
  }
  Model Refine(const Model& model) const {
    Data inliers;
    for (const Correspondence& c : data) {
      if (SquaredTransfer(model, c) < max_error * max_error) inliers.push_back(c);
    }
    return FitHomography(inliers).value_or(model);
  }
};

static_assert(RansacEstimator<EssentialEstimator> && RansacEstimator<FundamentalEstimator> &&
              RansacEstimator<HomographyEstimator>);

/// One pair's matches in normalised coordinates; `matches[i]` gave `data[i]`.
struct PairData {
  Data data;
  std::vector<Match> matches;
  double max_error = 0;  // TwoViewOptions::max_error_px in normalised units
};

PairData Normalize(const Features& features, const Intrinsics& intrinsics, const PairMatches& pair,
                   const TwoViewOptions& options) {
  const CameraIntrinsics& first = intrinsics.of(pair.pair.first);
  const CameraIntrinsics& second = intrinsics.of(pair.pair.second);
  PairData out;
  out.max_error =
      0.5 * options.max_error_px * (1.0 / first.MeanFocal_px() + 1.0 / second.MeanFocal_px());
  for (const Match& match : pair.matches) {
    const Keypoint& a = features.image(pair.pair.first).keypoints[match.first.index()];
    const Keypoint& b = features.image(pair.pair.second).keypoints[match.second.index()];
    const auto ray_a = first.NormalizedFromPixel({a.x_px, a.y_px});
    const auto ray_b = second.NormalizedFromPixel({b.x_px, b.y_px});
    if (!ray_a || !ray_b) continue;
    out.data.push_back({*ray_a, *ray_b});
    out.matches.push_back(match);
  }
  return out;
}

/// An epipolar matrix and what agrees with it.
struct EpipolarModel {
  Eigen::Matrix3d matrix;
  std::vector<size_t> inliers;
};

template <typename Estimator>
std::optional<EpipolarModel> Estimate(const PairData& pair, const TwoViewOptions& options,
                                      uint64_t seed) {
  Estimator estimator;
  estimator.data = pair.data;
  estimator.max_error = pair.max_error;
  RansacOptions ransac;
  ransac.confidence = options.confidence;
  ransac.max_iterations = options.max_iterations;
  ransac.seed = seed;
  const auto matches = static_cast<double>(pair.data.size());
  ransac.min_inlier_ratio =
      std::max(options.min_inlier_ratio, static_cast<double>(options.min_inliers) / matches);
  const auto result = LoRansac(estimator, ransac);
  if (!result) return std::nullopt;
  return EpipolarModel{result->model, EpipolarInliers(result->model, pair.data, pair.max_error)};
}

bool Enough(size_t inliers, const PairData& pair, const TwoViewOptions& options) {
  return inliers >= options.min_inliers &&
         static_cast<double>(inliers) >=
             options.min_inlier_ratio * static_cast<double>(pair.data.size());
}

std::vector<bool> TransferInliers(const Eigen::Matrix3d& homography,
                                  std::span<const Correspondence> data, double max_error) {
  std::vector<bool> inliers(data.size());
  for (size_t i = 0; i < data.size(); ++i) {
    inliers[i] = SquaredTransfer(homography, data[i]) < max_error * max_error;
  }
  return inliers;
}

/// Rotation that takes the first camera's rays to the second's (Kabsch), on the data below
/// `max_error`, until these stay the same; starts from those that agree with `homography`.
struct RotationFit {
  Eigen::Quaterniond second_from_first;
  size_t inliers = 0;
};
RotationFit FitRotation(const Eigen::Matrix3d& homography, std::span<const Correspondence> data,
                        double max_error) {
  constexpr int kMaxRounds = 5;
  std::vector<bool> used = TransferInliers(homography, data, max_error);
  RotationFit fit;
  for (int round = 0; round < kMaxRounds; ++round) {
    Eigen::Matrix3d moment = Eigen::Matrix3d::Zero();
    for (size_t i = 0; i < data.size(); ++i) {
      if (!used[i]) continue;
      moment += data[i].second.homogeneous().normalized() *
                data[i].first.homogeneous().normalized().transpose();
    }
    const Eigen::JacobiSVD<Eigen::Matrix3d, Eigen::FullPivHouseholderQRPreconditioner> svd(
        moment, Eigen::ComputeFullU | Eigen::ComputeFullV);
    const Eigen::Matrix3d u = svd.matrixU(), v = svd.matrixV();
    const Eigen::Vector3d signs(1, 1, (u * v.transpose()).determinant() < 0 ? -1 : 1);
    const Eigen::Matrix3d rotation = u * signs.asDiagonal() * v.transpose();
    const std::vector<bool> inliers = TransferInliers(rotation, data, max_error);
    fit = {Eigen::Quaterniond(rotation),
           static_cast<size_t>(std::count(inliers.begin(), inliers.end(), true))};
    if (inliers == used) break;
    used = inliers;
  }
  return fit;
}

/// Whether a homography explains (nearly) all that the epipolar matrix does.
std::optional<Eigen::Matrix3d> ExplainingHomography(const Data& inliers, double max_error,
                                                    const TwoViewOptions& options, uint64_t seed) {
  RansacOptions ransac;
  ransac.confidence = options.confidence;
  ransac.max_iterations = options.max_iterations;
  ransac.min_inlier_ratio = options.max_homography_ratio;
  ransac.seed = seed;
  const auto result = LoRansac(HomographyEstimator{inliers, max_error}, ransac);
  const double wanted = options.max_homography_ratio * static_cast<double>(inliers.size());
  if (!result || static_cast<double>(result->score.inliers) <= wanted) return std::nullopt;
  return result->model;
}

/// The rotation, when it explains (nearly) all that the epipolar matrix does.
std::optional<Eigen::Quaterniond> RotationAlone(const std::optional<Eigen::Matrix3d>& homography,
                                                const Data& inliers, const PairData& pair,
                                                const TwoViewOptions& options) {
  if (!homography) return std::nullopt;
  const RotationFit fit = FitRotation(*homography, inliers, pair.max_error);
  const double wanted = options.max_homography_ratio * static_cast<double>(inliers.size());
  if (static_cast<double>(fit.inliers) <= wanted) return std::nullopt;
  return fit.second_from_first;
}

/// A pose refined over the data that agree with it, and these.
struct PoseModel {
  Rigid3 second_from_first;
  std::vector<size_t> inliers;  // in front of both cameras
};

/// When the pose is the model (`calibrated`) its inliers are its own, else those of the fundamental
/// matrix. Those behind a camera go.
PoseModel RefinedPose(const PairData& pair, const EpipolarModel& model, bool calibrated,
                      const Rigid3& start) {
  const auto inliers_of = [&](const Rigid3& pose) {
    return calibrated ? EpipolarInliers(EssentialFromPose(pose), pair.data, pair.max_error)
                      : model.inliers;
  };
  PoseModel refined{start, inliers_of(start)};
  for (int round = 0; round < 2; ++round) {
    refined.second_from_first =
        RefinePose(refined.second_from_first, Subset(pair.data, refined.inliers), kFinalIterations);
    refined.inliers = inliers_of(refined.second_from_first);
  }
  std::erase_if(refined.inliers, [&](size_t i) {
    return !InFront(refined.second_from_first, pair.data[i], pair.max_error);
  });
  return refined;
}

/// The pose of the epipolar matrix or, of a plane, of its homography: five-point solutions are
/// twofold on a plane, and the wrong one has many points behind a camera. Most inliers win.
PoseModel BestPose(const PairData& pair, const EpipolarModel& model, bool calibrated,
                   const std::optional<Eigen::Matrix3d>& homography) {
  const Data inliers = Subset(pair.data, model.inliers);
  std::vector<Rigid3> starts = {PoseInFront(model.matrix, inliers, pair.max_error)};
  if (homography) {
    for (const Rigid3& pose : PosesFromHomography(*homography)) starts.push_back(pose);
  }
  PoseModel best;
  for (const Rigid3& start : starts) {
    PoseModel refined = RefinedPose(pair, model, calibrated, start);
    if (refined.inliers.size() > best.inliers.size()) best = std::move(refined);
  }
  return best;
}

double MedianAngle_rad(const PairData& pair, const PoseModel& pose) {
  std::vector<double> angles_rad;
  for (size_t i : pose.inliers) {
    angles_rad.push_back(RayAngle_rad(pose.second_from_first, pair.data[i]));
  }
  return Median(std::move(angles_rad));
}

/// The epipolar matrix of a pair and whether it is an essential one.
struct Verified {
  EpipolarModel model;
  bool calibrated = false;
};
std::optional<Verified> EstimateEpipolar(const PairData& pair, bool intrinsics_known,
                                         const TwoViewOptions& options, uint64_t seed) {
  const auto enough = [&](const std::optional<EpipolarModel>& model) {
    return model && Enough(model->inliers.size(), pair, options);
  };
  if (intrinsics_known) {
    auto essential = Estimate<EssentialEstimator>(pair, options, DeriveSeed(seed, 0));
    if (!enough(essential)) return std::nullopt;
    return Verified{*std::move(essential), true};
  }
  auto fundamental = Estimate<FundamentalEstimator>(pair, options, DeriveSeed(seed, 1));
  if (!enough(fundamental)) return std::nullopt;
  auto essential = Estimate<EssentialEstimator>(pair, options, DeriveSeed(seed, 0));
  const double wanted = kMinEssentialShare * static_cast<double>(fundamental->inliers.size());
  if (essential && static_cast<double>(essential->inliers.size()) > wanted) {
    return Verified{*std::move(essential), true};
  }
  return Verified{*std::move(fundamental), false};
}

std::optional<TwoView> VerifyPair(const PairMatches& matches, const PairData& pair,
                                  bool intrinsics_known, const TwoViewOptions& options,
                                  uint64_t seed) {
  if (pair.data.size() < options.min_inliers) return std::nullopt;
  const auto verified = EstimateEpipolar(pair, intrinsics_known, options, seed);
  if (!verified) return std::nullopt;
  const EpipolarModel& model = verified->model;
  const Data inliers = Subset(pair.data, model.inliers);
  const auto homography =
      ExplainingHomography(inliers, pair.max_error, options, DeriveSeed(seed, 2));
  const PoseModel pose = BestPose(pair, model, verified->calibrated, homography);
  if (!Enough(pose.inliers.size(), pair, options)) return std::nullopt;

  TwoView view;
  view.pair = matches.pair;
  view.kind = homography             ? TwoViewKind::kPlanar
              : verified->calibrated ? TwoViewKind::kCalibrated
                                     : TwoViewKind::kUncalibrated;
  view.second_from_first = pose.second_from_first;
  view.median_angle_rad = MedianAngle_rad(pair, pose);
  for (size_t i : pose.inliers) view.inliers.push_back(pair.matches[i]);
  std::optional<Eigen::Quaterniond> rotation = RotationAlone(homography, inliers, pair, options);
  if (!rotation && view.median_angle_rad < options.min_angle_rad) {
    rotation = pose.second_from_first.rotation;
  }
  if (rotation) {
    view.kind = TwoViewKind::kPanoramic;
    view.second_from_first = {*rotation, Eigen::Vector3d::Zero()};
    view.median_angle_rad = 0;
  }
  return view;
}

}  // namespace

Status TwoViewOptions::Validate() const {
  const auto bad = [](const char* field, double value, const char* expected) {
    return Error{ErrorCode::kInvalidArgument,
                 std::string(field) + " is " + std::to_string(value) + ", expected " + expected,
                 "two-view geometry"};
  };
  if (!(max_error_px > 0)) return bad("max_error_px", max_error_px, "more than 0");
  if (min_inliers < 8) {
    return bad("min_inliers", static_cast<double>(min_inliers), "at least 8");
  }
  if (!(min_inlier_ratio >= 0 && min_inlier_ratio <= 1)) {
    return bad("min_inlier_ratio", min_inlier_ratio, "0 to 1");
  }
  if (!(confidence > 0 && confidence < 1)) {
    return bad("confidence", confidence, "more than 0 and less than 1");
  }
  if (max_iterations < 1) return bad("max_iterations", max_iterations, "at least 1");
  if (!(max_homography_ratio > 0 && max_homography_ratio <= 1)) {
    return bad("max_homography_ratio", max_homography_ratio, "more than 0, at most 1");
  }
  if (!(min_angle_rad >= 0)) return bad("min_angle_rad", min_angle_rad, "at least 0");
  return {};
}

Result<TwoViews> BuildTwoViews(const Features& features, const Intrinsics& intrinsics,
                               const Matches& matches, const TwoViewOptions& options,
                               RunContext& context) {
  ROTUNDA_RETURN_IF_ERROR(options.Validate());
  const size_t count = matches.pairs.size();
  std::vector<std::optional<TwoView>> verified(count);
  std::atomic<size_t> done{0};
  context.threads.ParallelFor(
      count,
      [&](size_t i) {
        const PairMatches& pair = matches.pairs[i];
        const uint64_t seed =
            DeriveSeed(DeriveSeed(context.seed, pair.pair.first.index()), pair.pair.second.index());
        verified[i] = VerifyPair(pair, Normalize(features, intrinsics, pair, options),
                                 intrinsics.known, options, seed);
        context.Report("two-view geometry", ++done, count);
      },
      context.stop);
  if (context.Stopped()) return Error{ErrorCode::kCancelled, "stopped", "two-view geometry"};
  TwoViews views;
  for (std::optional<TwoView>& view : verified) {
    if (view) views.pairs.push_back(std::move(*view));
  }
  return views;
}

}  // namespace rotunda::sfm
