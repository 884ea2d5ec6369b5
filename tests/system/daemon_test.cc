// The daemon from its start to its end with no hardware: simulated cameras of another process, and
// nothing else than curl to talk to it.

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "sfm/core/calibration.h"
#include "sfm/core/frame_set.h"
#include "tests/support/background_process.h"
#include "tests/support/process.h"
#include "tests/support/simulated_daemon.h"

namespace rotunda {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;
using std::chrono::milliseconds;
using test::BackgroundProcess;
using test::NotifySocket;
using test::ProcessOutcome;
using test::RunProcess;

// Nothing here takes nearly so long unless it hangs.
constexpr auto kPatience = milliseconds(300000);
constexpr char kBlock[] = "127.42.9";
// With fewer cameras than this neighbours no longer overlap.
constexpr int kCameras = 30;
constexpr int kShots = 3;
constexpr int kHeartbeat_ms = 200;

bool WaitUntil(const std::function<bool()>& condition) {
  return test::WaitUntil(kPatience, condition);
}

/// A folder with the daemon's configuration, its state and its sockets; starts and stops it.
class Daemon {
 public:
  struct Config {
    std::string cameras;  // capture.toml
    // Of rotundad.toml: more keys of [service] and [devices], more tables.
    std::string service = "", devices = "", tables = "";
  };
  explicit Daemon(const Config& config) {
    std::ofstream(folder_ / "capture.toml") << config.cameras;
    std::ofstream(folder_ / "rotundad.toml")
        << "[service]\nsocket = \"" << Socket().string() << "\"\nstate_folder = \""
        << State().string() << "\"\n"
        << config.service << "[devices]\nboard = \"" << ROTUNDA_SOURCE_DIR
        << "/config/cuboid.toml\"\nsimulated_socket = \"" << CameraSocket().string() << "\"\n"
        << config.devices << "[storage]\nreserve_mb = 10\n"
        << config.tables;
    listening_ = test::ListenAsSystemd(Socket());
    notify_ = std::make_unique<NotifySocket>(folder_ / "notify");
  }
  ~Daemon() { close(listening_); }

  fs::path Socket() const { return folder_ / "api.sock"; }
  fs::path State() const { return folder_ / "state"; }
  fs::path CameraSocket() const { return folder_ / "cameras.sock"; }
  fs::path operator/(const std::string& name) const { return folder_ / name; }
  NotifySocket& notify() { return *notify_; }
  BackgroundProcess& process() { return *process_; }

  void Start() {
    process_ = std::make_unique<BackgroundProcess>(BackgroundProcess::Options{
        {ROTUNDA_DAEMON, "--config", folder_ / "rotundad.toml"},
        {{"NOTIFY_SOCKET", folder_ / "notify"}, {"WATCHDOG_USEC", "600000"}},
        listening_,
        folder_ / "log"});
  }

  /// `curl -s --unix-socket SOCKET ARGUMENTS http://localhost/PATH`.
  ProcessOutcome Curl(const std::string& path, std::vector<std::string> arguments = {}) const {
    std::vector<std::string> command = {"curl", "-s", "--unix-socket", Socket()};
    command.insert(command.end(), arguments.begin(), arguments.end());
    command.push_back("http://localhost" + path);
    return RunProcess(command);
  }
  Json Get(const std::string& path) const { return Json::parse(Curl(path).output); }
  Json Post(const std::string& path, const std::string& body = "",
            std::vector<std::string> more = {}) const {
    more.insert(more.end(), {"-X", "POST"});
    if (!body.empty()) more.insert(more.end(), {"-d", body});
    return Json::parse(Curl(path, more).output);
  }
  /// The job when it has ended.
  Json Ended(const Json& job) const {
    const std::string path = "/v1/jobs/" + job.at("id").dump();
    Json now;
    EXPECT_TRUE(WaitUntil([&] {
      now = Get(path);
      return now["state"] != "queued" && now["state"] != "running";
    })) << now.dump(1);
    return now;
  }
  std::string Log() const {
    std::ifstream log(folder_ / "log");
    return std::string(std::istreambuf_iterator<char>(log), {});
  }

 private:
  test::TemporaryFolder folder_;
  int listening_ = -1;
  std::unique_ptr<NotifySocket> notify_;
  std::unique_ptr<BackgroundProcess> process_;
};

/// What the simulated cameras see: shots 0 to kShots - 1 the target, shot kShots a person.
class DaemonSystem : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = std::make_unique<test::TemporaryFolder>();
    const std::vector<std::string> common = {
        "--cameras", std::to_string(kCameras), "--scale", "0.35", "--seed", "1"};
    Simulate(*folder_ / "target", {"--target", "cuboid", "--placements", std::to_string(kShots)},
             common);
    Simulate(*folder_ / "person", {}, common);
    const auto set = ReadFrameSet(*folder_ / "person");
    ASSERT_TRUE(set) << set.error().ToString();
    daemon_ = std::make_unique<Daemon>(
        Daemon::Config{.cameras = test::CaptureToml(*set, kBlock),
                       .tables = "[http]\nheartbeat_ms = " + std::to_string(kHeartbeat_ms) + "\n"});
    StartCameras();
  }
  static void TearDownTestSuite() {
    daemon_.reset();
    cameras_.reset();
    folder_.reset();
  }

  static void Simulate(const fs::path& out, std::vector<std::string> what,
                       const std::vector<std::string>& common) {
    what.insert(what.begin(), {ROTUNDA_COMMAND, "simulate", out});
    what.insert(what.end(), common.begin(), common.end());
    const ProcessOutcome outcome = RunProcess(what);
    ASSERT_EQ(outcome.exit_code, 0) << outcome.errors;
  }
  static void StartCameras() {
    BackgroundProcess::Options options;
    options.arguments = {ROTUNDA_COMMAND, "simulate", "--serve"};
    for (int i = 0; i < kShots; ++i) {
      options.arguments.push_back(*folder_ / "target" / ("placement_0" + std::to_string(i)));
    }
    options.arguments.insert(
        options.arguments.end(),
        {*folder_ / "person", "--hold", "--block", kBlock, "--socket", daemon_->CameraSocket()});
    options.output = *daemon_ / "cameras.log";
    cameras_ = std::make_unique<BackgroundProcess>(options);
    ASSERT_TRUE(WaitUntil([] { return SendToCameras({"list"}) == 0; })) << cameras_->Output();
  }
  static int SendToCameras(std::vector<std::string> words) {
    words.insert(words.begin(),
                 {ROTUNDA_COMMAND, "simulate", "--socket", daemon_->CameraSocket(), "--send"});
    return RunProcess(words).exit_code;
  }

  static inline std::unique_ptr<test::TemporaryFolder> folder_;
  static inline std::unique_ptr<Daemon> daemon_;
  static inline std::unique_ptr<BackgroundProcess> cameras_;

  // One after the other.
  void Start();
  void CalibrateFromTheTarget();
  void CapturePerson();
  void LookAtPicturesAndPoses();
  void LookAtReportAndExports();
  void LookAtDrift();
  void LookAtEvents();
  void LookAtTheRest();
  void CancelAndRunAgain();
  void ShowByCommand();
  void RefuseByCommand();
  void FollowEventsByCommand();
  void LoseACamera();
  void CaptureByCommand();
  void BackUp();
  void Reload();
  void StopAndStartAgain();
  void KeepTheNewest();

  /// `rotunda WORDS`, of this daemon.
  static std::vector<std::string> Command(std::vector<std::string> words) {
    words.insert(words.begin(), ROTUNDA_COMMAND);
    words.insert(words.end(), {"--socket", daemon_->Socket()});
    return words;
  }

  std::unique_ptr<BackgroundProcess> events_;   // curl on the event stream
  std::string calibration_, capture_, newest_;  // ids
};

