#include "rig/sim/camera_server.h"

#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <climits>
#include <cstddef>
#include <cstdio>
#include <cstring>
#include <mutex>
#include <set>
#include <sstream>
#include <system_error>
#include <thread>

#include "rig/bandwidth.h"
#include "rig/sim/gige_camera.h"
#include "rig/sim/gige_genicam.h"
#include "rig/sim/gige_network.h"
#include "rig/sim/gige_sender.h"

namespace rotunda::sim {
namespace {

constexpr uint32_t kBroadcast = 0xFFFFFFFF;
constexpr uint32_t kLoopbackNet = 127;
constexpr size_t kMaxCameras = 254;
constexpr size_t kMaxName = 15;  // the registers have 16 bytes, the last one is 0
constexpr int kMinSide_px = 8;
constexpr int kMaxSide_px = 16384;
constexpr size_t kMaxDatagram_bytes = 2048;
constexpr int kMaxDatagramsPerWake = 64;
constexpr int kAnswer_ms = 2000;
// How answers begin.
constexpr std::string_view kDone = "ok ", kRefused = "error ";
constexpr size_t kMaxAnswer_bytes = 128 * 1024;  // "list" of 254 cameras with all faults: 90 kB

/// The one clock of the simulated rig: that of the trigger line.
int64_t Now_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

Error IoError(const std::string& what, const std::string& context) {
  return {ErrorCode::kIo, what + ": " + std::generic_category().message(errno), context};
}

Result<sockaddr_un> SocketAddress(const std::filesystem::path& path) {
  sockaddr_un address = {};
  address.sun_family = AF_UNIX;
  const std::string text = path.string();
  if (text.size() >= sizeof(address.sun_path)) {
    return Error{ErrorCode::kInvalidArgument,
                 "the path is longer than the " + std::to_string(sizeof(address.sun_path) - 1) +
                     " bytes a socket may have",
                 text};
  }
  std::memcpy(address.sun_path, text.data(), text.size());
  return address;
}

/// Makes the command socket; one that nobody listens on any more is replaced.
Result<Descriptor> BindCommands(const std::filesystem::path& path) {
  ROTUNDA_ASSIGN_OR_RETURN(const sockaddr_un address, SocketAddress(path));
  const auto* system = reinterpret_cast<const sockaddr*>(&address);
  Descriptor socket(::socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  if (socket.get() < 0) return IoError("cannot make a socket", path.string());
  if (::bind(socket.get(), system, sizeof(address)) == 0) return socket;
  if (errno == EADDRINUSE) {
    std::error_code unknown;
    if (!std::filesystem::is_socket(path, unknown)) {
      return Error{ErrorCode::kAlreadyExists, "is there and not a socket", path.string()};
    }
    const Descriptor probe(::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0));
    if (::connect(probe.get(), system, sizeof(address)) == 0) {
      return Error{ErrorCode::kAlreadyExists, "another simulator listens there", path.string()};
    }
    if (errno == ECONNREFUSED && ::unlink(path.c_str()) == 0 &&
        ::bind(socket.get(), system, sizeof(address)) == 0) {
      return socket;
    }
    errno = EADDRINUSE;
  }
  return IoError("cannot make the socket", path.string());
}

bool IsLoopback(const Endpoint& endpoint) { return endpoint.address >> 24 == kLoopbackNet; }

Error Refused(const std::string& field, const std::string& found, const std::string& expected) {
  return {ErrorCode::kInvalidArgument, field + " is " + found + ", expected " + expected,
          "simulated cameras"};
}

/// What fits the registers and can be said in a command.
bool IsName(const std::string& text) {
  return !text.empty() && text.size() <= kMaxName && text != "all" &&
         text.find_first_of(" \t\n") == std::string::npos;
}

Status ValidateCamera(const SimulatedCamera& camera, std::set<std::string>& names) {
  for (const std::string& name : {camera.name, camera.serial}) {
    if (!IsName(name)) {
      return Refused("name or serial number", "\"" + name + "\"",
                     "1 to 15 characters without spaces, not \"all\"");
    }
    if (!names.insert(name).second) {
      return Refused("name or serial number", "\"" + name + "\" twice", "each once");
    }
  }
  for (const int side : {camera.width_px, camera.height_px}) {
    if (side < kMinSide_px || side > kMaxSide_px) {
      return Refused("side of " + camera.name, std::to_string(side), "8 to 16384 pixels");
    }
  }
  if (!(camera.exposure_delay_us >= 0) || !(camera.exposure_jitter_us >= 0) ||
      camera.clock_offset_ns < 0) {
    return Refused("delay, jitter or clock offset of " + camera.name, "negative", "0 or more");
  }
  return {};
}

/// " faults drop 0.05, mute"; empty: none.
std::string FaultList(const GigeCamera& camera) {
  std::string text;
  for (const Fault& fault : camera.faults()) {
    text += (text.empty() ? " faults " : ", ") + DescribeFault(fault);
  }
  return text;
}

}  // namespace

std::vector<SimulatedCamera> MakeCameras(int count, const SimulatedCamera& like) {
  std::vector<SimulatedCamera> cameras(static_cast<size_t>(count), like);
  for (int i = 0; i < count; ++i) {
    char text[32];
    std::snprintf(text, sizeof(text), "c%03d", i + 1);
    cameras[static_cast<size_t>(i)].name = text;
    std::snprintf(text, sizeof(text), "%05d", i + 1);
    cameras[static_cast<size_t>(i)].serial = (like.serial.empty() ? "SIM" : like.serial) + text;
  }
  return cameras;
}

std::vector<SimulatedCamera> CamerasOf(const ServedShots& shots) {
  SimulatedCamera like;
  like.width_px = shots.width_px;
  like.height_px = shots.height_px;
  like.format = shots.format;
  std::vector<SimulatedCamera> cameras = MakeCameras(static_cast<int>(shots.cameras.size()), like);
  for (size_t i = 0; i < cameras.size(); ++i) {
    if (IsName(shots.cameras[i])) cameras[i].name = shots.cameras[i];
    if (IsName(shots.serials[i])) cameras[i].serial = shots.serials[i];
  }
  return cameras;
}

Result<AddressBlock> ParseAddressBlock(std::string_view text) {
  const Error refused = Refused("address block", "\"" + std::string(text) + "\"",
                                "127.A.B with A and B of 0 to 255, such as 127.0.1");
  std::string_view rest = text;
  if (rest.ends_with(".x")) rest.remove_suffix(2);
  AddressBlock block;
  for (size_t i = 0; i < block.bytes.size(); ++i) {
    if (i > 0 && (rest.empty() || rest.front() != '.')) return refused;
    if (i > 0) rest.remove_prefix(1);
    const auto [end, error] =
        std::from_chars(rest.data(), rest.data() + rest.size(), block.bytes[i]);
    if (error != std::errc()) return refused;
    rest.remove_prefix(static_cast<size_t>(end - rest.data()));
  }
  if (!rest.empty() || block.bytes[0] != kLoopbackNet) return refused;
  return block;
}

Status CameraServerOptions::Validate() const {
  if (cameras.empty() || cameras.size() > kMaxCameras) {
    return Refused("number of cameras", std::to_string(cameras.size()), "1 to 254");
  }
  if (block.bytes[0] != kLoopbackNet) {
    return Refused("address block", std::to_string(block.bytes[0]) + ".x.x.x", "127.A.B");
  }
  std::set<std::string> names;
  for (const SimulatedCamera& camera : cameras) {
    ROTUNDA_RETURN_IF_ERROR(ValidateCamera(camera, names));
  }
  if (path_mtu_bytes < rig::kMinPacketSize_bytes || path_mtu_bytes > rig::kMaxPacketSize_bytes) {
    return Refused("path MTU", std::to_string(path_mtu_bytes),
                   std::to_string(rig::kMinPacketSize_bytes) + " to " +
                       std::to_string(rig::kMaxPacketSize_bytes) + " bytes");
  }
  if (!(link_bits_per_s >= 1e6)) {
    return Refused("link speed", std::to_string(link_bits_per_s), "at least 1e6 bits/s");
  }
  return {};
}

struct CameraServer::Impl {
  explicit Impl(CameraServerOptions given)
      : options(std::move(given)), xml(GenicamXml()), commands_begin(options.cameras.size() + 1) {}

