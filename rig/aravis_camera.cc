#include "rig/aravis_camera.h"

#include <arv.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstring>
#include <string_view>
#include <thread>

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

// A busy machine may not get to a camera's packets for hundreds of milliseconds; Aravis' own 100 ms
// loses frames then.
constexpr guint kFrameRetention_us = 1'000'000;
// Lost packets are asked for again after this. With Aravis' 20 ms a camera that only paused is
// taken for one that loses packets: a third of all was sent twice on a busy machine.
constexpr guint kPacketTimeout_us = 100'000;
// Of a frame's packets so many may be asked for again. Aravis' own quarter gives frames up that a
// busy machine was only late to read.
constexpr double kPacketRequestRatio = 1.0;
// The kernel counts a packet with its bookkeeping, about twice its bytes: with this a whole frame
// waits in the socket when the thread that reads it does not get to run.
constexpr int kSocketBufferPerPayload = 2;

constexpr auto kProbePatience = milliseconds(400);
constexpr auto kArmedPollInterval = milliseconds(1);
constexpr auto kPtpPatience = std::chrono::seconds(15);
constexpr auto kPtpPollInterval = milliseconds(100);
constexpr int64_t kPtpOffsetLimit_ns = 10'000;
// Packets of an earlier frame: none for so long means that no more come.
constexpr auto kQuietTime = milliseconds(20);
constexpr auto kQuietPatience = milliseconds(400);

// A value read back may differ by the camera's own steps.
constexpr double kRelativeTolerance = 0.01;
constexpr double kAbsoluteTolerance = 0.1;

struct Unref {
  void operator()(gpointer object) const { g_object_unref(object); }
};
template <typename T>
using GObjectPtr = std::unique_ptr<T, Unref>;

/// Takes the GError of one call; clears it.
class GErrorSlot {
 public:
  GErrorSlot() = default;
  ~GErrorSlot() { g_clear_error(&error_); }
  GErrorSlot(const GErrorSlot&) = delete;
  GErrorSlot& operator=(const GErrorSlot&) = delete;

  GError** out() {
    g_clear_error(&error_);
    return &error_;
  }
  explicit operator bool() const { return error_ != nullptr; }
  /// The camera answered that the caller may not do this.
  bool IsDenied() const {
    return g_error_matches(error_, ARV_DEVICE_ERROR, ARV_DEVICE_ERROR_NOT_CONTROLLER) ||
           g_error_matches(error_, ARV_DEVICE_ERROR, ARV_DEVICE_ERROR_PROTOCOL_ERROR_ACCESS_DENIED);
  }
  std::string message() const { return error_ == nullptr ? "" : error_->message; }
  Error ToError(const std::string& what) const { return {ErrorCode::kFailed, message(), what}; }
  Status status(const std::string& what) const {
    return error_ == nullptr ? Status() : Status(ToError(what));
  }

 private:
  GError* error_ = nullptr;
};

std::string Text(const char* text) { return text == nullptr ? "" : text; }

uint64_t FromBigEndian(const uint8_t* bytes) {
  uint64_t value = 0;
  for (int i = 0; i < 8; ++i) value = value << 8 | bytes[i];
  return value;
}

bool Near(double a, double b) {
  return std::abs(a - b) <= std::max(kAbsoluteTolerance, kRelativeTolerance * std::abs(b));
}

Error ReadBackError(const std::string& feature, const std::string& wanted,
                    const std::string& found) {
  return {ErrorCode::kFailed, "was set to " + wanted + ", but the camera has " + found, feature};
}

void DeleteBlock(gpointer block) { delete static_cast<FrameBlock*>(block); }

/// A buffer for Aravis over memory of ours, which comes back when the buffer goes.
GObjectPtr<ArvBuffer> MakeBuffer(FrameBlock memory, size_t payload_bytes) {
  auto* block = new FrameBlock(std::move(memory));
  return GObjectPtr<ArvBuffer>(
      arv_buffer_new_full(payload_bytes, block->data(), block, &DeleteBlock));
}

