#include "config/capture_config.h"

#include <algorithm>
#include <deque>

#include "config/toml_reader.h"
#include "sfm/core/file_io.h"

namespace rotunda::config {
namespace {

Section CaptureSection(rig::CaptureOptions& options) {
  rig::CameraSettings& settings = options.settings;
  rig::ShotTiming& timing = options.timing;
  return {"capture",
          {{"width_px", &settings.width_px},
           {"height_px", &settings.height_px},
           {"pixel_format", &settings.pixel_format},
           {"exposure_us", &settings.exposure_us},
           {"gain_db", &settings.gain_db},
           {"ptp", &settings.ptp},
           {"packet_size_bytes", &settings.packet_size_bytes},
           {"resend", &settings.resend},
           {"arm_ms", &timing.arm_ms},
           {"deadline_ms", &timing.deadline_ms},
           {"late_ms", &timing.late_ms},
           {"settle_ms", &timing.settle_ms},
           {"skew_limit_us", &options.skew_limit_us},
           {"retries", &options.retries},
           {"sets_in_memory", &options.sets_in_memory}}};
}

Section TriggerSection(rig::TriggerOptions& trigger) {
  return {"trigger",
          {{"chip", &trigger.gpio.chip},
           {"line", &trigger.gpio.line},
           {"active_low", &trigger.gpio.active_low},
           {"pulse_us", &trigger.pulse_us},
           {"camera_input", &trigger.camera_input}}};
}

}  // namespace

CheckedCaptureOptions CheckCaptureOptions(const std::string& text, const std::string& source) {
  CheckedCaptureOptions checked;
  const Result<TomlFile> file = TomlFile::Parse(text, source);
  if (!file) return {{}, {file.error()}};
  rig::CaptureOptions& options = checked.options;
  std::deque<rig::CameraPlace> cameras;  // whose places in memory stay
  std::deque<rig::UplinkOptions> uplinks;
  const auto camera_fields = [&](const std::string& name) -> std::vector<Field> {
    rig::CameraPlace& camera = cameras.emplace_back();
    camera.camera = name;
    return {{"serial", &camera.serial}, {"address", &camera.address}, {"uplink", &camera.uplink}};
  };
  const auto uplink_fields = [&](const std::string& name) -> std::vector<Field> {
    rig::UplinkOptions& uplink = uplinks.emplace_back();
    uplink.name = name;
    return {{"mbit_per_s", &uplink.mbit_per_s}, {"camera_mbit_per_s", &uplink.camera_mbit_per_s}};
  };
  checked.problems = file->ReadAll({CaptureSection(options),
                                    TriggerSection(options.trigger),
                                    {"uplinks", {}, uplink_fields},
                                    {"cameras", {}, camera_fields}});
  options.cameras.assign(cameras.begin(), cameras.end());
  options.uplinks.assign(uplinks.begin(), uplinks.end());
  // One link needs no naming.
  for (rig::CameraPlace& camera : options.cameras) {
    if (camera.uplink.empty() && uplinks.size() == 1) camera.uplink = uplinks.front().name;
  }
  file->AddLocated(options.Problems(), checked.problems);
  return checked;
}

Result<rig::CaptureOptions> ParseCaptureOptions(const std::string& text,
                                                const std::string& source) {
  CheckedCaptureOptions checked = CheckCaptureOptions(text, source);
  if (!checked.problems.empty()) return checked.problems.front();
  return std::move(checked.options);
}

Result<rig::CaptureOptions> ReadCaptureOptions(const std::filesystem::path& file) {
  ROTUNDA_ASSIGN_OR_RETURN(const std::string text, ReadFile(file));
  return ParseCaptureOptions(text, file.string());
}

}  // namespace rotunda::config