/// Kinds of the events in a stream, one after the other, without progress.
std::vector<std::string> KindsIn(const std::string& stream) {
  std::vector<std::string> kinds;
  for (size_t at = stream.find("event: "); at != std::string::npos;
       at = stream.find("event: ", at + 1)) {
    const std::string kind = stream.substr(at + 7, stream.find('\n', at) - at - 7);
    if (kind != "job_progress") kinds.push_back(kind);
  }
  return kinds;
}

/// A client connects before the daemon is there: the socket is systemd's.
void DaemonSystem::Start() {
  Daemon& daemon = *daemon_;
  events_ = std::make_unique<BackgroundProcess>(BackgroundProcess::Options{
      {"curl", "-sN", "--unix-socket", daemon.Socket(), "http://localhost/v1/events?after=0"},
      {},
      std::nullopt,
      daemon / "events"});
  daemon.Start();
  ASSERT_TRUE(daemon.notify().WaitFor("READY=1", kPatience)) << daemon.Log();
  ASSERT_TRUE(daemon.notify().WaitFor("WATCHDOG=1", kPatience)) << daemon.Log();
  ASSERT_TRUE(WaitUntil([&] { return daemon.Get("/v1/status")["cameras"]["ready"] == kCameras; }))
      << daemon.Curl("/v1/cameras").output;
}

/// Nothing is in force before it is activated.
void DaemonSystem::CalibrateFromTheTarget() {
  Daemon& daemon = *daemon_;
  std::vector<std::string> captures;
  for (int i = 0; i < kShots; ++i) {
    ASSERT_EQ(SendToCameras({"shot", std::to_string(i)}), 0);
    const Json job =
        daemon.Ended(daemon.Post("/v1/captures", R"({"subject":"target","reconstruct":false})"));
    ASSERT_EQ(job["state"], "done") << job.dump(1) << daemon.Log();
    ASSERT_EQ(job["result"]["complete"], true) << job.dump(1);
    captures.push_back(job["result"]["capture"]);
  }
  const Json calibrated =
      daemon.Ended(daemon.Post("/v1/calibrations", Json({{"captures", captures}}).dump()));
  ASSERT_EQ(calibrated["state"], "done") << calibrated.dump(1) << daemon.Log();
  EXPECT_EQ(calibrated["result"]["calibrated"], kCameras);
  calibration_ = calibrated["result"]["calibration"];
  EXPECT_FALSE(daemon.Get("/v1/status").contains("calibration")) << "not before it is activated";
  EXPECT_EQ(daemon.Post("/v1/calibrations/" + calibration_ + "/activate")["active"], true);
  EXPECT_EQ(daemon.Get("/v1/status")["calibration"], calibration_);
}

/// The same request twice is one shot; a reconstruction follows by itself.
void DaemonSystem::CapturePerson() {
  Daemon& daemon = *daemon_;
  ASSERT_EQ(SendToCameras({"shot", std::to_string(kShots)}), 0);
  const std::vector<std::string> key = {"-H", "Idempotency-Key: person-1"};
  const Json first = daemon.Post("/v1/captures", R"({"subject":"person"})", key);
  const Json second = daemon.Post("/v1/captures", R"({"subject":"person"})", key);
  EXPECT_EQ(first.at("id"), second.at("id"));
  const Json shot = daemon.Ended(first);
  ASSERT_EQ(shot["state"], "done") << shot.dump(1) << daemon.Log();
  capture_ = shot["result"]["capture"];
  EXPECT_EQ(daemon.Get("/v1/captures")["items"].size(), kShots + 1u);
  ASSERT_TRUE(WaitUntil([&] {
    return daemon.Get("/v1/captures/" + capture_).contains("reconstruction");
  })) << daemon.Curl("/v1/jobs").output;
  const Json seen = daemon.Get("/v1/captures/" + capture_);
  EXPECT_EQ(seen["subject"], "person");
  EXPECT_EQ(seen["calibration"], calibration_);
  EXPECT_EQ(seen["verdict"], "sure");
  const Json newest = daemon.Get("/v1/jobs?limit=1")["items"][0]["result"];
  EXPECT_EQ(newest["capture"], capture_);
  EXPECT_EQ(newest["method"], "tc-sfm");
  EXPECT_EQ(newest["preset"], "rig");
  EXPECT_EQ(newest["prior"], "none");
}

