#pragma once

#include <filesystem>
#include <map>
#include <string>

namespace rotunda::test {

/// A connection to a UNIX socket that sends and reads bytes as they are, for tests of what a
/// well-behaved client would never do. Throws when it cannot connect.
class UnixConnection {
 public:
  explicit UnixConnection(const std::filesystem::path& socket);
  ~UnixConnection();
  UnixConnection(const UnixConnection&) = delete;
  UnixConnection& operator=(const UnixConnection&) = delete;

  /// False: the other end has closed.
  bool Send(const std::string& bytes);
  /// Until the other end has read all that was sent, or closed. False: neither in ten seconds.
  bool WaitUntilTaken() const;
  /// The other end reads an end after what was sent; it can still answer.
  void EndSending();
  /// Reads until `text` has come, and gives all that was read and not given before; what there is
  /// when the other end closes first, or nothing has come for ten seconds.
  std::string ReadUntil(const std::string& text);
  /// `bytes` of them, or less as above.
  std::string Read(size_t bytes);
  /// Until the other end closes.
  std::string ReadAll();
  bool closed() const { return closed_; }

 private:
  bool ReadSome();
  int fd_ = -1;
  bool closed_ = false;
  std::string unread_;
};

struct UnixHttpAnswer {
  int status = 0;                              // 0: none came
  std::map<std::string, std::string> headers;  // names in lower case
  std::string body;
};

/// Status and headers from an answer's header, up to its empty line. Status 0: that is not
/// well-formed HTTP/1.1, or has a header twice.
UnixHttpAnswer ParseHead(const std::string& head);

/// One answer with Content-Length from the connection.
UnixHttpAnswer ReadAnswer(UnixConnection& connection);

/// One request on a connection of its own. `headers`: whole lines, each with "\r\n".
UnixHttpAnswer Ask(const std::filesystem::path& socket, const std::string& method,
                   const std::string& target, const std::string& body = "",
                   const std::string& headers = "");

}  // namespace rotunda::test
