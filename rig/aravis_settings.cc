#include "rig/aravis_settings.h"

#include <algorithm>
#include <cmath>

#include "rig/short_number.h"

namespace rotunda::rig {
namespace {

constexpr int64_t kPtpOffsetLimit_ns = 10'000;

// A value read back may differ by the camera's own steps.
constexpr double kRelativeTolerance = 0.01;
constexpr double kAbsoluteTolerance = 0.1;

// Aravis' bounds of what has none are the largest numbers there are.
constexpr double kUnlimited = 1e300;

bool Near(double a, double b) {
  return std::abs(a - b) <= std::max(kAbsoluteTolerance, kRelativeTolerance * std::abs(b));
}

std::string SizeText(int width, int height) {
  return std::to_string(width) + "x" + std::to_string(height);
}

Error ReadBackError(const std::string& feature, const std::string& wanted,
                    const std::string& found) {
  return {ErrorCode::kFailed, "was set to " + wanted + ", but the camera has " + found, feature};
}

Status WriteTextIfOffered(ArvCamera* camera, const char* feature, const std::string& value) {
  return HasFeature(camera, feature) ? WriteText(camera, feature, value) : Status();
}

std::string Plain(double value) { return Number(value, "%.10g"); }

/// A value that the camera does not take, with those it does: `key` is the configuration's for it.
struct ValueRange {
  std::string key;
  double least = 0;
  double most = 0;

