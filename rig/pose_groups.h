#pragma once

#include <cstddef>
#include <vector>

#include "sfm/core/rigid3.h"

namespace rotunda::rig {

/// What one sighting says of the pose of b in a.
struct PoseVote {
  Rigid3 a_from_b;
  double weight = 0;
  double size_m = 1;  // distance over which positions were measured
  size_t source = 0;  // votes of one source count once
};

struct PoseAgreement {
  double rotation_rad = 0;
  double share = 0;  // of size_m
};

/// The pose that the largest weight of sources agrees on: the mean of the votes around the one with
/// the most support.
struct PoseConsensus {
  Rigid3 a_from_b;
  double weight = 0;   // that agrees
  size_t sources = 0;  // that agree
};
PoseConsensus FindConsensus(const std::vector<PoseVote>& votes, const PoseAgreement& agreement);

/// Things in groups whose members' relative poses are known; every thing starts alone.
class PoseGroups {
 public:
  explicit PoseGroups(size_t count);
  size_t size() const { return group_.size(); }
  size_t group(size_t thing) const { return group_[thing]; }
  /// Pose of a thing in its group's frame.
  const Rigid3& group_from(size_t thing) const { return group_from_[thing]; }
  /// Takes group `b` into `a`.
  void Merge(size_t a, size_t b, const Rigid3& a_from_b);

 private:
  std::vector<size_t> group_;
  std::vector<Rigid3> group_from_;
};

/// A link between two groups.
struct GroupLink {
  size_t a = 0, b = 0;  // groups
  PoseConsensus consensus;
};

/// Joins groups along a maximum spanning forest of the links; false when there was none.
bool JoinGroups(std::vector<GroupLink> links, PoseGroups& groups);

}  // namespace rotunda::rig