/// The poses are those of the truth.
void DaemonSystem::LookAtPicturesAndPoses() {
  Daemon& daemon = *daemon_;
  const std::string in_capture = "/v1/captures/" + capture_;
  const std::string camera = daemon.Get(in_capture)["frames"][0]["camera"];
  const fs::path poses = daemon / "poses.json", picture = daemon / "frame.png";
  EXPECT_EQ(daemon.Curl(in_capture + "/poses", {"-f", "-o", poses}).exit_code, 0);
  EXPECT_EQ(daemon.Curl(in_capture + "/frames/" + camera + ".png", {"-f", "-o", picture}).exit_code,
            0);
  EXPECT_GT(fs::file_size(picture), 1000u);
  const ProcessOutcome errors = RunProcess({ROTUNDA_COMMAND, "evaluate", poses, "--truth",
                                            *folder_ / "person" / "truth.json", "--json"});
  ASSERT_EQ(errors.exit_code, 0) << errors.errors;
  EXPECT_EQ(Json::parse(errors.output)["registered"], kCameras) << errors.output;
  // A pixel of these small pictures is 2.5 mm at the body, and features are good to a fifth of one:
  // the reconstruction's own sigma is 1.4 mm.
  EXPECT_LT(Json::parse(errors.output)["mean_position_mm"], 2.0) << errors.output;
}

void DaemonSystem::LookAtReportAndExports() {
  Daemon& daemon = *daemon_;
  const std::string in_capture = "/v1/captures/" + capture_;
  EXPECT_NE(daemon.Curl(in_capture + "/report").output.find("</html>"), std::string::npos);
  // A file that the archive of each must have; "": it is none.
  const std::map<std::string, std::string> formats = {
      {"colmap", "images.bin"},     {"colmap-text", "images.txt"},
      {"metashape", "cameras.xml"}, {"nerfstudio", "transforms.json"},
      {"realitycapture", ".xmp"},   {"ply", ""}};
  for (const auto& [format, member] : formats) {
    const fs::path file = daemon / format;
    ASSERT_EQ(daemon.Curl(in_capture + "/export?format=" + format, {"-f", "-o", file}).exit_code,
              0);
    if (member.empty()) continue;
    const ProcessOutcome list = RunProcess({"tar", "-tf", file});
    EXPECT_EQ(list.exit_code, 0) << list.errors;
    EXPECT_NE(list.output.find(member), std::string::npos) << list.output;
  }
}

/// Nothing has moved.
void DaemonSystem::LookAtDrift() {
  Daemon& daemon = *daemon_;
  const Json drift = daemon.Get("/v1/drift");
  EXPECT_EQ(drift["calibration"], calibration_);
  ASSERT_EQ(drift["cameras"].size(), static_cast<size_t>(kCameras)) << drift.dump(1);
  for (const Json& each : drift["cameras"]) EXPECT_EQ(each["moved"], false) << each.dump();
  EXPECT_EQ(
      daemon.Get("/v1/drift?camera=" + drift["cameras"][0]["camera"].get<std::string>())["items"]
          .size(),
      1u);
}

/// What the stream said, and what one says that begins in the middle.
void DaemonSystem::LookAtEvents() {
  Daemon& daemon = *daemon_;
  const std::vector<std::string> told = {"capture_stored", "calibration_stored",
                                         "calibration_activated", "reconstruction_stored"};
  ASSERT_TRUE(WaitUntil([&] {
    return events_->Output().find("event: reconstruction_stored") != std::string::npos;
  })) << events_->Output();
  size_t at = 0;
  const std::vector<std::string> kinds = KindsIn(events_->Output());
  for (const std::string& kind : kinds) at += at < told.size() && kind == told[at];
  EXPECT_EQ(at, told.size()) << events_->Output();
  const size_t activated = events_->Output().find("event: calibration_activated");
  const size_t id = events_->Output().rfind("id: ", activated);
  const std::string last_id =
      events_->Output().substr(id + 4, events_->Output().find('\n', id) - id - 4);
  const ProcessOutcome resumed =
      daemon.Curl("/v1/events", {"-N", "--max-time", "1", "-H", "Last-Event-ID: " + last_id});
  EXPECT_EQ(resumed.output.find("calibration_activated"), std::string::npos);
  EXPECT_NE(resumed.output.find("reconstruction_stored"), std::string::npos) << resumed.output;
  size_t signs_of_life = 0;
  for (size_t at = 0; (at = resumed.output.find(": nothing new", at)) != std::string::npos; ++at) {
    ++signs_of_life;
  }
  EXPECT_GE(signs_of_life, 1u) << resumed.output;
  EXPECT_LE(signs_of_life, 1000u / kHeartbeat_ms) << "in a second";
}

/// What the README shows besides.
void DaemonSystem::LookAtTheRest() {
  Daemon& daemon = *daemon_;
  const std::string camera = daemon.Get("/v1/cameras")["items"][0]["camera"];
  EXPECT_EQ(daemon.Get("/v1/cameras/" + camera)["condition"], "ready");
  const fs::path preview = daemon / "preview.jpg";
  const std::string path = "/v1/cameras/" + camera + "/preview.jpg";
  ASSERT_EQ(daemon.Curl(path, {"-f", "-o", preview}).exit_code, 0) << daemon.Log();
  std::ifstream jpeg(preview, std::ios::binary);
  EXPECT_EQ(std::string(std::istreambuf_iterator<char>(jpeg), {}).substr(0, 3), "\xFF\xD8\xFF");
  const std::string made = daemon.Get("/v1/captures/" + capture_)["reconstruction"];
  EXPECT_EQ(daemon.Get("/v1/reconstructions/" + made)["capture"], capture_);
  EXPECT_EQ(daemon.Get("/v1/calibrations")["items"][0]["id"], calibration_);
  EXPECT_NE(daemon.Curl("/v1/calibrations/" + calibration_ + "/report").output.find("</html>"),
            std::string::npos);
  EXPECT_EQ(daemon.Get("/v1/calibrations/" + calibration_ + "/calibration.json")["cameras"].size(),
            static_cast<size_t>(kCameras));
  EXPECT_NE(daemon.Curl("/metrics")
                .output.find("\nrotunda_cameras_ready " + std::to_string(kCameras) + "\n"),
            std::string::npos);
  EXPECT_EQ(daemon.Get("/v1/openapi.json")["openapi"], "3.1.0");
}

/// A reconstruction in the middle of its work, twice.
void DaemonSystem::CancelAndRunAgain() {
  Daemon& daemon = *daemon_;
  const Json job = daemon.Post("/v1/captures/" + capture_ + "/reconstructions");
  const std::string path = "/v1/jobs/" + job.at("id").dump();
  for (const bool again : {false, true}) {
    if (again) {
      EXPECT_EQ(daemon.Post(path + "/rerun")["id"], job["id"]);
    }
    ASSERT_TRUE(WaitUntil([&] { return daemon.Get(path).contains("progress"); }));
    EXPECT_EQ(daemon.Curl(path, {"-f", "-X", "DELETE"}).exit_code, 0);
    EXPECT_EQ(daemon.Ended(job)["state"], "cancelled");
  }
  EXPECT_EQ(daemon.Get("/v1/captures/" + capture_)["reconstructions"].size(), 1u);
}

