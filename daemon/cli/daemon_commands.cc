#include "daemon/cli/daemon_commands.h"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <memory>
#include <thread>
#include <utility>
#include <vector>

#include "daemon/capture_job.h"
#include "daemon/cli/api_client.h"
#include "daemon/cli/daemon_tables.h"
#include "daemon/cli/terminal.h"
#include "daemon/reconstruction_request.h"
#include "rig/lens_models.h"

namespace rotunda::cli {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

// How often a job is asked for: a tenth of the time that has been waited, within these. Each look
// is a line of the daemon's access log.
constexpr auto kMinJobPollInterval = std::chrono::milliseconds(200);
constexpr auto kMaxJobPollInterval = std::chrono::milliseconds(1000);
// How often a daemon that has gone is looked for.
constexpr auto kReturnPollInterval = std::chrono::milliseconds(200);

/// What a list or one thing is asked with.
struct QueryArguments {
  fs::path socket = kDefaultSocket;
  std::string id;     // empty: the list
  std::string after;  // `next` of the page before; empty: the newest
  int limit = 20;
};

/// Asks and prints: JSON as it comes, else by `print`.
int Show(const Result<Json>& answer, const CommonOptions& common,
         const std::function<void(const Json&)>& print) {
  if (!answer) return Fail(answer.error());
  common.json ? PrintJson(*answer) : print(*answer);
  return kDone;
}

bool WaitsForDisk(const Json& job) {
  return job.contains("progress") && job["progress"]["stage"] == daemon::kWaitingForDisk;
}

/// Shows how far a job is; says once that its shot waits for the disk, also where no progress is
/// shown.
void ShowProgress(const Json& job, ProgressLine& progress, bool& told_of_disk) {
  if (!job.contains("progress")) return;
  const Json& at = job["progress"];
  progress.Update(at["stage"].get<std::string>(), at["done"], at["total"]);
  if (!WaitsForDisk(job) || std::exchange(told_of_disk, true)) return;
  progress.Tell("job " + job["id"].dump() +
                ": the shot is taken and waits for the disk: make room there (`rotunda status` "
                "says where and why)");
}

/// What is to know of a job whose daemon cannot be asked any more.
Error Left(const Error& error, const Json& job) {
  if (error.code == ErrorCode::kFailed) return error;  // it has answered
  const std::string id = job["id"].dump();
  return {error.code,
          error.message + "; job " + id + ": `rotunda jobs " + id +
              "` tells what became of it when the daemon is back, `rotunda jobs " + id +
              " --rerun` runs it again if it was interrupted",
          error.context};
}

/// What goes on in the daemon after Ctrl-C, and what ends it, by the last look at the job.
Error LeftRunning(const Json& job) {
  const std::string id = job["id"].dump(), cancel = "`rotunda jobs --cancel " + id + "`";
  return Interrupted("; job " + id + " goes on without this command" +
                     (WaitsForDisk(job)
                          ? ": its shot is taken and waits for the disk, and " + cancel +
                                " is refused: make room there (`rotunda status` says where and "
                                "why), and it is written; only the end of the daemon gives it up"
                          : ", " + cancel + " ends it"));
}

/// Shows a job's progress until it has ended. Ctrl-C leaves it running, and says so.
Result<Json> FollowJob(const ApiClient& client, const Json& job, const CommonOptions& common) {
  const std::string target = "/v1/jobs/" + job["id"].dump();
  ProgressLine progress(!common.json);
  bool told_of_disk = false;
  Json last = job;
  const auto begin = std::chrono::steady_clock::now();
  while (true) {
    const Result<Json> now = client.Get(target);
    if (!now && now.error().code == ErrorCode::kCancelled) return LeftRunning(last);
    if (!now) return Left(now.error(), job);
    last = *now;
    const std::string state = (*now)["state"];
    if (state == "done") return *now;
    if (state != "queued" && state != "running") {
      return Error{ErrorCode::kFailed, now->contains("error") ? FieldText(*now, "error") : state,
                   "job " + job["id"].dump()};
    }
    ShowProgress(*now, progress, told_of_disk);
    const auto waited = std::chrono::duration_cast<std::chrono::milliseconds>(
        std::chrono::steady_clock::now() - begin);
    std::this_thread::sleep_for(std::clamp(waited / 10, kMinJobPollInterval, kMaxJobPollInterval));
  }
}

/// Queues a job and follows it to its end.
Result<Json> RunJob(const ApiClient& client, const std::string& target, const Json& body,
                    const CommonOptions& common) {
  ROTUNDA_ASSIGN_OR_RETURN(const Json job, client.Post(target, body));
  return FollowJob(client, job, common);
}

/// Which page of a list.
void AddPageOptions(CLI::App* command, QueryArguments& query) {
  command->add_option("--limit", query.limit, "How many to list, the newest first")
      ->check(CLI::Range(1, 500))
      ->capture_default_str();
  command
      ->add_option("--after", query.after,
                   "List older ones: those after this, as the list before says")
      ->type_name("NEXT");
}

/// A command with --socket and, if `words` has a name for it, an id to look at and the options of a
/// list.
CLI::App* AddQuery(CLI::App& app, CommonOptions& common, QueryArguments& query,
                   const std::vector<std::string>& words) {
  CLI::App* command = AddCommand(app, common, words[0], words[1], words[2]);
  AddSocketOption(command, query.socket);
  if (words.size() > 3) {
    command->add_option(words[3], query.id, "Show this one instead of the list");
    AddPageOptions(command, query);
    command->get_option("--after")->excludes(words[3]);
  }
  return command;
}

/// What follows the path of a list.
std::string PageQuery(const QueryArguments& query) {
  return "?limit=" + std::to_string(query.limit) +
         (query.after.empty() ? "" : "&after=" + PercentEncoded(query.after));
}

std::string ListTarget(const std::string& path, const QueryArguments& query) {
  return path + (query.id.empty() ? PageQuery(query) : "/" + PercentEncoded(query.id));
}

/// Of a reconstruction that is asked for; empty fields are left to the daemon.
struct ReconstructionArguments {
  bool wanted = false;
  std::string calibration, method, preset, pairs, prior;
  std::optional<bool> refine_intrinsics;
};

void AddReconstructionOptions(CLI::App* command, ReconstructionArguments& arguments) {
  CLI::Option* wanted = command->add_flag("--reconstruct", arguments.wanted,
                                          "Reconstruct CAPTURE and wait for the result");
  wanted->needs("CAPTURE");
  command
      ->add_option("--calibration", arguments.calibration,
                   "Lenses, scale and rig frame of this one; default: that in force at the shot")
      ->type_name("CALIBRATION")
      ->needs(wanted);
  command->add_option("--method", arguments.method, "See rotunda reconstruct; default: tc-sfm")
      ->check(CLI::IsMember(NamesIn(sfm::MethodsByName())))
      ->needs(wanted);
  command->add_option("--pairs", arguments.pairs, "Pairs to match; default: exhaustive")
      ->check(CLI::IsMember(NamesIn(sfm::PairSelectionsByName())))
      ->needs(wanted);
  AddPresetOption(command, arguments.preset)->needs(wanted);
  AddPriorOption(command, arguments.prior)->needs(wanted);
  for (CLI::Option* flag : AddLensFlags(command, arguments.refine_intrinsics)) flag->needs(wanted);
}

/// `body` with the field, when there is a value.
void SetIfGiven(Json& body, const char* field, const std::string& value) {
  if (!value.empty()) body[field] = value;
}

Json BodyOf(const ReconstructionArguments& arguments) {
  Json body = Json::object();
  SetIfGiven(body, "calibration", arguments.calibration);
  SetIfGiven(body, "method", arguments.method);
  SetIfGiven(body, "preset", arguments.preset);
  SetIfGiven(body, "pairs", arguments.pairs);
  SetIfGiven(body, "prior", arguments.prior);
  if (arguments.refine_intrinsics) body["refine_intrinsics"] = *arguments.refine_intrinsics;
  return body;
}

/// Of a calibration that is asked for; no captures: none is. Empty fields are left to the daemon.
struct CalibrationArguments {
  std::vector<std::string> captures;
  std::string model, frame_from, intrinsics_from, compare;
};

void AddCalibrationOptions(CLI::App* command, CalibrationArguments& arguments) {
  CLI::Option* from = command->add_option("--from", arguments.captures,
                                          "Calibrate from these captures of the target, and wait");
  from->type_name("CAPTURE")->excludes("--activate")->excludes("CALIBRATION");
  CLI::Option* model =
      command->add_option("--model", arguments.model, "Lenses, see rotunda calibrate");
  model->check(CLI::IsMember(NamesIn(rig::LensModelsByName())))->needs(from);
  const auto earlier = [&](const char* name, std::string& id, const char* help) {
    return command->add_option(name, id, help)->type_name("CALIBRATION")->needs(from);
  };
  earlier("--fix-intrinsics-from", arguments.intrinsics_from,
          "Keep lenses, rig frame and target of this one: one shot is enough")
      ->excludes(model);
  earlier("--frame-from", arguments.frame_from, "Keep the rig frame of this one");
  earlier("--compare", arguments.compare,
          "Name cameras that moved since this one; default: the one in force");
}

Json BodyOf(const CalibrationArguments& arguments) {
  Json body = {{"captures", arguments.captures}};
  SetIfGiven(body, "model", arguments.model);
  SetIfGiven(body, "intrinsics_from", arguments.intrinsics_from);
  SetIfGiven(body, "frame_from", arguments.frame_from);
  SetIfGiven(body, "compare", arguments.compare);
  return body;
}

/// Until `stop`. A daemon that has been there is waited for when it goes, and no event is missed.
Status FollowEvents(const ApiClient& client, const std::string& after, const std::stop_token& stop,
                    const ApiClient::OnEvent& on_event) {
  std::string last_id;  // not empty once a stream has begun
  while (true) {
    const std::string& from = last_id.empty() ? after : last_id;
    const Status status = client.Follow(
        "/v1/events" + (from.empty() ? "" : "?after=" + PercentEncoded(from)), last_id, on_event);
    const bool is_lost = status.ok() || status.error().code == ErrorCode::kIo;
    const bool may_return = is_lost || status.error().code == ErrorCode::kNotFound;
    if (last_id.empty() || !may_return) return status;
    if (stop.stop_requested()) return Interrupted("");
    if (is_lost) {
      std::fprintf(stderr,
                   "rotunda: the daemon has ended the connection; waiting until it is "
                   "back (Ctrl-C ends)\n");
    }
    std::this_thread::sleep_for(kReturnPollInterval);
  }
}

void PrintShot(const Json& result, const std::string& tally) {
  std::printf("%s\ncapture %s\n", tally.c_str(), FieldText(result, "capture").c_str());
  for (const Json& note : result.value("notes", Json::array())) {
    std::printf("%s\n", note.get<std::string>().c_str());
  }
}

/// The job that reconstructs a capture which has just been taken. kNotFound.
Result<Json> ReconstructionOf(const ApiClient& client, const std::string& capture) {
  ROTUNDA_ASSIGN_OR_RETURN(const Json jobs, client.Get("/v1/jobs?limit=500"));
  for (const Json& job : jobs["items"]) {
    if (job["kind"] == "reconstruction" && job["request"]["capture"] == capture) return job;
  }
  return Error{ErrorCode::kNotFound, "has no reconstruction among the newest jobs", capture};
}

/// Waits for the reconstruction of a capture; gives its verdict and other figures. An unsure one is
/// no error.
Result<Json> FollowReconstruction(const ApiClient& client, const std::string& capture,
                                  const CommonOptions& common) {
  ROTUNDA_ASSIGN_OR_RETURN(const Json job, ReconstructionOf(client, capture));
  ROTUNDA_ASSIGN_OR_RETURN(const Json done, FollowJob(client, job, common));
  return done["result"];
}

/// With the cameras that are not where the calibration in force has them.
Status PrintReconstruction(const ApiClient& client, const Json& reconstruction) {
  ROTUNDA_ASSIGN_OR_RETURN(const Json status, client.Get("/v1/status"));
  PrintFields(reconstruction);
  PrintMoved(status);
  return {};
}

/// Adds its reconstruction to what is known of a shot.
Status TellReconstruction(const ApiClient& client, const CommonOptions& common, Json& result) {
  std::fflush(stdout);  // what is known before
  ROTUNDA_ASSIGN_OR_RETURN(result["reconstruction"],
                           FollowReconstruction(client, result["capture"], common));
  return common.json ? Status() : PrintReconstruction(client, result["reconstruction"]);
}

}  // namespace

