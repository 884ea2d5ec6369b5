#include "rig/shot.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "rig/complaints.h"
#include "sfm/core/statistics.h"

namespace rotunda::rig {
namespace {

std::string Fixed(double value) {
  char text[32];
  std::snprintf(text, sizeof(text), "%.1f", value);
  return text;
}

// In place of each camera's own trigger cable.
constexpr char kNobodySawThePulse[] =
    "armed and answering, but nobody saw the pulse: is the trigger cable connected? Else the "
    "trigger "
    "line itself, its driver or supply, [trigger] chip, line or camera_input";

/// Whether the reason's figures were measured of the camera.
bool IsMeasured(Verdict verdict) {
  return verdict == Verdict::kArmedLate || verdict == Verdict::kIncomplete ||
         verdict == Verdict::kLate || verdict == Verdict::kSkewed;
}

/// Whether the camera could not have told of a pulse.
bool WasNotThere(const CameraShot& camera) {
  const Verdict verdict = camera.verdict;
  return verdict == Verdict::kDisconnected || verdict == Verdict::kWrongCamera ||
         verdict == Verdict::kControlLost || verdict == Verdict::kCameraError ||
         verdict == Verdict::kNotArmed || verdict == Verdict::kArmedLate ||
         (verdict == Verdict::kNoClock && !camera.arrival_ms);
}

/// Several cameras waited for the pulse, and none of them saw it.
bool NobodySawThePulse(const std::vector<CameraShot>& cameras) {
  const auto missing = std::count_if(cameras.begin(), cameras.end(), [](const CameraShot& each) {
    return each.verdict == Verdict::kMissing;
  });
  return missing > 1 && std::all_of(cameras.begin(), cameras.end(), [](const CameraShot& each) {
           return each.verdict == Verdict::kMissing || WasNotThere(each);
         });
}

}  // namespace

const char* VerdictName(Verdict verdict) {
  switch (verdict) {
    case Verdict::kOk:
      return "ok";
    case Verdict::kDisconnected:
      return "disconnected";
    case Verdict::kWrongCamera:
      return "wrong camera";
    case Verdict::kControlLost:
      return "control lost";
    case Verdict::kCameraError:
      return "camera error";
    case Verdict::kNotArmed:
      return "not armed";
    case Verdict::kArmedLate:
      return "armed late";
    case Verdict::kMissing:
      return "missing";
    case Verdict::kInterrupted:
      return "interrupted";
    case Verdict::kIncomplete:
      return "incomplete";
    case Verdict::kLate:
      return "late";
    case Verdict::kWrongPicture:
      return "wrong picture";
    case Verdict::kWrongId:
      return "wrong id";
    case Verdict::kNoClock:
      return "no clock";
    case Verdict::kSkewed:
      return "skewed";
    case Verdict::kSecondFrame:
      return "second frame";
  }
  return "";
}

size_t Shot::OkCount() const {
  return static_cast<size_t>(
      std::count_if(cameras.begin(), cameras.end(),
                    [](const CameraShot& each) { return each.verdict == Verdict::kOk; }));
}

uint64_t Shot::ResentPackets() const {
  uint64_t sum = 0;
  for (const CameraShot& each : cameras) sum += each.resent_packets;
  return sum;
}

std::string Shot::Tally() const {
  return std::to_string(OkCount()) + "/" + std::to_string(cameras.size()) + " ok";
}

std::string Shot::Summary() const {
  const bool has_picture = std::any_of(cameras.begin(), cameras.end(), [](const CameraShot& each) {
    return each.verdict == Verdict::kOk || each.arrival_ms;
  });
  std::string text = Tally() + (has_picture ? "" : ", no camera gave a picture");
  const bool nobody_saw_it = NobodySawThePulse(cameras);
  std::vector<Complaint> complaints;
  for (const CameraShot& each : cameras) {
    if (each.verdict == Verdict::kOk) continue;
    const bool blames_line = nobody_saw_it && each.verdict == Verdict::kMissing;
    complaints.push_back({each.camera, VerdictName(each.verdict),
                          blames_line ? kNobodySawThePulse : each.reason,
                          IsMeasured(each.verdict)});
  }
  for (const std::string& each : GroupComplaints(complaints, cameras.size())) text += "; " + each;
  return text;
}

void JudgeSkew(double limit_us, Shot& shot) {
  std::vector<int64_t> times_ns;
  for (const CameraShot& each : shot.cameras) {
    if (each.exposed_ns) times_ns.push_back(*each.exposed_ns);
  }
  shot.skew = {};
  if (times_ns.empty()) return;
  // From the first: a double holds differences exactly, but not times of 10^18 ns.
  std::vector<double> since_ns;
  for (const int64_t time_ns : times_ns) {
    since_ns.push_back(static_cast<double>(time_ns - times_ns[0]));
  }
  const int64_t median_ns = times_ns[0] + static_cast<int64_t>(Median(std::move(since_ns)));
  std::vector<double> sizes_us;
  for (CameraShot& each : shot.cameras) {
    if (!each.exposed_ns) continue;
    const double skew_us = 1e-3 * static_cast<double>(*each.exposed_ns - median_ns);
    each.skew_us = skew_us;
    sizes_us.push_back(std::abs(skew_us));
    if (shot.skew.worst.empty() || std::abs(skew_us) > shot.skew.max_us) {
      shot.skew.max_us = std::abs(skew_us);
      shot.skew.worst = each.camera;
    }
    if (each.verdict == Verdict::kOk && std::abs(skew_us) > limit_us + each.clock_uncertainty_us) {
      each.verdict = Verdict::kSkewed;
      each.reason = Fixed(std::abs(skew_us)) + " us " + (skew_us > 0 ? "after" : "before") +
                    " the others, allowed are " + Fixed(limit_us) + " us";
    }
  }
  shot.skew.median_us = Median(std::move(sizes_us));
}

bool FrameIdCheck::Accept(uint64_t id) {
  // 16-bit ids go from 65535 to 1, which is accepted anyway.
  const bool follows = id > last_ && id <= last_ + 1 + unseen_;
  const bool ahead = id > last_ + 1 + unseen_;
  if (id != 1 && !follows && !(ahead && id == slipped_to_ + 1)) {
    slipped_to_ = ahead ? id : 0;
    return false;
  }
  Begin(id);
  return true;
}

}  // namespace rotunda::rig