/// The commands show the same.
void DaemonSystem::ShowByCommand() {
  const std::string camera = daemon_->Get("/v1/drift")["cameras"][0]["camera"];
  for (const std::vector<std::string>& words :
       std::vector<std::vector<std::string>>{{"captures"},
                                             {"captures", capture_},
                                             {"jobs"},
                                             {"status"},
                                             {"drift"},
                                             {"drift", camera}}) {
    const ProcessOutcome shown = RunProcess(Command(words));
    EXPECT_EQ(shown.exit_code, 0) << shown.errors;
    EXPECT_NE(shown.output.find(capture_), std::string::npos) << words[0] << shown.output;
  }
  const ProcessOutcome in_force = RunProcess(Command({"calibrations", calibration_, "--json"}));
  EXPECT_EQ(Json::parse(in_force.output)["active"], true) << in_force.errors;
  EXPECT_EQ(RunProcess(Command({"cameras"})).exit_code, 0);
}

/// With the reason, in a line.
void DaemonSystem::RefuseByCommand() {
  const std::vector<std::pair<std::vector<std::string>, std::string>> refused = {
      {{"captures", "none"}, "there is no capture \"none\""},
      {{"captures", "a b?c"}, "'a b?c' is no name"},
      {{"jobs", "1/rerun"}, "holds a '/'"},
      {{"drift", "none"}, "there is no camera 'none'"},
      {{"events", "--after", "x y"}, "'x y' is no number of an event"}};
  for (const auto& [words, reason] : refused) {
    const ProcessOutcome none = RunProcess(Command(words));
    EXPECT_EQ(none.exit_code, 1) << words[0];
    EXPECT_NE(none.errors.find(reason), std::string::npos) << none.errors;
    EXPECT_EQ(std::count(none.errors.begin(), none.errors.end(), '\n'), 1) << none.errors;
  }
}

void DaemonSystem::FollowEventsByCommand() {
  BackgroundProcess followed(
      {Command({"events", "--after", "0"}), {}, std::nullopt, *daemon_ / "followed"});
  EXPECT_TRUE(WaitUntil([&] {
    return followed.Output().find("reconstruction_stored") != std::string::npos;
  })) << followed.Output();
  followed.Signal(SIGINT);
  EXPECT_EQ(followed.Wait(), 0) << followed.Output();
}

/// On a terminal a line tells how far a shot is: a camera that does not answer takes time.
void DaemonSystem::LoseACamera() {
  Daemon& daemon = *daemon_;
  ASSERT_EQ(SendToCameras({"fault", std::string(kBlock) + ".2", "unplug"}), 0);
  const ProcessOutcome on_terminal =
      RunProcess({"script", "-qec",
                  std::string(ROTUNDA_COMMAND) + " capture --no-reconstruct --socket " +
                      daemon.Socket().string(),
                  "/dev/null"});
  EXPECT_NE(on_terminal.output.find("\r\x1b[Kcameras "), std::string::npos) << on_terminal.output;
  // What `systemctl status` shows follows.
  const auto wait_for_status = [&](int ready) {
    return daemon.notify().WaitFor(
        "STATUS=" + std::to_string(ready) + " of " + std::to_string(kCameras) + " cameras ready",
        kPatience);
  };
  ASSERT_TRUE(wait_for_status(kCameras - 1));
  const std::string unplugged = daemon.Get("/v1/status")["cameras"]["not_ready"][0];
  EXPECT_NE(daemon.Get("/v1/status")["problems"].dump().find("not ready: " + unplugged + ";"),
            std::string::npos);
  ASSERT_EQ(SendToCameras({"clear", "all"}), 0);
  ASSERT_TRUE(wait_for_status(kCameras));
}

void DaemonSystem::CaptureByCommand() {
  const ProcessOutcome by_command =
      RunProcess(Command({"capture", "--subject", "Zo\u00EB", "--follow", "--json"}));
  ASSERT_EQ(by_command.exit_code, 0) << by_command.errors;
  const Json taken = Json::parse(by_command.output);
  newest_ = taken["capture"];
  EXPECT_EQ(taken["reconstruction"]["capture"], newest_);
  EXPECT_EQ(taken["reconstruction"]["verdict"], "sure");
  // Columns stay below each other.
  const std::string list = RunProcess(Command({"captures"})).output;
  const size_t newest = list.find(newest_), person = list.find(capture_);
  EXPECT_NE(list.find("  Zo\u00EB  "), std::string::npos) << list;
  // One letter has two bytes.
  EXPECT_EQ(list.find(" 30 ", newest) - newest - 1, list.find(" 30 ", person) - person) << list;
}

/// A copy of the database, made beside the daemon.
void DaemonSystem::BackUp() {
  Daemon& daemon = *daemon_;
  const fs::path copy = daemon / "copy.db";
  const std::vector<std::string> back_up = {ROTUNDA_DAEMON, "--config", daemon / "rotundad.toml",
                                            "--backup", copy};
  EXPECT_EQ(RunProcess(back_up).exit_code, 0);
  EXPECT_TRUE(fs::exists(copy));
  EXPECT_EQ(RunProcess(back_up).exit_code, 1) << "it is there already";
}

