#include "tests/bench/daemon_checks.h"

#include <sqlite3.h>

#include <algorithm>
#include <cstdio>
#include <iterator>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <thread>
#include <utility>

#include "daemon/capture_job.h"
#include "daemon/store_captures.h"
#include "daemon/store_jobs.h"
#include "sfm/core/checksum.h"
#include "sfm/core/file_io.h"

namespace rotunda::bench {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;
using std::chrono::milliseconds;

constexpr auto kPollInterval = milliseconds(30);
constexpr char kScale[] = "0.3";

template <typename Record, typename List>
std::vector<Record> AllOf(const List& list) {
  std::vector<Record> all;
  daemon::Page page{daemon::kMaxPageLimit, ""};
  do {
    auto listing = list(page);
    Require(listing.ok(), listing.ok() ? "" : listing.error().ToString());
    all.insert(all.end(), listing->items.begin(), listing->items.end());
    page.after = listing->next;
  } while (!page.after.empty());
  return all;
}

size_t ComparePictures(daemon::Store& store, const fs::path& state, const std::string& capture) {
  size_t compared = 0;
  const auto frames = daemon::ListFrames(store, capture);
  Require(frames.ok(), "the frames of " + capture + " cannot be listed");
  for (const daemon::FrameRecord& frame : *frames) {
    if (frame.file.empty()) continue;
    const auto bytes = ReadFile(state / frame.file);
    Require(bytes.ok(), frame.file + " cannot be read");
    Require(Xxh3Text(*bytes) == frame.xxh3, frame.file + " is not what was taken");
    ++compared;
  }
  return compared;
}

/// Why a job may fail on the pictures of RenderScenes(): the cameras of the daemon before have not
/// come back yet; a calibration got pictures of the person, or too few of the target; few small
/// pictures do not give a model.
constexpr const char* kReasons[] = {
    "capture: cameras: none of ",
    "calibration: no picture of ",
    "calibration: no camera saw enough of the board",
    "calibration: no camera sees enough corners that fit together",
    "the corners seen do not determine all lens parameters",
    "reconstruction: reconstruction: no two pictures match",
    "reconstruction: reconstruction: no pair of pictures starts a model",
    "reconstruction: cluster reconstruction: no cluster of pictures gives a model",
};

std::string ReasonOf(const daemon::JobRecord& job) {
  return std::string(daemon::JobKindName(job.kind)) + ": " + job.error;
}

/// Each capture that is there and was to be reconstructed has one job for that. Gives how many.
size_t CheckFollowUps(daemon::Store& store, const std::vector<daemon::JobRecord>& jobs) {
  std::map<std::string, int> wanted, found;
  for (const daemon::JobRecord& job : jobs) {
    const auto follow_up = daemon::CaptureFollowUp(store, job);
    if (job.kind == daemon::JobKind::kReconstruction) {
      ++found[job.body];
    } else if (job.kind == daemon::JobKind::kCapture && follow_up &&
               daemon::FindCapture(store, job.product).ok()) {
      ++wanted[follow_up->body];
    }
  }
  for (const auto& [body, count] : wanted) {
    Require(count == 1, "two jobs took " + body);
    Require(found[body] == 1, std::to_string(found[body]) + " reconstructions of " + body);
  }
  return wanted.size();
}

}  // namespace

void Require(bool fine, const std::string& what) {
  if (!fine) throw std::runtime_error(what);
}

std::string CountsText(const std::map<std::string, size_t>& counts) {
  std::string text;
  for (const auto& [name, count] : counts) {
    text += (text.empty() ? "" : ", ") + std::to_string(count) + " " + name;
  }
  return text.empty() ? "none" : text;
}

double Quantile(std::vector<double> values, double part) {
  const auto rank = static_cast<ptrdiff_t>(part * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + rank, values.end());
  return values[static_cast<size_t>(rank)];
}

void Render(const std::string& command, const fs::path& out, std::vector<std::string> words) {
  words.insert(words.begin(), {command, "simulate", out});
  const auto outcome = test::RunProcess(words);
  Require(outcome.exit_code == 0, outcome.errors);
}

