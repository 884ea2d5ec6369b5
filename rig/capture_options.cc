#include "rig/capture_options.h"

#include <algorithm>
#include <fstream>
#include <map>
#include <set>
#include <sstream>

namespace rotunda::rig {
namespace {

constexpr int kMaxCameras = 1000;
// As long as a name in an address of the API may be.
constexpr size_t kMaxNameLength = 100;

Error Invalid(const std::string& key, const std::string& message) {
  return {ErrorCode::kInvalidArgument, message, key};
}

Status CheckRange(const std::string& key, double value, double low, double high) {
  if (value >= low && value <= high) return {};
  std::ostringstream text;
  text << "is " << value << ", expected " << low << " to " << high;
  return Invalid(key, text.str());
}

UplinkLoad LoadOf(const CaptureOptions& options, const std::string& name) {
  UplinkLoad load;
  load.uplink = name;
  for (const UplinkOptions& uplink : options.uplinks) {
    if (uplink.name != name) continue;
    load.uplink_bits_per_s = 1e6 * uplink.mbit_per_s;
    load.camera_link_bits_per_s = 1e6 * uplink.camera_mbit_per_s;
  }
  load.cameras = static_cast<int>(
      std::count_if(options.cameras.begin(), options.cameras.end(),
                    [&](const CameraPlace& camera) { return camera.uplink == name; }));
  return load;
}

/// Names become files of a frame set and parts of addresses: what stays in its folder everywhere.
Status CheckName(const std::string& name) {
  const auto is_alnum = [](char c) {
    return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z');
  };
  const auto is_allowed = [&](char c) { return is_alnum(c) || c == '-' || c == '_' || c == '.'; };
  if (!name.empty() && name.size() <= kMaxNameLength && is_alnum(name.front()) &&
      std::all_of(name.begin(), name.end(), is_allowed)) {
    return {};
  }
  return Invalid("cameras", "\"" + name + "\" is no name, expected at most " +
                                std::to_string(kMaxNameLength) +
                                " letters, digits, '-', '_' and '.', a letter or digit first");
}

Status CheckCameras(const CaptureOptions& options) {
  if (options.cameras.empty()) return Invalid("cameras", "there is none");
  if (options.cameras.size() > kMaxCameras) {
    return Invalid("cameras", "there are " + std::to_string(options.cameras.size()) +
                                  ", expected at most " + std::to_string(kMaxCameras));
  }
  std::map<std::string, std::string> owner;
  for (const CameraPlace& camera : options.cameras) {
    ROTUNDA_RETURN_IF_ERROR(CheckName(camera.camera));
    const std::string key = "cameras." + camera.camera;
    if (camera.serial.empty() && camera.address.empty()) {
      return Invalid(key, "has neither serial nor address, expected at least one");
    }
    const auto known =
        std::find_if(options.uplinks.begin(), options.uplinks.end(),
                     [&](const auto& uplink) { return uplink.name == camera.uplink; });
    if (known == options.uplinks.end()) {
      return Invalid(key + ".uplink", "is \"" + camera.uplink + "\", which is not in [uplinks]");
    }
    for (const std::string& mark : {camera.camera, camera.serial, camera.address}) {
      if (mark.empty()) continue;
      const auto [twin, is_new] = owner.emplace(mark, camera.camera);
      if (!is_new) return Invalid(key, "\"" + mark + "\" is already that of " + twin->second);
    }
  }
  return {};
}

Status CheckTiming(const CaptureOptions& options) {
  const ShotTiming& timing = options.timing;
  ROTUNDA_RETURN_IF_ERROR(CheckRange("capture.arm_ms", timing.arm_ms, 10, 60000));
  ROTUNDA_RETURN_IF_ERROR(CheckRange("capture.deadline_ms", timing.deadline_ms, 10, 60000));
  ROTUNDA_RETURN_IF_ERROR(CheckRange("capture.late_ms", timing.late_ms, 0, 60000));
  ROTUNDA_RETURN_IF_ERROR(CheckRange("capture.settle_ms", timing.settle_ms, 0, 10000));
  ROTUNDA_RETURN_IF_ERROR(CheckRange("capture.skew_limit_us", options.skew_limit_us, 1, 1e6));
  ROTUNDA_RETURN_IF_ERROR(CheckRange("capture.retries", options.retries, 0, 10));
  return CheckRange("capture.sets_in_memory", options.sets_in_memory, 2, 100);
}

/// The frames of one uplink must be through before the deadline.
Status CheckBandwidth(const CaptureOptions& options) {
  const CameraSettings& settings = options.settings;
  const size_t payload = settings.PayloadBytes();
  if (payload == 0) return {};  // known when cameras are open: CameraWorker looks again
  for (const UplinkOptions& uplink : options.uplinks) {
    const UplinkLoad load = LoadOf(options, uplink.name);
    if (load.cameras == 0) continue;
    const Status in_time = CheckInTime({payload, settings.packet_size_bytes, settings.exposure_us},
                                       load.Share(), options.timing.deadline_ms);
    if (in_time.ok()) continue;
    return Invalid("uplinks." + uplink.name,
                   "with " + std::to_string(load.cameras) + " cameras, " + in_time.error().message);
  }
  return {};
}

}  // namespace

Status CaptureOptions::Validate() const {
  ROTUNDA_RETURN_IF_ERROR(CheckCameras(*this));
  for (const UplinkOptions& uplink : uplinks) {
    const std::string key = "uplinks." + uplink.name;
    ROTUNDA_RETURN_IF_ERROR(CheckRange(key + ".mbit_per_s", uplink.mbit_per_s, 10, 400000));
    ROTUNDA_RETURN_IF_ERROR(
        CheckRange(key + ".camera_mbit_per_s", uplink.camera_mbit_per_s, 10, 100000));
  }
  ROTUNDA_RETURN_IF_ERROR(CheckTiming(*this));
  ROTUNDA_RETURN_IF_ERROR(CheckRange("capture.exposure_us", settings.exposure_us, 1, 1e7));
  ROTUNDA_RETURN_IF_ERROR(CheckRange("capture.gain_db", settings.gain_db, -60, 60));
  ROTUNDA_RETURN_IF_ERROR(CheckRange("capture.packet_size_bytes", settings.packet_size_bytes,
                                     kMinPacketSize_bytes, kMaxPacketSize_bytes));
  ROTUNDA_RETURN_IF_ERROR(CheckRange("capture.width_px", settings.width_px, 0, 65535));
  ROTUNDA_RETURN_IF_ERROR(CheckRange("capture.height_px", settings.height_px, 0, 65535));
  ROTUNDA_RETURN_IF_ERROR(CheckRange("trigger.pulse_us", trigger.pulse_us, 1, 1e6));
  ROTUNDA_RETURN_IF_ERROR(CheckRange("trigger.line", trigger.gpio.line, 0, 1023));
  const std::set<std::string> formats = {"Mono8",    "RGB8",     "BayerRG8",
                                         "BayerGB8", "BayerGR8", "BayerBG8"};
  if (!formats.contains(settings.pixel_format)) {
    return Invalid("capture.pixel_format",
                   "is \"" + settings.pixel_format +
                       "\", expected Mono8, BayerRG8, BayerGB8, BayerGR8, BayerBG8 or RGB8");
  }
  return CheckBandwidth(*this);
}

CameraSettings CaptureOptions::SettingsOf(const CameraPlace& place) const {
  CameraSettings own = settings;
  own.bandwidth = LoadOf(*this, place.uplink).Share();
  own.trigger_source = trigger.camera_input;
  return own;
}

Status CheckSocketBuffers(size_t payload_bytes) {
  std::ifstream file("/proc/sys/net/core/rmem_max");
  size_t limit = 0;
  if (!(file >> limit) || limit >= payload_bytes) return {};
  return Error{ErrorCode::kFailed,
               "is " + std::to_string(limit) + ", expected at least the " +
                   std::to_string(payload_bytes) +
                   " bytes of a frame, else packets are lost when the machine is busy: sysctl -w "
                   "net.core.rmem_max=" +
                   std::to_string(2 * payload_bytes),
               "net.core.rmem_max"};
}

}  // namespace rotunda::rig