FrameBlock TakeMemory(ArvBuffer* buffer) {
  auto* block = static_cast<FrameBlock*>(const_cast<void*>(arv_buffer_get_user_data(buffer)));
  return std::move(*block);
}

struct PixelFormatName {
  ArvPixelFormat format;
  const char* name;
};
constexpr std::array<PixelFormatName, 6> kPixelFormats = {{
    {ARV_PIXEL_FORMAT_MONO_8, "Mono8"},
    {ARV_PIXEL_FORMAT_BAYER_RG_8, "BayerRG8"},
    {ARV_PIXEL_FORMAT_BAYER_GB_8, "BayerGB8"},
    {ARV_PIXEL_FORMAT_BAYER_GR_8, "BayerGR8"},
    {ARV_PIXEL_FORMAT_BAYER_BG_8, "BayerBG8"},
    {ARV_PIXEL_FORMAT_RGB_8_PACKED, "RGB8"},
}};

std::string NameOf(ArvPixelFormat format) {
  for (const PixelFormatName& known : kPixelFormats) {
    if (known.format == format) return known.name;
  }
  return "pixel format " + std::to_string(format);
}

bool IsKnown(const std::string& pixel_format) {
  return std::any_of(std::begin(kPixelFormats), std::end(kPixelFormats),
                     [&](const PixelFormatName& known) { return known.name == pixel_format; });
}

std::string WhyIncomplete(ArvBufferStatus status, uint64_t missing_packets) {
  switch (status) {
    case ARV_BUFFER_STATUS_TIMEOUT:
    case ARV_BUFFER_STATUS_MISSING_PACKETS:
      return missing_packets == 0 ? "packets were lost"
                                  : std::to_string(missing_packets) + " packets were lost";
    case ARV_BUFFER_STATUS_WRONG_PACKET_ID:
      return "packets came in a wrong order";
    case ARV_BUFFER_STATUS_SIZE_MISMATCH:
      return "the camera sent more or less than its payload size says";
    default:
      return "receiving ended with status " + std::to_string(status);
  }
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
  Result<bool> WaitArmed(Clock::time_point deadline) override;
  Status SoftwareTrigger() override;
  std::optional<CameraFrame> Fetch(Clock::time_point deadline) override;
  Status Disarm() override;
  Result<ClockSample> SampleClock() override;
  StreamCounters counters() const override;
  Result<CameraHealth> ReadHealth() override;
  Status CheckPtp() override;
  bool LostControl() override;

 private:
  static void OnControlLost(ArvDevice*, gpointer self) {
    static_cast<AravisCamera*>(self)->control_lost_ = true;
  }
  bool Has(const char* feature) const {
    return arv_camera_is_feature_available(camera_.get(), feature, nullptr);
  }
  Status SetText(const char* feature, const std::string& value);
  Status SetTextIfOffered(const char* feature, const std::string& value);
  Status SetNumber(const char* feature, double value);
  Status ApplyPicture(const CameraSettings& settings);
  Status ApplyExposure(const CameraSettings& settings);
  Status ApplyTrigger(const CameraSettings& settings);
  Status ApplyPtp();
  Status ApplyTransport(const CameraSettings& settings);
  Status ApplyPacketDelay(const BandwidthShare& bandwidth);
  Status SetTriggerSource(const std::string& source);
  Result<AppliedSettings> ReadBack(const CameraSettings& settings);
  Status CheckControl();
  Status CheckMemory(const FrameBlock& memory) const;
  void Lend(FrameBlock memory);
  Result<int64_t> PtpOffset_ns();
  Result<bool> ReadArmed();
  uint64_t Counter(const char* name) const {
    return arv_stream_get_info_uint64_by_name(stream_.get(), name);
  }
  void DropBuffers();
  void CloseStream();
  void WaitUntilQuiet();
  CameraFrame Describe(ArvBuffer* buffer) const;

  GObjectPtr<ArvCamera> camera_;
  ArvDevice* device_;  // camera_'s
  GObjectPtr<ArvStream> stream_;
  CameraIdentity identity_;
  gulong control_lost_handler_ = 0;
  std::atomic<bool> control_lost_ = false;  // set by Aravis' heartbeat thread

  double tick_frequency_hz_ = 1e9;
  const char* armed_feature_ = nullptr;  // what tells that a trigger would be answered
  const char* temperature_feature_ = nullptr;

  std::string line_source_;     // of CameraSettings
  std::string trigger_source_;  // as it is now
  bool ptp_ = false;
  size_t payload_bytes_ = 0;
  bool receiving_ = false;  // the stream's thread runs
  bool acquiring_ = false;
  int lent_ = 0;  // buffers that no frame has come for
  uint64_t missing_when_armed_ = 0;
  uint64_t unasked_when_armed_ = 0;
};

