#include "daemon/service.h"

#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <filesystem>
#include <mutex>
#include <thread>
#include <utility>
#include <vector>

#include "daemon/api.h"
#include "daemon/calibration_job.h"
#include "daemon/capture_job.h"
#include "daemon/events.h"
#include "daemon/http_listener.h"
#include "daemon/http_server.h"
#include "daemon/jobs.h"
#include "daemon/reconstruction_job.h"
#include "daemon/retention.h"
#include "daemon/service_groups.h"
#include "daemon/service_log.h"
#include "daemon/store_jobs.h"

namespace rotunda::daemon {
namespace {

namespace fs = std::filesystem;
using std::chrono::milliseconds;

// Parts of the daemon as the log names them.
constexpr char kStore[] = "store";
constexpr char kCameras[] = "cameras";
constexpr char kJobs[] = "jobs";
constexpr char kHousekeeping[] = "housekeeping";
constexpr char kApi[] = "API";
// The threads of the server do something twice a second. A handler may read a large model for some
// seconds, and all of them may at the same time.
constexpr auto kServerSilence = std::chrono::seconds(30);
// Days pass without a job, too. Sooner when the policy could not be applied.
constexpr auto kRetentionInterval = std::chrono::hours(1);
constexpr auto kRetentionRetry = std::chrono::seconds(10);
// Of ended ones, some kilobytes each: years of a studio's work, and lists that are quick.
constexpr size_t kKeptJobs = 10000;
// Of service.end_ms, for what ends after a shot that the disk refuses; half of a shorter one.
constexpr auto kRestOfEnd = milliseconds(5000);
constexpr uint64_t kBytesPerMegabyte = 1000000;

RetentionPolicy PolicyOf(const config::DaemonConfig::Storage& storage) {
  RetentionPolicy policy;
  if (storage.keep_days > 0) policy.keep_days = storage.keep_days;
  if (storage.keep_count > 0) policy.keep_count = static_cast<size_t>(storage.keep_count);
  return policy;
}

std::vector<gid_t> GroupsNamed(const std::string& name) {
  const std::optional<gid_t> group = name.empty() ? std::nullopt : GroupId(name);
  return group ? std::vector<gid_t>{*group} : std::vector<gid_t>();
}

HttpAccess AccessOf(const config::DaemonConfig::Access& access, spdlog::logger& log) {
  for (const std::string& missing : MissingGroups(access)) log.warn("{}", missing);
  return {GroupsNamed(access.viewer_group), GroupsNamed(access.operator_group)};
}

std::map<Role, std::string> RoleNames(const config::DaemonConfig::Access& access) {
  return {{Role::kViewer,
           "a member of group '" + access.viewer_group + "' or '" + access.operator_group + "'"},
          {Role::kOperator, "a member of group '" + access.operator_group + "'"}};
}

/// How long the end of the daemon waits for a disk that refuses a shot.
milliseconds EndPatience(const config::DaemonConfig::Service& service) {
  const milliseconds end(service.end_ms);
  return std::max(end / 2, end - kRestOfEnd);
}

HttpLimits LimitsOf(const config::DaemonConfig::Http& http) {
  return {.header_bytes = http.header_bytes,
          .body_bytes = http.body_bytes,
          .connections = http.connections,
          .streams = http.streams,
          .request_ms = http.request_ms,
          .write_ms = http.write_ms,
          .heartbeat_ms = http.heartbeat_ms,
          .handler_threads = http.threads};
}

/// Applies the retention policy and forgets old jobs, at the start, whenever it is woken, and every
/// hour, apart from everything that is waited for.
class Housekeeper {
 public:
  Housekeeper(Store& store, RetentionPolicy policy, spdlog::logger& log)
      : store_(store),
        policy_(policy),
        log_(log),
        thread_([this](std::stop_token stop) { Run(stop); }) {}

  void RequestStop() { thread_.request_stop(); }

  void SetPolicy(RetentionPolicy policy) {
    const std::lock_guard lock(mutex_);
    policy_ = policy;
    WakeLocked();
  }
  void Wake() {
    const std::lock_guard lock(mutex_);
    WakeLocked();
  }
  /// Why the policy could not be applied; nullopt: it was.
  std::optional<std::string> Trouble() const {
    const std::lock_guard lock(mutex_);
    return trouble_;
  }

 private:
  void Run(std::stop_token stop) {
    while (!stop.stop_requested()) {
      std::unique_lock lock(mutex_);
      woken_ = false;
      const RetentionPolicy policy = policy_;
      lock.unlock();
      const auto removed = ApplyRetention(store_, policy, stop);
      const auto pruned = PruneJobs(store_, kKeptJobs);
      if (!pruned) log_.error("old jobs: {}", pruned.error().ToString());
      lock.lock();
      NoteTrouble(removed ? std::nullopt : std::optional(removed.error().ToString()));
      wake_.wait_for(lock, stop, trouble_ ? kRetentionRetry : kRetentionInterval,
                     [this] { return woken_; });
    }
  }

