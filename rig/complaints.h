#pragma once

#include <string>
#include <vector>

namespace rotunda::rig {

/// A camera that is not as it should be.
struct Complaint {
  std::string camera;
  std::string what;       // "late"
  std::string reason;     // in words; may be empty
  bool measured = false;  // the figures in the reason were measured of this camera
};

/// One text for all complaints that are the same but for measured figures, of which their range is
/// told: "c03r1 late (came 904 ms after the pulse)", "3 late (came 904 to 931 ms after the pulse):
/// c03r1, c03r2, c03r4", or "all late (...)" when it is all of `cameras`. In the order of each
/// one's first camera.
std::vector<std::string> GroupComplaints(const std::vector<Complaint>& complaints, size_t cameras);

}  // namespace rotunda::rig