/// What can be is taken over, what cannot is named, and nothing is of a file that is wrong.
void DaemonSystem::Reload() {
  Daemon& daemon = *daemon_;
  const fs::path file = daemon / "rotundad.toml";
  const auto reload_with = [&](const std::string& more) {
    std::ofstream(file, std::ios::app) << more;
    daemon.process().Signal(SIGHUP);
    EXPECT_TRUE(daemon.notify().WaitFor("RELOADING=1", kPatience));
    EXPECT_TRUE(daemon.notify().WaitFor("READY=1", kPatience));
    return daemon.Log();
  };
  fs::copy_file(file, daemon / "first.toml");
  const std::string changed =
      reload_with("[drift]\ncaptures = 3\n[access]\nviewer_group = \"nobody-has-this\"\n");
  EXPECT_NE(changed.find("drift.captures has changed: it takes a restart"), std::string::npos);
  EXPECT_NE(changed.find("there is no group 'nobody-has-this'"), std::string::npos);
  EXPECT_NE(changed.find("configuration reloaded"), std::string::npos) << changed;
  const std::string wrong = reload_with("[food]\n");
  EXPECT_NE(wrong.find(": food"), std::string::npos) << wrong;
  EXPECT_NE(wrong.find("the configuration is kept as it was"), std::string::npos) << wrong;
  const auto is_told = [&] {
    const std::string problems = daemon.Get("/v1/status")["problems"].dump();
    return problems.find("the configuration was not reloaded") != std::string::npos;
  };
  EXPECT_TRUE(is_told());
  fs::rename(daemon / "first.toml", file);
  std::ifstream first(file);
  std::string text(std::istreambuf_iterator<char>(first), {});
  const std::string reserve = "reserve_mb = 10\n";
  ASSERT_NE(text.find(reserve), std::string::npos);
  text.replace(text.find(reserve), reserve.size(), "reserve_mb = 11\n");
  std::ofstream(file) << text;
  EXPECT_EQ(daemon.Get("/v1/status")["disk"]["reserve_bytes"], 10000000);
  reload_with("");
  EXPECT_EQ(daemon.Get("/v1/status")["disk"]["reserve_bytes"], 11000000);
  EXPECT_FALSE(is_told());
}

/// Nothing is forgotten.
void DaemonSystem::StopAndStartAgain() {
  Daemon& daemon = *daemon_;
  BackgroundProcess followed({{ROTUNDA_COMMAND, "events", "--socket", daemon.Socket()},
                              {},
                              std::nullopt,
                              daemon / "followed"});
  ASSERT_TRUE(WaitUntil([&] {
    return daemon.Curl("/metrics").output.find("\nrotunda_http_streams 2\n") != std::string::npos;
  }));
  daemon.process().Signal(SIGTERM);
  EXPECT_TRUE(daemon.notify().WaitFor("STOPPING=1", kPatience));
  EXPECT_EQ(daemon.process().Wait(), 0) << daemon.Log();
  EXPECT_EQ(events_->Wait(), 0) << "the stream ended as a stream should";
  EXPECT_NE(daemon.Log().find("access uid=" + std::to_string(geteuid()) + " pid="),
            std::string::npos);
  EXPECT_NE(daemon.Log().find("\"GET /v1/openapi.json\" 200 "), std::string::npos);
  daemon.Start();
  EXPECT_EQ(daemon.Get("/v1/captures")["items"][0]["id"], newest_);
  EXPECT_EQ(daemon.Get("/v1/captures")["items"][2]["id"], capture_);
  EXPECT_EQ(daemon.Get("/v1/status")["calibration"], calibration_);
  // A command that follows the events has waited.
  const std::string job = daemon.Post("/v1/captures/" + capture_ + "/reconstructions")["id"].dump();
  daemon.Curl("/v1/jobs/" + job, {"-X", "DELETE"});
  EXPECT_TRUE(WaitUntil([&] {
    return followed.Output().find(" job_queued " + job + " ") != std::string::npos;
  })) << followed.Output();
  followed.Signal(SIGINT);
  EXPECT_EQ(followed.Wait(), 0) << followed.Output();
}

/// Also of what is captured while the policy is in force.
void DaemonSystem::KeepTheNewest() {
  Daemon& daemon = *daemon_;
  constexpr size_t kKept = 3;
  std::ifstream file(daemon / "rotundad.toml");
  std::string text(std::istreambuf_iterator<char>(file), {});
  const std::string storage = "[storage]\n";
  ASSERT_NE(text.find(storage), std::string::npos);
  text.insert(text.find(storage) + storage.size(), "keep_count = 3\n");
  std::ofstream(daemon / "rotundad.toml") << text;
  daemon.process().Signal(SIGHUP);
  const auto kept = [&] { return daemon.Get("/v1/captures")["items"].size(); };
  EXPECT_TRUE(WaitUntil([&] { return kept() == kKept; })) << kept();
  const Json shot = daemon.Ended(daemon.Post("/v1/captures", R"({"reconstruct":false})"));
  ASSERT_EQ(shot["state"], "done") << shot.dump(1);
  EXPECT_TRUE(WaitUntil([&] { return kept() == kKept; })) << kept();
  EXPECT_EQ(daemon.Get("/v1/captures")["items"][0]["id"], shot["result"]["capture"]);
}

TEST_F(DaemonSystem, FromStartToStopByCurlAlone) {
  ASSERT_NO_FATAL_FAILURE(Start());
  ASSERT_NO_FATAL_FAILURE(CalibrateFromTheTarget());
  ASSERT_NO_FATAL_FAILURE(CapturePerson());
  ASSERT_NO_FATAL_FAILURE(LookAtPicturesAndPoses());
  ASSERT_NO_FATAL_FAILURE(LookAtReportAndExports());
  ASSERT_NO_FATAL_FAILURE(LookAtDrift());
  ASSERT_NO_FATAL_FAILURE(LookAtEvents());
  ASSERT_NO_FATAL_FAILURE(LookAtTheRest());
  ASSERT_NO_FATAL_FAILURE(CancelAndRunAgain());
  ASSERT_NO_FATAL_FAILURE(ShowByCommand());
  ASSERT_NO_FATAL_FAILURE(RefuseByCommand());
  ASSERT_NO_FATAL_FAILURE(FollowEventsByCommand());
  ASSERT_NO_FATAL_FAILURE(LoseACamera());
  ASSERT_NO_FATAL_FAILURE(CaptureByCommand());
  ASSERT_NO_FATAL_FAILURE(BackUp());
  ASSERT_NO_FATAL_FAILURE(Reload());
  ASSERT_NO_FATAL_FAILURE(StopAndStartAgain());
  ASSERT_NO_FATAL_FAILURE(KeepTheNewest());
}

/// A daemon whose only camera is not there; its captures are put into the state folder.
std::string NoCameras() {
  return "[uplinks.u]\n[cameras.c0]\nserial = \"NONE\"\naddress = \"127.42.10.1\"\n";
}

