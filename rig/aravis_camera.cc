#include "rig/aravis_camera.h"

#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <thread>

#include "rig/aravis_object.h"
#include "rig/aravis_settings.h"
#include "rig/aravis_stream.h"
#include "rig/camera_discovery.h"

namespace rotunda::rig {
namespace {

using Clock = Camera::Clock;
using std::chrono::milliseconds;

// GigE Vision bootstrap registers, which every camera has.
constexpr uint64_t kControlPrivilegeRegister = 0x0A00;
constexpr uint32_t kControlPrivilegeBits = 0x3;         // control, exclusive
constexpr uint64_t kHeartbeatTimeoutRegister = 0x0938;  // ms
constexpr uint64_t kTickFrequencyRegister = 0x093C;
constexpr uint64_t kTimestampControlRegister = 0x0944;
constexpr uint32_t kTimestampLatch = 0x2;
constexpr uint64_t kTimestampValueRegister = 0x0948;

constexpr auto kProbePatience = milliseconds(400);
constexpr auto kArmedPollInterval = milliseconds(1);

uint64_t FromBigEndian(const uint8_t* bytes) {
  uint64_t value = 0;
  for (int i = 0; i < 8; ++i) value = value << 8 | bytes[i];
  return value;
}

class AravisCamera final : public Camera {
 public:
  AravisCamera(GObjectPtr<ArvCamera> camera, CameraIdentity identity)
      : camera_(std::move(camera)),
        device_(arv_camera_get_device(camera_.get())),
        identity_(std::move(identity)) {
    control_lost_handler_ =
        g_signal_connect(device_, "control-lost", G_CALLBACK(&AravisCamera::OnControlLost), this);
  }
  ~AravisCamera() override;

  Status ReadProperties();

  const CameraIdentity& identity() const override { return identity_; }
  Result<AppliedSettings> Apply(const CameraSettings& settings) override;
  Status Arm(TriggerBy by, FrameBlock memory) override;
  Status Refill(FrameBlock memory) override;
  Status StartOver(FrameBlock memory) override;
  Result<bool> WaitArmed(Clock::time_point deadline) override;
  Status SoftwareTrigger() override;
  std::optional<CameraFrame> Fetch(Clock::time_point deadline) override;
  Status Disarm() override;
  Result<ClockSample> SampleClock() override;
  StreamCounters counters() const override;
  Result<CameraHealth> ReadHealth() override;
  Status CheckPtp() override { return rig::CheckPtp(camera_.get()); }
  bool LostControl() override;

 private:
  static void OnControlLost(ArvDevice*, gpointer self) {
    static_cast<AravisCamera*>(self)->control_lost_ = true;
  }
  bool Has(const char* feature) const { return HasFeature(camera_.get(), feature); }
  Status SetTriggerSource(const std::string& source);
  Status CheckControl();
  Status CheckMemory(const FrameBlock& memory) const;
  Result<bool> ReadArmed();

  GObjectPtr<ArvCamera> camera_;
  ArvDevice* device_;                     // camera_'s
  std::unique_ptr<AravisStream> stream_;  // null until settings were applied
  CameraIdentity identity_;
  gulong control_lost_handler_ = 0;
  std::atomic<bool> control_lost_ = false;  // set by Aravis' heartbeat thread

  double tick_frequency_hz_ = 1e9;
  const char* armed_feature_ = nullptr;  // what tells that a trigger would be answered
  const char* temperature_feature_ = nullptr;

