#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "daemon/api_routes.h"
#include "daemon/capture_job.h"
#include "daemon/http_server.h"
#include "daemon/jobs.h"
#include "daemon/store.h"

namespace rotunda::daemon {

/// What the API reads and acts on; all of it outlives the routes.
struct ApiParts {
  Store& store;
  JobQueue& jobs;
  CaptureStation& station;
  std::string version;
  std::string started_at;  // RFC 3339
  std::function<uint64_t()> disk_reserve_bytes;
  std::function<HttpCounters()> counters;
  /// What else is wrong with the daemon, each in words. Null: nothing ever is.
  std::function<std::vector<std::string>()> troubles = nullptr;
};

/// Every route that is served. Handlers read or queue; what takes long is a job.
std::vector<Route> ApiRoutes(const ApiParts& parts);

// Its parts, a file each (api_<name>.cc).
std::vector<Route> ServiceRoutes(const ApiParts& parts);
std::vector<Route> CameraRoutes(const ApiParts& parts);
std::vector<Route> CaptureRoutes(const ApiParts& parts);
std::vector<Route> CalibrationRoutes(const ApiParts& parts);
std::vector<Route> JobRoutes(const ApiParts& parts);

}  // namespace rotunda::daemon