AravisCamera::~AravisCamera() {
  g_signal_handler_disconnect(device_, control_lost_handler_);
  CloseStream();
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
    identity_.firmware = Text(arv_camera_get_string(camera_.get(), name, nullptr));
    break;
  }
  if (Has("DeviceTemperature")) temperature_feature_ = "DeviceTemperature";
  if (Has("TriggerArmed")) {
    armed_feature_ = "TriggerArmed";
  } else if (Has("AcquisitionStatusSelector") && Has("AcquisitionStatus")) {
    ROTUNDA_RETURN_IF_ERROR(SetText("AcquisitionStatusSelector", "FrameTriggerWait"));
    armed_feature_ = "AcquisitionStatus";
  }
  return {};
}

Status AravisCamera::SetText(const char* feature, const std::string& value) {
  GErrorSlot error;
  arv_camera_set_string(camera_.get(), feature, value.c_str(), error.out());
  ROTUNDA_RETURN_IF_ERROR(error.status(feature + (" = " + value)));
  const std::string found = Text(arv_camera_get_string(camera_.get(), feature, error.out()));
  ROTUNDA_RETURN_IF_ERROR(error.status(feature));
  return found == value ? Status() : Status(ReadBackError(feature, value, found));
}

Status AravisCamera::SetTextIfOffered(const char* feature, const std::string& value) {
  return Has(feature) ? SetText(feature, value) : Status();
}

Status AravisCamera::SetNumber(const char* feature, double value) {
  GErrorSlot error;
  arv_camera_set_float(camera_.get(), feature, value, error.out());
  ROTUNDA_RETURN_IF_ERROR(error.status(feature + (" = " + std::to_string(value))));
  const double found = arv_camera_get_float(camera_.get(), feature, error.out());
  ROTUNDA_RETURN_IF_ERROR(error.status(feature));
  if (Near(found, value)) return {};
  return ReadBackError(feature, std::to_string(value), std::to_string(found));
}

Status AravisCamera::ApplyPicture(const CameraSettings& settings) {
  GErrorSlot error;
  int width = settings.width_px, height = settings.height_px;
  if (width == 0 || height == 0) {
    int sensor_width = 0, sensor_height = 0;
    arv_camera_get_sensor_size(camera_.get(), &sensor_width, &sensor_height, error.out());
    ROTUNDA_RETURN_IF_ERROR(error.status("sensor size"));
    if (width == 0) width = sensor_width;
    if (height == 0) height = sensor_height;
  }
  arv_camera_set_region(camera_.get(), 0, 0, width, height, error.out());
  const std::string wanted = std::to_string(width) + "x" + std::to_string(height);
  ROTUNDA_RETURN_IF_ERROR(error.status("picture size " + wanted));
  int x = 0, y = 0, found_width = 0, found_height = 0;
  arv_camera_get_region(camera_.get(), &x, &y, &found_width, &found_height, error.out());
  ROTUNDA_RETURN_IF_ERROR(error.status("picture size"));
  if (found_width != width || found_height != height) {
    return ReadBackError("picture size", wanted,
                         std::to_string(found_width) + "x" + std::to_string(found_height));
  }
  return SetText("PixelFormat", settings.pixel_format);
}

