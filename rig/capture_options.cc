#include "rig/capture_options.h"

#include <arpa/inet.h>

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

void CheckRange(const std::string& key, double value, double low, double high,
                std::vector<Error>& problems) {
  if (value >= low && value <= high) return;
  std::ostringstream text;
  text << "is " << value << ", expected " << low << " to " << high;
  problems.push_back(Invalid(key, text.str()));
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
void CheckName(const std::string& name, std::vector<Error>& problems) {
  const auto is_alnum = [](char c) {
    return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z');
  };
  const auto is_allowed = [&](char c) { return is_alnum(c) || c == '-' || c == '_' || c == '.'; };
  if (!name.empty() && name.size() <= kMaxNameLength && is_alnum(name.front()) &&
      std::all_of(name.begin(), name.end(), is_allowed)) {
    return;
  }
  problems.push_back(Invalid(
      "cameras", "\"" + name + "\" is no name, expected at most " + std::to_string(kMaxNameLength) +
                     " letters, digits, '-', '_' and '.', a letter or digit first"));
}

/// `owner` has what the cameras before are known by.
void CheckCamera(const CameraPlace& camera, const std::vector<UplinkOptions>& uplinks,
                 std::map<std::string, std::string>& owner, std::vector<Error>& problems) {
  CheckName(camera.camera, problems);
  const std::string key = "cameras." + camera.camera;
  if (camera.serial.empty() && camera.address.empty()) {
    problems.push_back(Invalid(key, "has neither serial nor address, expected at least one"));
  }
  in_addr parsed{};
  if (!camera.address.empty() && ::inet_pton(AF_INET, camera.address.c_str(), &parsed) != 1) {
    problems.push_back(
        Invalid(key + ".address",
                "is \"" + camera.address + "\", expected an IPv4 address such as 192.168.10.7"));
  }
  if (std::none_of(uplinks.begin(), uplinks.end(),
                   [&](const auto& uplink) { return uplink.name == camera.uplink; })) {
    problems.push_back(
        Invalid(key + ".uplink", "is \"" + camera.uplink + "\", which is not in [uplinks]"));
  }
  for (const std::string& mark : {camera.camera, camera.serial, camera.address}) {
    if (mark.empty()) continue;
    const auto [twin, is_new] = owner.emplace(mark, camera.camera);
    if (is_new) continue;
    problems.push_back(Invalid(key, "\"" + mark + "\" is already that of " + twin->second));
  }
}

void CheckCameras(const CaptureOptions& options, std::vector<Error>& problems) {
  if (options.cameras.empty()) problems.push_back(Invalid("cameras", "there is none"));
  if (options.cameras.size() > kMaxCameras) {
    problems.push_back(Invalid("cameras", "there are " + std::to_string(options.cameras.size()) +
                                              ", expected at most " + std::to_string(kMaxCameras)));
    return;
  }
  std::map<std::string, std::string> owner;
  for (const CameraPlace& camera : options.cameras) {
    CheckCamera(camera, options.uplinks, owner, problems);
  }
}

void CheckTiming(const CaptureOptions& options, std::vector<Error>& problems) {
  const ShotTiming& timing = options.timing;
  CheckRange("capture.arm_ms", timing.arm_ms, 10, 60000, problems);
  CheckRange("capture.deadline_ms", timing.deadline_ms, 10, 60000, problems);
  CheckRange("capture.late_ms", timing.late_ms, 0, 60000, problems);
  CheckRange("capture.settle_ms", timing.settle_ms, 0, 10000, problems);
  CheckRange("capture.skew_limit_us", options.skew_limit_us, 1, 1e6, problems);
  CheckRange("capture.retries", options.retries, 0, 10, problems);
  CheckRange("capture.sets_in_memory", options.sets_in_memory, 2, 100, problems);
}

void CheckSettings(const CameraSettings& settings, std::vector<Error>& problems) {
  CheckRange("capture.exposure_us", settings.exposure_us, 1, 1e7, problems);
  CheckRange("capture.gain_db", settings.gain_db, -60, 60, problems);
  CheckRange("capture.packet_size_bytes", settings.packet_size_bytes, kMinPacketSize_bytes,
             kMaxPacketSize_bytes, problems);
  CheckRange("capture.width_px", settings.width_px, 0, 65535, problems);
  CheckRange("capture.height_px", settings.height_px, 0, 65535, problems);
  const std::set<std::string> formats = {"Mono8",    "RGB8",     "BayerRG8",
                                         "BayerGB8", "BayerGR8", "BayerBG8"};
  if (formats.contains(settings.pixel_format)) return;
  problems.push_back(
      Invalid("capture.pixel_format",
              "is \"" + settings.pixel_format +
                  "\", expected Mono8, BayerRG8, BayerGB8, BayerGR8, BayerBG8 or RGB8"));
}

/// The frames of one uplink must be through before the deadline.
void CheckBandwidth(const CaptureOptions& options, std::vector<Error>& problems) {
  const CameraSettings& settings = options.settings;
  const size_t payload = settings.PayloadBytes();
  if (payload == 0) return;  // known when cameras are open: Camera::Apply looks again
  for (const UplinkOptions& uplink : options.uplinks) {
    const UplinkLoad load = LoadOf(options, uplink.name);
    if (load.cameras == 0) continue;
    const Status in_time = CheckInTime({payload, settings.packet_size_bytes, settings.exposure_us},
                                       load, options.timing.deadline_ms);
    if (!in_time.ok()) problems.push_back(in_time.error());
  }
}

}  // namespace

std::vector<Error> CaptureOptions::Problems() const {
  std::vector<Error> problems;
  CheckCameras(*this, problems);
  for (const UplinkOptions& uplink : uplinks) {
    const std::string key = "uplinks." + uplink.name;
    CheckRange(key + ".mbit_per_s", uplink.mbit_per_s, 10, 400000, problems);
    CheckRange(key + ".camera_mbit_per_s", uplink.camera_mbit_per_s, 10, 100000, problems);
  }
  CheckTiming(*this, problems);
  CheckSettings(settings, problems);
  CheckRange("trigger.pulse_us", trigger.pulse_us, 1, 1e6, problems);
  CheckRange("trigger.line", trigger.gpio.line, 0, 1023, problems);
  // Said of values that are in their ranges only.
  if (problems.empty()) CheckBandwidth(*this, problems);
  return problems;
}

Status CaptureOptions::Validate() const {
  const std::vector<Error> problems = Problems();
  return problems.empty() ? Status() : Status(problems.front());
}

CameraSettings CaptureOptions::SettingsOf(const CameraPlace& place) const {
  CameraSettings own = settings;
  own.uplink = LoadOf(*this, place.uplink);
  own.deadline_ms = timing.deadline_ms;
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
