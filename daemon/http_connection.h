#pragma once

#include <atomic>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <set>
#include <string>

#include "daemon/http_asio.h"
#include "daemon/http_bulk.h"
#include "daemon/http_message.h"
#include "daemon/http_problem.h"
#include "daemon/http_server.h"

// Private to the .cc files of the HTTP server.

namespace rotunda::daemon {

class HttpSession;

inline constexpr unsigned kHttp11 = 11;  // as Beast writes versions

/// What the connections of a server have in common: the input/output thread's alone, but for what
/// says "of all threads".
struct HttpShared {
  explicit HttpShared(HttpServer::Options given)
      : options(std::move(given)),
        handlers(static_cast<size_t>(options.limits.handler_threads)),
        bulk(io, handlers, options.limits.handler_threads) {}

  const HttpServer::Options options;  // of all threads
  // Sessions live in the input/output thread; this outlives the context that keeps them.
  std::set<HttpSession*> sessions;
  std::atomic<uint64_t> requests = 0, refused = 0, connections = 0, streams = 0;  // of all threads
  std::mutex mutex;                                                               // of all threads
  std::condition_variable all_gone;                                               // of all threads
  net::io_context io{1};
  net::thread_pool handlers;
  BulkQueue bulk;
};

/// One client: its socket, who it is, the request that is answered, and how that goes. Kept by the
/// operations it waits for; all of it is the input/output thread's, its end too: what a handler's
/// thread holds of it goes back with the result.
struct HttpConnection : std::enable_shared_from_this<HttpConnection> {
  HttpConnection(HttpShared& server, Socket socket, const Peer& peer)
      : server(server), stream(std::move(socket)), peer(peer) {}
  virtual ~HttpConnection() = default;
  HttpConnection(const HttpConnection&) = delete;
  HttpConnection& operator=(const HttpConnection&) = delete;

  /// What comes after an answer that was taken to its end.
  virtual void OnAnswered(bool keep_alive) = 0;
  /// An answer that does not come to its end; `trouble` is ours, empty: the client's.
  void CutOff(const std::string& trouble);
  void Close() { stream.close(); }

  /// The header of an answer, but for its length.
  template <typename Body>
  void SetHeaders(const HttpResponse& response, http::response<Body>& message);
  /// Tells the server's log of the request and its answer.
  void Log(const std::string& trouble = "");
  /// How long a client may take for the next piece, and work for it wait.
  Clock::time_point Patience() const {
    return Clock::now() + std::chrono::milliseconds(server.options.limits.write_ms);
  }

  HttpShared& server;
  Stream stream;
  const Peer peer;
  HttpRequest request;
  Clock::time_point begin = Clock::now();  // of the answer
  int status = 0;                          // of the answer
  uint64_t sent_bytes = 0;
  bool keep_alive = false;  // as the client wishes
  bool is_http11 = true;    // else HTTP/1.0
  bool ending = false;      // as soon as nothing is under way
};

template <typename Body>
void HttpConnection::SetHeaders(const HttpResponse& response, http::response<Body>& message) {
  status = response.status;
  sent_bytes = 0;
  message.result(static_cast<unsigned>(response.status));
  message.reason(ReasonPhrase(response.status));
  message.version(kHttp11);
  message.set(http::field::server, "rotundad");
  message.set(http::field::content_type, response.content_type);
  message.set(http::field::cache_control, "no-store");
  message.set("X-Content-Type-Options", "nosniff");
  for (const auto& [name, value] : response.headers) message.set(name, value);
  message.keep_alive(keep_alive && !ending);
}

}  // namespace rotunda::daemon