/// captures/ID in the state folder, as a backup brings it.
fs::path AddCapture(const Daemon& daemon, const std::string& id,
                    const std::optional<std::string>& subject = std::nullopt) {
  const fs::path capture = daemon.State() / "captures" / id;
  fs::create_directories(capture / "frames");
  FrameSet set;
  set.id = id;
  set.captured_at = "2026-01-01T00:00:00Z";
  set.subject = subject;
  for (const char* camera : {"c0", "c1"}) {
    Frame& frame = set.frames.emplace_back();
    frame.camera = camera;
    frame.serial = camera;
    frame.file = std::string("frames/") + camera + ".png";
    frame.width_px = frame.height_px = 64;
    frame.pixel_format = "Mono8";
    std::ofstream(capture / frame.file) << "picture";
  }
  std::ofstream(capture / "frameset.json") << FrameSetToJson(set);
  return capture;
}

TEST(DaemonWatchdog, IsNotFedWhileAWorkerHangs) {
  Daemon daemon({.cameras = NoCameras(), .tables = "[jobs]\ncomputing_silence_s = 1\n"});
  const fs::path capture = AddCapture(daemon, "stuck");
  daemon.Start();
  ASSERT_TRUE(daemon.notify().WaitFor("READY=1", kPatience)) << daemon.Log();
  ASSERT_EQ(daemon.Get("/v1/captures")["items"].size(), 1u) << daemon.Log();
  ASSERT_TRUE(daemon.notify().WaitFor("WATCHDOG=1", kPatience));
  // A file without an end: whoever reads it hangs.
  ASSERT_EQ(mkfifo((capture / "calibration.json").c_str(), 0600), 0);
  const Json job = daemon.Post("/v1/captures/stuck/reconstructions");
  ASSERT_TRUE(WaitUntil([&] { return daemon.Log().find("not fed") != std::string::npos; }));
  daemon.notify().Messages();
  EXPECT_FALSE(daemon.notify().WaitFor("WATCHDOG=1", milliseconds(2000)));
  EXPECT_NE(daemon.Get("/v1/status")["problems"].dump().find("job"), std::string::npos);
  // What systemd does then.
  daemon.process().Signal(SIGABRT);
  EXPECT_EQ(daemon.process().Wait(), 128 + SIGABRT);
  daemon.Start();
  EXPECT_EQ(daemon.Get("/v1/jobs/" + job.at("id").dump())["state"], "interrupted");
  EXPECT_TRUE(daemon.notify().WaitFor("WATCHDOG=1", kPatience));
}

/// What follows each "WORD: " in the log, one after the other.
std::vector<std::string> Told(const std::string& log, const std::string& word) {
  std::vector<std::string> told;
  const std::string mark = word + ": ";
  for (size_t at = log.find(mark); at != std::string::npos; at = log.find(mark, at + 1)) {
    const size_t begin = at + mark.size();
    told.push_back(log.substr(begin, log.find('\n', begin) - begin));
  }
  return told;
}

TEST(DaemonStart, MakesAStateFolderForItsUserAlone) {
  Daemon daemon({.cameras = NoCameras()});
  daemon.Start();
  ASSERT_TRUE(daemon.notify().WaitFor("READY=1", kPatience)) << daemon.Log();
  EXPECT_EQ(fs::status(daemon.State()).permissions(), fs::perms::owner_all);
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(daemon.State())) {
    EXPECT_EQ(entry.status().permissions() & ~fs::perms::owner_all, fs::perms::none) << entry;
  }
}

TEST(DaemonStop, EndsEverythingInTheReverseOrderOfItsStart) {
  Daemon daemon({.cameras = NoCameras(), .devices = "ready_ms = 600000\n"});
  daemon.Start();
  ASSERT_TRUE(daemon.notify().WaitFor("READY=1", kPatience)) << daemon.Log();
  const std::vector<std::string> parts = {"store", "cameras", "jobs", "housekeeping", "API"};
  EXPECT_EQ(Told(daemon.Log(), "started"), parts) << daemon.Log();
  // A stream and a job under way, which waits for its camera.
  BackgroundProcess stream(
      {{"curl", "-sN", "--unix-socket", daemon.Socket(), "http://localhost/v1/events?after=0"},
       {},
       std::nullopt,
       daemon / "events"});
  const Json job = daemon.Post("/v1/captures");
  ASSERT_TRUE(WaitUntil([&] { return stream.Output().find("job_started") != std::string::npos; }));
  daemon.process().Signal(SIGTERM);
  EXPECT_TRUE(daemon.notify().WaitFor("STOPPING=1", kPatience));
  EXPECT_EQ(daemon.process().Wait(), 0) << daemon.Log();
  EXPECT_EQ(stream.Wait(), 0) << "the stream ended as a stream should";
  const std::string log = daemon.Log();
  EXPECT_EQ(Told(log, "ended"), std::vector<std::string>(parts.rbegin(), parts.rend())) << log;
  // What is told of the job is stored, so the store was there until then.
  const size_t interrupted = log.find(" job_interrupted " + job.at("id").dump() + " ");
  ASSERT_NE(interrupted, std::string::npos) << log;
  EXPECT_LT(interrupted, log.find("ended: jobs")) << log;
  daemon.Start();
  EXPECT_EQ(daemon.Get("/v1/jobs/" + job.at("id").dump())["state"], "interrupted");
}

TEST(DaemonStop, EndsInTimeAlsoWhenADiskDoesNotAnswer) {
  Daemon daemon({.cameras = NoCameras(), .service = "stop_ms = 100\nend_ms = 1000\n"});
  const fs::path stuck = AddCapture(daemon, "stuck"), shown = AddCapture(daemon, "shown");
  daemon.Start();
  ASSERT_TRUE(daemon.notify().WaitFor("READY=1", kPatience)) << daemon.Log();
  // Files without an end: a request and a job hang on them.
  fs::remove(shown / "frames/c0.png");
  ASSERT_EQ(mkfifo((shown / "frames/c0.png").c_str(), 0600), 0);
  ASSERT_EQ(mkfifo((stuck / "calibration.json").c_str(), 0600), 0);
  BackgroundProcess picture({{"curl", "-s", "--unix-socket", daemon.Socket(),
                              "http://localhost/v1/captures/shown/frames/c0.png"},
                             {},
                             std::nullopt,
                             daemon / "picture"});
  const std::string job =
      "/v1/jobs/" + daemon.Post("/v1/captures/stuck/reconstructions").at("id").dump();
  ASSERT_TRUE(WaitUntil([&] { return daemon.Get(job)["state"] == "running"; }));
  daemon.process().Signal(SIGTERM);
  EXPECT_EQ(daemon.process().Wait(), 1) << daemon.Log();
  EXPECT_NE(daemon.Log().find("not at the end after 1000 ms (service.end_ms)"), std::string::npos)
      << daemon.Log();
  daemon.Start();
  EXPECT_EQ(daemon.Get(job)["state"], "interrupted") << daemon.Log();
  EXPECT_EQ(daemon.Get("/v1/captures")["items"].size(), 2u);
}

