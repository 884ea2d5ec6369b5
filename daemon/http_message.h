#pragma once

#include <sys/types.h>

#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace rotunda::daemon {

/// What the one at the other end of the socket may do. Each may do what those before it may.
enum class Role { kNone, kViewer, kOperator };

/// The process that connected, as the kernel knows it (not as it says).
struct Peer {
  uid_t uid = 0;
  pid_t pid = 0;
  Role role = Role::kNone;
};

struct HttpRequest {
  std::string method;                          // "GET"
  std::string target;                          // as sent: path and query, still percent-encoded
  std::map<std::string, std::string> headers;  // names in lower case
  std::string body;
  Peer peer;

  /// Whether only the header is wanted that GET would be answered with.
  bool IsHead() const { return method == "HEAD"; }
  /// Empty when the header is not there.
  std::string Header(const std::string& lower_case_name) const {
    const auto found = headers.find(lower_case_name);
    return found == headers.end() ? "" : found->second;
  }
};

/// Gives what has come up since it was called last; empty: nothing yet.
using StreamSource = std::function<std::string()>;

/// Exactly one of `body`, `file`, `stream` and what `bulk` makes is sent.
struct HttpResponse {
  int status = 200;
  std::string content_type = "application/json";
  std::vector<std::pair<std::string, std::string>> headers = {};
  std::string body = {};
  std::optional<std::filesystem::path> file = std::nullopt;
  StreamSource stream = nullptr;  // until the client goes or the server stops
  // What reads files may take long, or hang on a share that is gone: the server has only a few of
  // these under way at a time, so that other requests find a thread.
  std::function<HttpResponse()> bulk = nullptr;
  // Let go when the body has been taken or its client has gone.
  std::shared_ptr<const void> held = nullptr;
};

}  // namespace rotunda::daemon
