#include "daemon/cli/daemon_commands.h"

#include <chrono>
#include <cstdio>
#include <memory>
#include <thread>
#include <vector>

#include "daemon/cli/api_client.h"
#include "daemon/cli/terminal.h"

namespace rotunda::cli {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr auto kJobPollInterval = std::chrono::milliseconds(200);

/// What a list or one thing is asked with.
struct QueryArguments {
  fs::path socket = kDefaultSocket;
  std::string id;  // empty: the list
  int limit = 20;
};

/// A field as it is shown in a table; "-" when it is not there.
std::string Text(const Json& object, const std::string& key) {
  if (!object.contains(key)) return "-";
  const Json& value = object[key];
  if (value.is_string()) return value.get<std::string>();
  if (value.is_boolean()) return value.get<bool>() ? "yes" : "no";
  if (!value.is_number_float()) return value.dump();
  char text[32];
  std::snprintf(text, sizeof(text), "%.3f", value.get<double>());
  return text;
}

struct Column {
  const char* title;
  const char* key;
};

/// Columns as wide as they need.
void PrintTable(const Json& items, const std::vector<Column>& columns) {
  std::vector<size_t> widths;
  for (const Column& column : columns) {
    size_t width = std::string(column.title).size();
    for (const Json& item : items) width = std::max(width, Text(item, column.key).size());
    widths.push_back(width);
  }
  const auto print_row = [&](const auto& cell) {
    std::string line;
    for (size_t i = 0; i < columns.size(); ++i) {
      const std::string text = cell(columns[i]);
      line += text + std::string(widths[i] + 2 - text.size(), ' ');
    }
    line.erase(line.find_last_not_of(' ') + 1);
    std::printf("%s\n", line.c_str());
  };
  print_row([](const Column& column) { return std::string(column.title); });
  for (const Json& item : items) {
    print_row([&](const Column& column) { return Text(item, column.key); });
  }
}

void PrintJson(const Json& value) { std::printf("%s\n", value.dump(1).c_str()); }

/// Fields of one thing, a line each.
void PrintFields(const Json& object) {
  for (const auto& [key, value] : object.items()) {
    if (value.is_array() || value.is_object()) continue;
    std::printf("%-18s %s\n", key.c_str(), Text(object, key).c_str());
  }
}

/// Asks and prints: JSON as it comes, else by `print`.
int Show(const Result<Json>& answer, const CommonOptions& common,
         const std::function<void(const Json&)>& print) {
  if (!answer) return Fail(answer.error());
  common.json ? PrintJson(*answer) : print(*answer);
  return kDone;
}

void PrintJob(const Json& job) {
  PrintFields(job);
  for (const char* part : {"request", "progress", "result"}) {
    if (job.contains(part)) std::printf("%-18s %s\n", part, job[part].dump().c_str());
  }
}

void PrintJobs(const Json& page) {
  Json rows = page["items"];
  for (Json& row : rows) {
    if (!row.contains("progress") || row["state"] != "running") continue;
    const Json& progress = row["progress"];
    row["at"] = progress["stage"].get<std::string>() + " " + progress["done"].dump() + "/" +
                progress["total"].dump();
  }
  PrintTable(rows, {{"job", "id"},
                    {"kind", "kind"},
                    {"state", "state"},
                    {"created", "created_at"},
                    {"at", "at"},
                    {"product", "product"},
                    {"error", "error"}});
}

/// Shows a job's progress until it has ended. Ctrl-C leaves it running, and says so.
Result<Json> FollowJob(const ApiClient& client, const Json& job, const CommonOptions& common) {
  const std::string target = "/v1/jobs/" + job["id"].dump();
  ProgressLine progress(!common.json);
  while (true) {
    const Result<Json> now = client.Get(target);
    if (!now && now.error().code == ErrorCode::kCancelled) {
      const std::string id = job["id"].dump();
      return Interrupted("; job " + id + " goes on without this command, `rotunda jobs --cancel " +
                         id + "` ends it");
    }
    if (!now) return now.error();
    const std::string state = (*now)["state"];
    if (state == "done") return *now;
    if (state != "queued" && state != "running") {
      return Error{ErrorCode::kFailed, now->contains("error") ? Text(*now, "error") : state,
                   "job " + job["id"].dump()};
    }
    if (now->contains("progress")) {
      const Json& at = (*now)["progress"];
      progress.Update(at["stage"].get<std::string>(), at["done"], at["total"]);
    }
    std::this_thread::sleep_for(kJobPollInterval);
  }
}

/// Queues a job and follows it to its end.
Result<Json> RunJob(const ApiClient& client, const std::string& target, const Json& body,
                    const CommonOptions& common) {
  ROTUNDA_ASSIGN_OR_RETURN(const Json job, client.Post(target, body));
  return FollowJob(client, job, common);
}

void PrintStatus(const Json& status) {
  const Json& cameras = status["cameras"];
  std::printf("cameras      %s of %s ready\n", cameras["ready"].dump().c_str(),
              cameras["of"].dump().c_str());
  std::printf("calibration  %s\n",
              status.contains("calibration") ? Text(status, "calibration").c_str() : "none");
  if (status.contains("last_capture")) {
    const Json& last = status["last_capture"];
    std::printf("last capture %s, %s of %s frames, %s\n", Text(last, "id").c_str(),
                last["ok"].dump().c_str(), last["of"].dump().c_str(),
                last.contains("verdict") ? Text(last, "verdict").c_str() : "not reconstructed");
  }
  std::printf("jobs         %zu running, %s queued\n", status["jobs"]["running"].size(),
              status["jobs"]["queued"].dump().c_str());
  std::printf("disk         %.1f GB free\n", 1e-9 * status["disk"]["free_bytes"].get<double>());
  for (const Json& camera : status["moved"]) {
    std::printf("  moved: %s by %s mm, %s deg\n", Text(camera, "camera").c_str(),
                Text(camera, "position_mm").c_str(), Text(camera, "rotation_deg").c_str());
  }
  for (const Json& problem : status["problems"]) {
    std::printf("  see to: %s\n", problem.get<std::string>().c_str());
  }
}

void PrintCapture(const Json& capture) {
  PrintFields(capture);
  for (const Json& frame : capture["frames"]) {
    if (frame["status"] == "ok") continue;
    std::printf("  %s: %s\n", Text(frame, "camera").c_str(), Text(frame, "status").c_str());
  }
  if (capture["reconstructions"].empty()) return;
  PrintTable(capture["reconstructions"], {{"reconstruction", "id"},
                                          {"registered", "registered"},
                                          {"of", "of"},
                                          {"rms px", "rms_px"},
                                          {"verdict", "verdict"},
                                          {"mean mm", "mean_position_mm"},
                                          {"mean deg", "mean_rotation_deg"}});
}

/// A command with --socket and, if `what` is not empty, an id to look at and --limit.
CLI::App* AddQuery(CLI::App& app, CommonOptions& common, QueryArguments& query,
                   const std::vector<std::string>& words) {
  CLI::App* command = AddCommand(app, common, words[0], words[1], words[2]);
  AddSocketOption(command, query.socket);
  if (words.size() > 3) {
    command->add_option(words[3], query.id, "Show this one instead of the list");
    command->add_option("--limit", query.limit, "How many to list, the newest first")
        ->check(CLI::Range(1, 500))
        ->capture_default_str();
  }
  return command;
}

std::string ListTarget(const std::string& path, const QueryArguments& query) {
  return query.id.empty() ? path + "?limit=" + std::to_string(query.limit) : path + "/" + query.id;
}

}  // namespace

