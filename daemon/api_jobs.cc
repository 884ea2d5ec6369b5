#include <charconv>
#include <optional>

#include "daemon/api_answers.h"
#include "daemon/store_events.h"
#include "daemon/store_jobs.h"

namespace rotunda::daemon {
namespace {

// Of events, in one piece of a stream.
constexpr size_t kEventsAtOnce = 100;
// How long a client is to wait before it connects again.
constexpr int kRetry_ms = 2000;

/// nullopt: no number from 0 on that fits, written as we do.
std::optional<int64_t> Number(const std::string& text) {
  int64_t number = 0;
  const bool is_padded = text.size() > 1 && text.front() == '0';
  const auto [end, failure] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (is_padded || failure != std::errc() || end != text.data() + text.size() || number < 0)
    return std::nullopt;
  return number;
}

std::vector<std::string> StateNames() {
  std::vector<std::string> names;
  for (const JobState state : {JobState::kQueued, JobState::kRunning, JobState::kDone,
                               JobState::kFailed, JobState::kCancelled, JobState::kInterrupted}) {
    names.emplace_back(JobStateName(state));
  }
  return names;
}

HttpResponse List(const ApiParts& parts, const ApiRequest& request) {
  const Result<Page> page = PageOf(request);
  if (!page) return Problem(page.error());
  const auto state = request.query.find("state");
  return JsonAnswer(
      ListJobs(parts.store, *page,
               state == request.query.end() ? std::nullopt : JobStateFromName(state->second)));
}

/// Calls `act` with the job's number. What it refuses for the job's state is a conflict, what for
/// the queue's (kFailed) is for later.
template <typename Act>
HttpResponse WithJob(const ApiRequest& request, const Act& act) {
  const std::string& text = request.path.at("job");
  const std::optional<int64_t> number = Number(text);
  if (!number) return Problem(404, "job: '" + text + "' is no number of a job");
  const Result<JobRecord> job = act(*number);
  if (!job && job.error().code == ErrorCode::kInvalidArgument) {
    return Problem(409, job.error().ToString());
  }
  if (!job && job.error().code == ErrorCode::kFailed) return QueueFull(job.error());
  return JsonAnswer(job);
}

/// No event: how to come again. With the number a client that is cut off before its first event
/// misses nothing either.
std::string StreamBegin(int64_t after) {
  return "retry: " + std::to_string(kRetry_ms) + "\nid: " + std::to_string(after) + "\n\n";
}

std::string StreamText(const EventRecord& event) {
  return "id: " + std::to_string(event.number) + "\nevent: " + event.kind + "\ndata: " +
         ToJson(event).dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace) +
         "\n\n";
}

/// Server-sent events after number `after`. Each client has its own place: one that reads slowly
/// costs nobody else anything.
StreamSource EventsAfter(Store& store, int64_t after) {
  return [&store, after, begun = false]() mutable {
    std::string text = begun ? "" : StreamBegin(after);
    begun = true;
    const Result<std::vector<EventRecord>> events = ListEvents(store, after, kEventsAtOnce);
    if (!events) return text;
    for (const EventRecord& event : *events) {
      text += StreamText(event);
      after = event.number;
    }
    return text;
  };
}

HttpResponse Events(const ApiParts& parts, const ApiRequest& request) {
  const auto query = request.query.find("after");
  const std::string header = request.http.Header("last-event-id");
  const std::string from = header.empty() && query != request.query.end() ? query->second : header;
  std::optional<int64_t> after = Number(from);
  if (!from.empty() && !after) return Problem(400, "'" + from + "' is no number of an event");
  const Result<int64_t> newest = LastEventNumber(parts.store);
  if (!newest) return Problem(newest.error());
  // A number from before the store was restored from a backup may be one that is yet to come.
  if (!after || *after > *newest) after = *newest;
  HttpResponse response;
  response.content_type = "text/event-stream";
  response.stream = EventsAfter(parts.store, *after);
  return response;
}

}  // namespace

std::vector<Route> JobRoutes(const ApiParts& parts) {
  std::vector<QueryParameter> list_query = PageQuery();
  list_query.push_back({"state", "Only jobs in this state", StateNames()});
  return {
      {.method = "GET",
       .path = "/v1/jobs",
       .operation = "listJobs",
       .summary = "Jobs, newest first",
       .query = list_query,
       .schema = "JobPage",
       .handle = [parts](const ApiRequest& request) { return List(parts, request); }},
      {.method = "GET",
       .path = "/v1/jobs/{job}",
       .operation = "getJob",
       .summary = "One job",
       .schema = "Job",
       .handle =
           [parts](const ApiRequest& request) {
             return WithJob(request, [&](int64_t number) { return FindJob(parts.store, number); });
           }},
      {.method = "DELETE",
       .path = "/v1/jobs/{job}",
       .role = Role::kOperator,
       .operation = "cancelJob",
       .summary =
           "Cancel a job; one that runs ends within a second or two, and is `done` when it is "
           "a capture whose shot was taken",
       .schema = "Job",
       .refusals = {{409,
                     "The job has ended, or it is a capture whose shot is taken and waits for the "
                     "disk, which is not given up: `detail` says why"}},
       .handle =
           [parts](const ApiRequest& request) {
             return WithJob(request, [&](int64_t number) { return parts.jobs.Cancel(number); });
           }},
      {.method = "POST",
       .path = "/v1/jobs/{job}/rerun",
       .role = Role::kOperator,
       .operation = "rerunJob",
       .summary =
           "Queue an interrupted, failed or cancelled job again; a shot that it has taken is "
           "kept, else it takes one now, under a new id",
       .schema = "Job",
       .handle =
           [parts](const ApiRequest& request) {
             return WithJob(request, [&](int64_t number) { return parts.jobs.Rerun(number); });
           }},
      {.method = "GET",
       .path = "/v1/events",
       .operation = "followEvents",
       .summary = "Server-sent events, each with an Event as data, from now on or after one that "
                  "was seen",
       .query = {{"after", "Begin after this event, as Last-Event-ID does; 0: all that are kept"}},
       .content_type = "text/event-stream",
       .handle = [parts](const ApiRequest& request) { return Events(parts, request); }}};
}

}  // namespace rotunda::daemon
