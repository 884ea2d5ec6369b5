#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "sfm/core/result.h"

namespace rotunda::sim {

/// What can go wrong with one simulated camera. `value` is the fault's strength, in the unit given.
enum class FaultKind {
  kDropPackets,     // probability 0..1 that a packet is lost, sent again or not
  kNoResend,        // (no value) requests to send a packet again are not answered
  kDropLeader,      // (no value) the first packet of a frame is lost, also when sent again
  kDropTrailer,     // (no value) the last one
  kLate,            // ms that the frame is sent too late; its time stamp is right
  kWrongFrameId,    // added to the frame's id
  kRestartIds,      // (no value) the next frame has id 1 again, as after re-arming; once
  kSkew,            // ms that the exposure begins too late
  kSecondPulse,     // ms after a pulse at which the camera sees another edge
  kFirstFrameLost,  // ms of idling after which a pulse only wakes the camera; also after arming
  kMute,            // (no value) the trigger cable is cut
  kUnplug,          // (no value) network and power are gone at once; cleared: it boots
  kUnplugInFrame,   // part 0..1 of the next frame's packets that is sent before it is unplugged
  kStealControl,    // another client has exclusive control (1: and the camera does not tell who
                    // asks whether it has control); cleared: it is free
  kNoPtp,           // (no value) the PTP master is not heard any more
  kReboot,          // ms the camera takes to boot; all settings and the control are lost; once
};

inline constexpr size_t kFaultKinds = static_cast<size_t>(FaultKind::kReboot) + 1;

struct FaultText {
  FaultKind kind;
  const char* name;  // as in the command "fault CAMERA NAME VALUE"
  const char* unit;  // empty when the fault has no value
  const char* help;
};
const std::vector<FaultText>& FaultTexts();

/// A fault acts on the camera's next `frames` exposures (0: until it is cleared). Faults that
/// happen once (restart of ids, reboot) and those that concern no frame (unplug, control) are not
/// counted.
struct Fault {
  FaultKind kind = FaultKind::kDropPackets;
  double value = 0;
  int frames = 0;

  /// kInvalidArgument: names the fault, its value and what it may be.
  Status Validate() const;
};

/// As in a command, with what is left of it: "drop 0.05", "mute", "late 800 (2 more)".
std::string DescribeFault(const Fault& fault);

/// A command of the trigger socket:
///   pulse [LINE [EDGE_NS [WIDTH_US]]] on input LINE (0 or 1; 0), rising at EDGE_NS of the
///   monotonic
///                                    clock (now)
///   shot NUMBER                      what the cameras see next
///   fault CAMERA KIND [VALUE [FRAMES]]   CAMERA: name, serial number, address or "all"; VALUE must
///                                    be there when the kind has one
///   clear [CAMERA]                   no more faults
///   list                             a line a camera, with the faults in force
struct ServerCommand {
  enum class Kind { kPulse, kShot, kFault, kClear, kList };
  Kind kind = Kind::kPulse;
  int line = 0;
  std::optional<int64_t> edge_ns;  // now
  int64_t width_us = 1000;
  int shot = 0;
  std::string camera = "all";
  Fault fault;
};
Result<ServerCommand> ParseServerCommand(std::string_view text);

}  // namespace rotunda::sim
