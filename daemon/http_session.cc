#include "daemon/http_session.h"

#include <exception>
#include <optional>
#include <string>

#include "daemon/http_peer.h"
#include "daemon/http_problem.h"

namespace rotunda::daemon {
namespace {

using std::chrono::milliseconds;

// What a refused client may still send before the connection is closed on it, so that it reads why.
constexpr size_t kDiscardBytes = size_t{1} << 20;
constexpr auto kDiscardPatience = milliseconds(1000);
// Besides a header as long as it may be: what the client sends behind it.
constexpr size_t kReadAheadBytes = 65536;

template <typename Make>
HttpResponse Guarded(const Make& make) {
  try {
    return make();
  } catch (const std::exception& unexpected) {
    return Problem(500, std::string("unexpected failure: ") + unexpected.what());
  }
}

}  // namespace

HttpSession::HttpSession(HttpShared& server, Socket socket, const Peer& peer)
    : HttpConnection(server, std::move(socket), peer),
      buffer_(static_cast<size_t>(server.options.limits.header_bytes) + kReadAheadBytes) {
  server.sessions.insert(this);
  ++server.connections;
}

HttpSession::~HttpSession() {
  if (is_stream()) --server.streams;
  server.sessions.erase(this);
  const std::lock_guard lock(server.mutex);
  --server.connections;
  server.all_gone.notify_all();
}

std::shared_ptr<HttpSession> HttpSession::Self() {
  return std::static_pointer_cast<HttpSession>(shared_from_this());
}

void HttpSession::Read() {
  parser_.emplace();
  parser_->header_limit(static_cast<uint32_t>(server.options.limits.header_bytes));
  parser_->body_limit(static_cast<uint64_t>(server.options.limits.body_bytes));
  is_idle_ = true;
  stream.expires_after(milliseconds(server.options.limits.request_ms));
  http::async_read_header(
      stream, buffer_, *parser_,
      [self = Self()](beast::error_code error, size_t) { self->OnHeader(error); });
}

void HttpSession::End() {
  ending = true;
  if (is_idle_) Close();
  events_.End();
}

void HttpSession::OnHeader(beast::error_code error) {
  is_idle_ = false;
  if (error) return OnReadError(error);
  is_http11 = parser_->get().version() >= kHttp11;
  // HTTP/1.0 does not know that answer: there the wish counts for nothing (RFC 9110, 10.1.1).
  if (is_http11 && beast::iequals(parser_->get()[http::field::expect], "100-continue")) {
    static constexpr char kContinue[] = "HTTP/1.1 100 Continue\r\n\r\n";
    return net::async_write(stream, net::buffer(kContinue, sizeof(kContinue) - 1),
                            [self = Self()](beast::error_code failed, size_t) {
                              if (!failed) self->ReadBody();
                            });
  }
  ReadBody();
}

void HttpSession::ReadBody() {
  http::async_read(stream, buffer_, *parser_, [self = Self()](beast::error_code error, size_t) {
    if (error) return self->OnReadError(error);
    self->OnRequest();
  });
}

/// A request that cannot be read: why, when the client may still listen; then the end.
void HttpSession::OnReadError(beast::error_code error) {
  if (error.category() != http::make_error_code(http::error::bad_method).category() ||
      error == http::error::end_of_stream || error == http::error::partial_message) {
    // The client left, or was too slow: told of when it had begun to ask.
    if (!parser_->got_some()) return Close();
    request = {};
    begin = Clock::now();
    return CutOff("");
  }
  request = {};
  request.peer = peer;
  // As far as it could be read.
  request.method = std::string(parser_->get().method_string());
  request.target = std::string(parser_->get().target());
  ending = true;
  discard_ = true;
  begin = Clock::now();
  if (error == http::error::body_limit) {
    Send(Problem(413, "the body has more than " + std::to_string(server.options.limits.body_bytes) +
                          " bytes"));
  } else if (error == http::error::header_limit || error == http::error::buffer_overflow) {
    Send(Problem(431, "the header has more than " +
                          std::to_string(server.options.limits.header_bytes) + " bytes"));
  } else {
    Send(Problem(400, "this is not HTTP/1.1: " + error.message()));
  }
}

void HttpSession::OnRequest() {
  auto message = parser_->release();
  keep_alive = message.keep_alive();
  request = {};
  request.method = std::string(message.method_string());
  request.target = std::string(message.target());
  for (const auto& field : message) {
    std::string name(field.name_string());
    for (char& letter : name) letter = beast::detail::ascii_tolower(letter);
    // Repeated ones count as one list (RFC 9110, 5.3), so that none is lost unseen.
    const auto [kept, is_new] = request.headers.try_emplace(name, field.value());
    if (!is_new) kept->second += ", " + std::string(field.value());
  }
  request.body = std::move(message.body());
  request.peer = peer;
  begin = Clock::now();
  ++server.requests;
  net::post(server.handlers, [self = Self()]() mutable {
    HttpResponse response = self->Handle();
    net::io_context& io = self->server.io;
    net::post(io, [self = std::move(self), response = std::move(response)]() mutable {
      self->Send(std::move(response));
    });
  });
}

/// In a handler's thread; the request is left alone meanwhile.
HttpResponse HttpSession::Handle() const {
  return Guarded([this] { return server.options.handle(request); });
}

void HttpSession::Send(HttpResponse response) {
  if (response.stream && request.IsHead()) return answers_.SendHead(response, std::nullopt);
  const uint64_t places = PlacesFor(peer.role, server.options.limits.streams);
  if (response.stream && server.streams >= places) {
    response = Problem(
        503, "there are " + std::to_string(server.streams) + " event streams already; close one");
  }
  if (response.stream) return events_.Begin(std::move(response));
  if (response.bulk) return SendBulk(std::move(response.bulk));
  if (response.file) return answers_.SendFile(std::move(response));
  answers_.SendBody(std::move(response));
}

void HttpSession::SendBulk(std::function<HttpResponse()> make) {
  const auto self = Self();
  server.bulk.Do({[self, make = std::move(make)] {
                    net::post(self->server.io, [self, response = Guarded(make)]() mutable {
                      self->Send(std::move(response));
                    });
                  },
                  [self] { self->answers_.SendTooLate(); }, Patience()});
}

void HttpSession::OnAnswered(bool answer_keeps_alive) {
  Log();
  if (discard_) return Discard(kDiscardBytes);
  if (answer_keeps_alive && !ending) return Read();
  Close();
}

/// Lets a client that is still sending read its answer before the connection goes.
void HttpSession::Discard(size_t left) {
  beast::error_code ignored;
  stream.socket().shutdown(Socket::shutdown_send, ignored);
  stream.expires_after(kDiscardPatience);
  stream.async_read_some(net::buffer(scrap_),
                         [self = Self(), left](beast::error_code error, size_t bytes) {
                           if (error || bytes >= left) return self->Close();
                           self->Discard(left - bytes);
                         });
}

}  // namespace rotunda::daemon