Status AravisCamera::ApplyExposure(const CameraSettings& settings) {
  ROTUNDA_RETURN_IF_ERROR(SetTextIfOffered("ExposureMode", "Timed"));
  ROTUNDA_RETURN_IF_ERROR(SetTextIfOffered("ExposureAuto", "Off"));
  ROTUNDA_RETURN_IF_ERROR(SetTextIfOffered("GainAuto", "Off"));
  GErrorSlot error;
  arv_camera_set_exposure_time(camera_.get(), settings.exposure_us, error.out());
  ROTUNDA_RETURN_IF_ERROR(error.status("exposure time " + std::to_string(settings.exposure_us)));
  const double found = arv_camera_get_exposure_time(camera_.get(), error.out());
  ROTUNDA_RETURN_IF_ERROR(error.status("exposure time"));
  if (!Near(found, settings.exposure_us)) {
    return ReadBackError("exposure time", std::to_string(settings.exposure_us) + " us",
                         std::to_string(found) + " us");
  }
  if (!Has("Gain")) return {};
  return SetNumber("Gain", settings.gain_db);
}

Status AravisCamera::SetTriggerSource(const std::string& source) {
  if (trigger_source_ == source) return {};
  trigger_source_.clear();
  ROTUNDA_RETURN_IF_ERROR(SetText("TriggerSource", source));
  trigger_source_ = source;
  return {};
}

Status AravisCamera::ApplyTrigger(const CameraSettings& settings) {
  ROTUNDA_RETURN_IF_ERROR(SetTextIfOffered("AcquisitionMode", "Continuous"));
  ROTUNDA_RETURN_IF_ERROR(SetTextIfOffered("TriggerSelector", "FrameStart"));
  ROTUNDA_RETURN_IF_ERROR(SetText("TriggerMode", "On"));
  ROTUNDA_RETURN_IF_ERROR(SetTextIfOffered("TriggerActivation", "RisingEdge"));
  line_source_ = settings.trigger_source;
  trigger_source_.clear();
  return SetTriggerSource(line_source_);
}

Result<int64_t> AravisCamera::PtpOffset_ns() {
  GErrorSlot error;
  const std::string state = Text(arv_camera_get_string(camera_.get(), "PtpStatus", error.out()));
  ROTUNDA_RETURN_IF_ERROR(error.status("PtpStatus"));
  if (state != "Slave") {
    return Error{ErrorCode::kFailed, "is " + state + ", expected Slave (is there a PTP master?)",
                 "PtpStatus"};
  }
  if (!Has("PtpOffsetFromMaster")) return int64_t{0};
  const int64_t offset = arv_camera_get_integer(camera_.get(), "PtpOffsetFromMaster", error.out());
  ROTUNDA_RETURN_IF_ERROR(error.status("PtpOffsetFromMaster"));
  return offset;
}

Status AravisCamera::CheckPtp() {
  ROTUNDA_ASSIGN_OR_RETURN(const int64_t offset_ns, PtpOffset_ns());
  if (std::abs(offset_ns) <= kPtpOffsetLimit_ns) return {};
  return Error{ErrorCode::kFailed,
               "is " + std::to_string(offset_ns) + " ns, expected at most " +
                   std::to_string(kPtpOffsetLimit_ns),
               "PtpOffsetFromMaster"};
}

Status AravisCamera::ApplyPtp() {
  GErrorSlot error;
  arv_camera_set_boolean(camera_.get(), "PtpEnable", TRUE, error.out());
  ROTUNDA_RETURN_IF_ERROR(error.status("PtpEnable"));
  const auto deadline = Clock::now() + kPtpPatience;
  Status follows = CheckPtp();
  while (!follows && Clock::now() < deadline) {
    std::this_thread::sleep_for(kPtpPollInterval);
    follows = CheckPtp();
  }
  return follows;
}