TEST(DaemonStart, SaysEverythingThatIsWrongAndEnds) {
  const test::TemporaryFolder folder;
  std::ofstream(folder / "bad.toml") << "[http]\nthreads = 0\ncolour = 1\n[food]\n";
  for (const bool only_check : {true, false}) {
    std::vector<std::string> command = {ROTUNDA_DAEMON, "--config", folder / "bad.toml"};
    if (only_check) command.push_back("--check-config");
    const ProcessOutcome outcome = RunProcess(command);
    EXPECT_EQ(outcome.exit_code, 1);
    for (const char* part : {"bad.toml:2: http.threads", "bad.toml:3: http.colour",
                             "bad.toml:4: food", "capture.toml"}) {
      EXPECT_NE(outcome.errors.find(part), std::string::npos) << part << "\n" << outcome.errors;
    }
  }
  EXPECT_EQ(RunProcess({ROTUNDA_DAEMON, "--colour"}).exit_code, 2);
  EXPECT_EQ(RunProcess({ROTUNDA_DAEMON, "--help"}).exit_code, 0);
  const ProcessOutcome shipped =
      RunProcess({ROTUNDA_DAEMON, "--check-config", "--config",
                  std::string(ROTUNDA_SOURCE_DIR) + "/config/rotundad.toml"});
  EXPECT_EQ(shipped.exit_code, 0) << shipped.errors;
  for (const char* name : {"capture.toml", "cuboid.toml"}) {
    fs::copy_file(std::string(ROTUNDA_SOURCE_DIR) + "/config/" + name, folder / name);
  }
  const std::string doubtful = folder / "doubtful.toml", gone = folder / "gone";
  std::ofstream(doubtful)
      << "[access]\nviewer_group = \"root\"\noperator_group = \"nobody-has-this\"\n"
      << "[service]\nstate_folder = \"" << (folder / "state").string() << "\"\nsocket = \"" << gone
      << "/api.sock\"\n";
  const ProcessOutcome warned =
      RunProcess({ROTUNDA_DAEMON, "--check-config", "--config", doubtful});
  EXPECT_EQ(warned.exit_code, 0);
  EXPECT_EQ(warned.errors,
            "warning: access.operator_group: there is no group 'nobody-has-this': nobody has its "
            "rights\nwarning: " +
                doubtful + ":6: service.socket: " + gone +
                ": is not there: expected a folder that the daemon's user can write, or a socket "
                "that systemd listens on (rotunda.socket)\n");
}

TEST(ClientCommands, AskForWhatTheirOptionsSay) {
  Daemon daemon({.cameras = NoCameras()});
  AddCapture(daemon, "x");
  Calibration calibration;
  calibration.id = "k";
  calibration.created_at = "2026-01-01T00:00:00Z";
  fs::create_directories(daemon.State() / "calibrations" / "k");
  std::ofstream(daemon.State() / "calibrations" / "k" / "calibration.json")
      << CalibrationToJson(calibration);
  daemon.Start();
  ASSERT_TRUE(daemon.notify().WaitFor("READY=1", kPatience)) << daemon.Log();
  // The pictures are none, so that no job does much.
  const auto request_of = [&](std::vector<std::string> words) {
    words.insert(words.begin(), ROTUNDA_COMMAND);
    words.insert(words.end(), {"--socket", daemon.Socket()});
    const ProcessOutcome outcome = RunProcess(words);
    EXPECT_EQ(outcome.exit_code, 1) << outcome.errors;
    EXPECT_TRUE(outcome.errors.starts_with("rotunda: job ")) << outcome.errors;
    return daemon.Get("/v1/jobs")["items"][0]["request"];
  };
  EXPECT_EQ(request_of({"captures", "x", "--reconstruct", "--calibration", "k", "--method", "plain",
                        "--pairs", "neighbours", "--refine-intrinsics"}),
            Json::parse(R"({"capture":"x","calibration":"k","method":"plain","preset":"rig",
                            "pairs":"neighbours","prior":"none","refine_intrinsics":true})"));
  EXPECT_EQ(request_of({"captures", "x", "--reconstruct", "--fix-intrinsics", "--preset",
                        "internet", "--prior", "calibration", "--calibration", "k"}),
            Json::parse(R"({"capture":"x","calibration":"k","method":"tc-sfm","preset":"internet",
                            "pairs":"exhaustive","prior":"calibration",
                            "refine_intrinsics":false})"));
  EXPECT_EQ(request_of({"calibrations", "--from", "x", "--model", "opencv5", "--frame-from", "k"}),
            Json::parse(R"({"captures":["x"],"model":"opencv5","frame_from":"k"})"));
  EXPECT_EQ(
      request_of({"calibrations", "--from", "x", "--fix-intrinsics-from", "k", "--compare", "k"}),
      Json::parse(R"({"captures":["x"],"model":"opencv","intrinsics_from":"k","compare":"k"})"));
}

TEST(ClientCommands, ANameDoesNotSpeakToTheTerminal) {
  Daemon daemon({.cameras = NoCameras()});
  AddCapture(daemon, "elsewhere", "Zo\u00EB\t\x1b[31m");
  daemon.Start();
  ASSERT_TRUE(daemon.notify().WaitFor("READY=1", kPatience)) << daemon.Log();
  const ProcessOutcome list =
      RunProcess({ROTUNDA_COMMAND, "captures", "--socket", daemon.Socket()});
  EXPECT_NE(list.output.find("  Zo\u00EB??[31m  "), std::string::npos) << list.output;
}

