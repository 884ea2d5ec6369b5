#pragma once

#include <string>
#include <vector>

#include "sfm/reconstruction.h"

namespace rotunda::test {

/// Errors of the registered cameras after the least-squares Sim(3) of their centres to the truth.
struct PoseErrors {
  std::vector<ImageId> images;
  std::vector<double> rotation_rad;
  std::vector<double> position;  // the truth's unit
  double max_rotation_rad = 0;
  double max_position = 0;
  Sim3 truth_from_model;
};
PoseErrors ErrorsOf(const sfm::Reconstruction& reconstruction,
                    const std::vector<Rigid3>& cam_from_truth);

/// What is wrong with the reconstruction; empty when every camera is within the limits.
std::string NotNear(const sfm::Reconstruction& reconstruction,
                    const std::vector<Rigid3>& cam_from_truth, double max_rotation_rad,
                    double max_position);

/// Where two reconstructions, or two lists of them, are not the same to the last bit; empty when
/// they are.
std::string Difference(const sfm::Reconstruction& a, const sfm::Reconstruction& b);
std::string Difference(const std::vector<sfm::Reconstruction>& a,
                       const std::vector<sfm::Reconstruction>& b);

}  // namespace rotunda::test
