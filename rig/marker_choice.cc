#include "rig/marker_choice.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <optional>
#include <utility>

#include "rig/plane_fit.h"

namespace rotunda::rig {
namespace {

/// Half of a marker's neighbours must agree with it: fewer, and it is the one that is wrong.
constexpr double kLeastAgreement = 0.5;
/// Of two groups of markers that claim the same ids, the larger is the board when it is this many
/// times the smaller; else nobody can tell.
constexpr size_t kClearlyLarger = 2;

/// Corners of a marker on its face, in squares.
std::vector<PlanePoint> PointsOf(const BoardFace& face, const FoundMarker& marker) {
  std::vector<PlanePoint> points;
  const std::vector<Eigen::Vector3d> corners = face.MarkerInFace(marker.id);
  for (size_t k = 0; k < 4; ++k) {
    points.push_back({corners[k].head<2>() / face.square_m, marker.corners_px[k]});
  }
  return points;
}

/// Greatest distance of the two markers' corners from the one homography that fits both best, as a
/// share of the smaller marker's side.
double Misplacement(const BoardFace& face, const FoundMarker& a, const FoundMarker& b) {
  std::vector<PlanePoint> points = PointsOf(face, a);
  const std::vector<PlanePoint> more = PointsOf(face, b);
  points.insert(points.end(), more.begin(), more.end());
  const std::optional<PlaneFit> plane = PlaneFit::Fit(points);
  if (!plane) return INFINITY;
  double worst = 0;
  for (const PlanePoint& point : points) {
    worst = std::max(worst, (plane->Pixel(point.on_face) - point.pixel).norm());
  }
  return worst / std::min(a.Side_px(), b.Side_px());
}

/// The markers of one face and who agrees with whom.
class FaceMarkers {
 public:
  FaceMarkers(const BoardFace& face, const std::vector<FoundMarker>& markers,
              const BoardDetectionOptions& options)
      : markers_(markers),
        reasons_(markers.size()),
        kinds_(markers.size()),
        agrees_(markers.size()) {
    for (size_t i = 0; i < markers.size(); ++i) {
      for (size_t j = 0; j < i; ++j) {
        const Eigen::Vector2i apart =
            face.SquareOfMarker(markers[i].id) - face.SquareOfMarker(markers[j].id);
        const int squares = apart.cwiseAbs().maxCoeff();
        if (squares == 0 || squares > options.neighbourhood_squares) continue;
        const bool agree = Misplacement(face, markers[i], markers[j]) <= options.max_misplaced;
        agrees_[i].emplace_back(j, agree);
        agrees_[j].emplace_back(i, agree);
      }
    }
    RejectTheOutvoted();
    RejectDoubles();
  }

  const std::string& reason(size_t i) const { return reasons_[i]; }  // empty: accepted
  Rejection kind(size_t i) const { return kinds_[i]; }               // of a rejected one

 private:
  struct Votes {
    int all = 0, agreeing = 0;
    double Share() const { return all > 0 ? static_cast<double>(agreeing) / all : 0; }
  };
  Votes VotesOn(size_t i) const {
    Votes votes;
    for (const auto& [j, agree] : agrees_[i]) {
      if (!reasons_[j].empty()) continue;
      ++votes.all;
      votes.agreeing += agree ? 1 : 0;
    }
    return votes;
  }

  /// The one that fewest agree with goes first, since it outvotes good ones.
  void RejectTheOutvoted() {
    while (true) {
      std::optional<size_t> worst;
      Votes worst_votes;
      for (size_t i = 0; i < markers_.size(); ++i) {
        if (!reasons_[i].empty()) continue;
        const Votes votes = VotesOn(i);
        if (votes.Share() >= kLeastAgreement) continue;
        if (!worst || votes.Share() < worst_votes.Share()) {
          worst = i;
          worst_votes = votes;
        }
      }
      if (!worst) return;
      kinds_[*worst] = worst_votes.all == 0 ? Rejection::kAlone : Rejection::kMisplaced;
      reasons_[*worst] = worst_votes.all == 0
                             ? "no other marker of its face is near to confirm it"
                             : "it is not where its neighbours on the board put it (" +
                                   std::to_string(worst_votes.all - worst_votes.agreeing) + " of " +
                                   std::to_string(worst_votes.all) + " disagree)";
    }
  }

