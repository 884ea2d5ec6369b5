#pragma once

#include <array>
#include <optional>
#include <string>

#include "daemon/http_connection.h"
#include "daemon/http_message.h"

// Private to the .cc files of the HTTP server.

namespace rotunda::daemon {

/// The answer that goes on until the client leaves or the server stops: pieces of what its source
/// has, signs of life in between. Ends the connection.
class EventStream {
 public:
  /// `connection` has this as a member.
  explicit EventStream(HttpConnection& connection);

  bool begun() const { return begun_; }
  void Begin(HttpResponse response);
  /// Asks the source for what is new.
  void Pull();
  /// The connection is ending: the last piece, when no other is under way.
  void End();

 private:
  std::string Ask() const;
  void WatchForLeaving();
  void OnPiece(std::string piece);
  void WritePiece(std::string piece);
  void OnPieceWritten(beast::error_code error, size_t bytes);
  void WriteEnd();
  void Log();

  HttpConnection& connection_;
  bool begun_ = false;
  bool is_writing_ = false;  // or asks its source
  bool pull_again_ = false;
  bool logged_ = false;  // its end may be seen by reading and by writing
  StreamSource source_;
  http::response<http::empty_body> head_;
  std::optional<http::response_serializer<http::empty_body>> serializer_;  // when that is whole
  std::string piece_;
  net::steady_timer heartbeat_;
  std::array<char, 4096> scrap_{};
};

}  // namespace rotunda::daemon