  ~Impl() {
    if (!options.socket.empty() && commands.get() >= 0) ::unlink(options.socket.c_str());
  }

  Status Open();
  void Listen(const std::stop_token& stop);
  void OnControl(size_t camera);
  void OnDiscovery();
  void OnCommand();
  void Tick();
  int WaitTime_ms();
  void Answer(size_t camera, const GvcpRequest& request, const Endpoint& from);
  void Do(size_t camera, CameraActions actions);
  void SetFault(size_t camera, const Fault& fault);
  void ClearFaults(size_t camera);
  Result<std::string> Execute(const ServerCommand& command);
  int64_t Pulse(const TriggerPulse& pulse);
  Result<std::vector<size_t>> Find(const std::string& name) const;
  std::string List();

  CameraServerOptions options;
  const std::string xml;
  const size_t commands_begin;  // of the epoll tags: cameras, broadcasts, commands, wake-up
  std::vector<Descriptor> control_sockets;
  std::vector<Descriptor> stream_sockets;
  Descriptor broadcasts;
  Descriptor commands;
  Descriptor wake;
  Descriptor poll;

  std::mutex mutex;  // of cameras and shot
  std::vector<GigeCamera> cameras;
  int shot = 0;
  std::unique_ptr<GigeSender> sender;
  std::jthread listener;  // last: ends first
};

Status CameraServer::Impl::Open() {
  const auto& bytes = options.block.bytes;
  poll = Descriptor(::epoll_create1(EPOLL_CLOEXEC));
  wake = Descriptor(::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC));
  const auto listen_on = [&](const Descriptor& socket, uint64_t tag) {
    epoll_event event = {};
    event.events = EPOLLIN;
    event.data.u64 = tag;
    return ::epoll_ctl(poll.get(), EPOLL_CTL_ADD, socket.get(), &event) == 0;
  };
  GigeSender::Settings sending;
  for (size_t i = 0; i < options.cameras.size(); ++i) {
    const uint32_t address = uint32_t{bytes[0]} << 24 | uint32_t{bytes[1]} << 16 |
                             uint32_t{bytes[2]} << 8 | static_cast<uint32_t>(i + 1);
    cameras.emplace_back(GigeCamera::Settings{static_cast<int>(i), address, options.cameras[i],
                                              options.restart_frame_ids, options.path_mtu_bytes,
                                              options.link_bits_per_s, options.seed},
                         xml);
    ROTUNDA_ASSIGN_OR_RETURN(Descriptor control, BindUdp({address, kGvcpPort}));
    ROTUNDA_ASSIGN_OR_RETURN(Descriptor stream, BindUdp({address, 0}));
    if (!listen_on(control, i)) return IoError("cannot listen", AddressText(address));
    sending.sockets.push_back(stream.get());
    control_sockets.push_back(std::move(control));
    stream_sockets.push_back(std::move(stream));
  }
  ROTUNDA_ASSIGN_OR_RETURN(broadcasts, BindUdp({kBroadcast, kGvcpPort}, true));
  bool ok = listen_on(broadcasts, options.cameras.size());
  if (!options.socket.empty()) {
    ROTUNDA_ASSIGN_OR_RETURN(commands, BindCommands(options.socket));
    ok = ok && listen_on(commands, commands_begin);
  }
  if (!ok || !listen_on(wake, commands_begin + 1)) return IoError("cannot listen", "");
  sending.source = options.source ? options.source
                                  : PatternSource(options.cameras.front().width_px,
                                                  options.cameras.front().height_px);
  sending.seed = options.seed;
  sending.now_ns = Now_ns;
  sending.on_unplugged = [this](int camera) {
    const std::lock_guard lock(mutex);
    cameras[static_cast<size_t>(camera)].Unplug();
    sender->Cut(camera);
  };
  sender = std::make_unique<GigeSender>(std::move(sending));
  listener = std::jthread([this](const std::stop_token& stop) { Listen(stop); });
  return {};
}

