#include "daemon/http_server.h"

#include <sys/socket.h>

#include <atomic>
#include <mutex>
#include <set>
#include <string>
#include <thread>
#include <utility>

#include "daemon/http_asio.h"
#include "daemon/http_connection.h"
#include "daemon/http_peer.h"
#include "daemon/http_problem.h"
#include "daemon/http_session.h"

namespace rotunda::daemon {
namespace {

using std::chrono::milliseconds;

constexpr auto kBeatInterval = milliseconds(500);
// While descriptors are used up accept() fails at once: without a pause it would spin.
constexpr auto kAcceptPause = milliseconds(100);

}  // namespace

/// Takes connections and looks after them all.
struct HttpServer::Impl {
  explicit Impl(Options given) : access(given.access), shared(std::move(given)) {}

  // All in the input/output thread.
  void Accept();
  void Accepted(Socket socket);
  void Beat();
  void EndAll(bool at_once);

  HttpAccess access;      // of the input/output thread
  bool stopping = false;  // likewise
  std::atomic<Clock::rep> last_beat = Clock::now().time_since_epoch().count();
  HttpShared shared;
  Protocol::acceptor acceptor{shared.io};
  net::steady_timer beat{shared.io};
  net::steady_timer accept_pause{shared.io};
  std::thread thread;
};

void HttpServer::Impl::Accept() {
  acceptor.async_accept([this](beast::error_code error, Socket socket) {
    if (stopping || error == net::error::operation_aborted) return;
    if (!error) {
      Accepted(std::move(socket));
      return Accept();
    }
    accept_pause.expires_after(kAcceptPause);
    accept_pause.async_wait([this](beast::error_code stopped) {
      if (!stopped) Accept();
    });
  });
}

void HttpServer::Impl::Accepted(Socket socket) {
  const Peer peer = PeerOf(socket.native_handle(), access);
  if (shared.connections < PlacesFor(peer.role, shared.options.limits.connections)) {
    std::make_shared<HttpSession>(shared, std::move(socket), peer)->Read();
    return;
  }
  ++shared.refused;
  const HttpResponse problem = Problem(
      503, "there are " + std::to_string(shared.connections) + " connections already; close one");
  const std::string answer =
      "HTTP/1.1 503 Service Unavailable\r\nContent-Type: " + problem.content_type +
      "\r\nContent-Length: " + std::to_string(problem.body.size()) +
      "\r\nRetry-After: 1\r\nConnection: close\r\n\r\n" + problem.body;
  beast::error_code ignored;
  socket.non_blocking(true, ignored);
  const size_t sent = socket.write_some(net::buffer(answer), ignored);
  if (shared.options.log) shared.options.log({peer, "", "", problem.status, sent, 0, ""});
}

void HttpServer::Impl::Beat() {
  shared.bulk.GiveUpLate();
  net::post(shared.handlers, [this] { last_beat = Clock::now().time_since_epoch().count(); });
  beat.expires_after(kBeatInterval);
  beat.async_wait([this](beast::error_code error) {
    if (!error) Beat();
  });
}

void HttpServer::Impl::EndAll(bool at_once) {
  stopping = true;
  beast::error_code ignored;
  acceptor.close(ignored);
  accept_pause.cancel();
  const std::set<HttpSession*> all = shared.sessions;
  for (HttpSession* session : all) at_once ? session->Close() : session->End();
  if (at_once) shared.bulk.Clear();
}

HttpServer::HttpServer() = default;

Result<std::unique_ptr<HttpServer>> HttpServer::Start(int listening_fd, Options options) {
  int listening = 0;
  socklen_t bytes = sizeof(listening);
  if (getsockopt(listening_fd, SOL_SOCKET, SO_ACCEPTCONN, &listening, &bytes) != 0 ||
      listening == 0) {
    return Error{ErrorCode::kInvalidArgument,
                 "descriptor " + std::to_string(listening_fd) + " is not a listening socket", ""};
  }
  std::unique_ptr<HttpServer> server(new HttpServer);
  server->impl_ = std::make_unique<Impl>(std::move(options));
  Impl& impl = *server->impl_;
  beast::error_code error;
  impl.acceptor.assign(Protocol(), listening_fd, error);
  if (error) return Error{ErrorCode::kInvalidArgument, error.message(), "listening socket"};
  impl.Beat();
  impl.thread = std::thread([&impl] { impl.shared.io.run(); });
  return server;
}

HttpServer::~HttpServer() { Stop(milliseconds(0)); }

void HttpServer::Serve() {
  net::post(impl_->shared.io, [this] { impl_->Accept(); });
}

void HttpServer::SetAccess(HttpAccess access) {
  net::post(impl_->shared.io, [this, access = std::move(access)] { impl_->access = access; });
}

void HttpServer::Wake() {
  net::post(impl_->shared.io, [this] {
    for (HttpSession* session : impl_->shared.sessions) {
      if (session->is_stream()) session->Pull();
    }
  });
}

std::chrono::milliseconds HttpServer::Silence() const {
  const Clock::time_point last{Clock::duration(impl_->last_beat.load())};
  return std::chrono::duration_cast<milliseconds>(Clock::now() - last);
}

HttpCounters HttpServer::counters() const {
  const HttpShared& shared = impl_->shared;
  return {shared.requests, shared.refused, shared.connections, shared.streams};
}

void HttpServer::Stop(std::chrono::milliseconds patience) {
  if (!impl_->thread.joinable()) return;
  net::post(impl_->shared.io, [this, patience] { impl_->EndAll(patience.count() == 0); });
  {
    std::unique_lock lock(impl_->shared.mutex);
    impl_->shared.all_gone.wait_for(lock, patience,
                                    [this] { return impl_->shared.connections == 0; });
  }
  net::post(impl_->shared.io, [this] {
    impl_->EndAll(true);
    impl_->beat.cancel();
  });
  impl_->shared.handlers.join();  // their answers find closed connections
  net::post(impl_->shared.io, [this] { impl_->shared.io.stop(); });
  impl_->thread.join();
}

}  // namespace rotunda::daemon
