#include "rig/pose_groups.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <numeric>
#include <set>

namespace rotunda::rig {
namespace {

bool Agree(const PoseVote& a, const PoseVote& b, const PoseAgreement& agreement) {
  return (a.a_from_b.translation - b.a_from_b.translation).norm() <
             agreement.share * 0.5 * (a.size_m + b.size_m) &&
         RotationAngle_rad(a.a_from_b.rotation, b.a_from_b.rotation) < agreement.rotation_rad;
}

/// Weighted mean, rotations taken to the centre's half of the quaternions.
Rigid3 MeanPose(const std::vector<const PoseVote*>& votes, const Rigid3& centre) {
  Eigen::Vector4d rotation = Eigen::Vector4d::Zero();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();
  double sum = 0;
  for (const PoseVote* vote : votes) {
    const Eigen::Vector4d q = vote->a_from_b.rotation.coeffs();
    rotation += vote->weight * (q.dot(centre.rotation.coeffs()) < 0 ? Eigen::Vector4d(-q) : q);
    translation += vote->weight * vote->a_from_b.translation;
    sum += vote->weight;
  }
  return {Eigen::Quaterniond(Eigen::Vector4d(rotation)).normalized(), translation / sum};
}

}  // namespace

PoseConsensus FindConsensus(const std::vector<PoseVote>& votes, const PoseAgreement& agreement) {
  PoseConsensus best;
  best.weight = -1;
  for (const PoseVote& centre : votes) {
    std::vector<const PoseVote*> supporters;
    std::set<size_t> sources;
    double weight = 0;
    for (const PoseVote& vote : votes) {
      if (!Agree(centre, vote, agreement)) continue;
      supporters.push_back(&vote);
      if (sources.insert(vote.source).second) weight += vote.weight;
    }
    if (weight > best.weight) {
      best = {MeanPose(supporters, centre.a_from_b), weight, sources.size()};
    }
  }
  return best;
}

PoseGroups::PoseGroups(size_t count) : group_(count), group_from_(count) {
  std::iota(group_.begin(), group_.end(), size_t{0});
}

void PoseGroups::Merge(size_t a, size_t b, const Rigid3& a_from_b) {
  for (size_t thing = 0; thing < group_.size(); ++thing) {
    if (group_[thing] != b) continue;
    group_[thing] = a;
    group_from_[thing] = a_from_b * group_from_[thing];
  }
}

bool JoinGroups(std::vector<GroupLink> links, PoseGroups& groups) {
  std::stable_sort(links.begin(), links.end(), [](const GroupLink& x, const GroupLink& y) {
    return x.consensus.weight > y.consensus.weight;
  });
  // A group's number is that of one of its things, which keeps identity as its pose there until it
  // is merged: so a link's ends can be found again afterwards.
  for (const GroupLink& link : links) {
    const size_t a = groups.group(link.a), b = groups.group(link.b);
    if (a == b) continue;
    groups.Merge(
        a, b,
        groups.group_from(link.a) * link.consensus.a_from_b * groups.group_from(link.b).Inverse());
  }
  return !links.empty();
}

}  // namespace rotunda::rig