CLI::Option* AddSocketOption(CLI::App* command, fs::path& socket) {
  socket = kDefaultSocket;
  return command->add_option("--socket", socket, "Where the daemon serves")
      ->type_name("SOCKET")
      ->capture_default_str();
}

CLI::Option* AddPresetOption(CLI::App* command, std::string& preset) {
  return command
      ->add_option("--preset", preset,
                   "rig (default): the cameras surround the subject, and a result in which they do "
                   "not is unsure; internet: they may stand anywhere, and the result is not used "
                   "for drift")
      ->check(CLI::IsMember(NamesIn(daemon::RequestPresets())));
}

CLI::Option* AddPriorOption(CLI::App* command, std::string& prior) {
  return command
      ->add_option("--prior", prior,
                   "calibration: see rotunda reconstruct; such a result is not used for drift. "
                   "Default: none")
      ->check(CLI::IsMember(NamesIn(sfm::PriorsByName())));
}

int CaptureByDaemon(const DaemonShot& shot, const CommonOptions& common) {
  const ApiClient client(shot.socket, common.stop);
  Json body = {{"reconstruct", shot.reconstruct}};
  if (shot.subject) body["subject"] = *shot.subject;
  SetIfGiven(body, "preset", shot.preset);
  SetIfGiven(body, "prior", shot.prior);
  const Result<Json> job = RunJob(client, "/v1/captures", body, common);
  if (!job) return Fail(job.error());
  Json result = (*job)["result"];
  const std::string tally = FieldText(result, "ok") + "/" + FieldText(result, "of") + " ok";
  if (!common.json) PrintShot(result, tally);
  const Status followed = shot.follow ? TellReconstruction(client, common, result) : Status();
  if (common.json) PrintJson(result);
  if (!followed.ok()) return Fail(followed.error());
  if (result.value("complete", false)) return kDone;
  return Fail({ErrorCode::kFailed, result.value("summary", tally), kIncompleteSet});
}