  std::vector<size_t> GroupOf(size_t first, std::vector<bool>* taken) const {
    std::vector<size_t> group = {first};
    (*taken)[first] = true;
    for (size_t k = 0; k < group.size(); ++k) {
      for (const auto& [j, agree] : agrees_[group[k]]) {
        if (!agree || (*taken)[j] || !reasons_[j].empty()) continue;
        (*taken)[j] = true;
        group.push_back(j);
      }
    }
    return group;
  }

  /// Groups of markers that agree, the largest first; a group that claims an id of a larger one is
  /// a second copy.
  void RejectDoubles() {
    std::vector<bool> taken(markers_.size());
    std::vector<std::vector<size_t>> groups;
    for (size_t i = 0; i < markers_.size(); ++i) {
      if (reasons_[i].empty() && !taken[i]) groups.push_back(GroupOf(i, &taken));
    }
    std::stable_sort(groups.begin(), groups.end(),
                     [](const auto& a, const auto& b) { return a.size() > b.size(); });
    std::map<int, size_t> owner;  // of an id: the group that has it
    for (size_t g = 0; g < groups.size(); ++g) {
      std::optional<size_t> rival;
      for (size_t i : groups[g]) {
        const auto [place, is_new] = owner.emplace(markers_[i].id, g);
        if (!is_new && !rival) rival = place->second;
      }
      if (!rival) continue;
      Reject(groups[g], "its id is seen twice, and the other one has more of the board around it");
      if (groups[*rival].size() < kClearlyLarger * groups[g].size()) {
        Reject(groups[*rival],
               "its id is seen twice and both look right: is a second copy of the board, or a "
               "mirror, in view?");
      }
    }
  }

  void Reject(const std::vector<size_t>& group, const std::string& reason) {
    for (size_t i : group) {
      kinds_[i] = Rejection::kSeenTwice;
      reasons_[i] = reason;
    }
  }

  const std::vector<FoundMarker>& markers_;
  std::vector<std::string> reasons_;
  std::vector<Rejection> kinds_;
  std::vector<std::vector<std::pair<size_t, bool>>> agrees_;
};

}  // namespace

MarkerChoice ChooseMarkers(std::vector<FoundMarker> found, const Board& board,
                           const BoardDetectionOptions& options) {
  MarkerChoice choice;
  const auto reject = [&](const FoundMarker& marker, Rejection kind, const std::string& reason) {
    choice.rejected.push_back({marker.dictionary, marker.id, marker.Centre_px(), kind, reason});
  };
  std::vector<std::vector<FoundMarker>> of_face(board.faces.size());
  for (const FoundMarker& marker : found) {
    const auto face =
        std::find_if(board.faces.begin(), board.faces.end(), [&](const BoardFace& candidate) {
          return candidate.dictionary == marker.dictionary && candidate.HasMarker(marker.id);
        });
    if (face == board.faces.end()) {
      reject(marker, Rejection::kOnNoFace,
             "id " + std::to_string(marker.id) + " is on no face of the board");
    } else {
      of_face[static_cast<size_t>(face - board.faces.begin())].push_back(marker);
    }
  }
  for (size_t f = 0; f < board.faces.size(); ++f) {
    const FaceMarkers face(board.faces[f], of_face[f], options);
    for (size_t i = 0; i < of_face[f].size(); ++i) {
      if (face.reason(i).empty()) {
        choice.accepted.push_back({static_cast<int>(f), of_face[f][i]});
      } else {
        reject(of_face[f][i], face.kind(i),
               "on face '" + board.faces[f].name + "': " + face.reason(i));
      }
    }
  }
  return choice;
}

}  // namespace rotunda::rig