std::vector<fs::path> RenderScenes(const std::string& command, const fs::path& folder,
                                   int cameras) {
  const std::vector<std::string> common = {"--cameras", std::to_string(cameras), "--scale", kScale};
  std::vector<std::string> target = {"--target", "cuboid", "--placements",
                                     std::to_string(kTargetShots)};
  target.insert(target.end(), common.begin(), common.end());
  Render(command, folder / "target", target);
  Render(command, folder / "person", common);
  std::vector<fs::path> sets;
  for (size_t i = 0; i < kTargetShots; ++i) {
    sets.push_back(folder / "target" / ("placement_0" + std::to_string(i)));
  }
  sets.push_back(folder / "person");
  return sets;
}

std::optional<std::vector<Json>> DaemonClient::NewestJobs(size_t most) const {
  constexpr size_t kPage = 500;
  std::vector<Json> jobs;
  std::string after;
  do {
    const Json page =
        daemon_.Get("/v1/jobs?limit=" + std::to_string(std::min(most, kPage)) + after);
    if (!page.is_object() || !page.contains("items")) return std::nullopt;
    jobs.insert(jobs.end(), page["items"].begin(), page["items"].end());
    after = page.contains("next") ? "&after=" + page["next"].get<std::string>() : "";
  } while (!after.empty() && jobs.size() < most);
  return jobs;
}

bool DaemonClient::Run(milliseconds patience, bool new_work) {
  const size_t looked_at = new_work ? 100 : std::numeric_limits<size_t>::max();
  const auto end = std::chrono::steady_clock::now() + patience;
  bool reran = false;
  while (std::chrono::steady_clock::now() < end) {
    std::this_thread::sleep_for(kPollInterval);
    const auto jobs = NewestJobs(looked_at);
    if (!jobs) continue;
    Open open;
    for (const Json& job : *jobs) {
      if (job["kind"] == "capture" && job["state"] == "done") {
        acknowledged.insert(job["result"]["capture"].get<std::string>());
      }
      const bool runs_again = !reran && job["state"] == "interrupted" && WantsRerun(job, new_work);
      if (runs_again) daemon_.Ask("POST", "/v1/jobs/" + job["id"].dump() + "/rerun");
      if (runs_again || job["state"] == "queued" || job["state"] == "running") {
        ++(job["kind"] == "capture" ? open.captures : open.computing);
      }
    }
    reran = true;
    if (new_work) {
      Submit(open);
    } else if (open.captures + open.computing == 0) {
      return true;
    }
  }
  return false;
}

bool DaemonClient::WantsRerun(const Json& job, bool new_work) {
  // Else the same long one would be begun and killed for ever.
  constexpr int kLeftOut = 3;
  return !new_work || job["kind"] == "capture" || ++interrupted_ % kLeftOut != 0;
}

void DaemonClient::Submit(const Open& open) {
  if (open.captures == 0) {
    const bool reconstruct = std::exchange(follow_up_wanted_, false);
    daemon_.Ask("POST", "/v1/captures", Json({{"reconstruct", reconstruct}}).dump());
  }
  const bool have_target = acknowledged.size() >= kTargetShots;
  if (!have_target || follow_up_wanted_ || open.computing > 1) return;
  switch (++computed_ % 3) {
    case 0: {
      Json captures = Json::array();
      for (const std::string& id : acknowledged) {
        if (captures.size() < kTargetShots) captures.push_back(id);
      }
      daemon_.Ask("POST", "/v1/calibrations", Json({{"captures", captures}}).dump());
      break;
    }
    case 1:
      daemon_.Ask("POST", "/v1/captures/" + *acknowledged.rbegin() + "/reconstructions",
                  R"({"method": "plain"})");
      break;
    default:
      follow_up_wanted_ = true;
  }
}

void StateInspector::CheckFailure(const daemon::JobRecord& job) const {
  const std::string reason = ReasonOf(job);
  const auto is_in = [&reason](const std::string& part) {
    return reason.find(part) != std::string::npos;
  };
  Require(std::any_of(std::begin(kReasons), std::end(kReasons), is_in) ||
              std::any_of(more_reasons_.begin(), more_reasons_.end(), is_in),
          "job " + std::to_string(job.number) + " failed, which it must not for this reason: " +
              (job.error.empty() ? "none is given" : reason));
}

