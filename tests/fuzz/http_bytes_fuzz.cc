#include <filesystem>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "daemon/http_listener.h"
#include "daemon/http_server.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/support/http_echo.h"

namespace {

using namespace rotunda;
namespace fs = std::filesystem;

/// A server on a socket of its own. Nothing that it waits for ends by a time limit: who has no more
/// to say ends it.
class EchoServer {
 public:
  EchoServer() {
    folder_ = fs::temp_directory_path() / "rotunda-http-XXXXXX";
    fuzz::Require(mkdtemp(folder_.data()) != nullptr, "a folder can be made");
    constexpr int kNever_ms = 600000;
    daemon::HttpServer::Options options;
    // Small enough that inputs break them.
    options.limits.header_bytes = 512;
    options.limits.body_bytes = 256;
    options.limits.request_ms = kNever_ms;
    options.limits.write_ms = kNever_ms;
    options.limits.heartbeat_ms = kNever_ms;
    options.handle = [this](const daemon::HttpRequest& request) { return echo_.Answer(request); };
    const auto fd = daemon::ListenOn(Socket());
    fuzz::Require(fd.ok(), fd.ok() ? "" : fd.error().ToString().c_str());
    auto server = daemon::HttpServer::Start(*fd, std::move(options));
    fuzz::Require(server.ok(), server.ok() ? "" : server.error().ToString().c_str());
    server_ = std::move(*server);
    server_->Serve();
  }
  ~EchoServer() {
    server_.reset();
    std::error_code ignored;
    fs::remove_all(folder_, ignored);
  }

  void Check(const std::string& first, const std::string& second) {
    Converse(first, second);
    constexpr int kEvery = 50;
    if (++inputs_ % kEvery == 0) {
      fuzz::Require(Converse("GET / HTTP/1.1\r\nHost: h\r\n\r\n", "") == std::vector<int>{200},
                    "a good request is answered afterwards");
    }
    // Nothing of a connection stays.
    while (server_->counters().connections > 0) std::this_thread::yield();
  }

 private:
  fs::path Socket() const { return fs::path(folder_) / "s"; }
  std::vector<int> Converse(const std::string& first, const std::string& second) {
    const auto statuses = echo_.Converse(Socket(), first, second);
    fuzz::Require(statuses.ok(), statuses.ok() ? "" : statuses.error().message.c_str());
    return *statuses;
  }

  int inputs_ = 0;
  std::string folder_;
  test::HttpEcho echo_;
  std::unique_ptr<daemon::HttpServer> server_;
};

}  // namespace

/// The first byte says where the others are parted in two, in 256ths of them.
extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  static EchoServer server;
  if (size == 0) return 0;
  const std::string bytes(reinterpret_cast<const char*>(data) + 1, size - 1);
  const size_t middle = bytes.size() * data[0] / 256;
  server.Check(bytes.substr(0, middle), bytes.substr(middle));
  return 0;
}
