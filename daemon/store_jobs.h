#pragma once

#include <optional>
#include <string>
#include <vector>

#include "daemon/store.h"

namespace rotunda::daemon {

/// Readers. Everything that changes jobs goes through JobQueue (jobs.h).
Result<JobRecord> FindJob(Store& store, int64_t number);
Result<std::optional<JobRecord>> FindJobByKey(Store& store, const std::string& idempotency_key);
/// Newest first; only those in `state` when it is given.
Result<Listing<JobRecord>> ListJobs(Store& store, const Page& page,
                                    std::optional<JobState> state = std::nullopt);
Result<size_t> CountJobs(Store& store, JobState state);

/// Stores the job, or finds the one with its key: that is given when it is for the same (an
/// interrupted one is queued again), else kAlreadyExists.
Result<JobRecord> AddJob(Store& store, const NewJob& job);
/// The oldest queued job of one of the kinds, now running; nullopt: there is none.
Result<std::optional<JobRecord>> TakeJob(Store& store, const std::vector<JobKind>& kinds);
Status SetJobProduct(Store& store, int64_t number, const std::string& product);
Status SetJobProgress(Store& store, const JobRecord& job);  // stage, done, total
/// `end` has the state, result and error.
Status EndJob(Store& store, const JobRecord& end);
/// Queued: cancelled at once. Running: marked; its worker must be told. kInvalidArgument when the
/// job has ended.
Result<JobRecord> RequestCancel(Store& store, int64_t number);
/// Removes jobs that are done, failed or cancelled and not among the newest `keep` jobs, and the
/// events of jobs that are not there any more (the other events are the history of captures,
/// calibrations and cameras, and stay); gives how many jobs.
Result<size_t> PruneJobs(Store& store, size_t keep);
/// Whether a job in this state can be queued again.
bool CanRunAgain(JobState state);
/// Queues an interrupted, failed or cancelled job again; kInvalidArgument in any other state.
Result<JobRecord> RequeueJob(Store& store, int64_t number);

}  // namespace rotunda::daemon