  void WakeLocked() {
    woken_ = true;
    wake_.notify_all();
  }

  /// The log has each trouble once.
  void NoteTrouble(std::optional<std::string> why) {
    if (why && why != trouble_) log_.error("retention: {}", *why);
    trouble_ = std::move(why);
  }

  Store& store_;
  mutable std::mutex mutex_;
  std::condition_variable_any wake_;
  RetentionPolicy policy_;
  bool woken_ = false;
  std::optional<std::string> trouble_;
  spdlog::logger& log_;
  std::jthread thread_;
};

bool IsEndOfJob(const EventRecord& event) {
  return event.kind == "job_done" || event.kind == "job_failed" || event.kind == "job_cancelled";
}

template <typename Part>
void End(std::unique_ptr<Part>& part, const char* name, spdlog::logger& log) {
  if (!part) return;
  part = nullptr;
  log.info("ended: {}", name);
}

}  // namespace

/// In the order in which they are made.
struct Service::Parts {
  explicit Parts(int reserve_mb) { SetReserve(reserve_mb); }
  void SetReserve(int reserve_mb) {
    reserve_bytes = kBytesPerMegabyte * static_cast<uint64_t>(reserve_mb);
  }
  /// What to ask for the reserve; these outlive those who do.
  std::function<uint64_t()> Reserve() const {
    return [this] { return reserve_bytes.load(); };
  }

  void SetReloadTrouble(std::optional<std::string> why) {
    const std::lock_guard lock(reload_mutex);
    reload_trouble = std::move(why);
  }
  std::vector<std::string> Troubles() {
    std::vector<std::string> troubles;
    const std::lock_guard lock(reload_mutex);
    if (reload_trouble) {
      troubles.push_back("the configuration was not reloaded and is kept as it was: " +
                         *reload_trouble);
    }
    if (const auto trouble = housekeeper->Trouble()) {
      troubles.push_back("the retention policy could not be applied: " + *trouble);
    }
    return troubles;
  }