/// A camera that leaves shorter gaps than planned takes the others' part of the uplink, and one
/// that leaves longer ones is late.
Status AravisCamera::ApplyPacketDelay(const BandwidthShare& bandwidth) {
  GErrorSlot error;
  const int packet_size =
      static_cast<int>(arv_camera_gv_get_packet_size(camera_.get(), error.out()));
  ROTUNDA_RETURN_IF_ERROR(error.status("packet size"));
  const int64_t wanted_ns = PacketDelay_ns(packet_size, bandwidth);
  arv_camera_gv_set_packet_delay(camera_.get(), wanted_ns, error.out());
  ROTUNDA_RETURN_IF_ERROR(error.status("packet delay (GevSCPD)"));
  const int64_t found_ns = arv_camera_gv_get_packet_delay(camera_.get(), error.out());
  ROTUNDA_RETURN_IF_ERROR(error.status("packet delay (GevSCPD)"));
  const double interval_ns = 8e9 * packet_size / bandwidth.link_bits_per_s;
  const double tolerance_ns = kRelativeTolerance * (interval_ns + static_cast<double>(wanted_ns));
  if (std::abs(static_cast<double>(found_ns - wanted_ns)) <= tolerance_ns) return {};
  return ReadBackError("packet delay (GevSCPD)", std::to_string(wanted_ns) + " ns",
                       std::to_string(found_ns) + " ns");
}

Status AravisCamera::ApplyTransport(const CameraSettings& settings) {
  GErrorSlot error;
  arv_camera_gv_set_stream_options(camera_.get(), ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED);
  arv_camera_gv_set_packet_size(camera_.get(), settings.packet_size_bytes, error.out());
  ROTUNDA_RETURN_IF_ERROR(
      error.status("packet size " + std::to_string(settings.packet_size_bytes)));
  // A test packet of that size is sent when the stream is made; the size shrinks when it is lost.
  arv_camera_gv_set_packet_size_adjustment(camera_.get(), ARV_GV_PACKET_SIZE_ADJUSTMENT_ON_FAILURE);
  stream_.reset(arv_camera_create_stream(camera_.get(), nullptr, nullptr, error.out()));
  if (!stream_) return error.ToError("stream");
  receiving_ = true;
  ROTUNDA_RETURN_IF_ERROR(ApplyPacketDelay(settings.bandwidth));
  payload_bytes_ = arv_camera_get_payload(camera_.get(), error.out());
  ROTUNDA_RETURN_IF_ERROR(error.status("payload size"));
  g_object_set(
      stream_.get(), "socket-buffer", ARV_GV_STREAM_SOCKET_BUFFER_FIXED, "socket-buffer-size",
      static_cast<gint>(kSocketBufferPerPayload * payload_bytes_), "frame-retention",
      kFrameRetention_us, "packet-timeout", kPacketTimeout_us, "packet-request-ratio",
      kPacketRequestRatio, "packet-resend",
      settings.resend ? ARV_GV_STREAM_PACKET_RESEND_ALWAYS : ARV_GV_STREAM_PACKET_RESEND_NEVER,
      nullptr);
  return {};
}

