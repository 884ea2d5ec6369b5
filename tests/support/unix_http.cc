#include "tests/support/unix_http.h"

#include <linux/sockios.h>
#include <poll.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <optional>
#include <stdexcept>
#include <string_view>
#include <utility>

namespace rotunda::test {
namespace {

constexpr int kPatience_ms = 10000;

bool IsPrintable(std::string_view text) {
  return std::all_of(text.begin(), text.end(),
                     [](char byte) { return byte >= ' ' && byte <= '~'; });
}

/// "HTTP/1.1 404 Not Found" -> 404.
std::optional<int> StatusOf(std::string_view line) {
  constexpr std::string_view kVersion = "HTTP/1.1 ";
  constexpr size_t kDigits = 3;
  const size_t space = kVersion.size() + kDigits;
  if (!line.starts_with(kVersion) || line.size() < space + 2 || line[space] != ' ' ||
      !IsPrintable(line)) {
    return std::nullopt;
  }
  const std::string digits(line.substr(kVersion.size(), kDigits));
  if (digits.find_first_not_of("0123456789") != std::string::npos) return std::nullopt;
  return std::stoi(digits);
}

/// False: no "Name: value", or one that is there already.
bool AddHeader(std::string_view line, std::map<std::string, std::string>& headers) {
  const size_t colon = line.find(": ");
  if (colon == std::string_view::npos || colon == 0 || !IsPrintable(line)) return false;
  std::string name(line.substr(0, colon));
  for (char& letter : name) {
    if (std::isalnum(letter) == 0 && letter != '-') return false;
    letter = static_cast<char>(std::tolower(letter));
  }
  return headers.emplace(name, line.substr(colon + 2)).second;
}

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

bool UnixConnection::WaitUntilTaken() const {
  const auto end = std::chrono::steady_clock::now() + std::chrono::milliseconds(kPatience_ms);
  int unread = 0;
  while (ioctl(fd_, SIOCOUTQ, &unread) == 0 && unread > 0) {
    if (std::chrono::steady_clock::now() > end) return false;
    sched_yield();
  }
  return true;
}

void UnixConnection::EndSending() { shutdown(fd_, SHUT_WR); }

bool UnixConnection::ReadSome() {
  pollfd ready{fd_, POLLIN, 0};
  int count = 0;
  do {  // libFuzzer has a timer, whose signals are nothing to the connection
    count = closed_ ? 0 : poll(&ready, 1, kPatience_ms);
  } while (count < 0 && errno == EINTR);
  if (count <= 0) return false;
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

UnixHttpAnswer ParseHead(const std::string& head) {
  UnixHttpAnswer answer;
  if (!head.ends_with("\r\n\r\n")) return answer;
  size_t end = head.find("\r\n");
  const std::optional<int> status = StatusOf(std::string_view(head).substr(0, end));
  if (!status) return answer;
  for (size_t begin = end + 2; (end = head.find("\r\n", begin)) > begin; begin = end + 2) {
    const std::string_view line = std::string_view(head).substr(begin, end - begin);
    if (!AddHeader(line, answer.headers)) return {};
  }
  answer.status = *status;
  return answer;
}

UnixHttpAnswer ReadAnswer(UnixConnection& connection) {
  UnixHttpAnswer answer = ParseHead(connection.ReadUntil("\r\n\r\n"));
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
