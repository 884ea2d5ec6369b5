#include "tests/support/unix_http.h"

#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cctype>
#include <cstring>
#include <stdexcept>
#include <utility>

namespace rotunda::test {
namespace {

constexpr int kPatience_ms = 10000;

}  // namespace

UnixConnection::UnixConnection(const std::filesystem::path& socket_path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::strncpy(address.sun_path, socket_path.c_str(), sizeof(address.sun_path) - 1);
  fd_ = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (connect(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0) {
    close(fd_);
    throw std::runtime_error(socket_path.string() + ": " + std::strerror(errno));
  }
}

UnixConnection::~UnixConnection() { close(fd_); }

bool UnixConnection::Send(const std::string& bytes) {
  size_t sent = 0;
  while (sent < bytes.size()) {
    const ssize_t now = send(fd_, bytes.data() + sent, bytes.size() - sent, MSG_NOSIGNAL);
    if (now <= 0) return false;
    sent += static_cast<size_t>(now);
  }
  return true;
}

bool UnixConnection::ReadSome() {
  pollfd ready{fd_, POLLIN, 0};
  if (closed_ || poll(&ready, 1, kPatience_ms) <= 0) return false;
  char bytes[65536];
  const ssize_t got = recv(fd_, bytes, sizeof(bytes), 0);
  closed_ = got <= 0;
  if (got > 0) unread_.append(bytes, static_cast<size_t>(got));
  return got > 0;
}

std::string UnixConnection::ReadUntil(const std::string& text) {
  size_t found = unread_.find(text);
  while (found == std::string::npos && ReadSome()) found = unread_.find(text);
  const size_t count = found == std::string::npos ? unread_.size() : found + text.size();
  std::string given = unread_.substr(0, count);
  unread_.erase(0, count);
  return given;
}

std::string UnixConnection::Read(size_t bytes) {
  while (unread_.size() < bytes && ReadSome()) {
  }
  std::string given = unread_.substr(0, bytes);
  unread_.erase(0, bytes);
  return given;
}

std::string UnixConnection::ReadAll() {
  while (ReadSome()) {
  }
  return std::exchange(unread_, "");
}

UnixHttpAnswer ReadAnswer(UnixConnection& connection) {
  UnixHttpAnswer answer;
  std::string head = connection.ReadUntil("\r\n\r\n");
  if (head.size() < 12) return answer;
  answer.status = std::stoi(head.substr(9, 3));
  size_t begin = head.find("\r\n") + 2;
  for (size_t end; (end = head.find("\r\n", begin)) > begin; begin = end + 2) {
    std::string line = head.substr(begin, end - begin);
    const size_t colon = line.find(": ");
    for (size_t i = 0; i < colon; ++i) line[i] = static_cast<char>(std::tolower(line[i]));
    answer.headers[line.substr(0, colon)] = line.substr(colon + 2);
  }
  const auto length = answer.headers.find("content-length");
  if (length == answer.headers.end()) return answer;
  answer.body = connection.Read(std::stoul(length->second));
  return answer;
}

UnixHttpAnswer Ask(const std::filesystem::path& socket, const std::string& method,
                   const std::string& target, const std::string& body, const std::string& headers) {
  UnixConnection connection(socket);
  connection.Send(method + " " + target + " HTTP/1.1\r\nHost: localhost\r\n" + headers +
                  "Content-Length: " + std::to_string(body.size()) + "\r\n\r\n" + body);
  return ReadAnswer(connection);
}

}  // namespace rotunda::test
