#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "rig/sim/camera_fault.h"
#include "rig/sim/served_image.h"
#include "sfm/core/result.h"

namespace rotunda::sim {

/// One simulated camera as it comes out of its box.
struct SimulatedCamera {
  std::string name;  // DeviceUserID; names and serial numbers: 1 to 15 characters, each once
  std::string serial;
  int width_px = 1200;
  int height_px = 1600;
  PixelFormat format = PixelFormat::kBayerRG8;
  double exposure_delay_us = 0;   // from the edge to the begin of the exposure
  double exposure_jitter_us = 0;  // standard deviation of it
  int64_t clock_offset_ns = 0;    // of the camera's clock from the rig's while PTP is off
  // Longer gaps between packets are taken, and cut to this, as some cameras do.
  uint32_t max_packet_delay_ns = 100'000'000;
};

/// `count` cameras named c001, c002, ... with serial numbers SIM00001, ..., or with what
/// `like.serial` begins them with. Aravis' discovery knows a camera by its serial number: servers
/// that are to be discovered side by side need different ones.
std::vector<SimulatedCamera> MakeCameras(int count, const SimulatedCamera& like);

/// The cameras that took the frames: their names, serial numbers, picture size and format, as far
/// as a camera's registers can have them (else as MakeCameras has them).
std::vector<SimulatedCamera> CamerasOf(const ServedShots& shots);

/// The first three bytes of the addresses: camera i has BLOCK.(i+1). Any of 127.0.0.0/8 needs no
/// set-up on Linux.
struct AddressBlock {
  std::array<uint8_t, 3> bytes = {127, 0, 1};
};
/// "127.20.3" or "127.20.3.x".
Result<AddressBlock> ParseAddressBlock(std::string_view text);

struct CameraServerOptions {
  AddressBlock block;
  std::vector<SimulatedCamera> cameras;  // 1 to 254
  FrameSource source;                    // default: PatternSource of the first camera's size
  std::filesystem::path socket;          // of pulses and commands; empty: none
  int shots = 0;                         // that `source` has, by command "shot"; 0: any number
  bool pulse_advances_shot = true;       // else SetShot alone says what the cameras see
  bool restart_frame_ids = true;         // at AcquisitionStart, as many cameras do
  int path_mtu_bytes = 9000;             // longer packets do not arrive
  double link_bits_per_s = 1e9;          // of each camera
  uint64_t seed = 0;                     // of jitter and lost packets

  /// kInvalidArgument: names the field, what it is and what it may be.
  Status Validate() const;
};

/// What a camera has done since the server was started.
struct CameraCounters {
  uint64_t frames = 0;           // sent to their end
  uint64_t packets = 0;          // handed to the network, those sent again too
  uint64_t packets_dropped = 0;  // lost by a fault
  uint64_t packets_resent = 0;   // packets asked for again and sent
  uint64_t missed_pulses = 0;    // edges on its trigger input while it was not armed for them
};

/// GigE Vision cameras on loopback, for any GigE Vision client. One thread answers the clients, one
/// sends the frames. Member functions may be called from any thread.
class CameraServer {
 public:
  /// Binds all addresses and starts. kIo names the address: another server has it.
  static Result<std::unique_ptr<CameraServer>> Start(CameraServerOptions options);
  /// Stops; frames on their way are cut.
  ~CameraServer();
  CameraServer(const CameraServer&) = delete;
  CameraServer& operator=(const CameraServer&) = delete;

  int size() const;
  std::string address(int camera) const;  // "127.0.1.7"
  const SimulatedCamera& camera(int camera) const;
  const std::filesystem::path& socket() const;

  /// A pulse on input `line` of every camera, now; the time of its rising edge (steady clock).
  int64_t Pulse(int line = 0);
  /// What the cameras see from the next pulse on. A pulse on the trigger line then advances it by
  /// one (see pulse_advances_shot); frames triggered by software show it without advancing it.
  void SetShot(int shot);

  /// Replaces a fault of the same kind. kInvalidArgument: no such camera, a value out of range.
  Status SetFault(int camera, const Fault& fault);
  void ClearFaults();  // of all cameras

  CameraCounters counters(int camera) const;
  /// Does one command (see ServerCommand); the answer's text.
  Result<std::string> Execute(const ServerCommand& command);

 private:
  struct Impl;
  explicit CameraServer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// Sends one command to a server's socket and waits for its answer. kNotFound: no server listens
/// there; kFailed: the server refused, with its reason.
Result<std::string> SendServerCommand(const std::filesystem::path& socket,
                                      const std::string& command);

}  // namespace rotunda::sim