CLI::Option* AddSocketOption(CLI::App* command, fs::path& socket) {
  socket = kDefaultSocket;
  return command->add_option("--socket", socket, "Where the daemon serves")
      ->type_name("SOCKET")
      ->capture_default_str();
}

int CaptureByDaemon(const DaemonShot& shot, const CommonOptions& common) {
  const ApiClient client(shot.socket, common.stop);
  Json body = {{"reconstruct", shot.reconstruct}};
  if (shot.subject) body["subject"] = *shot.subject;
  const Result<Json> job = RunJob(client, "/v1/captures", body, common);
  if (!job) return Fail(job.error());
  const Json& result = (*job)["result"];
  const std::string tally = Text(result, "ok") + "/" + Text(result, "of") + " ok";
  if (common.json) {
    PrintJson(result);
  } else {
    std::printf("%s\ncapture %s\n", tally.c_str(), Text(result, "capture").c_str());
    for (const Json& note : result.value("notes", Json::array())) {
      std::printf("%s\n", note.get<std::string>().c_str());
    }
  }
  if (result.value("complete", false)) return kDone;
  return Fail({ErrorCode::kFailed, result.value("summary", tally), kIncompleteSet});
}

int CamerasOfDaemon(const fs::path& socket, const CommonOptions& common) {
  const Result<Json> cameras = ApiClient(socket, common.stop).Get("/v1/cameras");
  return Show(cameras, common, [](const Json& list) {
    PrintTable(list["items"], {{"camera", "camera"},
                               {"is", "condition"},
                               {"address", "address"},
                               {"serial", "serial"},
                               {"model", "model"},
                               {"temp C", "temperature_deg_c"},
                               {"resent", "resent_packets"},
                               {"problem", "problem"}});
  });
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
                "  rotunda captures 20261122T101500Z --reconstruct",
                "CAPTURE"});
  auto reconstruct = std::make_shared<bool>(false);
  command->add_flag("--reconstruct", *reconstruct, "Reconstruct CAPTURE and wait for the result")
      ->needs("CAPTURE");
  command->callback([=, &common, &chosen] {
    chosen = [=, &common] {
      const ApiClient client(query->socket, common.stop);
      const std::string target = ListTarget("/v1/captures", *query);
      if (*reconstruct) {
        return Show(RunJob(client, target + "/reconstructions", Json::object(), common), common,
                    PrintJob);
      }
      return Show(client.Get(target), common, [&](const Json& answer) {
        if (!query->id.empty()) return PrintCapture(answer);
        PrintTable(answer["items"], {{"capture", "id"},
                                     {"captured", "captured_at"},
                                     {"subject", "subject"},
                                     {"ok", "ok"},
                                     {"of", "of"},
                                     {"verdict", "verdict"}});
      });
    };
  });
}