  std::string line_source_;     // of CameraSettings
  std::string trigger_source_;  // as it is now
  bool ptp_ = false;
  bool acquiring_ = false;  // stream_ is not null then
};

AravisCamera::~AravisCamera() {
  g_signal_handler_disconnect(device_, control_lost_handler_);
  stream_.reset();
  // A camera that is gone would keep us waiting for seconds; there is nothing to stop.
  if (acquiring_ && !control_lost_) arv_camera_stop_acquisition(camera_.get(), nullptr);
}

Status AravisCamera::ReadProperties() {
  GErrorSlot error;
  std::array<uint8_t, 8> bytes{};
  arv_device_read_memory(device_, kTickFrequencyRegister, bytes.size(), bytes.data(), error.out());
  ROTUNDA_RETURN_IF_ERROR(error.status("timestamp tick frequency"));
  if (const uint64_t ticks = FromBigEndian(bytes.data()); ticks > 0) {
    tick_frequency_hz_ = static_cast<double>(ticks);
  }
  for (const char* name : {"DeviceFirmwareVersion", "DeviceVersion"}) {
    if (!Has(name)) continue;
    const Result<std::string> firmware = ReadText(camera_.get(), name);
    identity_.firmware = firmware ? *firmware : "";
    break;
  }
  if (Has("DeviceTemperature")) temperature_feature_ = "DeviceTemperature";
  if (Has("TriggerArmed")) {
    armed_feature_ = "TriggerArmed";
  } else if (Has("AcquisitionStatusSelector") && Has("AcquisitionStatus")) {
    ROTUNDA_RETURN_IF_ERROR(
        WriteText(camera_.get(), "AcquisitionStatusSelector", "FrameTriggerWait"));
    armed_feature_ = "AcquisitionStatus";
  }
  return {};
}

Status AravisCamera::SetTriggerSource(const std::string& source) {
  if (trigger_source_ == source) return {};
  trigger_source_.clear();
  ROTUNDA_RETURN_IF_ERROR(WriteText(camera_.get(), "TriggerSource", source));
  trigger_source_ = source;
  return {};
}

Result<AppliedSettings> AravisCamera::Apply(const CameraSettings& settings) {
  ArvCamera* camera = camera_.get();
  ROTUNDA_RETURN_IF_ERROR(Disarm());
  stream_.reset();
  ROTUNDA_RETURN_IF_ERROR(ApplyPicture(camera, settings));
  ROTUNDA_RETURN_IF_ERROR(ApplyExposure(camera, settings));
  ROTUNDA_RETURN_IF_ERROR(ApplyTriggerMode(camera));
  line_source_ = settings.trigger_source;
  trigger_source_.clear();
  ROTUNDA_RETURN_IF_ERROR(SetTriggerSource(line_source_));
  ptp_ = settings.ptp;
  if (ptp_) ROTUNDA_RETURN_IF_ERROR(ApplyPtp(camera));
  ROTUNDA_ASSIGN_OR_RETURN(stream_, AravisStream::Open(camera, settings));
  ROTUNDA_ASSIGN_OR_RETURN(AppliedSettings applied, ReadSettings(camera, settings));
  applied.payload_bytes = stream_->payload_bytes();
  // Before the gap between packets, which a camera may refuse when it is very long.
  ROTUNDA_RETURN_IF_ERROR(
      CheckInTime({applied.payload_bytes, applied.packet_size_bytes, applied.exposure_us},
                  settings.uplink, settings.deadline_ms));
  ROTUNDA_ASSIGN_OR_RETURN(
      applied.packet_delay_ns,
      ApplyPacketDelay(camera, applied.packet_size_bytes, settings.uplink.Share()));
  return applied;
}

Status AravisCamera::CheckControl() {
  GErrorSlot error;
  guint32 privilege = 0;
  if (!control_lost_) {
    arv_device_read_register(device_, kControlPrivilegeRegister, &privilege, error.out());
    if (error.IsDenied()) control_lost_ = true;
    ROTUNDA_RETURN_IF_ERROR(error.status("control"));
  }
  if ((privilege & kControlPrivilegeBits) == 0) {
    control_lost_ = true;
    return Error{ErrorCode::kFailed, "was lost: the camera was restarted or gave us up", "control"};
  }
  return {};
}

bool AravisCamera::LostControl() {
  if (!CheckControl()) return control_lost_;
  // A camera that does not tell who asks shows the other's privilege: but it obeys only that one.
  GErrorSlot error;
  guint32 timeout_ms = 0;
  arv_device_read_register(device_, kHeartbeatTimeoutRegister, &timeout_ms, error.out());
  if (!error) {
    arv_device_write_register(device_, kHeartbeatTimeoutRegister, timeout_ms, error.out());
  }
  if (error.IsDenied()) control_lost_ = true;
  return control_lost_;
}

Status AravisCamera::CheckMemory(const FrameBlock& memory) const {
  if (stream_) return stream_->CheckMemory(memory);
  return Error{ErrorCode::kInvalidArgument, "were not applied before it was armed", "settings"};
}

Status AravisCamera::Refill(FrameBlock memory) {
  ROTUNDA_RETURN_IF_ERROR(CheckMemory(memory));
  if (!acquiring_) return Arm(TriggerBy::kLine, std::move(memory));
  ROTUNDA_RETURN_IF_ERROR(CheckControl());
  stream_->Lend(std::move(memory));
  return {};
}

Status AravisCamera::StartOver(FrameBlock memory) {
  ROTUNDA_RETURN_IF_ERROR(CheckMemory(memory));
  stream_->Begin(std::move(memory));
  return {};
}

Status AravisCamera::Arm(TriggerBy by, FrameBlock memory) {
  ROTUNDA_RETURN_IF_ERROR(CheckMemory(memory));
  ROTUNDA_RETURN_IF_ERROR(Disarm());
  ROTUNDA_RETURN_IF_ERROR(CheckControl());
  ROTUNDA_RETURN_IF_ERROR(SetTriggerSource(by == TriggerBy::kLine ? line_source_ : "Software"));
  stream_->Begin(std::move(memory));
  acquiring_ = true;
  GErrorSlot error;
  arv_camera_start_acquisition(camera_.get(), error.out());
  return error.status("AcquisitionStart");
}

Result<bool> AravisCamera::ReadArmed() {
  GErrorSlot error;
  const bool armed = arv_camera_get_boolean(camera_.get(), armed_feature_, error.out());
  ROTUNDA_RETURN_IF_ERROR(error.status(armed_feature_));
  return armed;
}

Result<bool> AravisCamera::WaitArmed(Clock::time_point deadline) {
  if (armed_feature_ == nullptr) return true;
  while (true) {
    ROTUNDA_ASSIGN_OR_RETURN(const bool armed, ReadArmed());
    if (armed) return true;
    if (Clock::now() > deadline) return false;
    std::this_thread::sleep_for(kArmedPollInterval);
  }
}

Status AravisCamera::SoftwareTrigger() {
  GErrorSlot error;
  arv_camera_software_trigger(camera_.get(), error.out());
  return error.status("TriggerSoftware");
}

std::optional<CameraFrame> AravisCamera::Fetch(Clock::time_point deadline) {
  return stream_ ? stream_->Fetch(deadline) : std::nullopt;
}

Status AravisCamera::Disarm() {
  GErrorSlot error;
  if (acquiring_ && !control_lost_) {
    arv_camera_stop_acquisition(camera_.get(), error.out());
    // Packets of a frame that nobody took must not be taken for the next one.
    stream_->WaitForStragglers();
  }
  acquiring_ = false;
  if (stream_) stream_->End();
  return error.status("AcquisitionStop");
}

Result<ClockSample> AravisCamera::SampleClock() {
  GErrorSlot error;
  const auto before = Clock::now();
  arv_device_write_register(device_, kTimestampControlRegister, kTimestampLatch, error.out());
  const auto after = Clock::now();
  ROTUNDA_RETURN_IF_ERROR(error.status("timestamp latch"));
  std::array<uint8_t, 8> bytes{};
  arv_device_read_memory(device_, kTimestampValueRegister, bytes.size(), bytes.data(), error.out());
  ROTUNDA_RETURN_IF_ERROR(error.status("timestamp"));
  const auto ticks = static_cast<double>(FromBigEndian(bytes.data()));
  const bool is_ns = tick_frequency_hz_ == 1e9;
  const int64_t camera_ns = is_ns ? static_cast<int64_t>(FromBigEndian(bytes.data()))
                                  : std::llround(ticks * (1e9 / tick_frequency_hz_));
  const int64_t half_trip_ns =
      std::chrono::duration_cast<std::chrono::nanoseconds>(after - before).count() / 2;
  const int64_t middle_ns =
      std::chrono::duration_cast<std::chrono::nanoseconds>(before.time_since_epoch()).count() +
      half_trip_ns;
  return ClockSample{middle_ns - camera_ns, half_trip_ns};
}

StreamCounters AravisCamera::counters() const {
  return stream_ ? stream_->counters() : StreamCounters();
}

Result<CameraHealth> AravisCamera::ReadHealth() {
  CameraHealth health;
  ROTUNDA_RETURN_IF_ERROR(CheckControl());
  health.control_held = true;
  GErrorSlot error;
  if (temperature_feature_ != nullptr) {
    health.temperature_deg_c =
        arv_camera_get_float(camera_.get(), temperature_feature_, error.out());
    ROTUNDA_RETURN_IF_ERROR(error.status(temperature_feature_));
  }
  if (ptp_) {
    if (const Result<int64_t> offset = PtpOffset_ns(camera_.get())) health.ptp_offset_ns = *offset;
  }
  return health;
}

}  // namespace

Result<std::unique_ptr<Camera>> OpenAravisCamera(const CameraPlace& place) {
  ROTUNDA_ASSIGN_OR_RETURN(CameraIdentity identity, ProbeCamera(place.address, kProbePatience));
  if (!place.serial.empty() && identity.serial != place.serial) {
    return Error{
        ErrorCode::kBadInput,
        "serial " + place.serial + " expected at " + place.address + ", found " + identity.serial,
        ""};
  }
  GErrorSlot error;
  GObjectPtr<ArvCamera> camera(arv_camera_new(place.address.c_str(), error.out()));
  const bool is_taken =
      camera ? !arv_gv_device_is_controller(ARV_GV_DEVICE(arv_camera_get_device(camera.get())))
             : RefusesToBeRead(place.address, kProbePatience);
  if (is_taken) {
    return Error{ErrorCode::kAlreadyExists,
                 "another program controls it (close that, or wait for its heartbeat to run out)",
                 place.address};
  }
  if (!camera) {
    return Error{ErrorCode::kFailed, "it answers, but cannot be opened: " + error.message(),
                 place.address};
  }
  auto opened = std::make_unique<AravisCamera>(std::move(camera), std::move(identity));
  ROTUNDA_RETURN_IF_ERROR(opened->ReadProperties());
  return std::unique_ptr<Camera>(std::move(opened));
}

}  // namespace rotunda::rig
