#pragma once

#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "daemon/api.h"
#include "daemon/api_json.h"
#include "daemon/http_problem.h"

// Private to the api_*.cc files: what their handlers have in common.

namespace rotunda::daemon {

/// `value` as JSON, or its error.
HttpResponse JsonAnswer(const nlohmann::ordered_json& value, int status = 200);
template <typename T>
HttpResponse JsonAnswer(const Result<T>& value) {
  return value ? JsonAnswer(ToJson(*value)) : Problem(value.error());
}
HttpResponse FileAnswer(const std::filesystem::path& file, const std::string& content_type);

/// What `make` answers, made where it holds up nobody: for handlers that read files.
HttpResponse BulkAnswer(std::function<HttpResponse()> make);

/// 503: what is only done once at a time is being done.
HttpResponse Busy(const std::string& with_what);

/// 503: so many jobs wait that no more are taken.
HttpResponse QueueFull(const Error& error);

/// `limit` and `after` of every list.
std::vector<QueryParameter> PageQuery();
Result<Page> PageOf(const ApiRequest& request);

/// What a body says, an empty one as "{}"; kBadInput: no JSON, or no object.
Result<nlohmann::json> BodyObject(const std::string& body);

/// Queues a job with the request's Idempotency-Key: 202 and where to look for it. `body` is what
/// BodyObject() gave.
HttpResponse SubmitJob(const ApiParts& parts, JobKind kind, const Result<nlohmann::json>& body,
                       const ApiRequest& request);
/// Where that is, as the document says it.
ResponseHeader JobLocation();

}  // namespace rotunda::daemon
