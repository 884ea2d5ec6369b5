#include "daemon/http_problem.h"

#include <map>
#include <nlohmann/json.hpp>

namespace rotunda::daemon {
namespace {

int StatusOf(ErrorCode code) {
  switch (code) {
    case ErrorCode::kInvalidArgument:
      return 400;
    case ErrorCode::kNotFound:
      return 404;
    case ErrorCode::kAlreadyExists:
      return 409;
    case ErrorCode::kIo:
    case ErrorCode::kCancelled:
      return 503;
    case ErrorCode::kBadInput:
    case ErrorCode::kFailed:
      return 500;
  }
  return 500;
}

}  // namespace

std::string ReasonPhrase(int status) {
  static const std::map<int, std::string> phrases = {
      {200, "OK"},
      {201, "Created"},
      {202, "Accepted"},
      {400, "Bad Request"},
      {403, "Forbidden"},
      {404, "Not Found"},
      {405, "Method Not Allowed"},
      {409, "Conflict"},
      {413, "Content Too Large"},
      {415, "Unsupported Media Type"},
      {422, "Unprocessable Content"},
      {431, "Request Header Fields Too Large"},
      {500, "Internal Server Error"},
      {503, "Service Unavailable"},
      {507, "Insufficient Storage"},
  };
  const auto found = phrases.find(status);
  return found == phrases.end() ? "Unknown" : found->second;
}

HttpResponse Problem(int status, const std::string& detail) {
  const nlohmann::ordered_json problem = {{"type", "about:blank"},
                                          {"title", ReasonPhrase(status)},
                                          {"status", status},
                                          {"detail", detail}};
  HttpResponse response;
  response.status = status;
  response.content_type = "application/problem+json";
  // A detail may quote what the caller sent, which need not be UTF-8.
  response.body =
      problem.dump(1, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
  return response;
}

HttpResponse Problem(const Error& error) { return Problem(StatusOf(error.code), error.ToString()); }

}  // namespace rotunda::daemon
