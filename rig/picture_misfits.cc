#include "rig/picture_misfits.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <utility>

namespace rotunda::rig {
namespace {

/// How many of a view's corners are beyond `limit` sigmas.
size_t WrongCorners(const RigModel& model, const BoardShape& shape, const FaceView& view,
                    double limit) {
  const auto residuals = Residuals_px(model, shape, view);
  size_t wrong = 0;
  for (size_t i = 0; i < residuals.size(); ++i) {
    wrong += residuals[i].norm() > limit * view.corners[i].sigma_px;
  }
  return wrong;
}

/// The pictures of one shot.
struct ShotFit {
  size_t pictures = 0;
  std::vector<size_t> wrong;  // cameras whose picture does not fit
};

/// Judges pictures by how many of their corners are beyond a limit (in sigmas).
class PictureFits {
 public:
  PictureFits(const RigModel& model, const BoardShape& shape, const std::vector<FaceView>& views,
              double limit)
      : model_(model), shape_(shape), views_(views), limit_(limit) {}

  /// By shot; a picture is wrong with more than `max_wrong` of its corners beyond the limit.
  std::map<size_t, ShotFit> ByShot(double max_wrong) const {
    std::map<std::pair<size_t, size_t>, Corners> pictures;  // by shot and camera
    for (const FaceView& view : views_) {
      if (model_.Has(view)) Add(model_, view, pictures[{view.shot, view.camera}]);
    }
    std::map<size_t, ShotFit> shots;
    for (const auto& [place, corners] : pictures) {
      ShotFit& shot = shots[place.first];
      ++shot.pictures;
      if (corners.Share() > max_wrong) shot.wrong.push_back(place.second);
    }
    return shots;
  }

  /// Whether camera `a`'s picture of the shot would fit as one of camera `b`.
  bool FitsAs(size_t shot, size_t a, size_t b) const {
    RigModel exchanged = model_;
    exchanged.cam_from_rig[a] = model_.cam_from_rig[b];
    exchanged.intrinsics[a] = model_.intrinsics[b];
    Corners corners;
    for (const FaceView& view : views_) {
      if (view.camera == a && view.shot == shot) Add(exchanged, view, corners);
    }
    return 2 * corners.wrong < corners.all;
  }

 private:
  struct Corners {
    size_t all = 0, wrong = 0;
    double Share() const { return static_cast<double>(wrong) / static_cast<double>(all); }
  };
  void Add(const RigModel& model, const FaceView& view, Corners& corners) const {
    corners.all += view.corners.size();
    corners.wrong += WrongCorners(model, shape_, view, limit_);
  }

