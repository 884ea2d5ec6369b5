#include "rig/bandwidth.h"

#include <algorithm>
#include <cmath>

#include "rig/short_number.h"

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

Status CheckInTime(const FrameTransfer& transfer, const UplinkLoad& load, int deadline_ms) {
  const double needed_ms =
      1e3 * FrameTime_s(transfer.payload_bytes, transfer.packet_size_bytes, load.Share()) +
      1e-3 * transfer.exposure_us;
  if (needed_ms < deadline_ms) return {};
  // Rounded up: what is too slow must not look like the deadline.
  return Error{ErrorCode::kInvalidArgument,
               "with " + std::to_string(load.cameras) + " cameras, frames of " +
                   Number(1e-6 * static_cast<double>(transfer.payload_bytes), "%.5g MB") +
                   " need " + Number(std::ceil(needed_ms), "%.0f ms") +
                   " from the pulse on in packets of " +
                   std::to_string(transfer.packet_size_bytes) +
                   " bytes, but capture.deadline_ms is " + std::to_string(deadline_ms),
               "uplinks." + load.uplink};
}

}  // namespace rotunda::rig
