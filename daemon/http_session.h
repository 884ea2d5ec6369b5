#pragma once

#include <array>
#include <functional>
#include <memory>
#include <optional>

#include "daemon/http_answer.h"
#include "daemon/http_connection.h"
#include "daemon/http_event_stream.h"

// Private to the .cc files of the HTTP server.

namespace rotunda::daemon {

/// A connection from its first request to its end: reads requests one after the other, has them
/// handled, and chooses how the answer goes out.
class HttpSession : public HttpConnection {
 public:
  HttpSession(HttpShared& server, Socket socket, const Peer& peer);
  ~HttpSession() override;

  /// Waits for a request.
  void Read();
  /// Ends the connection as soon as nothing is under way on it.
  void End();
  /// Asks the source of an event stream for what is new.
  void Pull() { events_.Pull(); }
  bool is_stream() const { return events_.begun(); }

 private:
  std::shared_ptr<HttpSession> Self();
  void OnHeader(beast::error_code error);
  void ReadBody();
  void OnReadError(beast::error_code error);
  void OnRequest();
  HttpResponse Handle() const;
  void Send(HttpResponse response);
  void SendBulk(std::function<HttpResponse()> make);
  void OnAnswered(bool answer_keeps_alive) override;
  void Discard(size_t left);

  AnswerSender answers_{*this};
  EventStream events_{*this};
  beast::flat_buffer buffer_;
  std::optional<http::request_parser<http::string_body>> parser_;
  bool is_idle_ = false;  // waits for a request of which nothing is known yet
  bool discard_ = false;
  std::array<char, 4096> scrap_{};
};

}  // namespace rotunda::daemon