void AddCalibrations(CLI::App& app, CommonOptions& common, Action& chosen) {
  auto query = std::make_shared<QueryArguments>();
  CLI::App* command = AddQuery(
      app, common, *query,
      {"calibrations", "List the daemon's calibrations, show one, make one, put one in force.",
       "rotunda calibrations\n  rotunda calibrations --from 20261122T101500Z 20261122T101700Z\n"
       "  rotunda calibrations charuco-20261122T101700Z --activate",
       "CALIBRATION"});
  auto activate = std::make_shared<bool>(false);
  auto captures = std::make_shared<std::vector<std::string>>();
  command->add_flag("--activate", *activate, "Put CALIBRATION in force")->needs("CALIBRATION");
  command->add_option("--from", *captures, "Calibrate from these captures of the target, and wait")
      ->type_name("CAPTURE")
      ->excludes("--activate");
  command->callback([=, &common, &chosen] {
    chosen = [=, &common] {
      const ApiClient client(query->socket, common.stop);
      if (!captures->empty()) {
        return Show(RunJob(client, "/v1/calibrations", {{"captures", *captures}}, common), common,
                    PrintJob);
      }
      const std::string target = ListTarget("/v1/calibrations", *query);
      return Show(*activate ? client.Post(target + "/activate", nullptr) : client.Get(target),
                  common, [&](const Json& answer) {
                    if (!query->id.empty()) return PrintFields(answer);
                    PrintTable(answer["items"], {{"calibration", "id"},
                                                 {"created", "created_at"},
                                                 {"cameras", "cameras"},
                                                 {"rms px", "rms_px"},
                                                 {"held out px", "held_out_rms_px"},
                                                 {"in force", "active"}});
                  });
    };
  });
}

void AddEvents(CLI::App& app, CommonOptions& common, Action& chosen) {
  auto query = std::make_shared<QueryArguments>();
  auto after = std::make_shared<std::string>();
  CLI::App* command =
      AddQuery(app, common, *query,
               {"events", "Show what happens at the daemon, a line an event, until Ctrl-C.",
                "rotunda events\n  rotunda events --after 0 --json"});
  command->add_option("--after", *after, "Begin after this event; 0: with all that are kept")
      ->type_name("NUMBER");
  command->callback([=, &common, &chosen] {
    chosen = [=, &common] {
      const ApiClient client(query->socket, common.stop);
      const std::string target = "/v1/events" + (after->empty() ? "" : "?after=" + *after);
      const Status status = client.Follow(target, [&](const Json& event) {
        if (common.json) {
          std::printf("%s\n", event.dump().c_str());
        } else {
          std::printf("%s %s %s %s %s\n", event["number"].dump().c_str(), Text(event, "at").c_str(),
                      Text(event, "kind").c_str(), Text(event, "about").c_str(),
                      event["data"].dump().c_str());
        }
        std::fflush(stdout);  // each event when it happens, in a pipe too
      });
      const bool asked_to_end = !status && status.error().code == ErrorCode::kCancelled;
      return status.ok() || asked_to_end ? kDone : Fail(status.error());
    };
  });
}

}  // namespace rotunda::cli
