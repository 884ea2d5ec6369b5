#include "rig/camera_discovery.h"

#include <arpa/inet.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <map>
#include <set>
#include <span>
#include <system_error>
#include <utility>

namespace rotunda::rig {
namespace {

using Clock = std::chrono::steady_clock;

// GigE Vision 2.0, GVCP and bootstrap registers: a discovery answer carries the first 0xF8 bytes of
// the register map.
constexpr uint16_t kGvcpPort = 3956;
constexpr size_t kHeaderSize = 8;
constexpr size_t kDiscoveryDataSize = 0xF8;
constexpr uint8_t kDiscoveryAck = 0x03;
constexpr uint8_t kRequestId = 0x5A;
constexpr std::array<uint8_t, kHeaderSize> kDiscoveryCommand = {0x42, 0x01, 0x00, 0x02,
                                                                0x00, 0x00, 0x00, kRequestId};
constexpr uint8_t kBroadcastAnswerAllowed = 0x11;  // flags of the command sent to all
// Reads the register 0, the version.
constexpr uint8_t kReadAck = 0x81;
constexpr std::array<uint8_t, kHeaderSize + 4> kReadCommand = {
    0x42, 0x01, 0x00, 0x80, 0x00, 0x04, 0x00, kRequestId, 0x00, 0x00, 0x00, 0x00};
constexpr uint16_t kAccessDenied = 0x8006;

constexpr size_t kAddressRegister = 0x24;
struct TextRegister {
  size_t offset;
  size_t size;
};
constexpr TextRegister kVendor{0x48, 32};
constexpr TextRegister kModel{0x68, 32};
constexpr TextRegister kVersion{0x88, 32};
constexpr TextRegister kSerial{0xD8, 16};

class Socket {
 public:
  Socket() : fd_(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {}
  ~Socket() {
    if (fd_ >= 0) ::close(fd_);
  }
  Socket(Socket&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  Socket& operator=(Socket&&) = delete;
  int get() const { return fd_; }

 private:
  int fd_;
};

using Answer = std::array<uint8_t, kHeaderSize + kDiscoveryDataSize>;

std::string TextOf(const uint8_t* registers, TextRegister place) {
  const char* text = reinterpret_cast<const char*>(registers) + place.offset;
  return {text, ::strnlen(text, place.size)};
}

CameraIdentity IdentityOf(const Answer& answer) {
  const uint8_t* registers = answer.data() + kHeaderSize;
  std::array<char, INET_ADDRSTRLEN> address{};
  ::inet_ntop(AF_INET, registers + kAddressRegister, address.data(), address.size());
  return {address.data(), TextOf(registers, kSerial), TextOf(registers, kVendor),
          TextOf(registers, kModel), TextOf(registers, kVersion)};
}

Error IoError(const std::string& what, const std::string& context) {
  return {ErrorCode::kIo, what + ": " + std::generic_category().message(errno), context};
}

sockaddr_in GvcpAddress(in_addr host) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(kGvcpPort);
  address.sin_addr = host;
  return address;
}

/// One datagram off a socket that poll() found readable. How long it is; 0: it does not answer the
/// command that `ack` belongs to.
size_t Receive(int socket, uint8_t ack, Answer& answer) {
  const ssize_t size = ::recv(socket, answer.data(), answer.size(), MSG_DONTWAIT);
  const bool answers =
      size >= static_cast<ssize_t>(kHeaderSize) && answer[3] == ack && answer[7] == kRequestId;
  return answers ? static_cast<size_t>(size) : 0;
}

bool ReceiveIdentity(int socket, Answer& answer) {
  return Receive(socket, kDiscoveryAck, answer) == answer.size();
}

int MillisecondsUntil(Clock::time_point deadline) {
  const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - Clock::now());
  return static_cast<int>(std::max<int64_t>(0, left.count()));
}

/// A socket on every IPv4 network of this machine that has sent the discovery command to all.
Result<std::vector<Socket>> SendToAllNetworks() {
  ifaddrs* interfaces = nullptr;
  if (::getifaddrs(&interfaces) != 0) return IoError("cannot list the networks", "discovery");
  std::vector<Socket> sockets;
  for (const ifaddrs* each = interfaces; each != nullptr; each = each->ifa_next) {
    if (each->ifa_addr == nullptr || each->ifa_addr->sa_family != AF_INET) continue;
    if ((each->ifa_flags & IFF_UP) == 0) continue;
    Socket socket;
    sockaddr_in own = *reinterpret_cast<const sockaddr_in*>(each->ifa_addr);
    own.sin_port = 0;
    const int on = 1;
    const sockaddr_in everyone = GvcpAddress({htonl(INADDR_BROADCAST)});
    std::array<uint8_t, kHeaderSize> command = kDiscoveryCommand;
    command[1] = kBroadcastAnswerAllowed;
    // A network that cannot be asked has no cameras for us: the others still have.
    if (::bind(socket.get(), reinterpret_cast<const sockaddr*>(&own), sizeof(own)) == 0 &&
        ::setsockopt(socket.get(), SOL_SOCKET, SO_BROADCAST, &on, sizeof(on)) == 0 &&
        ::sendto(socket.get(), command.data(), command.size(), 0,
                 reinterpret_cast<const sockaddr*>(&everyone), sizeof(everyone)) > 0) {
      sockets.push_back(std::move(socket));
    }
  }
  ::freeifaddrs(interfaces);
  return sockets;
}

/// Sends `command` to one address and waits for an answer that `take` is content with.
template <typename Take>
Status Ask(const std::string& address, std::span<const uint8_t> command,
           std::chrono::milliseconds patience, const Take& take) {
  in_addr host{};
  if (::inet_pton(AF_INET, address.c_str(), &host) != 1) {
    return Error{ErrorCode::kInvalidArgument, "is not an IPv4 address", address};
  }
  const sockaddr_in camera = GvcpAddress(host);
  const Socket socket;
  if (::connect(socket.get(), reinterpret_cast<const sockaddr*>(&camera), sizeof(camera)) != 0 ||
      ::send(socket.get(), command.data(), command.size(), 0) < 0) {
    return IoError("cannot be reached", address);
  }
  const auto deadline = Clock::now() + patience;
  pollfd readable{socket.get(), POLLIN, 0};
  while (::poll(&readable, 1, MillisecondsUntil(deadline)) > 0) {
    errno = 0;
    if (take(socket.get())) return {};
    if (errno == ECONNREFUSED) break;  // the host is there, but no camera
  }
  return Error{ErrorCode::kNotFound, "no camera answers (power, cable and network of the camera?)",
               address};
}

}  // namespace

Result<CameraIdentity> ProbeCamera(const std::string& address, std::chrono::milliseconds patience) {
  Answer answer{};
  ROTUNDA_RETURN_IF_ERROR(Ask(address, kDiscoveryCommand, patience,
                              [&](int socket) { return ReceiveIdentity(socket, answer); }));
  CameraIdentity identity = IdentityOf(answer);
  identity.address = address;
  return identity;
}

bool RefusesToBeRead(const std::string& address, std::chrono::milliseconds patience) {
  Answer answer{};
  const Status answered = Ask(address, kReadCommand, patience,
                              [&](int socket) { return Receive(socket, kReadAck, answer) > 0; });
  return answered.ok() && (answer[0] << 8 | answer[1]) == kAccessDenied;
}

Result<std::vector<CameraIdentity>> DiscoverCameras(std::chrono::milliseconds patience) {
  ROTUNDA_ASSIGN_OR_RETURN(const std::vector<Socket> sockets, SendToAllNetworks());
  std::vector<pollfd> readable;
  for (const Socket& socket : sockets) readable.push_back({socket.get(), POLLIN, 0});
  const auto deadline = Clock::now() + patience;
  std::map<uint32_t, CameraIdentity> found;  // by address
  while (::poll(readable.data(), readable.size(), MillisecondsUntil(deadline)) > 0) {
    for (const pollfd& each : readable) {
      Answer answer{};
      if ((each.revents & POLLIN) == 0 || !ReceiveIdentity(each.fd, answer)) continue;
      uint32_t address = 0;
      std::memcpy(&address, answer.data() + kHeaderSize + kAddressRegister, sizeof(address));
      found.emplace(ntohl(address), IdentityOf(answer));
    }
  }
  std::vector<CameraIdentity> cameras;
  for (auto& [address, identity] : found) cameras.push_back(std::move(identity));
  return cameras;
}

CameraMatch MatchCameras(const std::vector<CameraPlace>& wanted,
                         const std::vector<CameraIdentity>& found) {
  std::map<std::string, const CameraIdentity*> by_serial, by_address;
  for (const CameraIdentity& camera : found) {
    by_serial.emplace(camera.serial, &camera);
    by_address.emplace(camera.address, &camera);
  }
  std::map<std::string, std::string> name_of_serial;
  for (const CameraPlace& place : wanted) name_of_serial.emplace(place.serial, place.camera);
  CameraMatch match{wanted, {}, {}};
  std::set<const CameraIdentity*> used;
  for (CameraPlace& place : match.places) {
    const auto there = by_address.find(place.address);
    const auto elsewhere = place.serial.empty() ? by_serial.end() : by_serial.find(place.serial);
    if (elsewhere != by_serial.end()) used.insert(elsewhere->second);
    const auto refuse = [&](const std::string& message, ErrorCode code = ErrorCode::kNotFound) {
      match.problems.push_back({code, message, place.camera});
    };
    if (place.address.empty() && elsewhere == by_serial.end()) {
      refuse("serial " + place.serial + " was not found on any network");
    } else if (place.address.empty()) {
      place.address = elsewhere->second->address;
    } else if (there == by_address.end() && elsewhere == by_serial.end()) {
      refuse("serial " + place.serial + " expected at " + place.address + ", found nothing there");
    } else if (there == by_address.end()) {
      refuse("serial " + place.serial + " is at " + elsewhere->second->address +
                 ", but configured at " + place.address + ", where nobody answers",
             ErrorCode::kBadInput);
    } else {
      used.insert(there->second);
      const std::string& serial = there->second->serial;
      if (place.serial.empty() || place.serial == serial) continue;
      const auto owner = name_of_serial.find(serial);
      refuse("serial " + place.serial + " expected at " + place.address + ", found " + serial +
             (owner == name_of_serial.end() ? "" : " (which belongs to " + owner->second + ")"));
    }
  }
  for (const CameraIdentity& camera : found) {
    if (!used.contains(&camera)) match.unused.push_back(camera);
  }
  return match;
}

}  // namespace rotunda::rig