  Error Refused(double value, const std::string& why) const {
    const bool is_known = least <= most && most < kUnlimited;
    const std::string allowed =
        is_known ? "; allowed are " + Plain(least) + " to " + Plain(most) : "";
    return {ErrorCode::kFailed, why + allowed, key + " = " + Plain(value)};
  }
};

Status WriteExposure(ArvCamera* camera, double exposure_us) {
  GErrorSlot error;
  ValueRange range{"exposure_us"};
  arv_camera_get_exposure_time_bounds(camera, &range.least, &range.most, nullptr);
  arv_camera_set_exposure_time(camera, exposure_us, error.out());
  if (error) return range.Refused(exposure_us, error.message());
  const double found = arv_camera_get_exposure_time(camera, error.out());
  ROTUNDA_RETURN_IF_ERROR(error.status("exposure time"));
  if (Near(found, exposure_us)) return {};
  return range.Refused(exposure_us, "the camera has " + Plain(found) + " instead");
}

Status WriteGain(ArvCamera* camera, double gain_db) {
  GErrorSlot error;
  ValueRange range{"gain_db"};
  arv_camera_get_float_bounds(camera, "Gain", &range.least, &range.most, nullptr);
  arv_camera_set_float(camera, "Gain", gain_db, error.out());
  if (error) return range.Refused(gain_db, error.message());
  const double found = arv_camera_get_float(camera, "Gain", error.out());
  ROTUNDA_RETURN_IF_ERROR(error.status("Gain"));
  if (Near(found, gain_db)) return {};
  return range.Refused(gain_db, "the camera has " + Plain(found) + " instead");
}

}  // namespace

bool HasFeature(ArvCamera* camera, const char* feature) {
  return arv_camera_is_feature_available(camera, feature, nullptr);
}

Result<std::string> ReadText(ArvCamera* camera, const char* feature) {
  GErrorSlot error;
  const char* text = arv_camera_get_string(camera, feature, error.out());
  ROTUNDA_RETURN_IF_ERROR(error.status(feature));
  return std::string(text == nullptr ? "" : text);
}

Status WriteText(ArvCamera* camera, const char* feature, const std::string& value) {
  GErrorSlot error;
  arv_camera_set_string(camera, feature, value.c_str(), error.out());
  ROTUNDA_RETURN_IF_ERROR(error.status(feature + (" = " + value)));
  ROTUNDA_ASSIGN_OR_RETURN(const std::string found, ReadText(camera, feature));
  return found == value ? Status() : Status(ReadBackError(feature, value, found));
}

/// "1 to 1200" or "16 to 1200 in steps of 4".
std::string RangeText(int least, int most, int step) {
  return std::to_string(least) + " to " + std::to_string(most) +
         (step > 1 ? " in steps of " + std::to_string(step) : "");
}

/// A size that the camera does not take, with those it does.
Error SizeRefused(ArvCamera* camera, const std::string& wanted, const std::string& why) {
  int least_width = 0, most_width = 0, least_height = 0, most_height = 0;
  arv_camera_get_width_bounds(camera, &least_width, &most_width, nullptr);
  arv_camera_get_height_bounds(camera, &least_height, &most_height, nullptr);
  std::string allowed;
  if (most_width > 0 && most_height > 0) {
    allowed =
        "; allowed are width_px " +
        RangeText(least_width, most_width, arv_camera_get_width_increment(camera, nullptr)) +
        " and height_px " +
        RangeText(least_height, most_height, arv_camera_get_height_increment(camera, nullptr)) +
        ", or 0 for all of the sensor";
  }
  return {ErrorCode::kFailed, why + allowed, "picture size " + wanted};
}

Status ApplyPicture(ArvCamera* camera, const CameraSettings& settings) {
  GErrorSlot error;
  int width = settings.width_px, height = settings.height_px;
  if (width == 0 || height == 0) {
    int sensor_width = 0, sensor_height = 0;
    arv_camera_get_sensor_size(camera, &sensor_width, &sensor_height, error.out());
    ROTUNDA_RETURN_IF_ERROR(error.status("sensor size"));
    if (width == 0) width = sensor_width;
    if (height == 0) height = sensor_height;
  }
  arv_camera_set_region(camera, 0, 0, width, height, error.out());
  const std::string wanted = SizeText(width, height);
  if (error) return SizeRefused(camera, wanted, error.message());
  int x = 0, y = 0, found_width = 0, found_height = 0;
  arv_camera_get_region(camera, &x, &y, &found_width, &found_height, error.out());
  ROTUNDA_RETURN_IF_ERROR(error.status("picture size"));
  if (found_width != width || found_height != height) {
    return SizeRefused(camera, wanted,
                       "the camera has " + SizeText(found_width, found_height) + " instead");
  }
  return WriteText(camera, "PixelFormat", settings.pixel_format);
}

Status ApplyExposure(ArvCamera* camera, const CameraSettings& settings) {
  ROTUNDA_RETURN_IF_ERROR(WriteTextIfOffered(camera, "ExposureMode", "Timed"));
  ROTUNDA_RETURN_IF_ERROR(WriteTextIfOffered(camera, "ExposureAuto", "Off"));
  ROTUNDA_RETURN_IF_ERROR(WriteTextIfOffered(camera, "GainAuto", "Off"));
  ROTUNDA_RETURN_IF_ERROR(WriteExposure(camera, settings.exposure_us));
  return HasFeature(camera, "Gain") ? WriteGain(camera, settings.gain_db) : Status();
}

Status ApplyTriggerMode(ArvCamera* camera) {
  ROTUNDA_RETURN_IF_ERROR(WriteTextIfOffered(camera, "AcquisitionMode", "Continuous"));
  ROTUNDA_RETURN_IF_ERROR(WriteTextIfOffered(camera, "TriggerSelector", "FrameStart"));
  ROTUNDA_RETURN_IF_ERROR(WriteText(camera, "TriggerMode", "On"));
  return WriteTextIfOffered(camera, "TriggerActivation", "RisingEdge");
}

Result<int64_t> PtpOffset_ns(ArvCamera* camera) {
  ROTUNDA_ASSIGN_OR_RETURN(const std::string state, ReadText(camera, "PtpStatus"));
  if (state != "Slave") {
    return Error{ErrorCode::kFailed, "is " + state + ", expected Slave (is there a PTP master?)",
                 "PtpStatus"};
  }
  if (!HasFeature(camera, "PtpOffsetFromMaster")) return int64_t{0};
  GErrorSlot error;
  const int64_t offset = arv_camera_get_integer(camera, "PtpOffsetFromMaster", error.out());
  ROTUNDA_RETURN_IF_ERROR(error.status("PtpOffsetFromMaster"));
  return offset;
}

Status CheckPtp(ArvCamera* camera) {
  ROTUNDA_ASSIGN_OR_RETURN(const int64_t offset_ns, PtpOffset_ns(camera));
  if (std::abs(offset_ns) <= kPtpOffsetLimit_ns) return {};
  return Error{ErrorCode::kFailed,
               "is " + std::to_string(offset_ns) + " ns, expected at most " +
                   std::to_string(kPtpOffsetLimit_ns),
               "PtpOffsetFromMaster"};
}

Status ApplyPtp(ArvCamera* camera) {
  GErrorSlot error;
  arv_camera_set_boolean(camera, "PtpEnable", TRUE, error.out());
  return error.status("PtpEnable");
}

/// A camera that leaves shorter gaps than planned takes the others' part of the uplink, and one
/// that leaves longer ones is late.
Result<int64_t> ApplyPacketDelay(ArvCamera* camera, int packet_size_bytes,
                                 const BandwidthShare& bandwidth) {
  GErrorSlot error;
  const int64_t wanted_ns = PacketDelay_ns(packet_size_bytes, bandwidth);
  arv_camera_gv_set_packet_delay(camera, wanted_ns, error.out());
  ROTUNDA_RETURN_IF_ERROR(error.status("packet delay (GevSCPD)"));
  const int64_t found_ns = arv_camera_gv_get_packet_delay(camera, error.out());
  ROTUNDA_RETURN_IF_ERROR(error.status("packet delay (GevSCPD)"));
  const double interval_ns = 8e9 * packet_size_bytes / bandwidth.link_bits_per_s;
  const double tolerance_ns = kRelativeTolerance * (interval_ns + static_cast<double>(wanted_ns));
  if (std::abs(static_cast<double>(found_ns - wanted_ns)) <= tolerance_ns) return found_ns;
  return ReadBackError("packet delay (GevSCPD)", std::to_string(wanted_ns) + " ns",
                       std::to_string(found_ns) + " ns");
}

Result<AppliedSettings> ReadSettings(ArvCamera* camera, const CameraSettings& settings) {
  GErrorSlot error;
  AppliedSettings applied;
  int x = 0, y = 0;
  arv_camera_get_region(camera, &x, &y, &applied.width_px, &applied.height_px, error.out());
  ROTUNDA_RETURN_IF_ERROR(error.status("picture size"));
  applied.pixel_format = settings.pixel_format;  // compared when it was set
  applied.exposure_us = arv_camera_get_exposure_time(camera, error.out());
  ROTUNDA_RETURN_IF_ERROR(error.status("exposure time"));
  if (HasFeature(camera, "Gain")) {
    applied.gain_db = arv_camera_get_float(camera, "Gain", error.out());
    ROTUNDA_RETURN_IF_ERROR(error.status("Gain"));
  }
  applied.packet_size_bytes = static_cast<int>(arv_camera_gv_get_packet_size(camera, error.out()));
  ROTUNDA_RETURN_IF_ERROR(error.status("packet size"));
  return applied;
}

}  // namespace rotunda::rig
