#include "rig/bandwidth.h"

#include <algorithm>
#include <cmath>
#include <sstream>

namespace rotunda::rig {
namespace {

double WireBits(int packet_size_bytes) {
  return 8.0 * (packet_size_bytes + kEthernetOverhead_bytes);
}

/// Between the beginnings of two packets of one camera.
double PacketInterval_s(int packet_size_bytes, const BandwidthShare& share) {
  return WireBits(packet_size_bytes) / std::min(share.share_bits_per_s, share.link_bits_per_s);
}

}  // namespace

BandwidthShare UplinkLoad::Share() const {
  return {kUsablePartOfUplink * uplink_bits_per_s / std::max(1, cameras), camera_link_bits_per_s};
}

int64_t PacketDelay_ns(int packet_size_bytes, const BandwidthShare& share) {
  const double own_s = WireBits(packet_size_bytes) / share.link_bits_per_s;
  return std::llround(1e9 * (PacketInterval_s(packet_size_bytes, share) - own_s));
}

double FrameTime_s(size_t payload_bytes, int packet_size_bytes, const BandwidthShare& share) {
  constexpr double kLeaderAndTrailer = 2;
  const double packets =
      std::ceil(static_cast<double>(payload_bytes) / (packet_size_bytes - kPacketHeaders_bytes)) +
      kLeaderAndTrailer;
  return packets * PacketInterval_s(packet_size_bytes, share);
}

Status CheckInTime(const FrameTransfer& transfer, const BandwidthShare& share, int deadline_ms) {
  const double needed_ms =
      1e3 * FrameTime_s(transfer.payload_bytes, transfer.packet_size_bytes, share) +
      1e-3 * transfer.exposure_us;
  if (needed_ms < deadline_ms) return {};
  std::ostringstream text;
  text.precision(3);
  text << "frames of " << static_cast<double>(transfer.payload_bytes) / 1e6 << " MB need "
       << needed_ms << " ms from the pulse on in packets of " << transfer.packet_size_bytes
       << " bytes, but capture.deadline_ms is " << deadline_ms;
  return Error{ErrorCode::kInvalidArgument, text.str(), "bandwidth"};
}

}  // namespace rotunda::rig