  std::atomic<uint64_t> reserve_bytes;
  std::mutex reload_mutex;
  std::optional<std::string> reload_trouble;
  EventHub events;
  std::unique_ptr<EventHub::Subscription> event_log;
  std::unique_ptr<Store> store;
  std::unique_ptr<CaptureStation> station;
  std::unique_ptr<JobQueue> jobs;
  std::unique_ptr<Housekeeper> housekeeper;
  std::unique_ptr<EventHub::Subscription> wake_housekeeper;
  std::unique_ptr<Router> router;
  std::unique_ptr<HttpServer> server;
  std::unique_ptr<EventHub::Subscription> wake_streams;
  fs::path own_socket;  // empty: systemd's
};

Service::Service(Options options, spdlog::logger& log)
    : options_(std::move(options)),
      log_(log),
      parts_(std::make_unique<Parts>(options_.config.storage.reserve_mb)) {}

Result<std::unique_ptr<Service>> Service::Start(Options options, spdlog::logger& log) {
  std::unique_ptr<Service> service(new Service(std::move(options), log));
  ROTUNDA_RETURN_IF_ERROR(service->StartStore());
  log.info("started: {}", kStore);
  Parts& parts = *service->parts_;
  const config::DaemonConfig& config = service->options_.config;

  CaptureStation::Options station{config.capture, std::nullopt,
                                  milliseconds(config.devices.ready_ms)};
  if (!config.devices.simulated_socket.empty()) {
    station.simulated = config.devices.simulated_socket;
  }
  parts.station = std::make_unique<CaptureStation>(std::move(station));
  if (Status opened = parts.station->Open(); !opened) {
    log.error("cameras: {}; the next capture tries again", opened.error().ToString());
  }
  log.info("started: {}", kCameras);
  JobQueue::Options queue;
  queue.capture_silence = std::chrono::seconds(config.jobs.capture_silence_s);
  queue.computing_silence = std::chrono::seconds(config.jobs.computing_silence_s);
  queue.tell = [&log](const std::string& trouble) { log.error("{}", trouble); };
  parts.jobs = std::make_unique<JobQueue>(
      *parts.store,
      JobHandlers{MakeCaptureHandler(*parts.store, *parts.station,
                                     {parts.Reserve(), EndPatience(config.service), queue.tell}),
                  MakeCalibrationHandler(*parts.store, {config.devices.board, config.jobs.threads}),
                  MakeReconstructionHandler(*parts.store, config.jobs.threads)},
      queue);
  log.info("started: {}", kJobs);
  parts.housekeeper = std::make_unique<Housekeeper>(*parts.store, PolicyOf(config.storage), log);
  // A capture that a job needs stays until the job has ended.
  parts.wake_housekeeper =
      parts.events.Subscribe([&housekeeper = *parts.housekeeper](const EventRecord& event) {
        if (IsEndOfJob(event)) housekeeper.Wake();
      });
  log.info("started: {}", kHousekeeping);
  ROTUNDA_RETURN_IF_ERROR(service->StartServer());
  log.info("started: {}", kApi);
  return service;
}

Status Service::StartStore() {
  parts_->event_log =
      parts_->events.Subscribe([this](const EventRecord& event) { LogEvent(log_, event); });
  StoreOptions options;
  options.state_folder = options_.config.service.state_folder;
  options.clock = options_.clock;
  const config::DaemonConfig::Drift& drift = options_.config.drift;
  options.drift = {drift.position_mm, drift.rotation_deg, static_cast<size_t>(drift.captures)};
  options.follow_up = CaptureFollowUp;
  options.still_opening = options_.still_starting;
  ROTUNDA_ASSIGN_OR_RETURN(parts_->store, Store::Open(std::move(options), parts_->events));
  LogRecovery(log_, parts_->store->recovery());
  return {};
}

Status Service::StartServer() {
  const config::DaemonConfig& config = options_.config;
  Parts& parts = *parts_;
  const ApiParts api{*parts.store,
                     *parts.jobs,
                     *parts.station,
                     options_.version,
                     parts.store->Now(),
                     parts.Reserve(),
                     [&parts] { return parts.server->counters(); },
                     [&parts] { return parts.Troubles(); }};
  parts.router = std::make_unique<Router>(ApiRoutes(api), RoleNames(config.access));
  std::optional<int> fd = options_.listening_fd;
  if (!fd) {
    ROTUNDA_ASSIGN_OR_RETURN(fd, ListenOn(config.service.socket));
    parts.own_socket = config.service.socket;
  }
  HttpServer::Options options;
  options.limits = LimitsOf(config.http);
  options.access = AccessOf(config.access, log_);
  options.handle = [&router = *parts.router](const HttpRequest& request) {
    return router.Handle(request);
  };
  options.log = [this](const AccessEntry& entry) { LogAccess(log_, entry); };
  ROTUNDA_ASSIGN_OR_RETURN(parts.server, HttpServer::Start(*fd, std::move(options)));
  parts.wake_streams =
      parts.events.Subscribe([&server = *parts.server](const EventRecord&) { server.Wake(); });
  parts.server->Serve();  // requests ask for parts.server
  return {};
}

Service::~Service() {
  Parts& parts = *parts_;
  // All are told before any is waited for.
  if (parts.jobs) parts.jobs->RequestStop();
  if (parts.housekeeper) parts.housekeeper->RequestStop();
  if (parts.server) parts.server->Stop(milliseconds(options_.config.service.stop_ms));
  parts.wake_streams = nullptr;
  End(parts.server, kApi, log_);
  if (!parts.own_socket.empty()) unlink(parts.own_socket.c_str());
  parts.wake_housekeeper = nullptr;
  End(parts.housekeeper, kHousekeeping, log_);
  End(parts.jobs, kJobs, log_);
  End(parts.station, kCameras, log_);
  End(parts.store, kStore, log_);
}

void Service::Reload(const config::DaemonConfig& wanted) {
  for (const std::string& key : config::NeedsRestart(options_.config, wanted)) {
    log_.warn("{} has changed: it takes a restart", key);
  }
  SetLevel(log_, wanted.service.log_level);
  parts_->server->SetAccess(AccessOf(wanted.access, log_));
  parts_->router->SetGroups(RoleNames(wanted.access));
  parts_->housekeeper->SetPolicy(PolicyOf(wanted.storage));
  parts_->SetReserve(wanted.storage.reserve_mb);
  parts_->SetReloadTrouble(std::nullopt);
}

void Service::RefuseReload(const std::string& why) {
  log_.error("the configuration is kept as it was");
  parts_->SetReloadTrouble(why);
}

std::optional<std::string> Service::Hung() const {
  if (parts_->server->Silence() > kServerSilence) return "the API's threads do not answer";
  return parts_->jobs->Hung();
}

std::string Service::Summary() const {
  size_t ready = 0;
  const std::vector<rig::CameraState> states = parts_->station->States();
  for (const rig::CameraState& state : states) {
    ready += state.condition == rig::CameraCondition::kReady;
  }
  return std::to_string(ready) + " of " + std::to_string(parts_->station->CameraNames().size()) +
         " cameras ready";
}

}  // namespace rotunda::daemon