Result<AppliedSettings> AravisCamera::ReadBack(const CameraSettings& settings) {
  GErrorSlot error;
  AppliedSettings applied;
  int x = 0, y = 0;
  arv_camera_get_region(camera_.get(), &x, &y, &applied.width_px, &applied.height_px, error.out());
  ROTUNDA_RETURN_IF_ERROR(error.status("picture size"));
  applied.pixel_format = settings.pixel_format;  // compared when it was set
  applied.exposure_us = arv_camera_get_exposure_time(camera_.get(), error.out());
  ROTUNDA_RETURN_IF_ERROR(error.status("exposure time"));
  if (Has("Gain")) applied.gain_db = arv_camera_get_float(camera_.get(), "Gain", error.out());
  ROTUNDA_RETURN_IF_ERROR(error.status("Gain"));
  applied.packet_size_bytes =
      static_cast<int>(arv_camera_gv_get_packet_size(camera_.get(), error.out()));
  ROTUNDA_RETURN_IF_ERROR(error.status("packet size"));
  applied.packet_delay_ns = arv_camera_gv_get_packet_delay(camera_.get(), error.out());
  ROTUNDA_RETURN_IF_ERROR(error.status("packet delay (GevSCPD)"));
  applied.payload_bytes = payload_bytes_;
  return applied;
}