void StateInspector::LookAtJobs(daemon::Store& store) {
  findings_.jobs.clear();
  findings_.failures.clear();
  const auto jobs = AllOf<daemon::JobRecord>(
      [&store](const daemon::Page& page) { return daemon::ListJobs(store, page); });
  for (const daemon::JobRecord& job : jobs) {
    const std::string number = "job " + std::to_string(job.number);
    ++findings_.jobs[daemon::JobStateName(job.state)];
    Require(job.state != daemon::JobState::kRunning, number + " is said to run");
    if (job.state == daemon::JobState::kFailed) {
      CheckFailure(job);
      ++findings_.failures[ReasonOf(job)];
    }
    if (job.state == daemon::JobState::kDone) {
      Require(!job.result.empty(), number + " is done without a result");
    }
  }
  findings_.follow_ups = CheckFollowUps(store, jobs);
}

void StateInspector::LookAtDatabase() const {
  sqlite3* opened = nullptr;
  const int code = sqlite3_open((state_ / "rotunda.db").c_str(), &opened);
  const std::unique_ptr<sqlite3, int (*)(sqlite3*)> database(opened, sqlite3_close);
  Require(code == SQLITE_OK, "the database cannot be opened");
  for (const char* pragma : {"PRAGMA integrity_check", "PRAGMA foreign_key_check"}) {
    std::string findings;
    const auto row = [](void* text, int, char** values, char**) {
      const std::string value = values[0] == nullptr ? "" : values[0];
      if (value != "ok") *static_cast<std::string*>(text) += value + "; ";
      return 0;
    };
    const int ran = sqlite3_exec(opened, pragma, row, &findings, nullptr);
    Require(ran == SQLITE_OK && findings.empty(), std::string(pragma) + ": " + findings);
  }
}

void StateInspector::LookAtTemporaries() const {
  for (const char* folder : {"captures", "calibrations", "reconstructions"}) {
    if (!fs::exists(state_ / folder)) continue;
    for (const auto& entry : fs::directory_iterator(state_ / folder)) {
      Require(!entry.path().filename().string().starts_with("."),
              entry.path().string() + " was left");
    }
  }
}

void StateInspector::Look(const std::set<std::string>& acknowledged, bool all_pictures) {
  {
    daemon::EventHub hub;
    // As the service opens it.
    daemon::StoreOptions options{state_, [] { return std::chrono::system_clock::now(); }, {}};
    options.follow_up = daemon::CaptureFollowUp;
    auto store = daemon::Store::Open(std::move(options), hub);
    Require(store.ok(), store.ok() ? "" : store.error().ToString());
    const daemon::RecoveryReport& recovery = (*store)->recovery();
    Require(recovery.gone.empty(), "a folder is gone");
    Require(recovery.unreadable.empty(),
            recovery.unreadable.empty() ? "" : recovery.unreadable.front());
    findings_.adopted += recovery.adopted.size();
    findings_.temporaries += recovery.removed_temporaries;
    for (const int64_t number : recovery.interrupted) {
      const auto job = daemon::FindJob(**store, number);
      Require(job.ok(), "an interrupted job is lost");
      ++findings_.interrupted[daemon::JobKindName(job->kind)];
    }
    for (const std::string& id : acknowledged) {
      Require(daemon::FindCapture(**store, id).ok(), "capture " + id + " is lost");
    }
    const auto captures = AllOf<daemon::CaptureRecord>(
        [&store](const daemon::Page& page) { return daemon::ListCaptures(**store, page); });
    findings_.captures = captures.size();
    for (const daemon::CaptureRecord& capture : captures) {
      if (!compared_.insert(capture.id).second && !all_pictures) continue;
      findings_.pictures += ComparePictures(**store, state_, capture.id);
    }
    LookAtJobs(**store);
  }
  LookAtDatabase();
  LookAtTemporaries();
}

}  // namespace rotunda::bench
