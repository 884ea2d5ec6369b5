#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

// The two protocols of GigE Vision (AIA, 1.2), device side. GVCP: requests and answers on UDP port
// 3956. GVSP: a frame as a leader, data packets and a trailer. All numbers are big endian.

namespace rotunda::sim {

using Bytes = std::vector<uint8_t>;

inline constexpr uint16_t kGvcpPort = 3956;
/// Largest data part of a GVCP packet (GigE Vision 1.2, 14.1: 576 bytes of IP datagram).
inline constexpr size_t kGvcpMaxData = 540;

/// Big endian numbers at `at`; the caller has checked the length.
uint16_t ReadBig16(std::span<const uint8_t> bytes, size_t at);
uint32_t ReadBig32(std::span<const uint8_t> bytes, size_t at);
void WriteBig16(std::span<uint8_t> bytes, size_t at, uint16_t value);
void WriteBig32(std::span<uint8_t> bytes, size_t at, uint32_t value);

enum class GvcpCommand : uint16_t {
  kDiscovery = 0x0002,
  kPacketResend = 0x0040,
  kReadRegister = 0x0080,
  kWriteRegister = 0x0082,
  kReadMemory = 0x0084,
  kWriteMemory = 0x0086,
};

enum class GvcpStatus : uint16_t {
  kSuccess = 0x0000,
  kNotImplemented = 0x8001,
  kInvalidParameter = 0x8002,
  kInvalidAddress = 0x8003,
  kWriteProtect = 0x8004,
  kBadAlignment = 0x8005,
  kAccessDenied = 0x8006,
  kInvalidHeader = 0x800E,
};

/// A request as it came. What a command does not have is empty or 0.
struct GvcpRequest {
  uint16_t command = 0;  // of GvcpCommand, or one that is not known
  uint16_t id = 0;
  bool wants_answer = false;
  GvcpStatus status = GvcpStatus::kSuccess;  // else: the header is right, the rest is not
  struct Write {
    uint32_t address = 0;
    Bytes data;
  };
  std::vector<uint32_t> read_registers;  // addresses
  std::vector<Write> writes;             // registers: 4 bytes each; memory: one block
  uint32_t memory_address = 0;           // to read
  uint16_t memory_bytes = 0;
  uint16_t block_id = 0;  // of packets to send again
  uint32_t first_packet = 0;
  uint32_t last_packet = 0;
};

/// Nothing when the bytes are no GVCP request at all: such datagrams are not answered.
std::optional<GvcpRequest> ParseGvcpRequest(std::span<const uint8_t> bytes);

/// The answer to `request`.
Bytes EncodeGvcpAnswer(const GvcpRequest& request, GvcpStatus status,
                       std::span<const uint8_t> data = {});

/// What the leader says of a frame, and how the frame is cut up.
struct GvspFrame {
  uint16_t block_id = 1;  // never 0
  uint64_t timestamp_ticks = 0;
  uint32_t pixel_format = 0;
  uint32_t width_px = 0;
  uint32_t height_px = 0;
  uint32_t offset_x_px = 0;
  uint32_t offset_y_px = 0;
  size_t payload_bytes = 0;
  uint32_t packet_size_bytes = 1500;  // of the IP datagram, as in the register SCPS
};

inline constexpr size_t kIpUdpHeader_bytes = 20 + 8;
inline constexpr size_t kGvspHeader_bytes = 8;
/// What a packet of the stream has besides image data.
inline constexpr size_t kGvspOverhead_bytes = kIpUdpHeader_bytes + kGvspHeader_bytes;

/// Leader, data packets and trailer.
uint32_t PacketCount(const GvspFrame& frame);

/// The bytes of the frame's image that packet `packet` carries; empty for leader and trailer.
struct PayloadRange {
  size_t offset = 0;
  size_t size = 0;
};
PayloadRange PayloadOfPacket(const GvspFrame& frame, uint32_t packet);

/// What stands before the image data of a packet, or all of a leader or trailer.
struct GvspHead {
  std::array<uint8_t, 44> bytes = {};
  size_t size = 0;
};
GvspHead EncodeGvspHead(const GvspFrame& frame, uint32_t packet);

/// The answer to a request for a packet that is no longer there.
GvspHead EncodeGvspUnavailable(uint16_t block_id, uint32_t packet);

}  // namespace rotunda::sim
