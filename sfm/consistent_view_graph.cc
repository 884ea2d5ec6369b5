#include "sfm/consistent_view_graph.h"

#include <Eigen/Geometry>
#include <Eigen/Sparse>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <span>
#include <string>

#include "sfm/disjoint_sets.h"

namespace rotunda::sfm {
namespace {

using Rotations = std::vector<std::optional<Eigen::Quaterniond>>;

constexpr int kAveragingRounds = 20;
constexpr double kSettled_rad = 1e-6;
/// Residuals below this weigh no more than this one: the weight would have no bound.
constexpr double kLeastResidual_rad = RadFromDeg(0.05);

bool HasRotationOfItsOwn(const TwoView& view) { return view.kind != TwoViewKind::kPanoramic; }

/// The edges that may vote, in the order of `graph`.
ViewGraph VotingEdges(const ViewGraph& graph, const TwoViews& two_views) {
  ViewGraph voting{graph.images, {}};
  for (const ViewGraphEdge& edge : graph.edges) {
    if (HasRotationOfItsOwn(two_views.pairs[edge.two_view])) voting.edges.push_back(edge);
  }
  return voting;
}

/// Connected images; their rotations are in one frame, the piece's own.
struct Piece {
  std::vector<size_t> images;
};

/// An edge between two pieces: what it says of their frames.
struct Vote {
  Eigen::Quaterniond second_from_first;  // frames of the pieces
  double weight = 0;
};

/// The rotation that the votes agree on: that of the vote with most weight near it, averaged over
/// those near it.
Eigen::Quaterniond Consensus(const std::vector<Vote>& votes, double near_rad) {
  size_t best = 0;
  double best_weight = -1;
  for (size_t a = 0; a < votes.size(); ++a) {
    double weight = 0;
    for (const Vote& other : votes) {
      if (RotationAngle_rad(votes[a].second_from_first, other.second_from_first) <= near_rad) {
        weight += other.weight;
      }
    }
    if (weight > best_weight) best_weight = weight, best = a;
  }
  const Eigen::Quaterniond& center = votes[best].second_from_first;
  Eigen::Vector4d sum = Eigen::Vector4d::Zero();
  for (const Vote& vote : votes) {
    if (RotationAngle_rad(center, vote.second_from_first) > near_rad) continue;
    const double sign = center.dot(vote.second_from_first) < 0 ? -1.0 : 1.0;
    sum += sign * vote.weight * vote.second_from_first.coeffs();
  }
  return Eigen::Quaterniond(Eigen::Vector4d(sum.normalized()));
}

/// Kruskal's order, but what joins two pieces is the consensus of all edges between them, in which
/// a weight counts to the power kVotePower: a single heavy edge that is wrong is outvoted by
/// several nearly as heavy, many light ones are not heard.
class RotationForest {
 public:
  /// `options` is borrowed like the rest.
  RotationForest(const ViewGraph& graph, const TwoViews& two_views,
                 const ConsistencyOptions& options)
      : graph_(graph),
        two_views_(two_views),
        options_(options),
        rotations_(graph.images),
        piece_of_(graph.images, SIZE_MAX) {}

  Rotations Grow() {
    for (const ViewGraphEdge& edge : graph_.edges) {
      Begin(edge.pair.first.index());
      Begin(edge.pair.second.index());
    }
    for (const size_t e : EdgesByWeight(graph_)) {
      const size_t a = piece_of_[graph_.edges[e].pair.first.index()];
      const size_t b = piece_of_[graph_.edges[e].pair.second.index()];
      if (a == b) continue;
      const std::span<const ViewGraphEdge> all = graph_.edges;
      const std::span<const ViewGraphEdge> voting =
          options_.piece_consensus ? all : all.subspan(e, 1);
      Join(std::min(a, b), std::max(a, b), voting);
    }
    return std::move(rotations_);
  }

 private:
  static constexpr double kVotePower = 4;

  void Begin(size_t image) {
    if (rotations_[image]) return;
    rotations_[image] = Eigen::Quaterniond::Identity();
    piece_of_[image] = pieces_.size();
    pieces_.push_back({{image}});
  }

