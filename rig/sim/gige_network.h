#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "rig/sim/gige_camera.h"
#include "sfm/core/result.h"

namespace rotunda::sim {

/// Owns a file descriptor.
class Descriptor {
 public:
  Descriptor() = default;
  explicit Descriptor(int fd) : fd_(fd) {}
  Descriptor(Descriptor&& other) noexcept;
  Descriptor& operator=(Descriptor&& other) noexcept;
  ~Descriptor();
  int get() const { return fd_; }

 private:
  int fd_ = -1;
};

/// "127.0.1.7"
std::string AddressText(uint32_t address);

/// A UDP socket that does not block. kIo names the address. `shared`: others may listen to the same
/// broadcasts.
Result<Descriptor> BindUdp(const Endpoint& local, bool shared = false);

/// One datagram; nothing when none has come. `buffer` is cut to what came.
struct Datagram {
  std::span<const uint8_t> bytes;
  Endpoint from;
};
std::optional<Datagram> ReceiveUdp(int socket, std::span<uint8_t> buffer);
void SendUdp(int socket, const Endpoint& to, std::span<const uint8_t> bytes);

/// One packet that stands in two places.
struct SplitPacket {
  GvspHead head;
  std::span<const uint8_t> payload;
};
/// Sends them in as few system calls as may be, without copying the payload; how many the network
/// took.
size_t SendPackets(int socket, const Endpoint& to, std::span<const SplitPacket> packets);

}  // namespace rotunda::sim
