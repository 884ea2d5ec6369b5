// The server over a real socket, by clients that behave and clients that do not.

#include "daemon/http_server.h"

#include <fcntl.h>
#include <grp.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <fstream>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <random>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "daemon/http_listener.h"
#include "tests/support/http_echo.h"
#include "tests/support/process.h"
#include "tests/support/unix_http.h"

namespace rotunda::daemon {
namespace {

using std::chrono::milliseconds;
using test::Ask;
using test::ReadAnswer;
using test::UnixConnection;
using test::UnixHttpAnswer;

constexpr char kGet[] = "GET /x HTTP/1.1\r\nHost: h\r\n\r\n";
// Times that end quickly where a test waits for them, and never where it does not.
constexpr int kSoon_ms = 150;
constexpr int kNever_ms = 600000;

class HttpServerTest : public testing::Test {
 protected:
  HttpServerTest() {
    options_.limits.request_ms = kNever_ms;
    options_.limits.write_ms = kNever_ms;
    options_.limits.heartbeat_ms = kNever_ms;
    options_.handle = [](const HttpRequest& request) {
      HttpResponse response;
      response.content_type = "text/plain";
      response.body = request.method + " " + request.target + " " + request.body;
      return response;
    };
    options_.log = [this](const AccessEntry& entry) {
      const std::lock_guard lock(mutex_);
      log_.push_back(entry);
    };
  }

  void Start() {
    const auto fd = ListenOn(Socket());
    ASSERT_TRUE(fd) << fd.error().ToString();
    auto server = HttpServer::Start(*fd, options_);
    ASSERT_TRUE(server) << server.error().ToString();
    server_ = std::move(*server);
    server_->Serve();
  }
  std::filesystem::path Socket() const { return folder_ / "s"; }
  /// A connection that the server has seen; nothing was asked on it.
  std::unique_ptr<UnixConnection> Idle() {
    const HttpCounters before = server_->counters();
    auto connection = std::make_unique<UnixConnection>(Socket());
    const auto seen = [&] {
      const HttpCounters now = server_->counters();
      return now.connections > before.connections ||
             now.refused_connections > before.refused_connections;
    };
    while (!seen()) std::this_thread::sleep_for(milliseconds(1));
    return connection;
  }
  std::vector<AccessEntry> Log() {
    const std::lock_guard lock(mutex_);
    return log_;
  }
  /// As a stream of events: "a" is what comes first, then what is put into `said`.
  void ServeStream() {
    options_.handle = [this](const HttpRequest&) {
      HttpResponse response;
      response.content_type = "text/event-stream";
      response.stream = [this, begun = false]() mutable {
        const std::lock_guard lock(mutex_);
        const std::string piece = begun ? said_ : "a\n\n";
        if (begun) said_.clear();
        begun = true;
        return piece;
      };
      return response;
    };
  }
  void Say(const std::string& text) {
    {
      const std::lock_guard lock(mutex_);
      said_ = text;
    }
    server_->Wake();
  }

