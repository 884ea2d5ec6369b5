#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "rig/capture_session.h"
#include "rig/sim/camera_server.h"

namespace rotunda::test {

/// Simulated cameras on an address block of their own, and capture options that fit them.
class SimulatedRig {
 public:
  struct Options {
    std::string block;  // "127.30.1"; no two tests that may run at the same time take the same one
    int cameras = 6;
    sim::SimulatedCamera like;
    bool restart_frame_ids = true;
    sim::FrameSource source;  // default: pattern
  };
  explicit SimulatedRig(const Options& options);

  sim::CameraServer& server() { return *server_; }
  /// Cameras "c000", "c001", ... with serial and address, one uplink.
  rig::CaptureOptions& capture() { return capture_; }
  /// Through Aravis, fired through the server's socket.
  Result<std::unique_ptr<rig::CaptureSession>> Open();
  std::string CameraName(int camera) const;
  /// What `camera` sees in shot number `shot`, as the bytes of a frame.
  std::vector<uint8_t> Served(int camera, int shot) const;
  /// Whether `frame` has exactly these bytes.
  bool IsAsServed(const rig::CameraFrame& frame, int camera, int shot) const;
  /// How many cameras of `taken` have exactly the bytes that they saw in shot number `shot`.
  int ExactFrames(const rig::Shot& taken, int shot) const;

 private:
  Options options_;
  std::unique_ptr<sim::CameraServer> server_;
  rig::CaptureOptions capture_;
};

/// The picture that `source` shows `camera` in `shot`, as the bytes of a frame.
std::vector<uint8_t> ServedBytes(const sim::FrameSource& source, const sim::SimulatedCamera& camera,
                                 int index, int shot);

}  // namespace rotunda::test
