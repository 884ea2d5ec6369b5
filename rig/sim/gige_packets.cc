#include "rig/sim/gige_packets.h"

#include <algorithm>

namespace rotunda::sim {
namespace {

constexpr size_t kGvcpHeader_bytes = 8;
constexpr uint8_t kGvcpKey = 0x42;
constexpr uint8_t kFlagAnswerRequired = 0x01;
constexpr uint8_t kFlagExtendedIds = 0x10;

enum GvspFormat : uint32_t { kLeader = 1, kTrailer = 2, kPayload = 3 };
constexpr uint16_t kPayloadTypeImage = 1;
constexpr uint16_t kStatusPacketUnavailable = 0x800C;
constexpr uint32_t kPacketIdMask = 0x00FFFFFF;

bool ParseReadRegister(std::span<const uint8_t> body, GvcpRequest& request) {
  if (body.empty() || body.size() % 4 != 0) return false;
  for (size_t at = 0; at < body.size(); at += 4) {
    request.read_registers.push_back(ReadBig32(body, at));
  }
  return true;
}

bool ParseWriteRegister(std::span<const uint8_t> body, GvcpRequest& request) {
  if (body.empty() || body.size() % 8 != 0) return false;
  for (size_t at = 0; at < body.size(); at += 8) {
    const auto value = body.subspan(at + 4, 4);
    request.writes.push_back({ReadBig32(body, at), Bytes(value.begin(), value.end())});
  }
  return true;
}

bool ParseReadMemory(std::span<const uint8_t> body, GvcpRequest& request) {
  if (body.size() != 8) return false;
  request.memory_address = ReadBig32(body, 0);
  request.memory_bytes = ReadBig16(body, 6);
  return request.memory_bytes > 0 && request.memory_bytes <= kGvcpMaxData - 4;
}

bool ParseWriteMemory(std::span<const uint8_t> body, GvcpRequest& request) {
  if (body.size() <= 4) return false;
  request.writes.push_back({ReadBig32(body, 0), Bytes(body.begin() + 4, body.end())});
  return true;
}

bool ParseResend(std::span<const uint8_t> body, GvcpRequest& request) {
  if (body.size() < 12) return false;
  request.block_id = ReadBig16(body, 2);
  request.first_packet = ReadBig32(body, 4) & kPacketIdMask;
  request.last_packet = ReadBig32(body, 8) & kPacketIdMask;
  return request.first_packet <= request.last_packet;
}

GvcpStatus ParseBody(std::span<const uint8_t> body, GvcpRequest& request) {
  bool ok = true;
  switch (static_cast<GvcpCommand>(request.command)) {
    case GvcpCommand::kDiscovery:
      break;
    case GvcpCommand::kPacketResend:
      ok = ParseResend(body, request);
      break;
    case GvcpCommand::kReadRegister:
      ok = ParseReadRegister(body, request);
      break;
    case GvcpCommand::kWriteRegister:
      ok = ParseWriteRegister(body, request);
      break;
    case GvcpCommand::kReadMemory:
      ok = ParseReadMemory(body, request);
      break;
    case GvcpCommand::kWriteMemory:
      ok = ParseWriteMemory(body, request);
      break;
    default:
      return GvcpStatus::kNotImplemented;
  }
  return ok ? GvcpStatus::kSuccess : GvcpStatus::kInvalidHeader;
}

void WriteGvspHeader(std::span<uint8_t> out, uint16_t block_id, uint32_t format, uint32_t packet) {
  WriteBig16(out, 2, block_id);
  WriteBig32(out, 4, format << 24 | (packet & kPacketIdMask));
}

}  // namespace

uint16_t ReadBig16(std::span<const uint8_t> bytes, size_t at) {
  return static_cast<uint16_t>(bytes[at] << 8 | bytes[at + 1]);
}

uint32_t ReadBig32(std::span<const uint8_t> bytes, size_t at) {
  return static_cast<uint32_t>(ReadBig16(bytes, at)) << 16 | ReadBig16(bytes, at + 2);
}

void WriteBig16(std::span<uint8_t> bytes, size_t at, uint16_t value) {
  bytes[at] = static_cast<uint8_t>(value >> 8);
  bytes[at + 1] = static_cast<uint8_t>(value);
}

void WriteBig32(std::span<uint8_t> bytes, size_t at, uint32_t value) {
  WriteBig16(bytes, at, static_cast<uint16_t>(value >> 16));
  WriteBig16(bytes, at + 2, static_cast<uint16_t>(value));
}

std::optional<GvcpRequest> ParseGvcpRequest(std::span<const uint8_t> bytes) {
  if (bytes.size() < kGvcpHeader_bytes || bytes[0] != kGvcpKey) return std::nullopt;
  GvcpRequest request;
  request.command = ReadBig16(bytes, 2);
  request.id = ReadBig16(bytes, 6);
  const size_t length = ReadBig16(bytes, 4);
  const bool is_resend = request.command == static_cast<uint16_t>(GvcpCommand::kPacketResend);
  request.wants_answer = (bytes[1] & kFlagAnswerRequired) != 0 && !is_resend;
  // Some clients count the header of a resend request in its length: the datagram's end counts.
  const auto body = bytes.subspan(kGvcpHeader_bytes);
  if (request.id == 0 || (body.size() != length && !is_resend) || body.size() > kGvcpMaxData) {
    request.status = GvcpStatus::kInvalidHeader;
  } else if (is_resend && (bytes[1] & kFlagExtendedIds) != 0) {
    request.status = GvcpStatus::kNotImplemented;
  } else {
    request.status = ParseBody(body, request);
  }
  return request;
}

Bytes EncodeGvcpAnswer(const GvcpRequest& request, GvcpStatus status,
                       std::span<const uint8_t> data) {
  Bytes answer(kGvcpHeader_bytes + data.size());
  WriteBig16(answer, 0, static_cast<uint16_t>(status));
  // An answer's code is its request's plus one.
  WriteBig16(answer, 2, static_cast<uint16_t>(request.command + 1));
  WriteBig16(answer, 4, static_cast<uint16_t>(data.size()));
  WriteBig16(answer, 6, request.id);
  std::copy(data.begin(), data.end(), answer.begin() + kGvcpHeader_bytes);
  return answer;
}

uint32_t PacketCount(const GvspFrame& frame) {
  const size_t block = frame.packet_size_bytes - kGvspOverhead_bytes;
  return static_cast<uint32_t>((frame.payload_bytes + block - 1) / block) + 2;
}

PayloadRange PayloadOfPacket(const GvspFrame& frame, uint32_t packet) {
  if (packet == 0 || packet + 1 >= PacketCount(frame)) return {};
  const size_t block = frame.packet_size_bytes - kGvspOverhead_bytes;
  const size_t offset = (packet - 1) * block;
  return {offset, std::min(block, frame.payload_bytes - offset)};
}

GvspHead EncodeGvspHead(const GvspFrame& frame, uint32_t packet) {
  GvspHead head;
  const std::span<uint8_t> out(head.bytes);
  const auto data = out.subspan(kGvspHeader_bytes);
  if (packet == 0) {
    WriteGvspHeader(out, frame.block_id, kLeader, packet);
    WriteBig16(data, 2, kPayloadTypeImage);
    WriteBig32(data, 4, static_cast<uint32_t>(frame.timestamp_ticks >> 32));
    WriteBig32(data, 8, static_cast<uint32_t>(frame.timestamp_ticks));
    WriteBig32(data, 12, frame.pixel_format);
    WriteBig32(data, 16, frame.width_px);
    WriteBig32(data, 20, frame.height_px);
    WriteBig32(data, 24, frame.offset_x_px);
    WriteBig32(data, 28, frame.offset_y_px);
    head.size = kGvspHeader_bytes + 36;
  } else if (packet + 1 == PacketCount(frame)) {
    WriteGvspHeader(out, frame.block_id, kTrailer, packet);
    WriteBig16(data, 2, kPayloadTypeImage);
    WriteBig32(data, 4, frame.height_px);
    head.size = kGvspHeader_bytes + 8;
  } else {
    WriteGvspHeader(out, frame.block_id, kPayload, packet);
    head.size = kGvspHeader_bytes;
  }
  return head;
}

GvspHead EncodeGvspUnavailable(uint16_t block_id, uint32_t packet) {
  GvspHead head;
  const std::span<uint8_t> out(head.bytes);
  WriteBig16(out, 0, kStatusPacketUnavailable);
  WriteGvspHeader(out, block_id, kPayload, packet);
  head.size = kGvspHeader_bytes;
  return head;
}

}  // namespace rotunda::sim