Result<AppliedSettings> AravisCamera::Apply(const CameraSettings& settings) {
  ROTUNDA_RETURN_IF_ERROR(Disarm());
  CloseStream();
  ROTUNDA_RETURN_IF_ERROR(ApplyPicture(settings));
  ROTUNDA_RETURN_IF_ERROR(ApplyExposure(settings));
  ROTUNDA_RETURN_IF_ERROR(ApplyTrigger(settings));
  ptp_ = settings.ptp;
  if (ptp_) ROTUNDA_RETURN_IF_ERROR(ApplyPtp());
  ROTUNDA_RETURN_IF_ERROR(ApplyTransport(settings));
  return ReadBack(settings);
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

void AravisCamera::DropBuffers() {
  lent_ = 0;
  if (stream_ && receiving_) arv_stream_stop_thread(stream_.get(), TRUE);
  receiving_ = false;
}

void AravisCamera::CloseStream() {
  if (!stream_) return;
  DropBuffers();
  arv_stream_start_thread(stream_.get());  // which the stream's end wants to stop
  stream_.reset();
}

Status AravisCamera::CheckMemory(const FrameBlock& memory) const {
  if (stream_ && memory.size() >= payload_bytes_) return {};
  return Error{
      ErrorCode::kInvalidArgument,
      std::to_string(memory.size()) + " bytes for a frame of " + std::to_string(payload_bytes_),
      "frame memory"};
}

void AravisCamera::Lend(FrameBlock memory) {
  missing_when_armed_ = Counter("n_missing_packets");
  ++lent_;
  arv_stream_push_buffer(stream_.get(), MakeBuffer(std::move(memory), payload_bytes_).release());
}

Status AravisCamera::Refill(FrameBlock memory) {
  ROTUNDA_RETURN_IF_ERROR(CheckMemory(memory));
  if (!acquiring_) return Arm(TriggerBy::kLine, std::move(memory));
  ROTUNDA_RETURN_IF_ERROR(CheckControl());
  Lend(std::move(memory));
  return {};
}

Status AravisCamera::Arm(TriggerBy by, FrameBlock memory) {
  ROTUNDA_RETURN_IF_ERROR(CheckMemory(memory));
  ROTUNDA_RETURN_IF_ERROR(Disarm());
  ROTUNDA_RETURN_IF_ERROR(CheckControl());
  ROTUNDA_RETURN_IF_ERROR(SetTriggerSource(by == TriggerBy::kLine ? line_source_ : "Software"));
  // Ids restart at AcquisitionStart on many cameras; a stream that goes on would take every frame
  // for an old one. Restarting its thread forgets the last id and keeps the socket.
  DropBuffers();
  Lend(std::move(memory));
  arv_stream_start_thread(stream_.get());
  receiving_ = true;
  unasked_when_armed_ = Counter("n_underruns");
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

CameraFrame AravisCamera::Describe(ArvBuffer* buffer) const {
  CameraFrame frame;
  const ArvBufferStatus status = arv_buffer_get_status(buffer);
  if (status != ARV_BUFFER_STATUS_SUCCESS) {
    frame.problem = WhyIncomplete(status, Counter("n_missing_packets") - missing_when_armed_);
    // Without the first packet Aravis knows neither id nor size.
    if (arv_buffer_get_frame_id(buffer) == 0) frame.problem += ", the first one among them";
    return frame;
  }
  frame.frame_id = arv_buffer_get_frame_id(buffer);
  frame.timestamp_ns = arv_buffer_get_timestamp(buffer);
  frame.width_px = arv_buffer_get_image_width(buffer);
  frame.height_px = arv_buffer_get_image_height(buffer);
  frame.pixel_format = NameOf(arv_buffer_get_image_pixel_format(buffer));
  int padding_x = 0, padding_y = 0;
  arv_buffer_get_image_padding(buffer, &padding_x, &padding_y);
  if (padding_x != 0 || padding_y != 0) {
    frame.problem = "rows are padded, which no 8-bit format of ours is";
    return frame;
  }
  // The camera says both, and its word is not enough to read memory by.
  const size_t told = BytesPerPixel(frame.pixel_format) *
                      static_cast<size_t>(std::max(0, frame.width_px)) *
                      static_cast<size_t>(std::max(0, frame.height_px));
  size_t held = 0;
  arv_buffer_get_data(buffer, &held);
  if (told == 0 || told > held || !IsKnown(frame.pixel_format)) {
    frame.problem = "says it is " + std::to_string(frame.width_px) + "x" +
                    std::to_string(frame.height_px) + " of " + frame.pixel_format + " and has " +
                    std::to_string(held) + " bytes";
    return frame;
  }
  frame.complete = true;
  frame.memory = TakeMemory(buffer);
  return frame;
}

std::optional<CameraFrame> AravisCamera::Fetch(Clock::time_point deadline) {
  while (true) {
    const auto left =
        std::chrono::duration_cast<std::chrono::microseconds>(deadline - Clock::now());
    const guint64 patience_us = static_cast<guint64>(std::max<int64_t>(0, left.count()));
    const GObjectPtr<ArvBuffer> buffer(arv_stream_timeout_pop_buffer(stream_.get(), patience_us));
    if (!buffer) return std::nullopt;
    if (arv_buffer_get_status(buffer.get()) == ARV_BUFFER_STATUS_ABORTED) continue;
    --lent_;
    return Describe(buffer.get());
  }
}

void AravisCamera::WaitUntilQuiet() {
  const auto deadline = Clock::now() + kQuietPatience;
  uint64_t received = Counter("n_received_packets");
  while (Clock::now() < deadline) {
    std::this_thread::sleep_for(kQuietTime);
    const uint64_t now = Counter("n_received_packets");
    if (now == received) return;
    received = now;
  }
}

Status AravisCamera::Disarm() {
  GErrorSlot error;
  if (acquiring_ && !control_lost_) {
    arv_camera_stop_acquisition(camera_.get(), error.out());
    // Packets of a frame that nobody took must not be taken for the next one.
    if (lent_ > 0 || Counter("n_underruns") != unasked_when_armed_) WaitUntilQuiet();
  }
  acquiring_ = false;
  DropBuffers();
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
  if (!stream_) return {};
  return {Counter("n_resent_packets"), Counter("n_missing_packets"), Counter("n_underruns")};
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
    if (const Result<int64_t> offset = PtpOffset_ns()) health.ptp_offset_ns = *offset;
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
  if (!camera) return error.ToError("cannot open " + place.address);
  if (!arv_gv_device_is_controller(ARV_GV_DEVICE(arv_camera_get_device(camera.get())))) {
    return Error{ErrorCode::kAlreadyExists,
                 "another program controls it (close that, or wait for its heartbeat to run out)",
                 place.address};
  }
  auto opened = std::make_unique<AravisCamera>(std::move(camera), std::move(identity));
  ROTUNDA_RETURN_IF_ERROR(opened->ReadProperties());
  return std::unique_ptr<Camera>(std::move(opened));
}

}  // namespace rotunda::rig