  /// Frame of b from frame of a, by every one of the edges that is between them.
  std::vector<Vote> Votes(size_t a, size_t b, std::span<const ViewGraphEdge> edges) const {
    std::vector<Vote> votes;
    for (const ViewGraphEdge& edge : edges) {
      const size_t i = edge.pair.first.index(), j = edge.pair.second.index();
      const Eigen::Quaterniond& relative =
          two_views_.pairs[edge.two_view].second_from_first.rotation;
      const double weight = std::pow(edge.weight, kVotePower);
      if (piece_of_[i] == a && piece_of_[j] == b) {
        votes.push_back({rotations_[j]->conjugate() * relative * *rotations_[i], weight});
      } else if (piece_of_[i] == b && piece_of_[j] == a) {
        votes.push_back(
            {rotations_[i]->conjugate() * relative.conjugate() * *rotations_[j], weight});
      }
    }
    return votes;
  }

  void Join(size_t a, size_t b, std::span<const ViewGraphEdge> voting) {
    const Eigen::Quaterniond b_from_a = Consensus(Votes(a, b, voting), options_.off_rad);
    for (const size_t image : pieces_[b].images) {
      rotations_[image] = (*rotations_[image] * b_from_a).normalized();
      piece_of_[image] = a;
      pieces_[a].images.push_back(image);
    }
    pieces_[b].images.clear();
  }

  const ViewGraph& graph_;
  const TwoViews& two_views_;
  const ConsistencyOptions& options_;
  Rotations rotations_;
  std::vector<size_t> piece_of_;  // by image
  std::vector<Piece> pieces_;
};

/// Rotation vector, in the second camera, from where the rotations put it to where the edge does;
/// nullopt between components.
std::optional<Eigen::Vector3d> Residual(const ViewGraphEdge& edge, const TwoViews& two_views,
                                        const Rotations& rotations) {
  const auto& first = rotations[edge.pair.first.index()];
  const auto& second = rotations[edge.pair.second.index()];
  if (!first || !second) return std::nullopt;
  const Eigen::AngleAxisd turn(two_views.pairs[edge.two_view].second_from_first.rotation * *first *
                               second->conjugate());
  return turn.angle() * turn.axis();
}

std::vector<double> Residuals_rad(const ViewGraph& graph, const TwoViews& two_views,
                                  const Rotations& rotations) {
  std::vector<double> residuals;
  for (const ViewGraphEdge& edge : graph.edges) {
    const auto residual = Residual(edge, two_views, rotations);
    residuals.push_back(residual ? residual->norm() : std::numeric_limits<double>::infinity());
  }
  return residuals;
}

/// One step of weighted least squares on the tangent vectors: R_i <- exp(d_i) R_i, where
/// d_j - R_ij d_i = residual of edge ij and |residual|^-3/2 is the weight of the L1/2 norm. Returns
/// the largest |d|.
double AverageOnce(const ViewGraph& graph, const TwoViews& two_views, Rotations& rotations) {
  const auto size = static_cast<Eigen::Index>(3 * graph.images);
  std::vector<Eigen::Triplet<double>> entries;
  Eigen::VectorXd right = Eigen::VectorXd::Zero(size);
  const auto add = [&](size_t row, size_t column, const Eigen::Matrix3d& block) {
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 3; ++c) {
        entries.emplace_back(3 * static_cast<int>(row) + r, 3 * static_cast<int>(column) + c,
                             block(r, c));
      }
    }
  };
  for (const ViewGraphEdge& edge : graph.edges) {
    const Eigen::Vector3d residual = *Residual(edge, two_views, rotations);
    const double weight =
        edge.weight * std::pow(std::max(residual.norm(), kLeastResidual_rad), -1.5);
    const Eigen::Matrix3d relative =
        two_views.pairs[edge.two_view].second_from_first.rotation.toRotationMatrix();
    const size_t i = edge.pair.first.index(), j = edge.pair.second.index();
    add(i, i, weight * Eigen::Matrix3d::Identity());
    add(j, j, weight * Eigen::Matrix3d::Identity());
    add(j, i, -weight * relative);
    add(i, j, -weight * relative.transpose());
    right.segment<3>(static_cast<Eigen::Index>(3 * j)) += weight * residual;
    right.segment<3>(static_cast<Eigen::Index>(3 * i)) -= weight * relative.transpose() * residual;
  }
  // The frame of each component is free: a little damping fixes it.
  constexpr double kDamping = 1e-9;
  for (int k = 0; k < size; ++k) entries.emplace_back(k, k, kDamping);
  Eigen::SparseMatrix<double> normal(size, size);
  normal.setFromTriplets(entries.begin(), entries.end());
  const Eigen::VectorXd step =
      Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>>(normal).solve(right);
  double largest = 0;
  for (size_t i = 0; i < graph.images; ++i) {
    if (!rotations[i]) continue;
    const Eigen::Vector3d d = step.segment<3>(static_cast<Eigen::Index>(3 * i));
    const double angle = d.norm();
    if (angle > 0) {
      rotations[i] = (Eigen::AngleAxisd(angle, d / angle) * *rotations[i]).normalized();
    }
    largest = std::max(largest, angle);
  }
  return largest;
}

