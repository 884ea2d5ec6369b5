#pragma once

#include <filesystem>
#include <mutex>
#include <string>
#include <string_view>
#include <vector>

#include "daemon/http_message.h"
#include "sfm/core/result.h"

namespace rotunda::test {

/// What a server under test serves, and a client that looks at every byte of the answers: each
/// request is answered with itself, a target that begins with "/stream" with a stream of one event.
class HttpEcho {
 public:
  /// The server's handler.
  daemon::HttpResponse Answer(const daemon::HttpRequest& request);

  /// Sends `first`, `second` when the server has taken that, and then no more; gives the statuses
  /// of the answers. kFailed, with what was found: the server leaves the connection open, or what
  /// it answers is not one well-formed answer for each request that the handler was given, in their
  /// order, and then at most one refusal that says why. Nobody else may ask meanwhile.
  Result<std::vector<int>> Converse(const std::filesystem::path& socket, const std::string& first,
                                    const std::string& second = "");

 private:
  std::mutex mutex_;
  std::vector<daemon::HttpRequest> asked_;  // in this conversation
};

}  // namespace rotunda::test