TEST(ClientCommands, ListsGoOnWhereTheySay) {
  Daemon daemon({.cameras = NoCameras()});
  for (const char* id : {"a", "b", "c"}) AddCapture(daemon, id);
  daemon.Start();
  ASSERT_TRUE(daemon.notify().WaitFor("READY=1", kPatience)) << daemon.Log();
  const auto list = [&](std::vector<std::string> more) {
    more.insert(more.begin(), {ROTUNDA_COMMAND, "captures", "--socket", daemon.Socket()});
    const ProcessOutcome outcome = RunProcess(more);
    EXPECT_EQ(outcome.exit_code, 0) << outcome.errors;
    return outcome.output;
  };
  const std::string first = list({"--limit", "2"}), hint = "older ones: the same with --after ";
  const size_t at = first.find(hint);
  ASSERT_NE(at, std::string::npos) << first;
  const std::string next = first.substr(at + hint.size(), first.find('\n', at) - at - hint.size());
  const std::string rest = list({"--limit", "2", "--after", next});
  EXPECT_NE(rest.find("\na  "), std::string::npos) << rest;
  EXPECT_EQ(rest.find("\nb  "), std::string::npos) << rest;
  EXPECT_EQ(rest.find(hint), std::string::npos) << "there are no more: " << rest;
  EXPECT_EQ(RunProcess({ROTUNDA_COMMAND, "drift", "--after", next}).exit_code, 2) << "of whom?";
  EXPECT_EQ(RunProcess({ROTUNDA_COMMAND, "captures", "a", "--after", next}).exit_code, 2);
}

/// Answers one request after the other with these bodies, then ends connections without an answer.
class ScriptedDaemon {
 public:
  explicit ScriptedDaemon(std::vector<std::string> bodies)
      : listening_(test::ListenAsSystemd(Socket())), thread_([this, bodies = std::move(bodies)] {
          for (const std::string& body : bodies) Answer(body);
          while (Take() >= 0) close(taken_);
        }) {}
  ~ScriptedDaemon() {
    shutdown(listening_, SHUT_RDWR);  // ends accept()
    thread_.join();
    close(listening_);
  }
  fs::path Socket() const { return folder_ / "api.sock"; }
  /// How many requests were answered.
  int answered() const { return answered_; }

 private:
  int Take() { return taken_ = accept(listening_, nullptr, nullptr); }
  void Answer(const std::string& body) {
    if (Take() < 0) return;
    char request[4096];
    const std::string answer =
        "HTTP/1.1 200 OK\r\nContent-Length: " + std::to_string(body.size()) + "\r\n\r\n" + body;
    // A client that was interrupted has gone.
    if (recv(taken_, request, sizeof(request), 0) > 0 &&
        send(taken_, answer.data(), answer.size(), MSG_NOSIGNAL) ==
            static_cast<ssize_t>(answer.size())) {
      ++answered_;
    }
    close(taken_);
  }

  test::TemporaryFolder folder_;
  int listening_;
  int taken_ = -1;
  std::atomic<int> answered_ = 0;
  std::thread thread_;
};

TEST(ClientCommands, NameTheJobWhoseDaemonHasGone) {
  const ScriptedDaemon daemon({R"({"id": 7})"});
  const ProcessOutcome outcome =
      RunProcess({ROTUNDA_COMMAND, "capture", "--socket", daemon.Socket()});
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_NE(outcome.errors.find("job 7: "), std::string::npos) << outcome.errors;
  EXPECT_NE(outcome.errors.find("`rotunda jobs 7 --rerun`"), std::string::npos) << outcome.errors;
}

TEST(ClientCommands, SayOnceThatAShotWaitsForTheDiskAlsoInAPipe) {
  const std::string waits = R"({"id": 7, "state": "running", "progress":)"
                            R"( {"stage": "waiting for the disk", "done": 0, "total": 1}})";
  const ScriptedDaemon daemon(
      {R"({"id": 7})", waits, waits, R"({"id": 7, "state": "failed", "error": "a reason"})"});
  const ProcessOutcome outcome =
      RunProcess({ROTUNDA_COMMAND, "capture", "--socket", daemon.Socket()});
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_EQ(outcome.errors,
            "rotunda: job 7: the shot is taken and waits for the disk: make room there (`rotunda "
            "status` says where and why)\nrotunda: job 7: a reason\n");
}

/// What `rotunda capture` says after Ctrl-C while its job, number 7, is at `stage`.
std::string SaidAfterCtrlC(const std::string& stage) {
  const std::string running = R"({"id": 7, "state": "running", "progress": {"stage": ")" + stage +
                              R"(", "done": 0, "total": 1}})";
  std::vector<std::string> answers(1000, running);
  answers.insert(answers.begin(), R"({"id": 7})");
  const ScriptedDaemon daemon(answers);
  const test::TemporaryFolder folder;
  BackgroundProcess command({{ROTUNDA_COMMAND, "capture", "--socket", daemon.Socket()},
                             {},
                             std::nullopt,
                             folder / "said"});
  // The job's number, how far it is, and a request more: by then the command has read that.
  EXPECT_TRUE(WaitUntil([&] { return daemon.answered() >= 3; })) << command.Output();
  command.Signal(SIGINT);
  EXPECT_EQ(command.Wait(), 130) << command.Output();
  return command.Output();
}

TEST(ClientCommands, SayAfterCtrlCWhatGoesOnAndWhatEndsIt) {
  EXPECT_EQ(SaidAfterCtrlC("exposing"),
            "rotunda: interrupted; job 7 goes on without this command, `rotunda jobs --cancel 7` "
            "ends it\n");
  const std::string waits = SaidAfterCtrlC("waiting for the disk");
  EXPECT_TRUE(test::Contains(
      waits,
      "interrupted; job 7 goes on without this command: its shot is taken and waits for the "
      "disk, and `rotunda jobs --cancel 7` is refused: make room there"))
      << waits;
}

TEST(ClientCommands, SayWhatToDoWithoutADaemon) {
  const test::TemporaryFolder folder;
  for (const char* command :
       {"status", "jobs", "captures", "calibrations", "drift", "events", "cameras", "capture"}) {
    const ProcessOutcome outcome =
        RunProcess({ROTUNDA_COMMAND, command, "--socket", folder / "none"});
    EXPECT_EQ(outcome.exit_code, 1) << command;
    EXPECT_NE(outcome.errors.find("no daemon serves there"), std::string::npos) << outcome.errors;
  }
}

}  // namespace
}  // namespace rotunda
