#pragma once

#include <cstdint>
#include <memory>
#include <optional>

#include "daemon/http_connection.h"
#include "daemon/http_message.h"

// Private to the .cc files of the HTTP server.

namespace rotunda::daemon {

/// Sends the answers of a connection, its OnAnswered() or CutOff() at the end of each: piece by
/// piece, each with its own time, so that a large answer may take long and a client that takes
/// nothing may not; all together have theirs, for a client that takes next to nothing.
class AnswerSender {
 public:
  /// `connection` has this as a member.
  explicit AnswerSender(HttpConnection& connection) : connection_(connection) {}

  /// Without the body when it was HEAD that asked; so do the others.
  void SendBody(HttpResponse response);
  /// The header alone, with the length of the body, if that is known.
  void SendHead(const HttpResponse& response, std::optional<uint64_t> bytes);
  /// Handlers' threads read it, a piece when the one before was taken: a read that is slow or hangs
  /// holds up nobody else while another of these threads is free.
  void SendFile(HttpResponse response);
  /// Instead of what files are read for, when its turn does not come.
  void SendTooLate();

 private:
  template <typename Body>
  struct Answer;
  struct FileAnswer;

  Clock::time_point DeadlineFor(uint64_t bytes) const;
  void OnFile(const HttpResponse& response, const std::shared_ptr<FileAnswer>& answer,
              beast::error_code error);
  void ReadPiece(const std::shared_ptr<FileAnswer>& answer);
  static std::string NextPiece(FileAnswer& answer);
  void OnFilePiece(const std::shared_ptr<FileAnswer>& answer);
  template <typename AnyAnswer>
  void Write(std::shared_ptr<AnyAnswer> answer);

  HttpConnection& connection_;
};

}  // namespace rotunda::daemon
