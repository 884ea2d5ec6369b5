#include "daemon/http_event_stream.h"

#include <exception>

namespace rotunda::daemon {
namespace {

using std::chrono::milliseconds;

}  // namespace

EventStream::EventStream(HttpConnection& connection)
    : connection_(connection), heartbeat_(connection.server.io) {}

void EventStream::Begin(HttpResponse response) {
  begun_ = true;
  ++connection_.server.streams;
  source_ = std::move(response.stream);
  connection_.keep_alive = false;
  connection_.SetHeaders(response, head_);
  // HTTP/1.0 knows no chunks: there the end of the connection is that of the stream.
  if (connection_.is_http11) head_.chunked(true);
  serializer_.emplace(head_);
  WatchForLeaving();
  is_writing_ = true;
  connection_.stream.expires_at(connection_.Patience());
  http::async_write_header(
      connection_.stream, *serializer_,
      [this, keep = connection_.shared_from_this()](beast::error_code error, size_t bytes) {
        OnPieceWritten(error, bytes);
      });
}

/// A client of a stream has nothing more to say: whatever comes, it is over.
void EventStream::WatchForLeaving() {
  connection_.stream.expires_never();
  connection_.stream.async_read_some(
      net::buffer(scrap_),
      [this, keep = connection_.shared_from_this()](beast::error_code, size_t) {
        heartbeat_.cancel();
        Log();
        connection_.Close();
      });
}

void EventStream::Pull() {
  if (!begun_ || is_writing_) {
    pull_again_ = true;
    return;
  }
  is_writing_ = true;
  pull_again_ = false;
  heartbeat_.cancel();
  net::post(connection_.server.handlers, [this, keep = connection_.shared_from_this()]() mutable {
    std::string piece = Ask();
    net::io_context& io = connection_.server.io;
    net::post(io, [this, keep = std::move(keep), piece = std::move(piece)]() mutable {
      OnPiece(std::move(piece));
    });
  });
}

/// In a handler's thread.
std::string EventStream::Ask() const {
  try {
    return source_();
  } catch (const std::exception&) {
    return "";  // the next call may succeed; the heartbeat goes on
  }
}

void EventStream::OnPiece(std::string piece) {
  is_writing_ = false;
  if (!connection_.stream.socket().is_open()) return;
  if (connection_.ending) return WriteEnd();
  if (!piece.empty()) return WritePiece(std::move(piece));
  if (pull_again_) return Pull();
  heartbeat_.expires_after(milliseconds(connection_.server.options.limits.heartbeat_ms));
  heartbeat_.async_wait([this, keep = connection_.shared_from_this()](beast::error_code error) {
    if (!error && !is_writing_) WritePiece(": nothing new\n\n");
  });
}

void EventStream::WritePiece(std::string piece) {
  is_writing_ = true;
  piece_ = std::move(piece);
  connection_.stream.expires_at(connection_.Patience());
  auto written = [this, keep = connection_.shared_from_this()](
                     beast::error_code error, size_t bytes) { OnPieceWritten(error, bytes); };
  const auto bytes = net::buffer(piece_);
  if (!connection_.is_http11) {
    return net::async_write(connection_.stream, bytes, std::move(written));
  }
  net::async_write(connection_.stream, http::make_chunk(bytes), std::move(written));
}

void EventStream::OnPieceWritten(beast::error_code error, size_t bytes) {
  is_writing_ = false;
  connection_.sent_bytes += bytes;
  if (error) {
    Log();
    return connection_.Close();
  }
  if (connection_.ending) return WriteEnd();
  Pull();
}

void EventStream::End() {
  if (begun_ && !is_writing_) WriteEnd();
}

void EventStream::WriteEnd() {
  if (is_writing_) return;
  is_writing_ = true;
  heartbeat_.cancel();
  if (!connection_.is_http11) {
    Log();
    return connection_.Close();
  }
  connection_.stream.expires_at(connection_.Patience());
  net::async_write(connection_.stream, http::make_chunk_last(),
                   [this, keep = connection_.shared_from_this()](beast::error_code, size_t) {
                     Log();
                     connection_.Close();
                   });
}

void EventStream::Log() {
  if (!std::exchange(logged_, true)) connection_.Log();
}

}  // namespace rotunda::daemon