void CameraServer::Impl::Listen(const std::stop_token& stop) {
  const std::stop_callback wake_up(stop, [this] {
    const uint64_t one = 1;
    [[maybe_unused]] const ssize_t written = ::write(wake.get(), &one, sizeof(one));
  });
  std::array<epoll_event, 64> events;
  while (!stop.stop_requested()) {
    const int count = ::epoll_wait(poll.get(), events.data(), events.size(), WaitTime_ms());
    for (int i = 0; i < count; ++i) {
      const uint64_t tag = events[static_cast<size_t>(i)].data.u64;
      if (tag < options.cameras.size()) OnControl(tag);
      if (tag == options.cameras.size()) OnDiscovery();
      if (tag == commands_begin) OnCommand();
    }
    Tick();
  }
}

/// Until a camera has to do something by itself.
int CameraServer::Impl::WaitTime_ms() {
  const std::lock_guard lock(mutex);
  const int64_t now_ns = Now_ns();
  int64_t next_ns = INT64_MAX;
  for (const GigeCamera& camera : cameras) next_ns = std::min(next_ns, camera.NextTick_ns(now_ns));
  if (next_ns == INT64_MAX) return -1;
  return static_cast<int>((next_ns - now_ns) / 1'000'000 + 1);
}

void CameraServer::Impl::Tick() {
  const std::lock_guard lock(mutex);
  const int64_t now_ns = Now_ns();
  for (size_t i = 0; i < cameras.size(); ++i) Do(i, cameras[i].Tick(now_ns, shot));
}

