#include "daemon/api_answers.h"

#include <algorithm>
#include <charconv>

#include "daemon/retention.h"
#include "sfm/core/json_reader.h"

namespace rotunda::daemon {
namespace {

constexpr size_t kMaxKeyLength = 200;
// About what a job takes.
constexpr char kQueueRetry_s[] = "60";

bool IsKey(const std::string& text) {
  return !text.empty() && text.size() <= kMaxKeyLength &&
         std::all_of(text.begin(), text.end(), [](char c) { return c > 0x20 && c < 0x7F; });
}

/// A request that can be read and cannot become a job: a value or an id in it that is not right
/// 422, too many jobs 503, less room on the disk than the reserve 507.
HttpResponse Refusal(const Error& error) {
  switch (error.code) {
    case ErrorCode::kInvalidArgument:
    case ErrorCode::kNotFound:
      return Problem(422, error.ToString());
    case ErrorCode::kIo:
      return IsBelowReserve(error) ? Problem(507, error.ToString()) : Problem(error);
    case ErrorCode::kFailed:
      return QueueFull(error);
    default:
      return Problem(error);
  }
}

}  // namespace

HttpResponse JsonAnswer(const nlohmann::ordered_json& value, int status) {
  HttpResponse response;
  response.status = status;
  response.body = AnswerText(value);
  return response;
}

HttpResponse FileAnswer(const std::filesystem::path& file, const std::string& content_type) {
  HttpResponse response;
  response.content_type = content_type;
  response.file = file;
  return response;
}

HttpResponse BulkAnswer(std::function<HttpResponse()> make) {
  HttpResponse response;
  response.bulk = std::move(make);
  return response;
}

HttpResponse Busy(const std::string& with_what) {
  HttpResponse response = Problem(503, with_what + "; try again in a second");
  response.headers.emplace_back("Retry-After", "1");
  return response;
}

HttpResponse QueueFull(const Error& error) {
  HttpResponse response = Problem(503, error.ToString());
  response.headers.emplace_back("Retry-After", kQueueRetry_s);
  return response;
}

std::vector<QueryParameter> PageQuery() {
  return {{"limit", "At most so many items, 1 to " + std::to_string(kMaxPageLimit) + "; default " +
                        std::to_string(Page().limit)},
          {"after", "`next` of the page before, also when what that page ended with is gone"}};
}

Result<Page> PageOf(const ApiRequest& request) {
  Page page;
  if (const auto given = request.query.find("limit"); given != request.query.end()) {
    const std::string& text = given->second;
    const auto [end, failure] = std::from_chars(text.data(), text.data() + text.size(), page.limit);
    if (failure != std::errc() || end != text.data() + text.size() || page.limit < 1 ||
        page.limit > kMaxPageLimit) {
      return Error{ErrorCode::kInvalidArgument,
                   "is '" + text + "', expected 1 to " + std::to_string(kMaxPageLimit),
                   "query: limit"};
    }
  }
  if (const auto given = request.query.find("after"); given != request.query.end()) {
    const bool is_place = given->second.find(',') != std::string::npos;
    if (!is_place && !IsStoreId(given->second)) {
      return Error{ErrorCode::kInvalidArgument,
                   "is '" + given->second + "', expected `next` of the page before, or an id",
                   "query: after"};
    }
    page.after = given->second;
  }
  return page;
}

Result<nlohmann::json> BodyObject(const std::string& body) {
  ROTUNDA_ASSIGN_OR_RETURN(nlohmann::json json, ParseJson(body.empty() ? "{}" : body, "body"));
  if (!json.is_object()) return Error{ErrorCode::kBadInput, "expected a JSON object", "body"};
  return json;
}

HttpResponse SubmitJob(const ApiParts& parts, JobKind kind, const Result<nlohmann::json>& body,
                       const ApiRequest& request) {
  const auto given = request.http.headers.find("idempotency-key");
  const std::string key = given == request.http.headers.end() ? "" : given->second;
  if (given != request.http.headers.end() && !IsKey(key)) {
    return Problem(400, "Idempotency-Key: is '" + key + "', expected 1 to " +
                            std::to_string(kMaxKeyLength) +
                            " printable ASCII characters without spaces, or no such header");
  }
  if (!body) return Problem(400, body.error().ToString());
  const Result<JobRecord> job = parts.jobs.Submit(kind, body->dump(), key);
  if (!job) return Refusal(job.error());
  HttpResponse response = JsonAnswer(ToJson(*job), 202);
  response.headers.emplace_back(JobLocation().name, "/v1/jobs/" + std::to_string(job->number));
  return response;
}

ResponseHeader JobLocation() { return {"Location", "Path of the job"}; }

}  // namespace rotunda::daemon
