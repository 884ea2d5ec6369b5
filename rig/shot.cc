#include "rig/shot.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "sfm/core/name_list.h"
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

/// Cameras that are not ok for one reason.
struct Complaint {
  Verdict verdict;
  std::string reason;
  std::vector<std::string> cameras;

  /// `all`: how many cameras there are.
  std::string Text(size_t all) const {
    const std::string why =
        std::string(VerdictName(verdict)) + (reason.empty() ? "" : " (" + reason + ")");
    if (cameras.size() == 1) return cameras.front() + " " + why;
    if (cameras.size() == all) return "all " + why;
    return std::to_string(cameras.size()) + " " + why + ": " + ListOfNames(cameras);
  }
};

/// In the order of each one's first camera.
std::vector<Complaint> ComplaintsOf(const std::vector<CameraShot>& cameras) {
  std::vector<Complaint> complaints;
  for (const CameraShot& each : cameras) {
    if (each.verdict == Verdict::kOk) continue;
    const auto same = std::find_if(complaints.begin(), complaints.end(), [&](const Complaint& one) {
      return one.verdict == each.verdict && one.reason == each.reason;
    });
    if (same == complaints.end()) {
      complaints.push_back({each.verdict, each.reason, {each.camera}});
    } else {
      same->cameras.push_back(each.camera);
    }
  }
  return complaints;
}

/// Whether the camera could not have told of a pulse.
bool WasNotThere(Verdict verdict) {
  return verdict == Verdict::kDisconnected || verdict == Verdict::kWrongCamera ||
         verdict == Verdict::kControlLost || verdict == Verdict::kCameraError ||
         verdict == Verdict::kNotArmed || verdict == Verdict::kArmedLate;
}

/// Several cameras waited for the pulse, and none of them saw it.
bool NobodySawThePulse(const std::vector<CameraShot>& cameras) {
  const auto missing = std::count_if(cameras.begin(), cameras.end(), [](const CameraShot& each) {
    return each.verdict == Verdict::kMissing;
  });
  return missing > 1 && std::all_of(cameras.begin(), cameras.end(), [](const CameraShot& each) {
           return each.verdict == Verdict::kMissing || WasNotThere(each.verdict);
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
  for (Complaint complaint : ComplaintsOf(cameras)) {
    if (nobody_saw_it && complaint.verdict == Verdict::kMissing) {
      complaint.reason = kNobodySawThePulse;
    }
    text += "; " + complaint.Text(cameras.size());
  }
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