void CameraServer::Impl::OnControl(size_t camera) {
  std::array<uint8_t, kMaxDatagram_bytes> buffer;
  for (int i = 0; i < kMaxDatagramsPerWake; ++i) {
    const auto datagram = ReceiveUdp(control_sockets[camera].get(), buffer);
    if (!datagram) return;
    const auto request = ParseGvcpRequest(datagram->bytes);
    if (!request) continue;
    const std::lock_guard lock(mutex);
    Answer(camera, *request, datagram->from);
  }
}

/// With the mutex held.
void CameraServer::Impl::Answer(size_t camera, const GvcpRequest& request, const Endpoint& from) {
  CameraActions actions = cameras[camera].Handle(request, from, Now_ns(), shot);
  if (!actions.answer.empty()) SendUdp(control_sockets[camera].get(), from, actions.answer);
  Do(camera, std::move(actions));
}

/// A client asks 255.255.255.255 who is there. Only this machine can reach the answer's addresses.
void CameraServer::Impl::OnDiscovery() {
  std::array<uint8_t, kMaxDatagram_bytes> buffer;
  for (int i = 0; i < kMaxDatagramsPerWake; ++i) {
    const auto datagram = ReceiveUdp(broadcasts.get(), buffer);
    if (!datagram) return;
    const auto request = ParseGvcpRequest(datagram->bytes);
    const bool is_discovery =
        request && request->command == static_cast<uint16_t>(GvcpCommand::kDiscovery);
    if (!is_discovery || !IsLoopback(datagram->from)) continue;
    const std::lock_guard lock(mutex);
    for (size_t camera = 0; camera < cameras.size(); ++camera) {
      Answer(camera, *request, datagram->from);
    }
  }
}

/// With the mutex held.
void CameraServer::Impl::Do(size_t camera, CameraActions actions) {
  const int index = static_cast<int>(camera);
  if (actions.cut) sender->Cut(index);
  for (FrameOrder& order : actions.frames) sender->Submit(std::move(order));
  if (actions.resend) sender->Resend(index, *actions.resend);
  if (actions.test_packet) {
    const auto& [to, size] = *actions.test_packet;
    SendUdp(stream_sockets[camera].get(), to, Bytes(size));
  }
}

int64_t CameraServer::Impl::Pulse(const TriggerPulse& pulse) {
  const std::lock_guard lock(mutex);
  for (size_t i = 0; i < cameras.size(); ++i) Do(i, cameras[i].Pulse(pulse, shot));
  if (options.pulse_advances_shot) ++shot;
  return pulse.rising_ns;
}

