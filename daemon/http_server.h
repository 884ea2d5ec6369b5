#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "daemon/http_message.h"
#include "sfm/core/result.h"

namespace rotunda::daemon {

/// What clients may cost. Of connections and of streams an eighth is for operators alone, so that
/// viewers cannot keep them out.
struct HttpLimits {
  int header_bytes = 16 * 1024;
  int body_bytes = 1024 * 1024;
  int connections = 128;
  int streams = 64;        // of the connections; the others stay free for requests
  int request_ms = 15000;  // for a request to arrive, after the connection or the last answer
  int write_ms = 15000;    // for a client to take the next piece of an answer
  // On the whole an answer must be taken at this rate: a large one may take long, but not for ever.
  int least_bytes_per_s = 50000;
  int heartbeat_ms = 15000;  // a stream on which nothing happens says so
  // Two of them (of three or more) never read files for an answer (`file`, `bulk`): files that hang
  // leave them free. Who waits longer than write_ms for one that may is told 503.
  int handler_threads = 4;
};

/// Groups whose members may look and may act. Root and the daemon's own user may act.
struct HttpAccess {
  std::vector<gid_t> viewers;
  std::vector<gid_t> operators;
};

/// A request that was answered (or whose client went away before), or a connection that was
/// refused.
struct AccessEntry {
  Peer peer;
  std::string method;  // empty: no request could be read
  std::string target;  // printable
  int status = 0;      // 0: the answer was not taken, or not given, to its end
  uint64_t sent_bytes = 0;
  double seconds = 0;   // from the last byte of the request to the last of the answer
  std::string trouble;  // ours, with status 0; empty: the client went away
};

/// Counts since the start.
struct HttpCounters {
  uint64_t requests = 0;
  uint64_t refused_connections = 0;  // too many
  uint64_t connections = 0;          // now
  uint64_t streams = 0;              // now
};

/// HTTP/1.1 over a UNIX socket. One thread does all input and output and never waits for anything
/// else; `handle` runs on a few others. Nothing here knows what is served.
class HttpServer {
 public:
  struct Options {
    HttpLimits limits;
    HttpAccess access;                                       // at first
    std::function<HttpResponse(const HttpRequest&)> handle;  // from several threads at once
    std::function<void(const AccessEntry&)> log;             // from the input/output thread
  };

  /// A listening socket becomes the server's; clients wait until Serve(). kInvalidArgument: it is
  /// none.
  static Result<std::unique_ptr<HttpServer>> Start(int listening_fd, Options options);
  /// Stops, without patience.
  ~HttpServer();
  HttpServer(const HttpServer&) = delete;
  HttpServer& operator=(const HttpServer&) = delete;

  /// Takes connections from now on. Called once.
  void Serve();
  /// Who may do what from now on; connections that are open keep their role.
  void SetAccess(HttpAccess access);
  /// Makes every stream ask its source. From any thread.
  void Wake();
  /// How long ago the input/output thread and a handler's thread last did something; they do every
  /// half second. From any thread.
  std::chrono::milliseconds Silence() const;
  HttpCounters counters() const;

  /// Takes no more requests, ends the streams, lets answers under way finish for at most
  /// `patience`.
  void Stop(std::chrono::milliseconds patience);

 private:
  HttpServer();
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace rotunda::daemon
