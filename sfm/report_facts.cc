#include "sfm/report_facts.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include "sfm/core/html_text.h"
#include "sfm/core/name_list.h"
#include "sfm/rig_alignment.h"
#include "sfm/run_choices.h"

namespace rotunda::sfm::report {
namespace {

/// A camera's figure stands out when it is beyond the median by this many robust standard
/// deviations (1.4826 x median absolute deviation) and by this factor. Both, because a rig that is
/// very even has a tiny deviation, and 90 cameras times three figures must not raise false alarms.
constexpr double kOutlierSigmas = 6.0;
constexpr double kOutlierFactor = 1.6;
/// Fewer observations than this share of the median leave a pose weakly held.
constexpr double kFewObservationsShare = 0.25;
/// Below this share of registered cameras there are gaps in the body's coverage.
constexpr double kUsableShare = 0.8;
/// Keypoints are localised to well under a pixel; more means blur, a wrong lens or wrong matches.
constexpr double kHighRms_px = 2.0;
/// A camera farther off the calibration than this many of its sigmas is named; where a single
/// direction holds the error, 90 cameras in place show one in a hundred shots.
constexpr double kLookSigmas = 4.0;

double Percentile(const std::vector<double>& sorted, double share) {
  const double place = share * static_cast<double>(sorted.size() - 1);
  const size_t below = static_cast<size_t>(place);
  const size_t above = std::min(below + 1, sorted.size() - 1);
  return sorted[below] + (place - static_cast<double>(below)) * (sorted[above] - sorted[below]);
}

void Summarize(Quantity& quantity) {
  std::vector<double> sorted;
  double largest = -1;
  for (size_t i = 0; i < quantity.values.size(); ++i) {
    if (!quantity.values[i]) continue;
    sorted.push_back(*quantity.values[i]);
    if (sorted.back() > largest) {
      largest = sorted.back();
      quantity.worst = i;
    }
  }
  if (sorted.empty()) return;
  std::sort(sorted.begin(), sorted.end());
  for (const double value : sorted) quantity.mean += value / static_cast<double>(sorted.size());
  quantity.median = Percentile(sorted, 0.5);
  quantity.low = Percentile(sorted, 0.05);
  quantity.high = Percentile(sorted, 0.95);
  quantity.max = sorted.back();
  quantity.decimals = DecimalsFor(quantity.median);
}

double RobustSigma(const Quantity& quantity) {
  std::vector<double> deviations;
  for (const auto& value : quantity.values) {
    if (value) deviations.push_back(std::abs(*value - quantity.median));
  }
  if (deviations.empty()) return 0;
  std::sort(deviations.begin(), deviations.end());
  return 1.4826 * Percentile(deviations, 0.5);
}

using Getter = std::function<std::optional<double>(const CameraPose&)>;

struct QuantityKind {
  const char* key;
  const char* label;
  std::string unit;
  bool graded;
  Getter value;
};

std::vector<QuantityKind> QuantityKinds(bool metric) {
  // Sigmas are kept in 1/1000 of the model's unit: millimetres when it is the metre.
  const double sigma_scale = metric ? 1.0 : 1e-3;
  return {
      {"observations", "Observations", "", false,
       [](const CameraPose& pose) { return static_cast<double>(pose.observations); }},
      {"rms", "Residual rms", "px", true, [](const CameraPose& pose) { return pose.rms_px; }},
      {"sigma-rotation", "σ rotation", "°", true,
       [](const CameraPose& pose) -> std::optional<double> {
         if (!pose.sigma) return std::nullopt;
         return pose.sigma->rotation_deg;
       }},
      {"sigma-position", "σ position", metric ? "mm" : "units", true,
       [sigma_scale](const CameraPose& pose) -> std::optional<double> {
         if (!pose.sigma) return std::nullopt;
         return pose.sigma->position_mm * sigma_scale;
       }},
      {"drift-rotation", "Turn vs calibration", "°", true,
       [](const CameraPose& pose) -> std::optional<double> {
         if (!pose.vs_calibration || pose.vs_calibration->swapped_with) return std::nullopt;
         return pose.vs_calibration->rotation_deg;
       }},
      {"drift-position", "Shift vs calibration", "mm", true,
       [](const CameraPose& pose) -> std::optional<double> {
         if (!pose.vs_calibration || pose.vs_calibration->swapped_with) return std::nullopt;
         return pose.vs_calibration->position_mm;
       }},
      {"focal", "Focal length", "px", false,
       [](const CameraPose& pose) -> std::optional<double> {
         if (pose.intrinsics.params.size() != CameraParamCount(pose.intrinsics.model)) {
           return std::nullopt;
         }
         return pose.intrinsics.MeanFocal_px();
       }},
  };
}

std::vector<Quantity> BuildQuantities(const PoseSet& poses) {
  std::vector<Quantity> quantities;
  for (const QuantityKind& kind : QuantityKinds(poses.metric)) {
    Quantity quantity{.key = kind.key,
                      .label = kind.label,
                      .unit = kind.unit,
                      .values = {},
                      .graded = kind.graded};
    for (const CameraPose& pose : poses.cameras) {
      std::optional<double> value = pose.registered ? kind.value(pose) : std::nullopt;
      if (value && !std::isfinite(*value)) value.reset();
      quantity.values.push_back(value);
    }
    if (!quantity.Known()) continue;
    Summarize(quantity);
    if (quantity.key == "observations") quantity.decimals = 0;
    quantities.push_back(std::move(quantity));
  }
  return quantities;
}

void Raise(CameraFacts& facts, Level level, std::string note) {
  facts.level = std::max(facts.level, level);
  facts.notes.push_back(std::move(note));
}

void NoteOutliers(const Quantity& quantity, const std::string& what,
                  std::vector<CameraFacts>& cameras) {
  const double limit = std::max(quantity.median + kOutlierSigmas * RobustSigma(quantity),
                                quantity.median * kOutlierFactor);
  if (quantity.median <= 0) return;
  for (size_t i = 0; i < cameras.size(); ++i) {
    const auto& value = quantity.values[i];
    if (!value || *value <= limit) continue;
    Raise(cameras[i], Level::kLook,
          what + ": " + Fixed(*value / quantity.median, 1) + " × the median");
  }
}

void NoteFewObservations(const Quantity& quantity, std::vector<CameraFacts>& cameras) {
  for (size_t i = 0; i < cameras.size(); ++i) {
    const auto& value = quantity.values[i];
    if (!value || *value >= kFewObservationsShare * quantity.median) continue;
    Raise(cameras[i], Level::kLook, "few observations");
  }
}

/// "15.2 mm and 0.310° (8.2 sigmas)".
std::string Displacement(const VsCalibration& off) {
  return Significant(off.position_mm) + " mm and " + Significant(off.rotation_deg) + "° (" +
         Fixed(off.sigmas, 1) + " sigmas)";
}

/// Off the calibration by more than errors usually are.
bool IsDoubtful(const CameraPose& pose) {
  return pose.registered && pose.vs_calibration && !pose.vs_calibration->moved &&
         !pose.vs_calibration->swapped_with && pose.vs_calibration->sigmas > kLookSigmas;
}

std::string InPlaceOf(const CameraPose& pose) {
  return "stands where the calibration has " + *pose.vs_calibration->swapped_with;
}

std::string ReasonOf(const CameraPose& pose) {
  return pose.reason.empty() ? "no reason given" : pose.reason;
}

void JudgePlace(const CameraPose& pose, bool folded, CameraFacts& facts) {
  if (!pose.registered) {
    Raise(facts, Level::kBad, "not registered: " + ReasonOf(pose));
  } else if (pose.vs_calibration && pose.vs_calibration->moved) {
    facts.moved = true;
    Raise(facts, Level::kBad, "moved by " + Displacement(*pose.vs_calibration));
  } else if (pose.vs_calibration && pose.vs_calibration->wrong_side) {
    facts.wrong_side = true;
    Raise(facts, Level::kBad,
          "on the wrong side: off the calibration by " + Displacement(*pose.vs_calibration));
  } else if (pose.vs_calibration && pose.vs_calibration->swapped_with) {
    facts.swapped = true;
    Raise(facts, Level::kBad, "swapped: " + InPlaceOf(pose));
  } else if (IsDoubtful(pose) && !folded) {
    Raise(facts, Level::kLook, "off the calibration by " + Displacement(*pose.vs_calibration));
  }
}

/// "; matches would turn it by 179°, log-likelihood -12 against that and 9.5 for it".
std::string OtherPlace(const OtherPose& other) {
  return "; matches would turn it by " + Significant(other.rotation_deg) + "°, log-likelihood " +
         Significant(other.against) + " against that and " + Significant(other.in_favour) +
         " for it";
}

void JudgeEvidence(const PoseEvidence& evidence, CameraFacts& facts) {
  if (evidence.doubtful) {
    Raise(facts, Level::kLook,
          "may be on the look-alike side" +
              (evidence.other_pose ? OtherPlace(*evidence.other_pose) : std::string()));
  }
  if (evidence.late) Raise(facts, Level::kLook, "weakly tied: placed after all others");
}

std::vector<CameraFacts> BuildCameraFacts(const ReportInput& input, const Facts& facts) {
  std::vector<CameraFacts> cameras(input.poses.cameras.size());
  for (size_t i = 0; i < cameras.size(); ++i) {
    const CameraPose& pose = input.poses.cameras[i];
    JudgePlace(pose, input.poses.summary.folded.value_or(false), cameras[i]);
    if (pose.evidence) JudgeEvidence(*pose.evidence, cameras[i]);
    const std::string& status = input.set.frames[i].status;
    if (status != "ok") Raise(cameras[i], Level::kLook, "frame: " + status);
  }
  if (const Quantity* q = facts.Find("rms")) NoteOutliers(*q, "high residual", cameras);
  if (const Quantity* q = facts.Find("sigma-rotation")) NoteOutliers(*q, "weak rotation", cameras);
  if (const Quantity* q = facts.Find("sigma-position")) NoteOutliers(*q, "weak position", cameras);
  if (const Quantity* q = facts.Find("observations")) NoteFewObservations(*q, cameras);
  return cameras;
}

std::vector<std::string> NamesWhere(const PoseSet& poses, const std::function<bool(size_t)>& pick) {
  std::vector<std::string> names;
  for (size_t i = 0; i < poses.cameras.size(); ++i) {
    if (pick(i)) names.push_back(poses.cameras[i].camera);
  }
  return names;
}

std::string ShotHeadline(const PoseSet& poses) {
  const PoseSummary& summary = poses.summary;
  std::string text = std::to_string(summary.registered) + " of " + std::to_string(summary.of) +
                     " cameras registered";
  if (summary.folded) text += *summary.folded ? ", folded" : ", not folded";
  return text + (poses.metric ? "; scale metric" : "; scale arbitrary");
}

std::string LookAlikesToldApart(const PoseSummary& summary) {
  return "Parts of the subject look alike (" + std::to_string(summary.ambiguous_communities) +
         " segments) and were told apart; log-likelihood against mistaking them " +
         Significant(*summary.margin) + ".";
}

void Say(Level level, const std::string& text, Verdict& verdict) {
  verdict.level = std::max(verdict.level, level);
  verdict.details.push_back(text);
}

/// What is known of look-alike sides.
void SayOfSides(const PoseSet& poses, const std::vector<CameraFacts>& cameras, Verdict& verdict) {
  const PoseSummary& summary = poses.summary;
  if (summary.folded.value_or(false)) {
    Say(Level::kBad,
        "The model is folded: look-alike sides of the subject were laid on one another. Do not "
        "use these poses.",
        verdict);
    const auto wrong = NamesWhere(poses, [&](size_t i) { return cameras[i].wrong_side; });
    if (!wrong.empty()) verdict.details.push_back("On the wrong side: " + ListOfNames(wrong) + ".");
  }
  if (summary.verdict == "unsure") {
    Say(Level::kBad, "Unsure: " + summary.verdict_reason + ".", verdict);
  }
  const auto preset = poses.options.find("preset");
  if (summary.verdict == "sure" && preset != poses.options.end() && preset->second == "internet") {
    verdict.details.push_back(
        "Preset internet: a fold that no match contradicts would not have been seen.");
  }
  if (summary.verdict == "sure" && summary.margin) {
    verdict.details.push_back(LookAlikesToldApart(summary));
  }
  if (summary.view_graph_margin) {
    verdict.details.push_back(
        "Of the pictures' pairs, the lightest that holds them together weighs " +
        Significant(*summary.view_graph_margin) +
        " x the heaviest that contradicts it (below about 1.2 pairs alone do not tell; the verdict "
        "does not rest on them).");
  }
  if (summary.verdict.empty() && !summary.folded) {
    Say(Level::kLook,
        "Not judged: this method does not look for look-alike sides, and there is no calibration "
        "to tell.",
        verdict);
  }
}

/// Pieces, and cameras without a pose.
void SayWhatIsMissing(const PoseSet& poses, Verdict& verdict) {
  const PoseSummary& summary = poses.summary;
  if (summary.models > 1) {
    Say(Level::kLook,
        "The reconstruction broke into " + std::to_string(summary.models) +
            " pieces that could not be joined; the largest is given.",
        verdict);
  }
  if (summary.registered == summary.of) return;
  const bool usable =
      static_cast<double>(summary.registered) >= kUsableShare * static_cast<double>(summary.of);
  const auto missing = NamesWhere(poses, [&](size_t i) { return !poses.cameras[i].registered; });
  std::string text = "Without a pose: " + ListOfNames(missing);
  const auto first = std::find_if(poses.cameras.begin(), poses.cameras.end(),
                                  [](const CameraPose& pose) { return !pose.registered; });
  if (missing.size() == 1) text += " (" + ReasonOf(*first) + ")";
  Say(usable ? Level::kLook : Level::kBad, text + ".", verdict);
}

void SayHowAccurate(const PoseSet& poses, Verdict& verdict) {
  const bool no_sigmas =
      std::none_of(poses.cameras.begin(), poses.cameras.end(),
                   [](const CameraPose& pose) { return pose.sigma.has_value(); });
  if (no_sigmas) {
    Say(Level::kLook, "Accuracy not known: without calibrated lenses there are no uncertainties.",
        verdict);
  }
  if (poses.summary.registered > 0 && poses.summary.rms_px > kHighRms_px) {
    Say(Level::kLook, "The residual of " + Significant(poses.summary.rms_px) + " px is high.",
        verdict);
  }
}

Verdict BuildShotVerdict(const PoseSet& poses, const std::vector<CameraFacts>& cameras) {
  Verdict verdict{Level::kGood, "Shot good", ShotHeadline(poses), {}};
  SayOfSides(poses, cameras, verdict);
  SayHowAccurate(poses, verdict);
  SayWhatIsMissing(poses, verdict);
  const auto weak = NamesWhere(poses, [&](size_t i) { return cameras[i].level == Level::kLook; });
  if (!weak.empty()) verdict.details.push_back("Worth a look: " + ListOfNames(weak) + ".");
  if (verdict.level == Level::kLook) verdict.mark = "Shot usable, look";
  if (poses.summary.verdict.empty() && !poses.summary.folded) verdict.mark = "Shot not judged";
  if (verdict.level == Level::kBad) verdict.mark = "Shot bad";
  if (verdict.details.empty()) {
    verdict.details.push_back("Nothing stands out in residuals, uncertainties or observations.");
  }
  return verdict;
}

/// "Camera c03 has moved", "Cameras c01 and c07 are swapped", "2 cameras have moved, 3 are
/// swapped".
std::string ChangeHeadline(const std::vector<std::string>& moved,
                           const std::vector<std::string>& swapped) {
  if (moved.empty() && swapped.size() == 2) {
    return "Cameras " + swapped[0] + " and " + swapped[1] + " are swapped";
  }
  if (moved.empty()) return std::to_string(swapped.size()) + " cameras are swapped";
  const std::string text = moved.size() == 1 ? "Camera " + moved[0] + " has moved"
                                             : std::to_string(moved.size()) + " cameras have moved";
  return swapped.empty() ? text : text + ", " + std::to_string(swapped.size()) + " are swapped";
}

/// One line a camera that is not in its place, as far as they are listed.
std::vector<std::string> ChangeDetails(const PoseSet& poses,
                                       const std::vector<CameraFacts>& cameras) {
  std::vector<std::string> details;
  size_t changed = 0;
  for (size_t i = 0; i < cameras.size(); ++i) {
    if (!cameras[i].moved && !cameras[i].swapped) continue;
    if (++changed > kNamesListed) continue;
    const CameraPose& pose = poses.cameras[i];
    details.push_back(
        pose.camera + " " +
        (cameras[i].swapped ? InPlaceOf(pose) : "by " + Displacement(*pose.vs_calibration)) + ".");
  }
  if (changed > kNamesListed) details.push_back("The table names all of them.");
  return details;
}

/// Names the cameras that are farther off than errors usually are, though not so far that they must
/// have moved.
void AddDoubtful(const PoseSet& poses, Verdict& verdict) {
  const auto doubtful = NamesWhere(poses, [&](size_t i) { return IsDoubtful(poses.cameras[i]); });
  if (doubtful.empty()) return;
  if (verdict.level == Level::kGood) {
    verdict.level = Level::kLook;
    verdict.mark = "Rig in place, look";
    verdict.headline = "No camera is seen to have moved";
  }
  verdict.details.push_back(
      "Off by more than " + Significant(kLookSigmas) +
      " sigmas, too little to say that they have moved: " + ListOfNames(doubtful) + ".");
}

/// Nobody would miss them otherwise.
void AddAbsent(const ReportInput& input, Verdict& verdict) {
  const std::vector<std::string> absent =
      CamerasWithoutFrame(*input.calibration, input.poses.cameras);
  if (absent.empty()) return;
  verdict.level = std::max(verdict.level, Level::kLook);
  if (verdict.mark == "Rig in place") verdict.mark = "Rig partly checked";
  verdict.details.push_back("Calibrated, but not in this frame set: " + ListOfNames(absent) + ".");
}

/// "All 90 cameras stand where the calibration says; the farthest off, in sigmas: c04 by ...".
std::string InPlace(const PoseSet& poses, size_t checked) {
  const auto sigmas = [](const CameraPose& pose) {
    return pose.vs_calibration ? pose.vs_calibration->sigmas : 0;
  };
  const auto farthest = std::max_element(
      poses.cameras.begin(), poses.cameras.end(),
      [&](const CameraPose& a, const CameraPose& b) { return sigmas(a) < sigmas(b); });
  return "All " + std::to_string(checked) +
         " cameras stand where the calibration says, as far as their uncertainties tell; the "
         "farthest off, in sigmas: " +
         farthest->camera + " by " + Displacement(*farthest->vs_calibration) + ".";
}

Verdict BuildRigVerdict(const ReportInput& input, const std::vector<CameraFacts>& cameras) {
  const PoseSet& poses = input.poses;
  const auto checked = NamesWhere(poses, [&](size_t i) {
    return poses.cameras[i].registered && poses.cameras[i].vs_calibration.has_value();
  });
  if (checked.empty()) {
    return {Level::kUnknown,
            "Rig not checked",
            "Not checked for moved cameras",
            {"There is no calibration to compare with."}};
  }
  if (poses.summary.folded.value_or(false)) {
    return {Level::kUnknown,
            "Rig not checked",
            "Not checked for moved cameras",
            {"Where the cameras of a folded model stand says nothing of the rig."}};
  }
  if (DisagreesAsAWhole(poses.cameras, kMovedSigmas)) {
    return {Level::kBad,
            "Rig differs",
            "The rig does not match the calibration",
            {"Half of the cameras or more are off beyond their uncertainties: the calibration is "
             "another rig's, or the rig has changed as a whole."}};
  }
  Verdict verdict{Level::kGood, "Rig in place", "No camera has moved", {}};
  const auto moved = NamesWhere(poses, [&](size_t i) { return cameras[i].moved; });
  const auto swapped = NamesWhere(poses, [&](size_t i) { return cameras[i].swapped; });
  const bool changed = !moved.empty() || !swapped.empty();
  if (changed) {
    verdict = {Level::kBad, "Rig changed", ChangeHeadline(moved, swapped),
               ChangeDetails(poses, cameras)};
  } else if (HadPrior(poses)) {
    return {Level::kUnknown,
            "Rig not checked",
            "Not checked for moved cameras",
            {"The calibration was a prior of these poses: they do not show that the rig is as it "
             "says."}};
  }
  if (checked.size() < poses.cameras.size()) {
    if (verdict.level == Level::kGood) {
      verdict.level = Level::kLook;
      verdict.mark = "Rig partly checked";
      verdict.headline = "No camera seen to have moved";
    }
    verdict.details.push_back(std::to_string(checked.size()) + " of " +
                              std::to_string(poses.cameras.size()) + " cameras could be checked.");
  } else if (!changed) {
    verdict.details.push_back(InPlace(poses, checked.size()));
  }
  AddDoubtful(poses, verdict);
  if (input.calibration) AddAbsent(input, verdict);
  return verdict;
}

}  // namespace

std::string_view LevelName(Level level) {
  switch (level) {
    case Level::kGood:
      return "good";
    case Level::kUnknown:
      return "unknown";
    case Level::kLook:
      return "look";
    case Level::kBad:
      return "bad";
  }
  return "unknown";
}

bool Quantity::Known() const {
  return std::any_of(values.begin(), values.end(), [](const auto& v) { return v.has_value(); });
}

const Quantity* Facts::Find(std::string_view key) const {
  for (const Quantity& quantity : quantities) {
    if (quantity.key == key) return &quantity;
  }
  return nullptr;
}

Facts BuildFacts(const ReportInput& input) {
  Facts facts;
  facts.quantities = BuildQuantities(input.poses);
  facts.cameras = BuildCameraFacts(input, facts);
  facts.shot = BuildShotVerdict(input.poses, facts.cameras);
  facts.rig = BuildRigVerdict(input, facts.cameras);
  for (const CameraPose& pose : input.poses.cameras) {
    if (pose.registered) facts.observations += pose.observations;
    facts.has_sides = facts.has_sides || !pose.side.empty();
  }
  return facts;
}

}  // namespace rotunda::sfm::report