int CamerasOfDaemon(const fs::path& socket, const CommonOptions& common) {
  const Result<Json> cameras = ApiClient(socket, common.stop).Get("/v1/cameras");
  return Show(cameras, common, PrintCameras);
}

void AddStatus(CLI::App& app, CommonOptions& common, Action& chosen) {
  auto query = std::make_shared<QueryArguments>();
  CLI::App* command = AddQuery(
      app, common, *query,
      {"status", "Tell how the rig is, from the daemon, and what to see to.", "rotunda status"});
  command->callback([query, &common, &chosen] {
    chosen = [query, &common] {
      return Show(ApiClient(query->socket, common.stop).Get("/v1/status"), common, PrintStatus);
    };
  });
}

void AddJobs(CLI::App& app, CommonOptions& common, Action& chosen) {
  auto query = std::make_shared<QueryArguments>();
  CLI::App* command =
      AddQuery(app, common, *query,
               {"jobs", "List the daemon's jobs, show one, cancel one or run one again.",
                "rotunda jobs\n  rotunda jobs 17\n  rotunda jobs 17 --cancel", "JOB"});
  auto cancel = std::make_shared<bool>(false), rerun = std::make_shared<bool>(false);
  auto follow = std::make_shared<bool>(false);
  command->add_flag("--cancel", *cancel, "Cancel JOB")->needs("JOB");
  command->add_flag("--rerun", *rerun, "Run JOB again: interrupted, failed or cancelled ones")
      ->needs("JOB")
      ->excludes("--cancel");
  command->add_flag("--follow", *follow, "Show the progress of JOB until it has ended")
      ->needs("JOB")
      ->excludes("--cancel");
  command->callback([=, &common, &chosen] {
    chosen = [=, &common] {
      const ApiClient client(query->socket, common.stop);
      const std::string target = ListTarget("/v1/jobs", *query);
      Result<Json> answer = *cancel  ? client.Delete(target)
                            : *rerun ? client.Post(target + "/rerun", nullptr)
                                     : client.Get(target);
      if (answer && *follow) answer = FollowJob(client, *answer, common);
      return Show(answer, common, query->id.empty() ? PrintJobs : PrintJob);
    };
  });
}