/// The cameras a command means.
Result<std::vector<size_t>> CameraServer::Impl::Find(const std::string& name) const {
  std::vector<size_t> found;
  for (size_t i = 0; i < options.cameras.size(); ++i) {
    const SimulatedCamera& camera = options.cameras[i];
    if (name == "all" || name == camera.name || name == camera.serial ||
        name == AddressText(cameras[i].settings().address)) {
      found.push_back(i);
    }
  }
  if (!found.empty()) return found;
  return Error{ErrorCode::kInvalidArgument,
               "no camera is called \"" + name +
                   "\"; expected a name, a serial number, an address "
                   "or all (\"list\" shows them)",
               "command"};
}

std::string CameraServer::Impl::List() {
  std::ostringstream text;
  for (size_t i = 0; i < cameras.size(); ++i) {
    const CameraCounters sent = sender->counters(static_cast<int>(i));
    const std::lock_guard lock(mutex);
    const GigeCamera& camera = cameras[i];
    text << AddressText(camera.settings().address) << ' ' << options.cameras[i].name << ' '
         << options.cameras[i].serial << ' '
         << (!camera.is_reachable(Now_ns()) ? "gone"
             : camera.is_acquiring()        ? "acquiring"
             : camera.is_controlled()       ? "controlled"
                                            : "free")
         << " frames " << sent.frames << " resent " << sent.packets_resent << " missed "
         << camera.missed_pulses() << FaultList(camera) << '\n';
  }
  return text.str();
}

void CameraServer::Impl::OnCommand() {
  std::array<char, kMaxDatagram_bytes> buffer;
  sockaddr_un from = {};
  socklen_t from_size = sizeof(from);
  const ssize_t count = ::recvfrom(commands.get(), buffer.data(), buffer.size(), 0,
                                   reinterpret_cast<sockaddr*>(&from), &from_size);
  if (count < 0) return;
  const auto command = ParseServerCommand({buffer.data(), static_cast<size_t>(count)});
  const Result<std::string> done = command.ok() ? Execute(*command) : command.error();
  // Who has bound no address of its own wants no answer.
  if (from_size <= offsetof(sockaddr_un, sun_path)) return;
  const std::string answer =
      done.ok() ? std::string(kDone) + *done : std::string(kRefused) + done.error().ToString();
  [[maybe_unused]] const ssize_t sent =
      ::sendto(commands.get(), answer.data(), answer.size(), MSG_DONTWAIT,
               reinterpret_cast<const sockaddr*>(&from), from_size);
}

void CameraServer::Impl::SetFault(size_t camera, const Fault& fault) {
  const std::lock_guard lock(mutex);
  Do(camera, cameras[camera].SetFault(fault, Now_ns()));
}

void CameraServer::Impl::ClearFaults(size_t camera) {
  const std::lock_guard lock(mutex);
  for (const FaultText& text : FaultTexts()) cameras[camera].ClearFault(text.kind);
}

Result<std::string> CameraServer::Impl::Execute(const ServerCommand& command) {
  using Kind = ServerCommand::Kind;
  if (command.kind == Kind::kList) return List();
  if (command.kind == Kind::kPulse) {
    const TriggerPulse pulse = {command.line, command.edge_ns.value_or(Now_ns()),
                                command.width_us * 1000};
    return "edge_ns " + std::to_string(Pulse(pulse));
  }
  if (command.kind == Kind::kShot) {
    const int last = options.shots > 0 ? options.shots - 1 : INT_MAX;
    if (command.shot < 0 || command.shot > last) {
      return Refused("shot", std::to_string(command.shot),
                     last == 0 ? "0, the only one" : "0 to " + std::to_string(last));
    }
    const std::lock_guard lock(mutex);
    shot = command.shot;
    return std::string("shot ") + std::to_string(shot);
  }
  if (command.kind == Kind::kFault) ROTUNDA_RETURN_IF_ERROR(command.fault.Validate());
  ROTUNDA_ASSIGN_OR_RETURN(const std::vector<size_t> found, Find(command.camera));
  for (const size_t camera : found) {
    if (command.kind == Kind::kFault) SetFault(camera, command.fault);
    if (command.kind == Kind::kClear) ClearFaults(camera);
  }
  return std::to_string(found.size()) + (found.size() == 1 ? " camera" : " cameras");
}

