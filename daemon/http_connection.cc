#include "daemon/http_connection.h"

namespace rotunda::daemon {
namespace {

// Of a method or target, in the log.
constexpr size_t kLoggedBytes = 256;

std::string Printable(const std::string& text) {
  std::string printable = text.substr(0, kLoggedBytes);
  for (char& byte : printable) {
    if (byte < 0x20 || byte > 0x7E) byte = '?';
  }
  return printable;
}

}  // namespace

void HttpConnection::CutOff(const std::string& trouble) {
  status = 0;
  Log(trouble);
  Close();
}

void HttpConnection::Log(const std::string& trouble) {
  if (!server.options.log) return;
  const std::chrono::duration<double> spent = Clock::now() - begin;
  server.options.log({peer, Printable(request.method), Printable(request.target), status,
                      sent_bytes, spent.count(), trouble});
}

}  // namespace rotunda::daemon