  const RigModel& model_;
  const BoardShape& shape_;
  const std::vector<FaceView>& views_;
  double limit_;
};

/// Of a picture that does not fit; `wrong`: all cameras whose pictures of the shot do not.
std::string WhyMisfit(const BoardSightings& sightings, const PictureFits& fits,
                      const DroppedPicture& picture, const std::vector<size_t>& wrong) {
  std::string reason =
      "does not fit the other cameras' pictures of this shot: it was taken at another moment, or "
      "is not this camera's";
  for (const size_t other : wrong) {
    if (other != *picture.camera && fits.FitsAs(picture.shot, *picture.camera, other)) {
      reason = "is the picture of " + sightings.cameras[other].camera +
               ": the two cameras are swapped in this shot";
    }
  }
  return reason;
}

bool SameCorners(const FaceView& a, const FaceView& b) {
  return std::equal(a.corners.begin(), a.corners.end(), b.corners.begin(), b.corners.end(),
                    [](const SeenCorner& one, const SeenCorner& other) {
                      return one.corner == other.corner && one.pixel == other.pixel;
                    });
}

/// Of two shots: who has a picture with corners in both, and in whose pictures they are the same.
struct ShotPair {
  std::set<size_t> both, same;  // cameras
};

/// By earlier and later shot; pairs without a camera in common are left out.
std::map<std::pair<size_t, size_t>, ShotPair> PairShots(const std::vector<FaceView>& views) {
  std::map<std::pair<size_t, size_t>, ShotPair> pairs;
  std::map<size_t, std::vector<const FaceView*>> by_camera;
  for (const FaceView& view : views) by_camera[view.camera].push_back(&view);
  for (const auto& [camera, own] : by_camera) {
    for (const FaceView* a : own) {
      for (const FaceView* b : own) {
        if (a->shot >= b->shot) continue;
        ShotPair& pair = pairs[{a->shot, b->shot}];
        pair.both.insert(camera);
        if (a->face == b->face && SameCorners(*a, *b)) pair.same.insert(camera);
      }
    }
  }
  return pairs;
}

Error GivenTwice(const BoardSightings& sightings, size_t first, size_t second,
                 const ShotPair& pair) {
  const BoardShot &a = sightings.shots[first], &b = sightings.shots[second];
  return {ErrorCode::kBadInput,
          "has the same pictures as shot '" + a.id + "' (" + a.folder.string() + "), of " +
              std::to_string(pair.same.size()) + " of " + std::to_string(pair.both.size()) +
              " cameras (the first: " + sightings.cameras[*pair.same.begin()].camera +
              "): give every shot once, it would count as two",
          "shot '" + b.id + "' (" + b.folder.string() + ")"};
}

}  // namespace

double ThresholdSigmas(size_t count, double lost) {
  return std::sqrt(2.0 * std::log(std::max(3.0, static_cast<double>(count) / lost)));
}

bool IsLeftOut(const std::vector<DroppedPicture>& dropped, const FaceView& view) {
  return std::any_of(dropped.begin(), dropped.end(), [&](const DroppedPicture& d) {
    return d.shot == view.shot && (!d.camera || *d.camera == view.camera);
  });
}

std::vector<FaceView> Without(const std::vector<FaceView>& views,
                              const std::vector<DroppedPicture>& dropped) {
  std::vector<FaceView> rest;
  for (const FaceView& view : views) {
    if (!IsLeftOut(dropped, view)) rest.push_back(view);
  }
  return rest;
}

std::vector<DroppedPicture> FindMisfits(const BoardSightings& sightings,
                                        const std::vector<FaceView>& views, const BoardShape& shape,
                                        const RigCalibration& result,
                                        const RigCalibrationOptions& options) {
  const double limit = NoiseScale(result.model, shape, views) *
                       ThresholdSigmas(CornerCount(views), options.lost_corners);
  const PictureFits fits(result.model, shape, views, limit);
  std::vector<DroppedPicture> dropped;
  for (const auto& [shot, fit] : fits.ByShot(options.max_wrong_corners)) {
    const auto share = static_cast<double>(fit.wrong.size()) / static_cast<double>(fit.pictures);
    if (fit.wrong.size() >= 2 && share > options.max_wrong_pictures) {
      dropped.push_back(
          {shot, std::nullopt,
           std::to_string(fit.wrong.size()) + " of " + std::to_string(fit.pictures) +
               " pictures do not fit together: the board moved while the shot was "
               "taken, or pictures of different moments or rigs are mixed; take it again"});
      continue;
    }
    for (const size_t camera : fit.wrong) {
      DroppedPicture& picture = dropped.emplace_back(DroppedPicture{shot, camera, ""});
      picture.reason = WhyMisfit(sightings, fits, picture, fit.wrong);
    }
  }
  return dropped;
}

Result<std::vector<DroppedPicture>> FindRepeats(const BoardSightings& sightings,
                                                const std::vector<FaceView>& views) {
  std::map<std::pair<size_t, size_t>, size_t> first;  // by later shot and camera
  for (const auto& [shots, pair] : PairShots(views)) {
    if (2 * pair.same.size() > pair.both.size()) {
      return GivenTwice(sightings, shots.first, shots.second, pair);
    }
    for (const size_t camera : pair.same)
      first.emplace(std::pair(shots.second, camera), shots.first);
  }
  std::vector<DroppedPicture> repeats;
  for (const auto& [place, earlier] : first) {
    repeats.push_back({place.first, place.second,
                       "is the same picture as its one in " + sightings.shots[earlier].id +
                           ", to the last bit: the camera sent an old frame again, or the file was "
                           "copied"});
  }
  return repeats;
}

}  // namespace rotunda::rig
