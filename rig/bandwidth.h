#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "sfm/core/result.h"

namespace rotunda::rig {

/// What one camera may use of the link that it shares with others.
struct BandwidthShare {
  double share_bits_per_s = 0;  // of the shared uplink
  double link_bits_per_s = 0;   // of the camera's own link
};

/// A network link that `cameras` cameras send over at once.
struct UplinkLoad {
  std::string uplink;
  int cameras = 0;
  double uplink_bits_per_s = 1e10;
  double camera_link_bits_per_s = 1e9;

  /// Every camera the same part of what may be used of the uplink.
  BandwidthShare Share() const;
};

/// Of an uplink this much is planned for: the rest is for control, resends and clock messages.
inline constexpr double kUsablePartOfUplink = 0.9;
/// Ethernet's preamble, header, check sequence and gap around each packet.
inline constexpr int kEthernetOverhead_bytes = 38;
/// IP, UDP and GVSP headers, which count into the packet size.
inline constexpr int kPacketHeaders_bytes = 36;
/// Packet sizes that are used at all: what every IPv4 host takes, and the longest jumbo frames.
inline constexpr int kMinPacketSize_bytes = 576;
inline constexpr int kMaxPacketSize_bytes = 16384;

/// The gap a camera has to leave between two of its packets (GevSCPD), so that its share is not
/// exceeded: the interval (packet + 38) * 8 / share minus the packet's own time on its link.
int64_t PacketDelay_ns(int packet_size_bytes, const BandwidthShare& share);

/// Time from the first to the last packet of a frame of `payload_bytes` sent with that gap; leader
/// and trailer are packets too.
double FrameTime_s(size_t payload_bytes, int packet_size_bytes, const BandwidthShare& share);

/// What has to be done between a pulse and its deadline.
struct FrameTransfer {
  size_t payload_bytes = 0;
  int packet_size_bytes = 0;
  double exposure_us = 0;
};
/// kInvalidArgument when exposure and transfer take longer than `deadline_ms`, with both and the
/// uplink.
Status CheckInTime(const FrameTransfer& transfer, const UplinkLoad& load, int deadline_ms);

}  // namespace rotunda::rig
