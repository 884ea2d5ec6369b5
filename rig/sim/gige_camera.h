#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

#include "rig/sim/camera_fault.h"
#include "rig/sim/camera_server.h"
#include "rig/sim/gige_genicam.h"
#include "rig/sim/gige_packets.h"
#include "rig/sim/gige_registers.h"
#include "rig/sim/served_image.h"

namespace rotunda::sim {

struct Endpoint {
  uint32_t address = 0;  // IPv4, host byte order
  uint16_t port = 0;
  bool operator==(const Endpoint&) const = default;
};

/// One frame to be sent: fixed when its exposure is triggered.
struct FrameOrder {
  int camera = 0;
  uint64_t number = 0;  // of the camera's exposures since the server was started
  Exposure exposure;
  GvspFrame frame;
  Endpoint to;
  int64_t start_ns = 0;            // when the first packet goes out
  int64_t packet_interval_ns = 0;  // between the begins of two packets
  double drop_probability = 0;     // of every packet
  bool drop_leader = false;
  bool drop_trailer = false;
  bool drop_data = false;  // packets too long for the path
  bool resend = true;
  std::optional<uint32_t> unplug_at_packet;
};

/// Packets first..last of a frame, to be sent again.
struct ResendOrder {
  uint16_t block_id = 0;
  uint32_t first = 0;
  uint32_t last = 0;
  Endpoint to;  // the stream's destination
};

/// What a datagram or an edge makes the camera do.
struct CameraActions {
  Bytes answer;  // empty: none
  std::vector<FrameOrder> frames;
  std::optional<ResendOrder> resend;
  std::optional<std::pair<Endpoint, size_t>> test_packet;  // its length without IP and UDP
  bool cut = false;  // what is being sent ends, what was sent is forgotten
};

/// An edge on a trigger input: level high from `rising_ns` on for `width_ns`.
struct TriggerPulse {
  int line = 0;
  int64_t rising_ns = 0;
  int64_t width_ns = 1'000'000;
};

/// One GigE Vision camera without network, threads or clock: registers, control channel, exposure.
/// Times are the rig's, from any fixed begin.
class GigeCamera {
 public:
  struct Settings {
    int index = 0;
    uint32_t address = 0;  // IPv4, host byte order
    SimulatedCamera camera;
    bool restart_frame_ids = true;
    int path_mtu_bytes = 9000;
    double link_bits_per_s = 1e9;
    uint64_t seed = 0;
  };
  /// `xml` outlives the camera.
  GigeCamera(Settings settings, std::string_view xml);

  /// Answers a request.
  CameraActions Handle(const GvcpRequest& request, const Endpoint& from, int64_t now_ns, int shot);
  /// A pulse on the trigger cable.
  CameraActions Pulse(const TriggerPulse& pulse, int shot);
  /// What time brings: control that lapses, frames of a camera that runs free.
  CameraActions Tick(int64_t now_ns, int shot);

  /// When Tick has something to do at the earliest; later than `now_ns`.
  int64_t NextTick_ns(int64_t now_ns) const;

  CameraActions SetFault(const Fault& fault, int64_t now_ns);
  void ClearFault(FaultKind kind);
  /// Those in force; `frames` is how many exposures are left.
  std::vector<Fault> faults() const;
  /// As kUnplug, see kUnplugInFrame.
  void Unplug();

  bool is_controlled() const { return controller_.has_value(); }
  bool is_acquiring() const { return acquiring_; }
  bool is_reachable(int64_t now_ns) const;
  uint64_t missed_pulses() const { return missed_pulses_; }
  const Settings& settings() const { return settings_; }

 private:
  void Reset();
  void ReleaseControl();
  void Refresh(int64_t now_ns);
  int64_t CameraTime_ns(int64_t rig_time_ns) const;

  GvcpStatus Read(const GvcpRequest& request, bool owns, Bytes& data) const;
  GvcpStatus Write(const GvcpRequest::Write& write, const Endpoint& from, int64_t now_ns,
                   CameraActions& actions);
  /// What a write that was accepted sets going.
  void ActOnWrite(uint32_t address, int64_t now_ns, int shot, CameraActions& actions);
  GvcpStatus WriteFeature(const Feature& feature, const GvcpRequest::Write& write);
  GvcpStatus WritePrivilege(uint32_t privilege, const Endpoint& from, int64_t now_ns);
  GvcpStatus WritePacketSize(uint32_t text, CameraActions& actions);
  void StartOrStop(bool start, int64_t now_ns);
  bool FitsSensor() const;

  void Expose(int64_t edge_ns, int shot, CameraActions& actions);
  FrameOrder MakeOrder(int64_t edge_ns, int shot);
  void ApplyFaults(FrameOrder& order);

  struct ActiveFault {
    Fault fault;
    int frames_left = 0;  // 0: until cleared
  };
  const ActiveFault* Active(FaultKind kind) const;
  /// The value of a fault that acts on this exposure, which is counted.
  std::optional<double> Take(FaultKind kind);

  Settings settings_;
  RegisterMap registers_;
  std::array<std::optional<ActiveFault>, kFaultKinds> faults_;
  std::optional<Endpoint> controller_;
  int64_t last_heartbeat_ns_ = 0;
  bool acquiring_ = false;
  int64_t booted_ns_ = 0;      // not reachable before
  int64_t busy_until_ns_ = 0;  // end of the exposure
  int64_t last_edge_ns_ = 0;   // or the begin of the acquisition
  bool is_fresh_ = false;      // no edge since the acquisition was started
  int64_t next_free_run_ns_ = 0;
  std::optional<int64_t> ptp_since_ns_;
  uint16_t block_id_ = 0;
  uint64_t exposures_ = 0;
  uint64_t missed_pulses_ = 0;
};

}  // namespace rotunda::sim
