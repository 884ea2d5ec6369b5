#pragma once

#include <cstdint>
#include <string>

#include "rig/aravis_object.h"
#include "rig/camera.h"

namespace rotunda::rig {

// What is written to a camera, each value read back: kFailed names the feature, what was wanted and
// what the camera has. Features that it does not offer are left out where cameras do without them.

bool HasFeature(ArvCamera* camera, const char* feature);
Result<std::string> ReadText(ArvCamera* camera, const char* feature);
Status WriteText(ArvCamera* camera, const char* feature, const std::string& value);

/// Size and pixel format.
Status ApplyPicture(ArvCamera* camera, const CameraSettings& settings);
/// Exposure time and gain, both by hand.
Status ApplyExposure(ArvCamera* camera, const CameraSettings& settings);
/// A frame for every rising edge; the edge's source is another setting.
Status ApplyTriggerMode(ArvCamera* camera);
/// Switches PTP on. It takes seconds until the camera's clock follows its master: see CheckPtp.
Status ApplyPtp(ArvCamera* camera);
/// The gap between packets of the size that they have by now; as the camera has it then, ns.
Result<int64_t> ApplyPacketDelay(ArvCamera* camera, int packet_size_bytes,
                                 const BandwidthShare& bandwidth);

/// How far the camera's clock is from its PTP master's. kFailed while it does not follow one.
Result<int64_t> PtpOffset_ns(ArvCamera* camera);
/// kFailed when the camera's clock does not follow its PTP master closely.
Status CheckPtp(ArvCamera* camera);

/// What the camera has, but for the gap between packets and the payload, which is the stream's.
/// `settings` are those that were applied.
Result<AppliedSettings> ReadSettings(ArvCamera* camera, const CameraSettings& settings);

}  // namespace rotunda::rig