void AddCaptures(CLI::App& app, CommonOptions& common, Action& chosen) {
  auto query = std::make_shared<QueryArguments>();
  CLI::App* command =
      AddQuery(app, common, *query,
               {"captures", "List the daemon's captures, show one, or reconstruct one again.",
                "rotunda captures\n  rotunda captures 20261122T101500Z\n"
                "  rotunda captures 20261122T101500Z --reconstruct\n"
                "  rotunda captures 20261122T101500Z --reconstruct --prior calibration",
                "CAPTURE"});
  auto reconstruction = std::make_shared<ReconstructionArguments>();
  AddReconstructionOptions(command, *reconstruction);
  command->callback([=, &common, &chosen] {
    chosen = [=, &common] {
      const ApiClient client(query->socket, common.stop);
      const std::string target = ListTarget("/v1/captures", *query);
      if (reconstruction->wanted) {
        return Show(RunJob(client, target + "/reconstructions", BodyOf(*reconstruction), common),
                    common, PrintJob);
      }
      return Show(client.Get(target), common, query->id.empty() ? PrintCaptures : PrintCapture);
    };
  });
}

void AddCalibrations(CLI::App& app, CommonOptions& common, Action& chosen) {
  auto query = std::make_shared<QueryArguments>();
  CLI::App* command = AddQuery(
      app, common, *query,
      {"calibrations", "List the daemon's calibrations, show one, make one, put one in force.",
       "rotunda calibrations\n  rotunda calibrations --from 20261122T101500Z 20261122T101700Z\n"
       "  rotunda calibrations charuco-20261122T101700250Z --activate\n"
       "  rotunda calibrations --from 20261123T080000Z --fix-intrinsics-from "
       "charuco-20261122T101700250Z",
       "CALIBRATION"});
  auto activate = std::make_shared<bool>(false);
  auto calibration = std::make_shared<CalibrationArguments>();
  command->add_flag("--activate", *activate, "Put CALIBRATION in force")->needs("CALIBRATION");
  AddCalibrationOptions(command, *calibration);
  command->callback([=, &common, &chosen] {
    chosen = [=, &common] {
      const ApiClient client(query->socket, common.stop);
      if (!calibration->captures.empty()) {
        return Show(RunJob(client, "/v1/calibrations", BodyOf(*calibration), common), common,
                    PrintJob);
      }
      const std::string target = ListTarget("/v1/calibrations", *query);
      return Show(*activate ? client.Post(target + "/activate", nullptr) : client.Get(target),
                  common, query->id.empty() ? PrintCalibrations : PrintCalibration);
    };
  });
}

