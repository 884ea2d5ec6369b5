#include "tests/support/http_echo.h"

#include <algorithm>
#include <iterator>
#include <nlohmann/json.hpp>
#include <utility>

#include "tests/support/unix_http.h"

namespace rotunda::test {
namespace {

using daemon::HttpRequest;

// Of what daemon/README.md names, what bytes alone can lead to.
constexpr int kRefusals[] = {400, 413, 431};
constexpr char kEvent[] = "data: 1\n\n";
constexpr std::string_view kEventChunk = "9\r\ndata: 1\n\n\r\n";
constexpr size_t kQuotedBytes = 200;

Error Wrong(const std::string& what, std::string_view found) {
  return {ErrorCode::kFailed, what + ": '" + std::string(found.substr(0, kQuotedBytes)) + "'", ""};
}

bool IsStream(const HttpRequest& request) { return request.target.starts_with("/stream"); }

std::string Echo(const HttpRequest& request) {
  return request.method + " " + request.target + "\n" + request.body;
}

/// Whether a handler may be given it: nothing that would end a line elsewhere.
bool IsClean(const HttpRequest& request) {
  const auto is_clean = [](const std::string& text) {
    return text.find_first_of(std::string_view("\0\r\n", 3)) == std::string::npos;
  };
  return !request.method.empty() && is_clean(request.method) && is_clean(request.target) &&
         std::all_of(request.headers.begin(), request.headers.end(), [&](const auto& header) {
           return is_clean(header.first) && is_clean(header.second);
         });
}

std::string HeaderOf(const UnixHttpAnswer& answer, const std::string& lower_case_name) {
  const auto found = answer.headers.find(lower_case_name);
  return found == answer.headers.end() ? "" : found->second;
}

/// Takes an answer's header from the front of `answers`.
Result<UnixHttpAnswer> TakeHead(std::string_view& answers) {
  const size_t end = std::min(answers.find("\r\n\r\n"), answers.size());
  const std::string_view head = answers.substr(0, end + 4);
  UnixHttpAnswer answer = ParseHead(std::string(head));
  if (answer.status == 0) return Wrong("not the header of an answer", answers);
  answers.remove_prefix(head.size());
  return answer;
}

/// Takes what Content-Length says from the front of `answers`.
Result<std::string> TakeBody(const UnixHttpAnswer& answer, std::string_view& answers) {
  const std::string length = HeaderOf(answer, "content-length");
  const size_t bytes = std::min(answers.size(), size_t{1} << 30);
  if (length.empty() || length.size() > 9 ||
      length.find_first_not_of("0123456789") != std::string::npos || std::stoul(length) > bytes) {
    return Wrong("a body of " + std::to_string(answers.size()) + " bytes with the Content-Length",
                 length);
  }
  const std::string body(answers.substr(0, std::stoul(length)));
  answers.remove_prefix(body.size());
  return body;
}

/// A stream comes last, and ends when its client has no more to say: anywhere.
Status TakeStream(const UnixHttpAnswer& answer, std::string_view sent, std::string_view& answers) {
  const std::string coding = HeaderOf(answer, "transfer-encoding");
  const bool in_chunks = coding == "chunked" && kEventChunk.starts_with(answers);
  const bool to_http10 = coding.empty() && std::string_view(kEvent).starts_with(answers) &&
                         sent.find("HTTP/1.0") != std::string_view::npos;
  if (HeaderOf(answer, "connection") != "close" || !(in_chunks || to_http10)) {
    return Wrong("no stream of events", answers);
  }
  answers = {};
  return {};
}

Status TakeEcho(const HttpRequest& request, const UnixHttpAnswer& answer, std::string_view sent,
                std::string_view& answers) {
  if (!IsClean(request)) return Wrong("the handler was given a broken request", Echo(request));
  if (request.IsHead()) return {};
  if (IsStream(request)) return TakeStream(answer, sent, answers);
  ROTUNDA_ASSIGN_OR_RETURN(const std::string body, TakeBody(answer, answers));
  if (body != Echo(request)) return Wrong("another request's answer", body);
  if (HeaderOf(answer, "connection") == "close" && !answers.empty()) {
    return Wrong("more after the last answer", answers);
  }
  return {};
}

/// The last there is on its connection, with a reason for people and programs; to HEAD without it.
Status TakeRefusal(const UnixHttpAnswer& answer, std::string_view sent, std::string_view& answers) {
  if (std::find(std::begin(kRefusals), std::end(kRefusals), answer.status) == std::end(kRefusals)) {
    return Wrong("an unexpected status", std::to_string(answer.status));
  }
  if (HeaderOf(answer, "connection") != "close") {
    return Wrong("a refusal does not end the connection", answers);
  }
  if (answers.empty() && sent.find("HEAD ") != std::string_view::npos) return {};
  ROTUNDA_ASSIGN_OR_RETURN(const std::string body, TakeBody(answer, answers));
  const auto problem = nlohmann::json::parse(body, nullptr, false);
  if (HeaderOf(answer, "content-type") != "application/problem+json" || !problem.is_object() ||
      problem.value("status", nlohmann::json()) != answer.status ||
      problem.value("title", nlohmann::json()) == "Unknown" ||
      !problem.value("title", nlohmann::json()).is_string() ||
      !problem.value("detail", nlohmann::json()).is_string()) {
    return Wrong("a refusal that is no problem+json", body);
  }
  if (!answers.empty()) return Wrong("more after a refusal", answers);
  return {};
}

/// The statuses; `asked` are the requests that the handler was given on the connection out of what
/// was `sent`.
Result<std::vector<int>> CheckAnswers(std::string_view answers, std::string_view sent,
                                      const std::vector<HttpRequest>& asked) {
  std::vector<int> statuses;
  auto next = asked.begin();
  while (!answers.empty()) {
    ROTUNDA_ASSIGN_OR_RETURN(const UnixHttpAnswer answer, TakeHead(answers));
    if (answer.status == 100) continue;  // the answer itself follows, or the client has left
    if (answer.status != 200) {
      ROTUNDA_RETURN_IF_ERROR(TakeRefusal(answer, sent, answers));
    } else {
      if (next == asked.end()) return Wrong("an answer to nothing", answers);
      ROTUNDA_RETURN_IF_ERROR(TakeEcho(*next++, answer, sent, answers));
    }
    statuses.push_back(answer.status);
  }
  if (next != asked.end()) return Wrong("no answer to", Echo(*next));
  return statuses;
}

}  // namespace

daemon::HttpResponse HttpEcho::Answer(const HttpRequest& request) {
  {
    const std::lock_guard lock(mutex_);
    asked_.push_back(request);
  }
  daemon::HttpResponse response;
  response.content_type = "text/plain";
  if (!IsStream(request)) {
    response.body = Echo(request);
    return response;
  }
  response.content_type = "text/event-stream";
  response.stream = [given = false]() mutable {
    return std::string(std::exchange(given, true) ? "" : kEvent);
  };
  return response;
}

Result<std::vector<int>> HttpEcho::Converse(const std::filesystem::path& socket,
                                            const std::string& first, const std::string& second) {
  UnixConnection connection(socket);
  // A server that has closed has answered; that is read all the same.
  if (connection.Send(first) && connection.WaitUntilTaken()) connection.Send(second);
  connection.EndSending();
  const std::string answers = connection.ReadAll();
  std::vector<HttpRequest> asked;
  {
    const std::lock_guard lock(mutex_);
    asked.swap(asked_);
  }
  if (!connection.closed()) return Wrong("the connection stays open after", answers);
  return CheckAnswers(answers, first + second, asked);
}

}  // namespace rotunda::test