/// Robust average over the edges within `limit_rad` of `rotations`.
Rotations Average(const ViewGraph& graph, const TwoViews& two_views, Rotations rotations,
                  double limit_rad) {
  const std::vector<double> residuals = Residuals_rad(graph, two_views, rotations);
  ViewGraph near{graph.images, {}};
  for (size_t e = 0; e < graph.edges.size(); ++e) {
    if (residuals[e] <= limit_rad) near.edges.push_back(graph.edges[e]);
  }
  for (int round = 0; round < kAveragingRounds; ++round) {
    if (AverageOnce(near, two_views, rotations) < kSettled_rad) break;
  }
  return rotations;
}

std::vector<EdgeVerdict> Judge(const std::vector<double>& residuals_rad, double agree_rad) {
  std::vector<EdgeVerdict> verdicts;
  for (const double residual_rad : residuals_rad) {
    verdicts.push_back(residual_rad <= agree_rad ? EdgeVerdict::kAgrees : EdgeVerdict::kRejected);
  }
  return verdicts;
}

std::optional<double> LightestJoining(const ViewGraph& graph,
                                      const std::vector<double>& residuals_rad, double agree_rad) {
  std::optional<double> lightest;
  DisjointSets sets(graph.images);
  for (const size_t e : EdgesByWeight(graph)) {
    const auto [first, second] = graph.edges[e].pair;
    if (residuals_rad[e] > agree_rad) continue;
    if (sets.Unite(first.index(), second.index())) lightest = graph.edges[e].weight;
  }
  return lightest;
}

std::optional<double> HeaviestOff(const ViewGraph& graph, const std::vector<double>& residuals_rad,
                                  double far_rad) {
  std::optional<double> heaviest;
  for (size_t e = 0; e < graph.edges.size(); ++e) {
    if (!(residuals_rad[e] > far_rad)) continue;
    heaviest = std::max(heaviest.value_or(0.0), graph.edges[e].weight);
  }
  return heaviest;
}

}  // namespace

std::optional<double> ConsistentViewGraph::Margin() const {
  if (!lightest_joining || !heaviest_off) return std::nullopt;
  return *lightest_joining / *heaviest_off;
}

Status ConsistencyOptions::Validate() const {
  const auto bad = [](const char* field, double value, const char* expected) {
    return Error{ErrorCode::kInvalidArgument,
                 std::to_string(value) + " is out of range, expected " + expected, field};
  };
  if (!(agree_rad > 0)) return bad("agree_rad", agree_rad, "> 0");
  if (!(off_rad >= agree_rad)) return bad("off_rad", off_rad, ">= agree_rad");
  if (!(far_rad >= off_rad)) return bad("far_rad", far_rad, ">= off_rad");
  return {};
}

Result<ConsistentViewGraph> BuildConsistentViewGraph(const ViewGraph& graph,
                                                     const TwoViews& two_views,
                                                     const ConsistencyOptions& options) {
  ROTUNDA_RETURN_IF_ERROR(options.Validate());
  const ViewGraph voting = VotingEdges(graph, two_views);
  Rotations rotations = RotationForest(voting, two_views, options).Grow();
  rotations = Average(voting, two_views, std::move(rotations), options.far_rad);
  rotations = Average(voting, two_views, std::move(rotations), options.off_rad);
  ConsistentViewGraph consistent{
      Judge(Residuals_rad(graph, two_views, rotations), options.agree_rad)};
  const std::vector<double> residuals_rad = Residuals_rad(voting, two_views, rotations);
  consistent.lightest_joining = LightestJoining(voting, residuals_rad, options.agree_rad);
  consistent.heaviest_off = HeaviestOff(voting, residuals_rad, options.far_rad);
  return consistent;
}

ViewGraph EdgesThatAgree(const ViewGraph& graph, const ConsistentViewGraph& consistent) {
  ViewGraph agreeing{graph.images, {}};
  for (size_t e = 0; e < graph.edges.size(); ++e) {
    if (consistent.verdicts[e] == EdgeVerdict::kAgrees) agreeing.edges.push_back(graph.edges[e]);
  }
  return agreeing;
}

}  // namespace rotunda::sfm
