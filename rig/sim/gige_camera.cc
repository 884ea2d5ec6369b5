#include "rig/sim/gige_camera.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdio>
#include <utility>

#include "rig/bandwidth.h"
#include "rig/sim/noise.h"
#include "sfm/core/run_context.h"

namespace rotunda::sim {
namespace {

constexpr uint32_t kGigeVision12 = 0x00010002;
constexpr uint32_t kBigEndianUtf8 = 0x80000001;
constexpr uint32_t kLinkLocalDhcp = 0x6;
/// Write memory, resend, concatenation; serial number and user-defined name are registers.
constexpr uint32_t kCapabilities = 1u << 0 | 1u << 1 | 1u << 2 | 1u << 30 | 1u << 31;
constexpr uint64_t kTicksPerSecond = 1'000'000'000;
constexpr uint32_t kDefaultHeartbeat_ms = 3000;
constexpr uint32_t kDefaultPacket_bytes = 1500;
constexpr double kDefaultExposure_us = 10000;
constexpr double kDefaultRate_hz = 5;
constexpr double kTemperature_C = 41;       // of a camera in a warm rig
constexpr double kTemperatureSpread_C = 6;  // between cameras
constexpr int64_t kBoot_ns = 500'000'000;   // after the command DeviceReset
/// Until PTP has found the master, and until it follows it. Real ones take seconds.
constexpr int64_t kPtpListening_ns = 100'000'000;
constexpr int64_t kPtpUncalibrated_ns = 300'000'000;
constexpr double kPtpResidual_ns = 200;  // of the clock from its master, at most
constexpr uint32_t kPacketSizeMask = 0xFFFF;
constexpr uint32_t kFlagTriggerOn = 1;

// What each random number of a camera is for.
enum SeedOf : uint64_t { kJitterSeed, kTemperatureSeed, kPtpSeed };

double Us(double us) { return us * 1e3; }

}  // namespace

GigeCamera::GigeCamera(Settings settings, std::string_view xml)
    : settings_(std::move(settings)), registers_(xml) {
  char url[64];
  std::snprintf(url, sizeof(url), "Local:rotunda.xml;%x;%zx", reg::kXml, xml.size());
  const uint32_t ip = settings_.address;
  registers_.Set(reg::kVersion, kGigeVision12);
  registers_.Set(reg::kDeviceMode, kBigEndianUtf8);
  // A locally administered address that follows from the IP address.
  registers_.Set(reg::kMacHigh, 0x0252);
  registers_.Set(reg::kMacLow, ip);
  registers_.Set(reg::kIpConfigSupported, kLinkLocalDhcp);
  registers_.Set(reg::kIpConfigCurrent, kLinkLocalDhcp);
  registers_.Set(reg::kCurrentIp, ip);
  registers_.Set(reg::kSubnetMask, 0xFF000000);
  registers_.SetText(reg::kVendorName, "Rotunda", 32);
  registers_.SetText(reg::kModelName, "SimulatedGigE", 32);
  registers_.SetText(reg::kManufacturerInfo, "simulated camera", 48);
  registers_.SetText(reg::kDeviceVersion, "1.0.0", 32);
  registers_.SetText(reg::kSerialNumber, settings_.camera.serial, 16);
  registers_.SetText(reg::kUserName, settings_.camera.name, 16);
  registers_.SetText(reg::kXmlUrl, url, sizeof(url));
  registers_.Set(reg::kInterfaces, 1);
  registers_.Set(reg::kStreamChannels, 1);
  registers_.Set(reg::kCapability, kCapabilities);
  registers_.Set64(reg::kTickFrequency, kTicksPerSecond);
  registers_.Set(reg::kSensorWidth, static_cast<uint32_t>(settings_.camera.width_px));
  registers_.Set(reg::kSensorHeight, static_cast<uint32_t>(settings_.camera.height_px));
  Random random(DeriveSeed(DeriveSeed(settings_.seed, kTemperatureSeed), ip));
  registers_.SetFloat(reg::kTemperature,
                      kTemperature_C + kTemperatureSpread_C * (random.Uniform() - 0.5));
  Reset();
}

/// As after switching on.
void GigeCamera::Reset() {
  registers_.Set(reg::kHeartbeatTimeout, kDefaultHeartbeat_ms);
  registers_.Set(reg::kStreamPacketSize, kDefaultPacket_bytes);
  registers_.Set(reg::kStreamPacketDelay, 0);
  registers_.Set(reg::kWidth, registers_.Get(reg::kSensorWidth));
  registers_.Set(reg::kHeight, registers_.Get(reg::kSensorHeight));
  registers_.Set(reg::kOffsetX, 0);
  registers_.Set(reg::kOffsetY, 0);
  registers_.Set(reg::kPixelFormat, static_cast<uint32_t>(settings_.camera.format));
  registers_.Set(reg::kAcquisitionMode, value::kModeContinuous);
  registers_.SetFloat(reg::kFrameRate, kDefaultRate_hz);
  registers_.Set(reg::kTriggerSelector, 0);
  registers_.Set(reg::kTriggerMode, 0);
  registers_.Set(reg::kTriggerSource, value::kSourceLine0);
  registers_.Set(reg::kTriggerActivation, value::kRisingEdge);
  registers_.SetFloat(reg::kTriggerDelay, 0);
  registers_.Set(reg::kExposureMode, 1);
  registers_.Set(reg::kExposureAuto, 0);
  registers_.SetFloat(reg::kExposureTime, kDefaultExposure_us);
  registers_.SetFloat(reg::kGain, 0);
  registers_.Set(reg::kGainAuto, 0);
  registers_.Set(reg::kChunkMode, 0);
  registers_.Set(reg::kPtpEnable, 0);
  registers_.Set64(reg::kTimestampLatched, 0);
  ptp_since_ns_.reset();
  block_id_ = 0;
  busy_until_ns_ = 0;
  ReleaseControl();
}

void GigeCamera::ReleaseControl() {
  controller_.reset();
  acquiring_ = false;
  registers_.Set(reg::kControlPrivilege, 0);
  registers_.Set(reg::kStreamPort, 0);
  registers_.Set(reg::kStreamAddress, 0);
  registers_.Set(reg::kAcquisition, 0);
}

bool GigeCamera::is_reachable(int64_t now_ns) const {
  return !Active(FaultKind::kUnplug) && now_ns >= booted_ns_;
}

/// Time on the camera's clock: its own, or the rig's once PTP follows it.
int64_t GigeCamera::CameraTime_ns(int64_t rig_time_ns) const {
  if (ptp_since_ns_ && rig_time_ns - *ptp_since_ns_ >= kPtpUncalibrated_ns) {
    return rig_time_ns + static_cast<int64_t>(registers_.Get64(reg::kPtpOffset));
  }
  return rig_time_ns + settings_.camera.clock_offset_ns;
}

/// Registers whose values come with time.
void GigeCamera::Refresh(int64_t now_ns) {
  const bool is_armed =
      acquiring_ && now_ns >= busy_until_ns_ && registers_.Get(reg::kTriggerMode) == kFlagTriggerOn;
  registers_.Set(reg::kTriggerArmed, is_armed ? 1 : 0);
  uint32_t status = value::kPtpDisabled;
  int64_t offset_ns = 0;
  if (ptp_since_ns_) {
    const int64_t since_ns = now_ns - *ptp_since_ns_;
    Random random(DeriveSeed(DeriveSeed(settings_.seed, kPtpSeed), settings_.address));
    const double residual_ns = random.Uniform(-kPtpResidual_ns, kPtpResidual_ns);
    if (Active(FaultKind::kNoPtp)) {
      status = value::kPtpListening;
      offset_ns = std::llround(residual_ns);  // as it was when the master was last heard
    } else if (since_ns >= kPtpUncalibrated_ns) {
      status = value::kPtpSlave;
      offset_ns = std::llround(residual_ns);
    } else {
      status = since_ns < kPtpListening_ns ? value::kPtpListening : value::kPtpUncalibrated;
      offset_ns = settings_.camera.clock_offset_ns;
    }
  }
  registers_.Set(reg::kPtpStatus, status);
  registers_.Set64(reg::kPtpOffset, static_cast<uint64_t>(offset_ns));
}

CameraActions GigeCamera::Handle(const GvcpRequest& request, const Endpoint& from, int64_t now_ns,
                                 int shot) {
  CameraActions actions = Tick(now_ns, shot);
  if (!is_reachable(now_ns)) return {};
  Refresh(now_ns);
  const bool owns = controller_ == from;
  if (owns) last_heartbeat_ns_ = now_ns;
  GvcpStatus status = request.status;
  Bytes data;
  const auto command = static_cast<GvcpCommand>(request.command);
  if (status == GvcpStatus::kSuccess && command == GvcpCommand::kPacketResend) {
    const Endpoint to{registers_.Get(reg::kStreamAddress),
                      static_cast<uint16_t>(registers_.Get(reg::kStreamPort))};
    actions.resend = {request.block_id, request.first_packet, request.last_packet, to};
  } else if (status == GvcpStatus::kSuccess && command == GvcpCommand::kDiscovery) {
    data = registers_.Read(0, reg::kDiscoveryEnd);
  } else if (status == GvcpStatus::kSuccess && !request.writes.empty()) {
    data.resize(4);
    for (const GvcpRequest::Write& write : request.writes) {
      status = Write(write, from, now_ns, actions);
      if (status != GvcpStatus::kSuccess) break;
      ActOnWrite(write.address, now_ns, shot, actions);
      WriteBig16(data, 2, static_cast<uint16_t>(ReadBig16(data, 2) + 1));
    }
  } else if (status == GvcpStatus::kSuccess) {
    status = Read(request, owns, data);
  }
  if (request.wants_answer) actions.answer = EncodeGvcpAnswer(request, status, data);
  return actions;
}

GvcpStatus GigeCamera::Read(const GvcpRequest& request, bool owns, Bytes& data) const {
  const bool is_exclusive =
      (registers_.Get(reg::kControlPrivilege) & value::kExclusiveAccess) != 0 && !owns;
  const ActiveFault* stolen = Active(FaultKind::kStealControl);
  for (const uint32_t address : request.read_registers) {
    if (address % 4 != 0) return GvcpStatus::kBadAlignment;
    if (!registers_.Contains(address, 4)) return GvcpStatus::kInvalidAddress;
    const bool is_privilege = address == reg::kControlPrivilege;
    if (is_exclusive && !is_privilege) return GvcpStatus::kAccessDenied;
    Bytes value = registers_.Read(address, 4);
    if (is_privilege && stolen && stolen->fault.value == 0) value.assign(4, 0);
    data.insert(data.end(), value.begin(), value.end());
  }
  if (request.read_registers.empty()) {
    if (is_exclusive) return GvcpStatus::kAccessDenied;
    if (!registers_.Contains(request.memory_address, request.memory_bytes)) {
      return GvcpStatus::kInvalidAddress;
    }
    data.resize(4);
    WriteBig32(data, 0, request.memory_address);
    const Bytes block = registers_.Read(request.memory_address, request.memory_bytes);
    data.insert(data.end(), block.begin(), block.end());
  }
  return GvcpStatus::kSuccess;
}

GvcpStatus GigeCamera::Write(const GvcpRequest::Write& write, const Endpoint& from, int64_t now_ns,
                             CameraActions& actions) {
  if (write.address % 4 != 0) return GvcpStatus::kBadAlignment;
  if (!registers_.Contains(write.address, write.data.size())) return GvcpStatus::kInvalidAddress;
  const Feature* feature = WritableAt(write.address);
  if (feature == nullptr) return GvcpStatus::kWriteProtect;
  if (feature->kind != Feature::Kind::kText && write.data.size() != feature->bytes) {
    return GvcpStatus::kInvalidParameter;
  }
  if (write.address == reg::kControlPrivilege) {
    return WritePrivilege(ReadBig32(write.data, 0), from, now_ns);
  }
  if (controller_ != from) return GvcpStatus::kAccessDenied;
  if (feature->locked && acquiring_) return GvcpStatus::kWriteProtect;
  if (write.address == reg::kStreamPacketSize) {
    return WritePacketSize(ReadBig32(write.data, 0), actions);
  }
  return WriteFeature(*feature, write);
}

void GigeCamera::ActOnWrite(uint32_t address, int64_t now_ns, int shot, CameraActions& actions) {
  const bool is_on = registers_.Get(address) != 0;
  switch (address) {
    case reg::kAcquisition:
      StartOrStop(is_on, now_ns);
      break;
    case reg::kTriggerSoftware:
      if (acquiring_ && registers_.Get(reg::kTriggerMode) == kFlagTriggerOn &&
          registers_.Get(reg::kTriggerSource) == value::kSourceSoftware) {
        Expose(now_ns, shot, actions);
      }
      break;
    case reg::kTimestampControl:
      registers_.Set64(reg::kTimestampLatched, static_cast<uint64_t>(CameraTime_ns(now_ns)));
      break;
    case reg::kPtpEnable:
      if (!is_on) ptp_since_ns_.reset();
      if (is_on && !ptp_since_ns_) ptp_since_ns_ = now_ns;
      break;
    case reg::kDeviceReset:
      Reset();
      booted_ns_ = now_ns + kBoot_ns;
      actions.cut = true;
      break;
    default:
      break;
  }
}

/// Checks the value and stores it.
GvcpStatus GigeCamera::WriteFeature(const Feature& feature, const GvcpRequest::Write& write) {
  if (feature.kind == Feature::Kind::kText) {
    if (write.data.size() > feature.bytes) return GvcpStatus::kInvalidParameter;
    registers_.SetText(
        feature.address,
        std::string_view(reinterpret_cast<const char*>(write.data.data()), write.data.size()),
        feature.bytes);
    return GvcpStatus::kSuccess;
  }
  const uint32_t code = ReadBig32(write.data, 0);
  bool ok = true;
  switch (feature.kind) {
    case Feature::Kind::kFloat: {
      const double number = std::bit_cast<double>(uint64_t{code} << 32 | ReadBig32(write.data, 4));
      ok = number >= feature.min && number <= feature.max;
      break;
    }
    case Feature::Kind::kEnumeration:
      ok = std::any_of(feature.entries.begin(), feature.entries.end(),
                       [&](const auto& entry) { return entry.second == code; });
      break;
    case Feature::Kind::kCommand:
      break;
    default:
      ok = code >= feature.min && code <= feature.max;
  }
  if (!ok) return GvcpStatus::kInvalidParameter;
  if (feature.address == reg::kStreamPacketDelay && code > settings_.camera.max_packet_delay_ns) {
    registers_.Set(reg::kStreamPacketDelay, settings_.camera.max_packet_delay_ns);
    return GvcpStatus::kSuccess;
  }
  const Bytes before = registers_.Read(feature.address, write.data.size());
  registers_.SetBytes(feature.address, write.data);
  if (FitsSensor()) return GvcpStatus::kSuccess;
  registers_.SetBytes(feature.address, before);
  return GvcpStatus::kInvalidParameter;
}

bool GigeCamera::FitsSensor() const {
  const auto sum = [&](uint32_t a, uint32_t b) { return registers_.Get(a) + registers_.Get(b); };
  return sum(reg::kOffsetX, reg::kWidth) <= registers_.Get(reg::kSensorWidth) &&
         sum(reg::kOffsetY, reg::kHeight) <= registers_.Get(reg::kSensorHeight);
}

GvcpStatus GigeCamera::WritePrivilege(uint32_t privilege, const Endpoint& from, int64_t now_ns) {
  if (controller_ && controller_ != from) return GvcpStatus::kAccessDenied;
  const uint32_t asked = privilege & (value::kExclusiveAccess | value::kControlAccess);
  if (asked == 0) {
    ReleaseControl();
    return GvcpStatus::kSuccess;
  }
  controller_ = from;
  last_heartbeat_ns_ = now_ns;
  registers_.Set(reg::kControlPrivilege, asked);
  return GvcpStatus::kSuccess;
}

/// The register holds the size alone; bit 0 (the highest) asks for one packet of it.
GvcpStatus GigeCamera::WritePacketSize(uint32_t text, CameraActions& actions) {
  const uint32_t size = text & kPacketSizeMask;
  const Feature& feature = *WritableAt(reg::kStreamPacketSize);
  if (size < feature.min || size > feature.max) return GvcpStatus::kInvalidParameter;
  registers_.Set(reg::kStreamPacketSize, size);
  const auto port = static_cast<uint16_t>(registers_.Get(reg::kStreamPort));
  const bool arrives = size <= static_cast<uint32_t>(settings_.path_mtu_bytes);
  if ((text & value::kFireTestPacket) != 0 && port != 0 && arrives) {
    actions.test_packet = {{registers_.Get(reg::kStreamAddress), port}, size - kIpUdpHeader_bytes};
  }
  return GvcpStatus::kSuccess;
}

void GigeCamera::StartOrStop(bool start, int64_t now_ns) {
  if (start && !acquiring_) {
    if (settings_.restart_frame_ids) block_id_ = 0;
    is_fresh_ = true;
    next_free_run_ns_ = now_ns;
  }
  acquiring_ = start;
}

CameraActions GigeCamera::Tick(int64_t now_ns, int shot) {
  CameraActions actions;
  const int64_t timeout_ns = int64_t{registers_.Get(reg::kHeartbeatTimeout)} * 1'000'000;
  if (controller_ && !Active(FaultKind::kStealControl) &&
      now_ns - last_heartbeat_ns_ > timeout_ns) {
    ReleaseControl();
    actions.cut = true;
  }
  if (acquiring_ && registers_.Get(reg::kTriggerMode) != kFlagTriggerOn && is_reachable(now_ns) &&
      now_ns >= next_free_run_ns_) {
    next_free_run_ns_ = now_ns + std::llround(1e9 / registers_.GetFloat(reg::kFrameRate));
    Expose(now_ns, shot, actions);
  }
  return actions;
}

int64_t GigeCamera::NextTick_ns(int64_t now_ns) const {
  int64_t next_ns = INT64_MAX;
  if (controller_ && !Active(FaultKind::kStealControl)) {
    next_ns = last_heartbeat_ns_ + int64_t{registers_.Get(reg::kHeartbeatTimeout)} * 1'000'000;
  }
  if (acquiring_ && registers_.Get(reg::kTriggerMode) != kFlagTriggerOn) {
    next_ns = std::min(next_ns, next_free_run_ns_);
  }
  return std::max(next_ns, now_ns + 1);
}

CameraActions GigeCamera::Pulse(const TriggerPulse& pulse, int shot) {
  CameraActions actions;
  const bool listens = registers_.Get(reg::kTriggerMode) == kFlagTriggerOn &&
                       registers_.Get(reg::kTriggerSource) == static_cast<uint32_t>(pulse.line);
  if (!is_reachable(pulse.rising_ns) || !acquiring_ || !listens) {
    ++missed_pulses_;
    return actions;
  }
  if (Take(FaultKind::kMute)) return actions;
  const bool falls = registers_.Get(reg::kTriggerActivation) == value::kFallingEdge;
  const int64_t edge_ns = pulse.rising_ns + (falls ? pulse.width_ns : 0);
  const std::optional<double> second_ms = Take(FaultKind::kSecondPulse);
  Expose(edge_ns, shot, actions);
  if (second_ms) Expose(edge_ns + std::llround(*second_ms * 1e6), shot, actions);
  return actions;
}

void GigeCamera::Expose(int64_t edge_ns, int shot, CameraActions& actions) {
  const bool is_first = std::exchange(is_fresh_, false);
  const int64_t idle_ns = edge_ns - std::exchange(last_edge_ns_, edge_ns);
  const ActiveFault* asleep = Active(FaultKind::kFirstFrameLost);
  if (asleep && (is_first || static_cast<double>(idle_ns) > asleep->fault.value * 1e6)) {
    Take(FaultKind::kFirstFrameLost);
    return;
  }
  const bool has_stream = registers_.Get(reg::kStreamPort) != 0;
  if (!acquiring_ || !has_stream || edge_ns < busy_until_ns_) {
    ++missed_pulses_;
    return;
  }
  actions.frames.push_back(MakeOrder(edge_ns, shot));
  if (registers_.Get(reg::kAcquisitionMode) == value::kModeSingleFrame) {
    acquiring_ = false;
    registers_.Set(reg::kAcquisition, 0);
  }
}

FrameOrder GigeCamera::MakeOrder(int64_t edge_ns, int shot) {
  FrameOrder order;
  order.camera = settings_.index;
  order.number = exposures_++;
  const uint32_t code = registers_.Get(reg::kPixelFormat);
  const PixelFormat format = *PixelFormatOfCode(code);
  const double exposure_us = registers_.GetFloat(reg::kExposureTime);
  order.exposure = {settings_.index, shot, format, exposure_us, registers_.GetFloat(reg::kGain)};
  Random random(DeriveSeed(DeriveSeed(DeriveSeed(settings_.seed, kJitterSeed), settings_.address),
                           order.number));
  const double delay_us = settings_.camera.exposure_delay_us +
                          settings_.camera.exposure_jitter_us * random.Normal() +
                          registers_.GetFloat(reg::kTriggerDelay);
  const double skew_ms = Take(FaultKind::kSkew).value_or(0);
  const int64_t begin_ns =
      edge_ns + std::llround(std::max(0.0, Us(delay_us))) + std::llround(skew_ms * 1e6);
  busy_until_ns_ = begin_ns + std::llround(Us(exposure_us));
  order.start_ns = busy_until_ns_;
  if (Take(FaultKind::kRestartIds)) block_id_ = 0;
  if (++block_id_ == 0) block_id_ = 1;
  GvspFrame& frame = order.frame;
  frame.block_id = block_id_;
  frame.timestamp_ticks = static_cast<uint64_t>(CameraTime_ns(begin_ns));
  frame.pixel_format = code;
  frame.width_px = registers_.Get(reg::kWidth);
  frame.height_px = registers_.Get(reg::kHeight);
  frame.offset_x_px = registers_.Get(reg::kOffsetX);
  frame.offset_y_px = registers_.Get(reg::kOffsetY);
  frame.payload_bytes = size_t{frame.width_px} * frame.height_px * BytesPerPixel(format);
  frame.packet_size_bytes = registers_.Get(reg::kStreamPacketSize);
  order.to = {registers_.Get(reg::kStreamAddress),
              static_cast<uint16_t>(registers_.Get(reg::kStreamPort))};
  const double packet_ns = (frame.packet_size_bytes + rig::kEthernetOverhead_bytes) * 8 /
                           settings_.link_bits_per_s * 1e9;
  order.packet_interval_ns = std::llround(packet_ns) + registers_.Get(reg::kStreamPacketDelay);
  order.drop_data = frame.packet_size_bytes > static_cast<uint32_t>(settings_.path_mtu_bytes);
  ApplyFaults(order);
  return order;
}

void GigeCamera::ApplyFaults(FrameOrder& order) {
  order.drop_probability = Take(FaultKind::kDropPackets).value_or(0);
  order.drop_leader = Take(FaultKind::kDropLeader).has_value();
  order.drop_trailer = Take(FaultKind::kDropTrailer).has_value();
  order.resend = !Take(FaultKind::kNoResend).has_value();
  order.start_ns += std::llround(Take(FaultKind::kLate).value_or(0) * 1e6);
  if (const auto offset = Take(FaultKind::kWrongFrameId)) {
    const auto id = static_cast<uint16_t>(order.frame.block_id + std::lround(*offset));
    order.frame.block_id = id == 0 ? 1 : id;
  }
  if (const auto part = Take(FaultKind::kUnplugInFrame)) {
    order.unplug_at_packet = static_cast<uint32_t>(*part * PacketCount(order.frame));
  }
}

const GigeCamera::ActiveFault* GigeCamera::Active(FaultKind kind) const {
  const auto& fault = faults_[static_cast<size_t>(kind)];
  return fault ? &*fault : nullptr;
}

std::optional<double> GigeCamera::Take(FaultKind kind) {
  auto& fault = faults_[static_cast<size_t>(kind)];
  if (!fault) return std::nullopt;
  const double value = fault->fault.value;
  const bool is_once = kind == FaultKind::kRestartIds || kind == FaultKind::kUnplugInFrame;
  if (is_once || (fault->frames_left > 0 && --fault->frames_left == 0)) fault.reset();
  return value;
}

CameraActions GigeCamera::SetFault(const Fault& fault, int64_t now_ns) {
  CameraActions actions;
  switch (fault.kind) {
    case FaultKind::kReboot:
      Reset();
      booted_ns_ = now_ns + std::llround(fault.value * 1e6);
      actions.cut = true;
      return actions;
    case FaultKind::kUnplug:
      Unplug();
      actions.cut = true;
      return actions;
    case FaultKind::kStealControl:
      ReleaseControl();
      controller_ = Endpoint{};
      registers_.Set(reg::kControlPrivilege, value::kExclusiveAccess);
      actions.cut = true;
      break;
    default:
      break;
  }
  faults_[static_cast<size_t>(fault.kind)] = ActiveFault{fault, fault.frames};
  return actions;
}

void GigeCamera::ClearFault(FaultKind kind) {
  auto& fault = faults_[static_cast<size_t>(kind)];
  const bool was_in_force = fault.has_value();
  fault.reset();
  if (kind == FaultKind::kStealControl && was_in_force) ReleaseControl();
  if (kind == FaultKind::kUnplug && was_in_force) Reset();
}

std::vector<Fault> GigeCamera::faults() const {
  std::vector<Fault> in_force;
  for (const auto& active : faults_) {
    if (active) in_force.push_back({active->fault.kind, active->fault.value, active->frames_left});
  }
  return in_force;
}

void GigeCamera::Unplug() {
  faults_[static_cast<size_t>(FaultKind::kUnplug)] = ActiveFault{{FaultKind::kUnplug}};
  ReleaseControl();
}

}  // namespace rotunda::sim