  test::TemporaryFolder folder_;
  HttpServer::Options options_;
  std::mutex mutex_;
  std::vector<AccessEntry> log_;
  std::string said_;
  std::unique_ptr<HttpServer> server_;
};

TEST_F(HttpServerTest, AnswersRequestsOneAfterTheOtherOnAConnection) {
  Start();
  UnixConnection connection(Socket());
  for (const char* body : {"one", "two"}) {
    connection.Send("POST /a?b=c HTTP/1.1\r\nHost: h\r\nContent-Length: 3\r\n\r\n" +
                    std::string(body));
    const UnixHttpAnswer answer = ReadAnswer(connection);
    EXPECT_EQ(answer.status, 200);
    EXPECT_EQ(answer.body, "POST /a?b=c " + std::string(body));
    EXPECT_EQ(answer.headers.at("content-type"), "text/plain");
  }
  // Two at once: the second waits in the socket.
  connection.Send(std::string(kGet) + kGet);
  EXPECT_EQ(ReadAnswer(connection).body, "GET /x ");
  EXPECT_EQ(ReadAnswer(connection).body, "GET /x ");
  EXPECT_EQ(server_->counters().requests, 4u);
  EXPECT_EQ(server_->counters().connections, 1u);
}

TEST_F(HttpServerTest, HeadersThatComeTwiceAreOneList) {
  options_.handle = [](const HttpRequest& request) {
    HttpResponse response;
    response.body = request.Header("idempotency-key");
    return response;
  };
  Start();
  UnixConnection connection(Socket());
  connection.Send("GET /x HTTP/1.1\r\nHost: h\r\nIdempotency-Key: a\r\nIdempotency-Key: b\r\n\r\n");
  EXPECT_EQ(ReadAnswer(connection).body, "a, b");
}

TEST_F(HttpServerTest, AnswersHeadWithTheHeaderAlone) {
  std::ofstream(folder_ / "file") << "12345";
  options_.handle = [file = folder_ / "file"](const HttpRequest& request) {
    HttpResponse response;
    response.body = "123";
    if (request.target == "/file") response.file = file;
    if (request.target == "/stream") response.stream = [] { return std::string("a\n\n"); };
    if (request.target == "/none") response.status = 404;
    HttpResponse later;
    if (request.target == "/bulk") later.bulk = [response] { return response; };
    return later.bulk ? later : response;
  };
  Start();
  UnixConnection connection(Socket());
  const std::vector<std::pair<std::string, std::string>> lengths = {
      {"/", "3"}, {"/file", "5"}, {"/none", "3"}, {"/bulk", "3"}, {"/stream", ""}};
  for (const auto& [target, length] : lengths) {
    connection.Send("HEAD " + target + " HTTP/1.1\r\nHost: h\r\n\r\n");
    const std::string head = connection.ReadUntil("\r\n\r\n");
    EXPECT_EQ(head.starts_with("HTTP/1.1 404"), target == "/none") << head;
    EXPECT_EQ(head.find("Content-Length: " + length + "\r\n") != std::string::npos, !length.empty())
        << head;
    // Whatever followed the header would be read as this answer's.
    connection.Send(kGet);
    EXPECT_EQ(ReadAnswer(connection).body, "123") << target;
  }
}

TEST_F(HttpServerTest, KnowsWhoConnects) {
  options_.handle = [](const HttpRequest& request) {
    HttpResponse response;
    response.body = std::to_string(request.peer.uid) + " " + std::to_string(request.peer.pid) +
                    " " + std::to_string(static_cast<int>(request.peer.role));
    return response;
  };
  Start();
  EXPECT_EQ(Ask(Socket(), "GET", "/").body,
            std::to_string(geteuid()) + " " + std::to_string(getpid()) + " 2")
      << "the daemon's own user may act";
}

/// Connects as another user with one supplementary group and gives the status of the answer.
int StatusAs(uid_t user, gid_t group, const std::filesystem::path& socket) {
  const pid_t child = fork();
  if (child == 0) {
    if (setgroups(1, &group) != 0 || setgid(user) != 0 || setuid(user) != 0) _exit(0);
    int status = 0;
    try {
      status = Ask(socket, "GET", "/").status;
    } catch (const std::exception&) {
    }
    _exit(status / 100);  // an exit status has one byte
  }
  int ended = 0;
  waitpid(child, &ended, 0);
  return WEXITSTATUS(ended);
}

TEST_F(HttpServerTest, RolesComeFromTheGroupsOfThePeer) {
  if (geteuid() != 0) GTEST_SKIP() << "needs root to become other users";
  constexpr gid_t kViewers = 54321, kOperators = 54322, kOthers = 54323;
  constexpr uid_t kNobody = 65534;
  options_.access = {{kViewers}, {kOperators}};
  options_.handle = [](const HttpRequest& request) {
    HttpResponse response;
    response.status = request.peer.role == Role::kOperator ? 200
                      : request.peer.role == Role::kViewer ? 300
                                                           : 400;
    return response;
  };
  Start();
  chmod(folder_.path().c_str(), 0755);
  chmod(Socket().c_str(), 0666);
  EXPECT_EQ(StatusAs(kNobody, kOperators, Socket()), 2);
  EXPECT_EQ(StatusAs(kNobody, kViewers, Socket()), 3);
  EXPECT_EQ(StatusAs(kNobody, kOthers, Socket()), 4);
  server_->SetAccess({{kOthers}, {kViewers}});
  EXPECT_EQ(StatusAs(kNobody, kViewers, Socket()), 2);
  EXPECT_EQ(StatusAs(kNobody, kOthers, Socket()), 3);
  EXPECT_EQ(StatusAs(kNobody, kOperators, Socket()), 4);
}

TEST_F(HttpServerTest, WhatIsTooLargeOrNoHttpIsRefusedWithTheReason) {
  options_.limits.body_bytes = 2000;
  options_.limits.header_bytes = 2000;
  Start();
  const UnixHttpAnswer body = Ask(Socket(), "POST", "/", std::string(2001, 'x'));
  EXPECT_EQ(body.status, 413);
  EXPECT_NE(body.body.find("more than 2000 bytes"), std::string::npos) << body.body;
  EXPECT_EQ(body.headers.at("content-type"), "application/problem+json");
  // Without saying so beforehand.
  UnixConnection chunked(Socket());
  chunked.Send("POST / HTTP/1.1\r\nHost: h\r\nTransfer-Encoding: chunked\r\n\r\n7d1\r\n" +
               std::string(2001, 'x') + "\r\n0\r\n\r\n");
  EXPECT_EQ(ReadAnswer(chunked).status, 413);
  UnixConnection head(Socket());
  head.Send("HEAD / HTTP/1.1\r\nHost: h\r\nContent-Length: 2001\r\n\r\n");
  const std::string refusal = head.ReadAll();
  EXPECT_TRUE(refusal.starts_with("HTTP/1.1 413 ")) << refusal;
  EXPECT_TRUE(refusal.ends_with("\r\n\r\n")) << "no body: " << refusal;
  const std::vector<AccessEntry> log = Log();
  EXPECT_TRUE(std::any_of(log.begin(), log.end(), [](const AccessEntry& entry) {
    return entry.method == "HEAD" && entry.target == "/" && entry.status == 413;
  })) << "the log names what was refused";
  EXPECT_EQ(Ask(Socket(), "GET", "/", "", "X: " + std::string(3000, 'x') + "\r\n").status, 431);
  EXPECT_EQ(Ask(Socket(), "GET", "/" + std::string(200000, 'x')).status, 431);
  for (const char* nonsense :
       {"\x16\x03\x01\x02", "GET\r\n\r\n", "GET / HTTP/9.9\r\n\r\n",
        "GET / HTTP/1.1\r\nContent-Length: -1\r\n\r\n", "\r\n\r\n\r\n\r\n"}) {
    UnixConnection connection(Socket());
    connection.Send(nonsense);
    EXPECT_EQ(ReadAnswer(connection).status, 400) << nonsense;
    connection.ReadAll();
    EXPECT_TRUE(connection.closed()) << nonsense;
  }
  EXPECT_EQ(Ask(Socket(), "GET", "/").status, 200) << "and it serves on";
}

TEST_F(HttpServerTest, ContinuesWhereAClientAsksFirst) {
  Start();
  UnixConnection connection(Socket());
  connection.Send(
      "POST / HTTP/1.1\r\nHost: h\r\nContent-Length: 2\r\nExpect: 100-continue\r\n\r\n");
  EXPECT_EQ(connection.ReadUntil("\r\n\r\n"), "HTTP/1.1 100 Continue\r\n\r\n");
  connection.Send("hi");
  EXPECT_EQ(ReadAnswer(connection).body, "POST / hi");
  UnixConnection old(Socket());
  old.Send("POST / HTTP/1.0\r\nContent-Length: 2\r\nExpect: 100-continue\r\n\r\nhi");
  EXPECT_EQ(ReadAnswer(old).body, "POST / hi") << "HTTP/1.0 does not know that answer";
}

TEST_F(HttpServerTest, AClientThatIsTooSlowLosesItsConnection) {
  options_.limits.request_ms = kSoon_ms;
  Start();
  UnixConnection silent(Socket()), in_header(Socket()), in_body(Socket()), idle(Socket());
  in_header.Send("GET / HT");
  in_body.Send("POST / HTTP/1.1\r\nHost: h\r\nContent-Length: 10\r\n\r\nabc");
  idle.Send(kGet);
  EXPECT_EQ(ReadAnswer(idle).status, 200);
  for (UnixConnection* connection : {&silent, &in_header, &in_body, &idle}) {
    EXPECT_EQ(connection->ReadAll(), "");
    EXPECT_TRUE(connection->closed());
  }
  // The log names those that had begun to ask.
  while (Log().size() < 3) std::this_thread::sleep_for(milliseconds(1));
  server_ = nullptr;
  EXPECT_EQ(Log().size(), 3u);
  int slow = 0;
  for (const AccessEntry& entry : Log()) {
    slow += entry.status == 0 && entry.method.empty() && entry.peer.pid == getpid();
  }
  EXPECT_EQ(slow, 2);
}

TEST_F(HttpServerTest, AClientThatTakesNothingLosesItsConnectionAndHoldsUpNobody) {
  // The one that reads stops, too, while what it has read is moved to where there is more room.
  options_.limits.write_ms = 10 * kSoon_ms;
  options_.handle = [](const HttpRequest& request) {
    HttpResponse response;
    response.body = request.target == "/large" ? std::string(50000000, 'x') : "small";
    return response;
  };
  Start();
  UnixConnection lazy(Socket());
  lazy.Send("GET /large HTTP/1.1\r\nHost: h\r\n\r\n");
  EXPECT_EQ(Ask(Socket(), "GET", "/small").body, "small");
  while (Log().size() < 2) std::this_thread::sleep_for(milliseconds(5));
  EXPECT_EQ(Log().back().status, 0) << "given up";
  EXPECT_LT(lazy.ReadAll().size(), 50000000u);
  // One that reads gets all of it, however long that takes.
  EXPECT_EQ(Ask(Socket(), "GET", "/large").body.size(), 50000000u);
}

TEST_F(HttpServerTest, AClientThatTakesNextToNothingLosesItsConnectionInTheEnd) {
  constexpr size_t kLarge = 20000000;
  options_.limits.write_ms = kSoon_ms;
  options_.limits.least_bytes_per_s = std::numeric_limits<int>::max();
  options_.handle = [](const HttpRequest&) {
    HttpResponse response;
    response.body = std::string(kLarge, 'x');
    return response;
  };
  Start();
  UnixConnection miser(Socket());
  miser.Send(kGet);
  size_t taken = 0;
  while (Log().empty()) {  // each piece in time
    taken += miser.Read(4000).size();
    std::this_thread::sleep_for(milliseconds(1));
  }
  EXPECT_EQ(Log().back().status, 0) << "given up";
  EXPECT_LT(taken, kLarge);
}

TEST_F(HttpServerTest, WhatAnAnswerHoldsIsKeptUntilItIsTakenOrItsClientHasGone) {
  constexpr size_t kLarge = 20000000;
  std::atomic<int> held = 0;
  options_.handle = [&held](const HttpRequest&) {
    HttpResponse response;
    response.body = std::string(kLarge, 'x');
    ++held;
    response.held = std::shared_ptr<const void>(&held, [&held](const void*) { --held; });
    return response;
  };
  Start();
  {
    UnixConnection goes(Socket()), takes(Socket());
    goes.Send(kGet);
    takes.Send(kGet);
    EXPECT_EQ(goes.Read(10).size(), 10u);
    EXPECT_EQ(takes.Read(10).size(), 10u);
    EXPECT_EQ(held, 2);
    takes.Read(kLarge);
    while (held == 2) std::this_thread::sleep_for(milliseconds(1));
    EXPECT_EQ(held, 1);
  }
  while (held > 0) std::this_thread::sleep_for(milliseconds(1));
}

TEST_F(HttpServerTest, TooManyConnectionsAreTurnedAway) {
  options_.limits.connections = 3;
  Start();
  std::vector<std::unique_ptr<UnixConnection>> taken;
  for (int i = 0; i < 3; ++i) {
    taken.push_back(std::make_unique<UnixConnection>(Socket()));
    taken.back()->Send(kGet);
    EXPECT_EQ(ReadAnswer(*taken.back()).status, 200);
  }
  UnixConnection one_more(Socket());
  const UnixHttpAnswer refusal = ReadAnswer(one_more);
  EXPECT_EQ(refusal.status, 503);
  EXPECT_EQ(refusal.headers.at("content-type"), "application/problem+json");
  EXPECT_NE(refusal.body.find("3 connections"), std::string::npos) << refusal.body;
  EXPECT_EQ(server_->counters().refused_connections, 1u);
  while (Log().size() < 4) std::this_thread::sleep_for(milliseconds(1));
  EXPECT_EQ(Log().back().status, 503);
  EXPECT_EQ(Log().back().peer.pid, getpid());
  taken.pop_back();
  while (server_->counters().connections == 3) std::this_thread::sleep_for(milliseconds(1));
  EXPECT_EQ(Ask(Socket(), "GET", "/").status, 200);
}

/// Makes this thread, and no other, another user while it lives: the kernel tells the server who
/// connected when.
class AsUser {
 public:
  AsUser(uid_t user, gid_t group) {
    syscall(SYS_setresgid, -1, group, -1);
    syscall(SYS_setresuid, -1, user, -1);
  }
  ~AsUser() {
    syscall(SYS_setresuid, -1, 0, -1);
    syscall(SYS_setresgid, -1, 0, -1);
  }
  AsUser(const AsUser&) = delete;
  AsUser& operator=(const AsUser&) = delete;
};

TEST_F(HttpServerTest, ViewersCannotTakeThePlacesOfOperators) {
  if (geteuid() != 0) GTEST_SKIP() << "needs root to become other users";
  constexpr gid_t kViewers = 54321;
  constexpr uid_t kNobody = 65534;
  options_.limits.connections = 16;
  options_.limits.streams = 8;
  options_.access = {{kViewers}, {}};
  ServeStream();
  Start();
  chmod(folder_.path().c_str(), 0755);
  chmod(Socket().c_str(), 0666);
  std::vector<std::unique_ptr<UnixConnection>> all;
  const auto open = [&] {
    all.push_back(std::make_unique<UnixConnection>(Socket()));
    all.back()->Send(kGet);
    return ReadAnswer(*all.back()).status;  // of a stream without waiting for its end
  };
  {
    const AsUser viewer(kNobody, kViewers);
    for (int i = 0; i < 7; ++i) EXPECT_EQ(open(), 200) << i;
    EXPECT_EQ(open(), 503) << "the eighth stream";
    while (server_->counters().connections < 14) all.push_back(Idle());
    EXPECT_EQ(ReadAnswer(*Idle()).status, 503) << "the fifteenth connection";
  }
  EXPECT_EQ(open(), 200) << "an operator's stream";
  EXPECT_EQ(server_->counters().streams, 8u);
}

TEST_F(HttpServerTest, FilesAreSentWhole) {
  const std::string bytes(300001, 'y');
  std::ofstream(folder_ / "there") << bytes;
  options_.handle = [this](const HttpRequest& request) {
    HttpResponse response;
    response.content_type = "image/png";
    response.file = folder_ / request.target.substr(1);
    return response;
  };
  Start();
  const UnixHttpAnswer there = Ask(Socket(), "GET", "/there");
  EXPECT_TRUE(there.body == bytes) << there.body.size() << " bytes";
  EXPECT_EQ(there.headers.at("content-type"), "image/png");
  EXPECT_EQ(Ask(Socket(), "GET", "/gone").status, 404);
  std::ofstream(folder_ / "empty") << "";
  UnixConnection connection(Socket());
  for (const size_t size : {size_t{0}, bytes.size(), size_t{0}}) {
    connection.Send("GET /" + std::string(size > 0 ? "there" : "empty") +
                    " HTTP/1.1\r\nHost: h\r\n\r\n");
    const UnixHttpAnswer answer = ReadAnswer(connection);
    EXPECT_EQ(answer.status, 200);
    EXPECT_EQ(answer.body.size(), size);
  }
}

TEST_F(HttpServerTest, AFileThatIsShorterThanItWasIsNotTakenForWhole) {
  constexpr size_t kLarge = 20000000;
  std::ofstream(folder_ / "shrinks") << std::string(kLarge, 'y');
  options_.handle = [this](const HttpRequest&) {
    HttpResponse response;
    response.file = folder_ / "shrinks";
    return response;
  };
  Start();
  UnixConnection connection(Socket());
  connection.Send(kGet);
  EXPECT_EQ(connection.Read(10).size(), 10u);
  std::filesystem::resize_file(folder_ / "shrinks", 10);
  EXPECT_LT(connection.ReadAll().size(), kLarge);
  EXPECT_TRUE(connection.closed());
  while (Log().empty()) std::this_thread::sleep_for(milliseconds(5));
  EXPECT_EQ(Log().back().status, 0);
  EXPECT_EQ(Log().back().trouble, "the file is shorter than it was");
}

TEST_F(HttpServerTest, AFileThatHangsHoldsUpNobodyElse) {
  std::ofstream(folder_ / "there") << "picture";
  ASSERT_EQ(mkfifo((folder_ / "hangs").c_str(), 0600), 0);  // until somebody writes
  options_.handle = [this](const HttpRequest& request) {
    HttpResponse response;
    response.file = folder_ / request.target.substr(1);
    return response;
  };
  Start();
  UnixConnection waits(Socket());
  waits.Send("GET /hangs HTTP/1.1\r\nHost: h\r\n\r\n");
  for (int i = 0; i < 10; ++i) EXPECT_EQ(Ask(Socket(), "GET", "/there").body, "picture");
  std::ofstream(folder_ / "hangs") << "";
  EXPECT_NE(ReadAnswer(waits).status, 0);
}

TEST_F(HttpServerTest, FilesThatHangLeaveThreadsForTheRest) {
  options_.limits.write_ms = kSoon_ms;
  const auto hangs = folder_ / "hangs";
  ASSERT_EQ(mkfifo(hangs.c_str(), 0600), 0);  // whoever opens it to read waits for a writer
  std::atomic<int> hanging = 0;
  options_.handle = [&](const HttpRequest& request) {
    HttpResponse response;
    if (request.target == "/file") response.file = hangs;
    if (request.target == "/bulk") {
      response.bulk = [&] {
        ++hanging;
        std::ifstream wait(hangs);
        return HttpResponse();
      };
    }
    return response;
  };
  Start();
  const auto ask = [&](const std::string& target) {
    auto connection = std::make_unique<UnixConnection>(Socket());
    connection->Send("GET " + target + " HTTP/1.1\r\nHost: h\r\n\r\n");
    return connection;
  };
  // Two of the four threads, which is all that may.
  const auto first = ask("/bulk"), second = ask("/bulk");
  while (hanging < 2) std::this_thread::sleep_for(milliseconds(1));
  std::vector<std::unique_ptr<UnixConnection>> late;
  for (int i = 0; i < 8; ++i) late.push_back(ask(i % 2 == 0 ? "/file" : "/bulk"));
  for (int i = 0; i < 10; ++i) EXPECT_EQ(Ask(Socket(), "GET", "/").status, 200);
  for (const auto& connection : late) {
    const UnixHttpAnswer answer = ReadAnswer(*connection);
    EXPECT_EQ(answer.status, 503);
    EXPECT_NE(answer.body.find("does their disk or share answer"), std::string::npos);
    EXPECT_TRUE(answer.headers.contains("retry-after"));
  }
  // A handler's thread still ends the silence, again and again.
  for (milliseconds before = server_->Silence();;) {
    std::this_thread::sleep_for(milliseconds(1));
    const milliseconds now = server_->Silence();
    if (now < before) break;
    before = now;
  }
  const int writer = open(hangs.c_str(), O_RDWR | O_CLOEXEC);
  EXPECT_EQ(ReadAnswer(*first).status, 200);
  EXPECT_EQ(ReadAnswer(*second).status, 200);
  EXPECT_EQ(hanging, 2);
  close(writer);
  std::ofstream(folder_ / "there") << "picture";
  std::filesystem::rename(folder_ / "there", hangs);
  for (int i = 0; i < 10; ++i) EXPECT_EQ(Ask(Socket(), "GET", "/file").body, "picture");
}

TEST_F(HttpServerTest, AHandlerThatThrowsIsAnAnswerToo) {
  options_.handle = [](const HttpRequest& request) -> HttpResponse {
    if (request.target != "/bulk") throw std::runtime_error("a bug");
    HttpResponse response;
    response.bulk = []() -> HttpResponse { throw std::runtime_error("a bug"); };
    return response;
  };
  Start();
  const UnixHttpAnswer answer = Ask(Socket(), "GET", "/");
  EXPECT_EQ(answer.status, 500);
  EXPECT_NE(answer.body.find("a bug"), std::string::npos) << answer.body;
  EXPECT_EQ(Ask(Socket(), "GET", "/bulk").status, 500);
}

TEST_F(HttpServerTest, StreamsBringWhatComesUpAndSignsOfLife) {
  options_.limits.heartbeat_ms = kSoon_ms;
  ServeStream();
  Start();
  UnixConnection stream(Socket());
  stream.Send(kGet);
  const std::string head = stream.ReadUntil("a\n\n");
  EXPECT_NE(head.find("text/event-stream"), std::string::npos) << head;
  EXPECT_NE(head.find("chunked"), std::string::npos) << head;
  EXPECT_EQ(server_->counters().streams, 1u);
  Say("b\n\n");
  EXPECT_NE(stream.ReadUntil("b\n\n"), "");
  EXPECT_NE(stream.ReadUntil(": nothing new\n\n").find(": nothing new"), std::string::npos);
  Say("c\n\n");
  EXPECT_NE(stream.ReadUntil("c\n\n").find("c\n\n"), std::string::npos);
}

TEST_F(HttpServerTest, StreamsToHttp10AreNotCutIntoChunks) {
  ServeStream();
  Start();
  UnixConnection stream(Socket());
  stream.Send("GET / HTTP/1.0\r\n\r\n");
  const std::string head = stream.ReadUntil("\r\n\r\n");
  EXPECT_EQ(head.find("chunked"), std::string::npos) << head;
  EXPECT_EQ(stream.ReadUntil("a\n\n"), "a\n\n");
  Say("b\n\n");
  EXPECT_EQ(stream.ReadUntil("b\n\n"), "b\n\n");
  server_->Stop(milliseconds(kNever_ms));
  EXPECT_EQ(stream.ReadAll(), "");
}

TEST_F(HttpServerTest, AStreamsClientMayGoAtAnyTime) {
  ServeStream();
  Start();
  for (int i = 0; i < 5; ++i) {
    UnixConnection stream(Socket());
    stream.Send(kGet);
    stream.ReadUntil("a\n\n");
  }
  while (server_->counters().connections > 0) std::this_thread::sleep_for(milliseconds(1));
  EXPECT_EQ(server_->counters().streams, 0u);
}

TEST_F(HttpServerTest, ThereIsALimitOfStreams) {
  options_.limits.streams = 1;
  ServeStream();
  Start();
  UnixConnection stream(Socket());
  stream.Send(kGet);
  stream.ReadUntil("a\n\n");
  EXPECT_EQ(Ask(Socket(), "GET", "/").status, 503);
}

TEST_F(HttpServerTest, StoppingFinishesAnswersEndsStreamsAndClosesTheRest) {
  std::atomic<bool> asked = false, may_answer = false;
  ServeStream();
  options_.handle = [&, stream = options_.handle](const HttpRequest& request) {
    if (request.target != "/slow") return stream(request);
    asked = true;
    while (!may_answer) std::this_thread::sleep_for(milliseconds(1));
    HttpResponse response;
    response.body = "done";
    return response;
  };
  Start();
  UnixConnection slow(Socket()), stream(Socket()), idle(Socket());
  stream.Send(kGet);
  stream.ReadUntil("a\n\n");
  slow.Send("GET /slow HTTP/1.1\r\nHost: h\r\n\r\n");
  while (!asked) std::this_thread::sleep_for(milliseconds(1));
  std::thread stop([&] { server_->Stop(milliseconds(kNever_ms)); });
  EXPECT_EQ(idle.ReadAll(), "");
  const std::string end = stream.ReadAll();
  EXPECT_TRUE(end.ends_with("0\r\n\r\n")) << end;
  may_answer = true;
  const UnixHttpAnswer answer = ReadAnswer(slow);
  EXPECT_EQ(answer.body, "done");
  EXPECT_EQ(answer.headers.at("connection"), "close");
  stop.join();
  EXPECT_THROW(UnixConnection late(Socket()), std::runtime_error);
}

TEST_F(HttpServerTest, StoppingWithoutPatienceWaitsForNobody) {
  ServeStream();
  Start();
  UnixConnection stream(Socket()), idle(Socket());
  stream.Send(kGet);
  stream.ReadUntil("a\n\n");
  server_ = nullptr;
  idle.ReadAll();
  EXPECT_TRUE(idle.closed());
}

TEST_F(HttpServerTest, ManyClientsAtOnce) {
  Start();
  std::atomic<int> good = 0;
  std::vector<std::jthread> clients;
  for (int i = 0; i < 50; ++i) {
    clients.emplace_back([&] {
      UnixConnection connection(Socket());
      for (int k = 0; k < 20; ++k) {
        connection.Send(kGet);
        good += ReadAnswer(connection).body == "GET /x ";
      }
    });
  }
  clients.clear();
  EXPECT_EQ(good, 1000);
}

/// A few bytes of two requests in a row are others, or are missing.
std::string BrokenRequests(std::mt19937_64& random) {
  std::string broken =
      "POST /v1/x?a=b HTTP/1.1\r\nHost: h\r\nTransfer-Encoding: "
      "chunked\r\n\r\n5\r\nhello\r\n0\r\n\r\n"
      "GET / HTTP/1.0\r\nConnection: keep-alive\r\nContent-Length: 0\r\n\r\n";
  for (uint64_t changes = 1 + random() % 5; changes > 0; --changes) {
    const size_t at = random() % broken.size();
    if (random() % 2 == 0) {
      broken[at] = static_cast<char>(random());
    } else {
      broken.erase(at, random() % 8);
    }
  }
  return broken;
}

TEST_F(HttpServerTest, BrokenRequestsHarmNobody) {
  constexpr uint64_t kSeed = 7;
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  Start();
  std::mt19937_64 random(kSeed);
  for (int i = 0; i < 500; ++i) {
    UnixConnection connection(Socket());
    connection.Send(BrokenRequests(random));  // and goes, whatever the answer is
  }
  EXPECT_EQ(Ask(Socket(), "GET", "/").status, 200);
  while (server_->counters().connections > 0) std::this_thread::sleep_for(milliseconds(1));
}

TEST_F(HttpServerTest, BrokenRequestsAreRefusedWithTheReasonOrAnswered) {
  constexpr uint64_t kSeed = 11;
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  test::HttpEcho echo;
  options_.handle = [&echo](const HttpRequest& request) { return echo.Answer(request); };
  Start();
  std::mt19937_64 random(kSeed);
  std::map<int, int> count_of_status;
  for (int i = 0; i < 500; ++i) {
    const std::string broken = BrokenRequests(random);
    const size_t middle = random() % broken.size();
    const auto statuses = echo.Converse(Socket(), broken.substr(0, middle), broken.substr(middle));
    ASSERT_TRUE(statuses) << statuses.error().ToString() << "\nmutant " << i << ", in two at "
                          << middle << ":\n"
                          << testing::PrintToString(broken);
    for (const int status : *statuses) ++count_of_status[status];
  }
  EXPECT_GT(count_of_status[200], 0);
  EXPECT_GT(count_of_status[400], 0);
}

TEST_F(HttpServerTest, TheLogHasNoControlCharacters) {
  Start();
  Ask(Socket(), "GET", "/\xff\xc3\xa4");
  while (Log().empty()) std::this_thread::sleep_for(milliseconds(1));
  EXPECT_EQ(Log()[0].target, "/???");
  EXPECT_EQ(Log()[0].status, 200);
  EXPECT_EQ(Log()[0].peer.uid, geteuid());
}

TEST_F(HttpServerTest, ADeadSocketIsReplacedAndALivingOneIsNot) {
  {
    const auto dead = ListenOn(Socket());
    ASSERT_TRUE(dead);
    close(*dead);
  }
  Start();
  const auto second = ListenOn(Socket());
  ASSERT_FALSE(second);
  EXPECT_EQ(second.error().code, ErrorCode::kAlreadyExists);
  std::ofstream(folder_ / "file") << "precious";
  EXPECT_FALSE(ListenOn(folder_ / "file"));
  EXPECT_TRUE(std::filesystem::is_regular_file(folder_ / "file"));
  EXPECT_FALSE(ListenOn(folder_ / std::string(200, 'x')));
  EXPECT_FALSE(HttpServer::Start(STDIN_FILENO, options_)) << "no listening socket";
}

TEST_F(HttpServerTest, ALivingSocketOfAnotherTypeIsNotReplaced) {
  const int simulator = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  Socket().string().copy(address.sun_path, sizeof(address.sun_path) - 1);
  ASSERT_EQ(bind(simulator, reinterpret_cast<const sockaddr*>(&address), sizeof(address)), 0);
  const auto listening = ListenOn(Socket());
  close(simulator);
  ASSERT_FALSE(listening);
  EXPECT_EQ(listening.error().code, ErrorCode::kAlreadyExists);
}

}  // namespace
}  // namespace rotunda::daemon
