#include "rig/sim/camera_fault.h"

#include <algorithm>
#include <charconv>
#include <sstream>

namespace rotunda::sim {
namespace {

constexpr double kMaxDelay_ms = 60000;
constexpr int kMaxFrames = 1'000'000;
constexpr int64_t kMaxWidth_us = 60'000'000;
// Cameras have the inputs Line0 and Line1.
constexpr int kLastLine = 1;
// A century after the clock's begin: far below where nanoseconds and all delays overflow.
constexpr int64_t kMaxEdge_ns = 100LL * 365 * 86400 * 1'000'000'000;

struct Limits {
  double low;
  double high;
};

Limits LimitsOf(FaultKind kind) {
  switch (kind) {
    case FaultKind::kDropPackets:
    case FaultKind::kUnplugInFrame:
      return {0, 1};
    case FaultKind::kWrongFrameId:
      return {-65535, 65535};
    case FaultKind::kStealControl:
      return {0, 1};
    default:
      return {0, kMaxDelay_ms};
  }
}

const FaultText& TextOf(FaultKind kind) { return FaultTexts()[static_cast<size_t>(kind)]; }

Error Refused(const std::string& message) {
  return {ErrorCode::kInvalidArgument, message, "command"};
}

template <typename Number>
Result<Number> ParseNumber(const std::string& word, const std::string& what) {
  Number number = {};
  const char* end = word.data() + word.size();
  const auto [stopped, error] = std::from_chars(word.data(), end, number);
  if (error != std::errc() || stopped != end) {
    return Refused(what + " is \"" + word + "\", expected a number");
  }
  return number;
}

Status CheckRange(const std::string& what, int64_t value, int64_t most) {
  if (value >= 0 && value <= most) return {};
  return Refused(what + " is " + std::to_string(value) + ", expected 0 to " + std::to_string(most));
}

std::vector<std::string> Words(std::string_view text) {
  std::istringstream stream{std::string(text)};
  std::vector<std::string> words;
  for (std::string word; stream >> word;) words.push_back(word);
  return words;
}

Result<ServerCommand> ParsePulse(const std::vector<std::string>& words) {
  ServerCommand command;
  command.kind = ServerCommand::Kind::kPulse;
  if (words.size() > 1) {
    ROTUNDA_ASSIGN_OR_RETURN(command.line, ParseNumber<int>(words[1], "line"));
    ROTUNDA_RETURN_IF_ERROR(CheckRange("line", command.line, kLastLine));
  }
  if (words.size() > 2) {
    ROTUNDA_ASSIGN_OR_RETURN(const int64_t edge_ns, ParseNumber<int64_t>(words[2], "edge"));
    ROTUNDA_RETURN_IF_ERROR(CheckRange("edge", edge_ns, kMaxEdge_ns));
    command.edge_ns = edge_ns;
  }
  if (words.size() > 3) {
    ROTUNDA_ASSIGN_OR_RETURN(command.width_us, ParseNumber<int64_t>(words[3], "width"));
    ROTUNDA_RETURN_IF_ERROR(CheckRange("width", command.width_us, kMaxWidth_us));
  }
  return command;
}

Result<ServerCommand> ParseFault(const std::vector<std::string>& words) {
  ServerCommand command;
  command.kind = ServerCommand::Kind::kFault;
  command.camera = words[1];
  const auto& texts = FaultTexts();
  const auto text = std::find_if(texts.begin(), texts.end(),
                                 [&](const FaultText& known) { return words[2] == known.name; });
  if (text == texts.end()) {
    std::string names;
    for (const FaultText& known : texts)
      names += std::string(names.empty() ? "" : ", ") + known.name;
    return Refused("fault is \"" + words[2] + "\", expected one of " + names);
  }
  command.fault.kind = text->kind;
  if (words.size() == 3 && *text->unit != '\0') {
    return Refused(std::string("\"") + text->name + "\" needs a value, " + text->unit + ": " +
                   text->help);
  }
  if (words.size() > 3) {
    ROTUNDA_ASSIGN_OR_RETURN(command.fault.value, ParseNumber<double>(words[3], "value"));
  }
  if (words.size() > 4) {
    ROTUNDA_ASSIGN_OR_RETURN(command.fault.frames, ParseNumber<int>(words[4], "frames"));
  }
  ROTUNDA_RETURN_IF_ERROR(command.fault.Validate());
  return command;
}

}  // namespace

const std::vector<FaultText>& FaultTexts() {
  static const std::vector<FaultText> texts = {
      {FaultKind::kDropPackets, "drop", "0..1", "each packet is lost with this probability"},
      {FaultKind::kNoResend, "no-resend", "", "requests to send a packet again are not answered"},
      {FaultKind::kDropLeader, "drop-leader", "", "the first packet of a frame is lost"},
      {FaultKind::kDropTrailer, "drop-trailer", "", "the last packet of a frame is lost"},
      {FaultKind::kLate, "late", "ms", "frames are sent this much later"},
      {FaultKind::kWrongFrameId, "wrong-id", "number", "is added to the frame id"},
      {FaultKind::kRestartIds, "restart-ids", "", "the next frame has id 1"},
      {FaultKind::kSkew, "skew", "ms", "exposures begin this much later"},
      {FaultKind::kSecondPulse, "second-pulse", "ms", "a pulse is followed by another one"},
      {FaultKind::kFirstFrameLost, "first-lost", "ms",
       "after so long without a pulse, and after arming, a pulse gives no frame"},
      {FaultKind::kMute, "mute", "", "the trigger cable is cut"},
      {FaultKind::kUnplug, "unplug", "", "network and power are gone"},
      {FaultKind::kUnplugInFrame, "unplug-in-frame", "0..1",
       "network and power go when this part of the next frame is sent"},
      {FaultKind::kStealControl, "steal", "0 or 1",
       "another client has control (1: and the camera does not tell who asks)"},
      {FaultKind::kNoPtp, "no-ptp", "", "the PTP master is not heard any more"},
      {FaultKind::kReboot, "reboot", "ms", "restarts, which takes so long"},
  };
  return texts;
}

Status Fault::Validate() const {
  const Limits limits = LimitsOf(kind);
  const std::string name = TextOf(kind).name;
  std::ostringstream message;
  if (!(value >= limits.low && value <= limits.high)) {
    message << "value of \"" << name << "\" is " << value << ", expected " << limits.low << " to "
            << limits.high;
    return Refused(message.str());
  }
  if (frames < 0 || frames > kMaxFrames) {
    message << "frames of \"" << name << "\" is " << frames << ", expected 0 (until cleared) to "
            << kMaxFrames;
    return Refused(message.str());
  }
  return {};
}

std::string DescribeFault(const Fault& fault) {
  const FaultText& text = TextOf(fault.kind);
  std::ostringstream out;
  out << text.name;
  if (*text.unit != '\0') out << ' ' << fault.value;
  if (fault.frames > 0) out << " (" << fault.frames << " more)";
  return out.str();
}

Result<ServerCommand> ParseServerCommand(std::string_view text) {
  const std::vector<std::string> words = Words(text);
  const std::string name = words.empty() ? "" : words[0];
  const auto has_words = [&](size_t least, size_t most) {
    return words.size() >= least && words.size() <= most;
  };
  if (name == "pulse" && has_words(1, 4)) return ParsePulse(words);
  if (name == "fault" && has_words(3, 5)) return ParseFault(words);
  ServerCommand command;
  if (name == "shot" && has_words(2, 2)) {
    command.kind = ServerCommand::Kind::kShot;
    ROTUNDA_ASSIGN_OR_RETURN(command.shot, ParseNumber<int>(words[1], "shot"));
    return command;
  }
  if (name == "clear" && has_words(1, 2)) {
    command.kind = ServerCommand::Kind::kClear;
    if (words.size() > 1) command.camera = words[1];
    return command;
  }
  if (name == "list" && has_words(1, 1)) {
    command.kind = ServerCommand::Kind::kList;
    return command;
  }
  return Refused(
      "\"" + std::string(text) +
      "\" is none; expected pulse [LINE [EDGE_NS [WIDTH_US]]], shot NUMBER, fault CAMERA "
      "KIND [VALUE [FRAMES]], clear [CAMERA] or list");
}

}  // namespace rotunda::sim
