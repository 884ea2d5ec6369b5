#include "tests/support/strecha.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cstdlib>
#include <fstream>
#include <iostream>

namespace rotunda::test {

std::optional<std::filesystem::path> SharedFolder() {
  const char* named = std::getenv("ROTUNDA_SHARED");
  const std::filesystem::path folder =
      named != nullptr ? std::filesystem::path(named)
                       : std::filesystem::path(ROTUNDA_SOURCE_DIR).parent_path() / "shared";
  if (!std::filesystem::is_directory(folder / "data")) return std::nullopt;
  return folder;
}

Calibration ReadStrechaTruth(const std::filesystem::path& set) {
  Calibration truth;
  truth.id = set.filename().string() + "-truth";
  truth.created_at = "2008-01-01T00:00:00Z";
  truth.source = CalibrationSource::kTruth;
  for (const auto& entry : std::filesystem::directory_iterator(set / "gt_dense_cameras")) {
    if (entry.path().extension() != ".camera") continue;
    std::array<double, 26> v{};
    std::ifstream file(entry.path());
    for (double& value : v) file >> value;
    if (!file) {
      std::cerr << "malformed: " << entry.path() << "\n";
      std::abort();
    }
    Eigen::Matrix3d rig_from_cam;
    rig_from_cam << v[12], v[13], v[14], v[15], v[16], v[17], v[18], v[19], v[20];
    const Eigen::Vector3d center_m(v[21], v[22], v[23]);
    CalibratedCamera& camera = truth.cameras.emplace_back();
    camera.camera = entry.path().stem().stem().string();  // 0000.jpg.camera
    camera.intrinsics = {CameraModel::kPinhole,
                         static_cast<int>(v[24]),
                         static_cast<int>(v[25]),
                         {v[0], v[4], v[2], v[5]}};
    camera.cam_from_rig.rotation = Eigen::Quaterniond(Eigen::Matrix3d(rig_from_cam.transpose()));
    camera.cam_from_rig.rotation.normalize();
    camera.cam_from_rig.translation = -(camera.cam_from_rig.rotation * center_m);
  }
  std::sort(truth.cameras.begin(), truth.cameras.end(),
            [](const auto& a, const auto& b) { return a.camera < b.camera; });
  return truth;
}

}  // namespace rotunda::test
