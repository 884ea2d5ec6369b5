#include "daemon/store_jobs.h"

#include <charconv>

#include "daemon/store_internal.h"
#include "daemon/store_sql.h"

namespace rotunda::daemon {
namespace {

constexpr char kSelect[] =
    "SELECT number, kind, state, stage, done, total, idempotency_key, body, product, result, "
    "error, created_at, started_at, ended_at, cancel_requested FROM jobs ";

JobRecord ReadRow(Statement& row) {
  JobRecord job;
  job.number = row.Int();
  job.kind = JobKindFromName(row.Text()).value_or(JobKind::kCapture);
  job.state = JobStateFromName(row.Text()).value_or(JobState::kFailed);
  job.stage = row.Text();
  job.done = row.Count();
  job.total = row.Count();
  job.idempotency_key = row.Text();
  job.body = row.Text();
  job.product = row.OptionalId().value_or("");
  job.result = row.Text();
  job.error = row.Text();
  job.created_at = row.Text();
  job.started_at = row.OptionalText();
  job.ended_at = row.OptionalText();
  job.cancel_requested = row.Bool();
  return job;
}

Result<JobRecord> Select(Database& database, int64_t number) {
  Statement row = database.Prepare(std::string(kSelect) + "WHERE number = ?");
  ROTUNDA_ASSIGN_OR_RETURN(std::optional<JobRecord> job, ReadOne(row.Bind(number), ReadRow));
  if (!job) return NotFound("job", std::to_string(number));
  return *std::move(job);
}

EventRecord JobEvent(const JobRecord& job, const std::string& what) {
  Json data = {{"kind", JobKindName(job.kind)}};
  if (what == "job_progress") {
    data["stage"] = job.stage;
    data["done"] = job.done;
    data["total"] = job.total;
  }
  if (!job.product.empty()) data["product"] = job.product;
  if (!job.error.empty()) data["error"] = job.error;
  return MakeEvent(what, std::to_string(job.number), data);
}

/// The job's row with these values, and the event of its new state.
Status Change(Database& database, const JobRecord& job, std::vector<EventRecord>& events) {
  Statement update = database.Prepare(
      "UPDATE jobs SET state = ?, stage = ?, done = ?, total = ?, result = ?, error = ?, "
      "started_at = ?, ended_at = ?, cancel_requested = ? WHERE number = ?");
  update.Bind(JobStateName(job.state)).Bind(job.stage).Bind(job.done).Bind(job.total);
  update.Bind(job.result).Bind(job.error).Bind(job.started_at).Bind(job.ended_at);
  update.Bind(job.cancel_requested).Bind(job.number);
  const std::string state = job.state == JobState::kRunning ? "started" : JobStateName(job.state);
  events.push_back(JobEvent(job, "job_" + state));
  return update.Run();
}

Status Requeue(Database& database, JobRecord& job, std::vector<EventRecord>& events) {
  job.state = JobState::kQueued;
  job.stage.clear();
  job.done = job.total = 0;
  job.result.clear();
  job.error.clear();
  job.started_at = job.ended_at = std::nullopt;
  job.cancel_requested = false;
  return Change(database, job, events);
}

Result<std::optional<JobRecord>> SelectByKey(Database& database, const std::string& key) {
  Statement row = database.Prepare(std::string(kSelect) + "WHERE idempotency_key = ?");
  return ReadOne(row.Bind(key), ReadRow);
}

/// What Write() has to change in one row, and the row afterwards.
template <typename Body>
Result<JobRecord> ChangeJob(Store& store, int64_t number, Body body) {
  JobRecord job;
  ROTUNDA_RETURN_IF_ERROR(store.Write([&](Database& database, auto& events) -> Status {
    ROTUNDA_ASSIGN_OR_RETURN(job, Select(database, number));
    return body(database, job, events);
  }));
  return job;
}

Error WrongState(const JobRecord& job, const std::string& expected) {
  return {ErrorCode::kInvalidArgument,
          "is " + std::string(JobStateName(job.state)) + ", expected " + expected,
          "job " + std::to_string(job.number)};
}

}  // namespace

Status CheckPage(const Page& page) {
  if (page.limit >= 1 && page.limit <= kMaxPageLimit) return {};
  return Error{
      ErrorCode::kInvalidArgument,
      "is " + std::to_string(page.limit) + ", expected 1 to " + std::to_string(kMaxPageLimit),
      "limit"};
}

std::string PlaceText(const Place& place) {
  std::string text;
  for (const std::string& value : place) text += (text.empty() ? "" : ",") + value;
  return text;
}

Result<Place> PlaceAfter(const std::string& after, size_t columns,
                         const std::function<Result<Place>(const std::string& id)>& place_of) {
  if (after.find(',') == std::string::npos) return place_of(after);
  Place place;
  std::string rest = after;  // times and ids have no comma; the last column may
  for (size_t comma; place.size() + 1 < columns && (comma = rest.find(',')) != std::string::npos;) {
    place.push_back(rest.substr(0, comma));
    rest.erase(0, comma + 1);
  }
  place.push_back(rest);
  if (place.size() == columns) return place;
  return Error{ErrorCode::kInvalidArgument,
               "is '" + after + "', expected `next` of a page of this list", "after"};
}

Result<JobRecord> AddJobRow(Database& database, const NewJob& job, const std::string& now,
                            std::vector<EventRecord>& events) {
  std::optional<std::string> key;
  if (!job.idempotency_key.empty()) {
    key = job.idempotency_key;
    ROTUNDA_ASSIGN_OR_RETURN(std::optional<JobRecord> known, SelectByKey(database, *key));
    if (known && (known->kind != job.kind || known->body != job.body)) {
      return Error{ErrorCode::kAlreadyExists,
                   "was used for another request, that of job " + std::to_string(known->number),
                   "Idempotency-Key \"" + *key + "\""};
    }
    if (known && known->state == JobState::kInterrupted) {
      ROTUNDA_RETURN_IF_ERROR(Requeue(database, *known, events));
    }
    if (known) return *known;
  }
  Statement insert = database.Prepare(
      "INSERT INTO jobs (kind, state, idempotency_key, body, created_at) "
      "VALUES (?, 'queued', ?, ?, ?)");
  insert.Bind(JobKindName(job.kind)).Bind(key).Bind(job.body).Bind(now);
  ROTUNDA_RETURN_IF_ERROR(insert.Run());
  ROTUNDA_ASSIGN_OR_RETURN(JobRecord added, Select(database, database.LastInsertedRow()));
  events.push_back(JobEvent(added, "job_queued"));
  return added;
}

Result<std::optional<JobRecord>> FindJobByProduct(Store& store, const std::string& id) {
  std::optional<JobRecord> job;
  ROTUNDA_RETURN_IF_ERROR(store.Read([&](Database& database) {
    Statement row =
        database.Prepare(std::string(kSelect) + "WHERE product = ? ORDER BY number DESC LIMIT 1");
    if (row.Bind(id).Step()) job = ReadRow(row);
    return row.status();
  }));
  return job;
}

Result<JobRecord> FindJob(Store& store, int64_t number) {
  Result<JobRecord> job = NotFound("job", std::to_string(number));
  ROTUNDA_RETURN_IF_ERROR(store.Read([&](Database& database) {
    job = Select(database, number);
    return Status();
  }));
  return job;
}

Result<std::optional<JobRecord>> FindJobByKey(Store& store, const std::string& idempotency_key) {
  Result<std::optional<JobRecord>> job = std::optional<JobRecord>();
  ROTUNDA_RETURN_IF_ERROR(store.Read([&](Database& database) {
    job = SelectByKey(database, idempotency_key);
    return Status();
  }));
  return job;
}

Result<Listing<JobRecord>> ListJobs(Store& store, const Page& page, std::optional<JobState> state) {
  ROTUNDA_RETURN_IF_ERROR(CheckPage(page));
  int64_t before = INT64_MAX;
  if (!page.after.empty()) {
    const char* end = page.after.data() + page.after.size();
    const auto parsed = std::from_chars(page.after.data(), end, before);
    if (parsed.ec != std::errc() || parsed.ptr != end) return NotFound("job", page.after);
  }
  Result<Listing<JobRecord>> listing = Listing<JobRecord>();
  ROTUNDA_RETURN_IF_ERROR(store.Read([&](Database& database) {
    Statement rows =
        database.Prepare(std::string(kSelect) + "WHERE number < ? " +
                         (state ? "AND state = ? " : "") + "ORDER BY number DESC LIMIT ?");
    rows.Bind(before);
    if (state) rows.Bind(JobStateName(*state));
    rows.Bind(uint64_t{page.limit + 1});
    listing = ReadListing<JobRecord>(
        rows, page.limit, ReadRow, [](const JobRecord& job) { return std::to_string(job.number); });
    return Status();
  }));
  return listing;
}

Result<size_t> CountJobs(Store& store, JobState state) {
  size_t count = 0;
  ROTUNDA_RETURN_IF_ERROR(store.Read([&](Database& database) {
    Statement row = database.Prepare("SELECT count(*) FROM jobs WHERE state = ?");
    if (row.Bind(JobStateName(state)).Step()) count = row.Count();
    return row.status();
  }));
  return count;
}

Result<JobRecord> AddJob(Store& store, const NewJob& job) {
  JobRecord added;
  ROTUNDA_RETURN_IF_ERROR(store.Write([&](Database& database, auto& events) -> Status {
    ROTUNDA_ASSIGN_OR_RETURN(added, AddJobRow(database, job, store.Now(), events));
    return {};
  }));
  return added;
}

Result<std::optional<JobRecord>> TakeJob(Store& store, const std::vector<JobKind>& kinds) {
  std::string list;
  for (const JobKind kind : kinds) {
    list += (list.empty() ? "'" : ", '") + std::string(JobKindName(kind)) + "'";
  }
  const std::string query = "SELECT number FROM jobs WHERE state = 'queued' AND kind IN (" + list +
                            ") ORDER BY number LIMIT 1";
  // Asked as a reader first: an idle worker must not write.
  Result<int64_t> waiting = int64_t{0};
  ROTUNDA_RETURN_IF_ERROR(store.Read([&](Database& database) {
    waiting = database.Number(query);
    return Status();
  }));
  if (!waiting) return waiting.error();
  if (*waiting == 0) return std::optional<JobRecord>();

  std::optional<JobRecord> taken;
  ROTUNDA_RETURN_IF_ERROR(store.Write([&](Database& database, auto& events) -> Status {
    ROTUNDA_ASSIGN_OR_RETURN(const int64_t number, database.Number(query));
    if (number == 0) return {};
    ROTUNDA_ASSIGN_OR_RETURN(taken, Select(database, number));
    taken->state = JobState::kRunning;
    taken->started_at = store.Now();
    return Change(database, *taken, events);
  }));
  return taken;
}

Status SetJobProduct(Store& store, int64_t number, const std::string& product) {
  return store.Write([&](Database& database, auto&) {
    return database.Prepare("UPDATE jobs SET product = ? WHERE number = ?")
        .Bind(product)
        .Bind(number)
        .Run();
  });
}

Status SetJobProgress(Store& store, const JobRecord& job) {
  return store.Write([&](Database& database, auto& events) {
    events.push_back(JobEvent(job, "job_progress"));
    return database.Prepare("UPDATE jobs SET stage = ?, done = ?, total = ? WHERE number = ?")
        .Bind(job.stage)
        .Bind(job.done)
        .Bind(job.total)
        .Bind(job.number)
        .Run();
  });
}

Status EndJob(Store& store, const JobRecord& end) {
  const auto ended =
      ChangeJob(store, end.number, [&](Database& database, JobRecord& job, auto& events) -> Status {
        job.state = end.state;
        job.result = end.result;
        job.error = end.error;
        job.ended_at = store.Now();
        ROTUNDA_RETURN_IF_ERROR(
            database.Prepare("DELETE FROM events WHERE kind = 'job_progress' AND about = ?")
                .Bind(std::to_string(job.number))
                .Run());
        return Change(database, job, events);
      });
  return ended ? Status() : Status(ended.error());
}

Result<JobRecord> RequestCancel(Store& store, int64_t number) {
  return ChangeJob(store, number, [&](Database& database, JobRecord& job, auto& events) -> Status {
    if (job.state == JobState::kQueued) {
      job.state = JobState::kCancelled;
      job.ended_at = store.Now();
      return Change(database, job, events);
    }
    if (job.state != JobState::kRunning) return WrongState(job, "queued or running");
    job.cancel_requested = true;
    return database.Prepare("UPDATE jobs SET cancel_requested = 1 WHERE number = ?")
        .Bind(number)
        .Run();
  });
}

Result<size_t> PruneJobs(Store& store, size_t keep) {
  Result<int64_t> removed = int64_t{0};
  ROTUNDA_RETURN_IF_ERROR(store.Write([&](Database& database, auto&) -> Status {
    ROTUNDA_RETURN_IF_ERROR(
        database
            .Prepare("DELETE FROM jobs WHERE state IN ('done', 'failed', 'cancelled') AND "
                     "number <= (SELECT max(number) FROM jobs) - ?")
            .Bind(uint64_t{keep})
            .Run());
    removed = database.Number("SELECT changes()");
    if (!removed) return removed.error();
    return database.Execute(
        "DELETE FROM events WHERE kind GLOB 'job_*' AND CAST(about AS INTEGER) NOT IN "
        "(SELECT number FROM jobs)");
  }));
  return static_cast<size_t>(*removed);
}

bool CanRunAgain(JobState state) {
  return state == JobState::kInterrupted || state == JobState::kFailed ||
         state == JobState::kCancelled;
}

Result<JobRecord> RequeueJob(Store& store, int64_t number) {
  return ChangeJob(store, number, [](Database& database, JobRecord& job, auto& events) -> Status {
    if (!CanRunAgain(job.state)) return WrongState(job, "interrupted, failed or cancelled");
    return Requeue(database, job, events);
  });
}

}  // namespace rotunda::daemon
