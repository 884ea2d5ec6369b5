#pragma once

#include <chrono>
#include <string>
#include <vector>

#include "rig/camera.h"
#include "sfm/core/result.h"

namespace rotunda::rig {

// Who is there, by GigE Vision's discovery command: no control is taken, and a silent address costs
// the patience given instead of the seconds that opening it would. Safe to call from any thread.

/// Asks the one at an IPv4 address. kNotFound: no answer within `patience`; kInvalidArgument: not
/// an IPv4 address.
Result<CameraIdentity> ProbeCamera(const std::string& address, std::chrono::milliseconds patience);

/// Whether the one at an IPv4 address answers and does not let us read it: another program has
/// exclusive control.
bool RefusesToBeRead(const std::string& address, std::chrono::milliseconds patience);

/// Asks by broadcast on all of this machine's networks and listens for `patience`. Sorted by
/// address, each address once.
Result<std::vector<CameraIdentity>> DiscoverCameras(std::chrono::milliseconds patience);

/// The configured cameras beside those that are there.
struct CameraMatch {
  std::vector<CameraPlace> places;  // as wanted; addresses filled in where the serial was found
  // Missing and wrong cameras; the context is the camera's name. kBadInput: at another address.
  std::vector<Error> problems;
  std::vector<CameraIdentity> unused;  // there, but not in the configuration
};
CameraMatch MatchCameras(const std::vector<CameraPlace>& wanted,
                         const std::vector<CameraIdentity>& found);

}  // namespace rotunda::rig
