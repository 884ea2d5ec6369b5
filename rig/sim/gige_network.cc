#include "rig/sim/gige_network.h"

#include <arpa/inet.h>
#include <sys/socket.h>
#include <sys/uio.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <system_error>
#include <utility>

namespace rotunda::sim {
namespace {

/// Holds several bursts of a camera, so that a receiver's pause does not block the sender.
constexpr int kSendBuffer_bytes = 4 << 20;
constexpr size_t kMaxBatch = 64;

sockaddr_in ToSystem(const Endpoint& endpoint) {
  sockaddr_in address = {};
  address.sin_family = AF_INET;
  address.sin_port = htons(endpoint.port);
  address.sin_addr.s_addr = htonl(endpoint.address);
  return address;
}

}  // namespace

Descriptor::Descriptor(Descriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}

Descriptor& Descriptor::operator=(Descriptor&& other) noexcept {
  std::swap(fd_, other.fd_);
  return *this;
}

Descriptor::~Descriptor() {
  if (fd_ >= 0) ::close(fd_);
}

std::string AddressText(uint32_t address) {
  char text[INET_ADDRSTRLEN] = {};
  const in_addr system = {htonl(address)};
  ::inet_ntop(AF_INET, &system, text, sizeof(text));
  return text;
}

Result<Descriptor> BindUdp(const Endpoint& local, bool shared) {
  const std::string name = AddressText(local.address) + ":" + std::to_string(local.port);
  const auto failed = [&](const char* what) {
    const std::string hint =
        errno == EADDRINUSE ? "; another simulator has it: stop it or choose another address block"
                            : "";
    return Error{ErrorCode::kIo, what + std::generic_category().message(errno) + hint, name};
  };
  Descriptor socket(::socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  if (socket.get() < 0) return failed("cannot make a socket: ");
  const int on = 1;
  const int size = kSendBuffer_bytes;
  if (shared) ::setsockopt(socket.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
  ::setsockopt(socket.get(), SOL_SOCKET, SO_SNDBUF, &size, sizeof(size));
  const sockaddr_in address = ToSystem(local);
  if (::bind(socket.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0) {
    return failed("cannot bind: ");
  }
  return socket;
}

std::optional<Datagram> ReceiveUdp(int socket, std::span<uint8_t> buffer) {
  sockaddr_in from = {};
  socklen_t from_size = sizeof(from);
  const ssize_t count = ::recvfrom(socket, buffer.data(), buffer.size(), 0,
                                   reinterpret_cast<sockaddr*>(&from), &from_size);
  if (count < 0) return std::nullopt;
  return Datagram{buffer.first(static_cast<size_t>(count)),
                  {ntohl(from.sin_addr.s_addr), ntohs(from.sin_port)}};
}

// UDP makes no promise: what the network does not take is lost, as on a wire.
void SendUdp(int socket, const Endpoint& to, std::span<const uint8_t> bytes) {
  const sockaddr_in address = ToSystem(to);
  [[maybe_unused]] const ssize_t sent =
      ::sendto(socket, bytes.data(), bytes.size(), 0, reinterpret_cast<const sockaddr*>(&address),
               sizeof(address));
}

size_t SendPackets(int socket, const Endpoint& to, std::span<const SplitPacket> packets) {
  sockaddr_in address = ToSystem(to);
  std::array<mmsghdr, kMaxBatch> messages;
  std::array<std::array<iovec, 2>, kMaxBatch> parts;
  size_t sent = 0;
  while (!packets.empty()) {
    const size_t count = std::min(packets.size(), kMaxBatch);
    for (size_t i = 0; i < count; ++i) {
      const SplitPacket& packet = packets[i];
      parts[i][0] = {const_cast<uint8_t*>(packet.head.bytes.data()), packet.head.size};
      parts[i][1] = {const_cast<uint8_t*>(packet.payload.data()), packet.payload.size()};
      messages[i] = {};
      messages[i].msg_hdr.msg_name = &address;
      messages[i].msg_hdr.msg_namelen = sizeof(address);
      messages[i].msg_hdr.msg_iov = parts[i].data();
      messages[i].msg_hdr.msg_iovlen = packet.payload.empty() ? 1 : 2;
    }
    const int taken =
        ::sendmmsg(socket, messages.data(), static_cast<unsigned>(count), MSG_NOSIGNAL);
    if (taken <= 0) break;
    sent += static_cast<size_t>(taken);
    packets = packets.subspan(static_cast<size_t>(taken));
  }
  return sent;
}

}  // namespace rotunda::sim
