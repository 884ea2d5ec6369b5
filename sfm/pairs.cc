#include "sfm/pairs.h"

#include <cmath>

#include "sfm/core/rigid3.h"

namespace rotunda::sfm {
namespace {

constexpr double kSubjectRadius_m = 0.35;
constexpr double kSubjectHeight_m = 1.9;
constexpr int kSubjectAzimuths = 24;
constexpr int kSubjectRings = 20;
constexpr double kMaxViewAngle_rad = RadFromDeg(60.0);
constexpr double kMinSharedView = 0.2;

struct SurfacePoint {
  Eigen::Vector3d position_m;
  Eigen::Vector3d normal;
};

std::vector<SurfacePoint> SubjectSurface() {
  std::vector<SurfacePoint> points;
  for (int ring = 0; ring < kSubjectRings; ++ring) {
    const double z_m = kSubjectHeight_m * (ring + 0.5) / kSubjectRings;
    for (int step = 0; step < kSubjectAzimuths; ++step) {
      const double azimuth_rad = 2.0 * kPi * step / kSubjectAzimuths;
      const Eigen::Vector3d normal(std::cos(azimuth_rad), std::sin(azimuth_rad), 0.0);
      points.push_back({kSubjectRadius_m * normal + Eigen::Vector3d(0, 0, z_m), normal});
    }
  }
  return points;
}

/// Unit directions from each surface point to the camera; zero where the camera does not see the
/// point.
std::vector<Eigen::Vector3d> SightLines(const CalibratedCamera& camera,
                                        const std::vector<SurfacePoint>& surface) {
  const Eigen::Vector3d center_m = camera.cam_from_rig.OriginInSource();
  std::vector<Eigen::Vector3d> lines(surface.size(), Eigen::Vector3d::Zero());
  for (size_t i = 0; i < surface.size(); ++i) {
    const Eigen::Vector3d line = (center_m - surface[i].position_m).normalized();
    const auto pixel = camera.intrinsics.Project(camera.cam_from_rig * surface[i].position_m);
    if (pixel && camera.intrinsics.Contains(*pixel) && line.dot(surface[i].normal) > 0) {
      lines[i] = line;
    }
  }
  return lines;
}

bool SeeTheSame(const std::vector<Eigen::Vector3d>& first,
                const std::vector<Eigen::Vector3d>& second) {
  const double min_cosine = std::cos(kMaxViewAngle_rad);
  size_t seen_first = 0, seen_second = 0, shared = 0;
  for (size_t i = 0; i < first.size(); ++i) {
    const bool by_first = !first[i].isZero();
    const bool by_second = !second[i].isZero();
    seen_first += by_first;
    seen_second += by_second;
    shared += by_first && by_second && first[i].dot(second[i]) > min_cosine;
  }
  const size_t fewer = std::min(seen_first, seen_second);
  return fewer > 0 && static_cast<double>(shared) >= kMinSharedView * static_cast<double>(fewer);
}

}  // namespace

std::vector<ImagePair> ExhaustivePairs(size_t images) {
  std::vector<ImagePair> pairs;
  for (size_t first = 0; first < images; ++first) {
    for (size_t second = first + 1; second < images; ++second) {
      pairs.push_back({ImageId(first), ImageId(second)});
    }
  }
  return pairs;
}

Result<std::vector<ImagePair>> NeighbourPairs(const FrameSet& set, const Calibration& calibration) {
  const std::vector<SurfacePoint> surface = SubjectSurface();
  std::vector<std::vector<Eigen::Vector3d>> lines;
  for (const Frame& frame : set.frames) {
    const CalibratedCamera* camera = calibration.Find(frame.camera);
    if (camera == nullptr) {
      return Error{ErrorCode::kBadInput, "the calibration has no camera '" + frame.camera + "'",
                   set.folder.string()};
    }
    lines.push_back(SightLines(*camera, surface));
  }
  std::vector<ImagePair> pairs;
  for (const ImagePair& pair : ExhaustivePairs(set.frames.size())) {
    if (SeeTheSame(lines[pair.first.index()], lines[pair.second.index()])) pairs.push_back(pair);
  }
  return pairs;
}

}  // namespace rotunda::sfm