CameraServer::CameraServer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

CameraServer::~CameraServer() = default;

Result<std::unique_ptr<CameraServer>> CameraServer::Start(CameraServerOptions options) {
  ROTUNDA_RETURN_IF_ERROR(options.Validate());
  auto impl = std::make_unique<Impl>(std::move(options));
  ROTUNDA_RETURN_IF_ERROR(impl->Open());
  return std::unique_ptr<CameraServer>(new CameraServer(std::move(impl)));
}

int CameraServer::size() const { return static_cast<int>(impl_->options.cameras.size()); }

std::string CameraServer::address(int camera) const {
  return AddressText(impl_->cameras[static_cast<size_t>(camera)].settings().address);
}

const SimulatedCamera& CameraServer::camera(int camera) const {
  return impl_->options.cameras[static_cast<size_t>(camera)];
}

const std::filesystem::path& CameraServer::socket() const { return impl_->options.socket; }

int64_t CameraServer::Pulse(int line) { return impl_->Pulse({line, Now_ns()}); }

void CameraServer::SetShot(int shot) {
  const std::lock_guard lock(impl_->mutex);
  impl_->shot = shot;
}

Status CameraServer::SetFault(int camera, const Fault& fault) {
  ROTUNDA_RETURN_IF_ERROR(fault.Validate());
  if (camera < 0 || camera >= size()) {
    return Refused("camera", std::to_string(camera), "0 to " + std::to_string(size() - 1));
  }
  impl_->SetFault(static_cast<size_t>(camera), fault);
  return {};
}

void CameraServer::ClearFaults() {
  for (size_t i = 0; i < impl_->cameras.size(); ++i) impl_->ClearFaults(i);
}

CameraCounters CameraServer::counters(int camera) const {
  CameraCounters counters = impl_->sender->counters(camera);
  const std::lock_guard lock(impl_->mutex);
  counters.missed_pulses = impl_->cameras[static_cast<size_t>(camera)].missed_pulses();
  return counters;
}

Result<std::string> CameraServer::Execute(const ServerCommand& command) {
  return impl_->Execute(command);
}

Result<std::string> SendServerCommand(const std::filesystem::path& path,
                                      const std::string& command) {
  ROTUNDA_ASSIGN_OR_RETURN(const sockaddr_un address, SocketAddress(path));
  const Descriptor socket(::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  if (socket.get() < 0) return IoError("cannot make a socket", path.string());
  // An address that the kernel chooses, for the answer.
  sockaddr_un own = {};
  own.sun_family = AF_UNIX;
  const timeval patience = {kAnswer_ms / 1000, kAnswer_ms % 1000 * 1000};
  for (const int which : {SO_RCVTIMEO, SO_SNDTIMEO}) {
    ::setsockopt(socket.get(), SOL_SOCKET, which, &patience, sizeof(patience));
  }
  if (::bind(socket.get(), reinterpret_cast<const sockaddr*>(&own), sizeof(own.sun_family)) != 0 ||
      ::connect(socket.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0 ||
      ::send(socket.get(), command.data(), command.size(), 0) < 0) {
    if (errno == ENOENT || errno == ECONNREFUSED) {
      return Error{ErrorCode::kNotFound, "no simulator listens there", path.string()};
    }
    return IoError("cannot send to the simulator", path.string());
  }
  std::string answer(kMaxAnswer_bytes, '\0');
  const ssize_t count = ::recv(socket.get(), answer.data(), answer.size(), 0);
  if (count < 0) return IoError("no answer from the simulator", path.string());
  answer.resize(static_cast<size_t>(count));
  if (answer.starts_with(kDone)) return answer.substr(kDone.size());
  if (answer.starts_with(kRefused)) answer.erase(0, kRefused.size());
  return Error{ErrorCode::kFailed, answer.substr(0, answer.find('\n')), path.string()};
}

}  // namespace rotunda::sim