void AddDrift(CLI::App& app, CommonOptions& common, Action& chosen) {
  auto query = std::make_shared<QueryArguments>();
  CLI::App* command = AddQuery(
      app, common, *query,
      {"drift",
       "Tell how far cameras are from where the calibration in force has them, of each the newest "
       "that is known, or the history of one.",
       "rotunda drift\n  rotunda drift c07r2"});
  command->add_option("CAMERA", query->id, "Show its history, the newest first");
  AddPageOptions(command, *query);
  command->get_option("--limit")->needs("CAMERA");
  command->get_option("--after")->needs("CAMERA");
  command->callback([query, &common, &chosen] {
    chosen = [query, &common] {
      const bool is_one = !query->id.empty();
      const std::string target =
          "/v1/drift" + (is_one ? PageQuery(*query) + "&camera=" + PercentEncoded(query->id) : "");
      return Show(ApiClient(query->socket, common.stop).Get(target), common,
                  is_one ? PrintDriftHistory : PrintDrift);
    };
  });
}

void AddEvents(CLI::App& app, CommonOptions& common, Action& chosen) {
  auto query = std::make_shared<QueryArguments>();
  auto after = std::make_shared<std::string>();
  CLI::App* command = AddQuery(
      app, common, *query,
      {"events",
       "Show what happens at the daemon, a line an event, until Ctrl-C; also when the daemon is "
       "restarted meanwhile.",
       "rotunda events\n  rotunda events --after 0 --json"});
  command->add_option("--after", *after, "Begin after this event; 0: with all that are kept")
      ->type_name("NUMBER");
  command->callback([=, &common, &chosen] {
    chosen = [=, &common] {
      const ApiClient client(query->socket, common.stop);
      const Status status = FollowEvents(client, *after, common.stop, [&common](const Json& event) {
        common.json ? static_cast<void>(std::printf("%s\n", event.dump().c_str()))
                    : PrintEvent(event);
        std::fflush(stdout);  // each event when it happens, in a pipe too
      });
      const bool asked_to_end = !status && status.error().code == ErrorCode::kCancelled;
      return status.ok() || asked_to_end ? kDone : Fail(status.error());
    };
  });
}

}  // namespace rotunda::cli
