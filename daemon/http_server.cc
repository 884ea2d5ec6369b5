#include "daemon/http_server.h"

#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <condition_variable>
#include <csignal>
#include <cstring>
#include <deque>
#include <mutex>
#include <optional>
#include <set>
#include <thread>
#include <type_traits>
#include <utility>
// <utility> must be there before Boost 1.74's Asio under C++20.
#include <boost/asio/io_context.hpp>
#include <boost/asio/local/stream_protocol.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/thread_pool.hpp>
#include <boost/asio/write.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>

#include "daemon/http_problem.h"

namespace rotunda::daemon {
namespace {

namespace net = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace fs = std::filesystem;
using Protocol = net::local::stream_protocol;
using Socket = Protocol::socket;
using Stream = beast::basic_stream<Protocol>;
using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr auto kBeatInterval = milliseconds(500);
// While descriptors are used up accept() fails at once: without a pause it would spin.
constexpr auto kAcceptPause = milliseconds(100);
// What a refused client may still send before the connection is closed on it, so that it reads why.
constexpr size_t kDiscardBytes = size_t{1} << 20;
constexpr auto kDiscardPatience = milliseconds(1000);
// Of a file, in memory at a time for each client that takes one.
constexpr uint64_t kFilePieceBytes = uint64_t{1} << 18;
constexpr int kBacklog = 64;
constexpr int kHttp11 = 11;
constexpr int kOperatorsShare = 8;  // one in so many places
// Of the handlers' threads: one may be held up by a camera or a file that is looked at for the
// status, the other answers.
constexpr int kNeverBulk = 2;
constexpr char kFilesRetry_s[] = "10";
constexpr char kFilesHang[] = "the files are not read in time: does their disk or share answer?";

/// Groups of the process at the other end, supplementary ones too, when it connected.
std::vector<gid_t> PeerGroups(int fd, gid_t primary) {
  std::vector<gid_t> groups(64);
  auto bytes = static_cast<socklen_t>(groups.size() * sizeof(gid_t));
  int failed = getsockopt(fd, SOL_SOCKET, SO_PEERGROUPS, groups.data(), &bytes);
  if (failed != 0 && errno == ERANGE) {  // `bytes` is now what it takes
    groups.resize(bytes / sizeof(gid_t));
    failed = getsockopt(fd, SOL_SOCKET, SO_PEERGROUPS, groups.data(), &bytes);
  }
  groups.resize(failed != 0 ? 0 : bytes / sizeof(gid_t));
  groups.push_back(primary);
  return groups;
}

Peer PeerOf(int fd, const HttpAccess& access) {
  ucred credentials{};
  socklen_t bytes = sizeof(credentials);
  if (getsockopt(fd, SOL_SOCKET, SO_PEERCRED, &credentials, &bytes) != 0) return {};
  Peer peer{credentials.uid, credentials.pid, Role::kNone};
  const std::vector<gid_t> groups = PeerGroups(fd, credentials.gid);
  const auto in_one_of = [&](const std::vector<gid_t>& wanted) {
    return std::find_first_of(groups.begin(), groups.end(), wanted.begin(), wanted.end()) !=
           groups.end();
  };
  if (peer.uid == 0 || peer.uid == geteuid() || in_one_of(access.operators)) {
    peer.role = Role::kOperator;
  } else if (in_one_of(access.viewers)) {
    peer.role = Role::kViewer;
  }
  return peer;
}

/// How many of `all` places there are for one with this role: an operator finds at least one of
/// two.
uint64_t PlacesFor(Role role, int all) {
  const int kept = all < 2 ? 0 : std::max(1, all / kOperatorsShare);
  return static_cast<uint64_t>(role == Role::kOperator ? all : all - kept);
}

std::string Printable(beast::string_view text) {
  std::string printable(text.substr(0, std::min<size_t>(text.size(), 256)));
  for (char& byte : printable) {
    if (byte < 0x20 || byte > 0x7E) byte = '?';
  }
  return printable;
}

template <typename Body>
struct Answer {
  http::response<Body> response;
  std::optional<http::response_serializer<Body>> serializer;  // made when `response` is whole
  Clock::time_point deadline = {};                            // for all of it
  std::shared_ptr<const void> held = nullptr;
};

/// A file on its way. Handlers' threads read it, a piece when the one before was taken: a read that
/// is slow or hangs holds up nobody else while another of these threads is free.
struct FileAnswer : Answer<http::buffer_body> {
  beast::file file;
  uint64_t left_bytes = 0;
  std::vector<char> piece;
};

}  // namespace

struct HttpServer::Impl {
  class Session;

  explicit Impl(Options given)
      : options(std::move(given)),
        access(options.access),
        handlers(static_cast<size_t>(options.limits.handler_threads)) {}

  /// Work that reads files, and what to do instead when its turn does not come until `patience`.
  /// `work` runs in a handler's thread, `give_up` in the input/output thread.
  struct Bulk {
    std::function<void()> work;
    std::function<void()> give_up;
    Clock::time_point patience;
  };

  void Accept();
  void Accepted(Socket socket);
  // All in the input/output thread.
  void Do(Bulk bulk);
  void Next();
  void GiveUpLateBulk();
  void Beat();
  void Gone(Session* session);
  /// In the input/output thread.
  void EndAll(bool at_once);

  const Options options;
  HttpAccess access;  // of the input/output thread
  // Sessions live in the input/output thread alone; this outlives the context that keeps them.
  std::set<Session*> sessions;
  std::atomic<uint64_t> requests = 0, refused = 0, connections = 0, streams = 0;
  std::atomic<Clock::rep> last_beat = Clock::now().time_since_epoch().count();
  bool stopping = false;  // of the input/output thread
  std::mutex mutex;
  std::condition_variable all_gone;
  net::io_context io{1};
  Protocol::acceptor acceptor{io};
  net::steady_timer beat{io};
  net::steady_timer accept_pause{io};
  net::thread_pool handlers;
  std::thread thread;
  // Of the input/output thread. Sessions that wait here go before the context that they hang on.
  std::deque<Bulk> waiting_bulk;
  int running_bulk = 0;
};

/// One connection. Kept by the operations it waits for; all members run in the input/output thread,
/// its end too: what a handler's thread holds of it goes back with the result.
class HttpServer::Impl::Session : public std::enable_shared_from_this<Session> {
 public:
  Session(Impl& server, Socket socket, const Peer& peer)
      : server_(server),
        stream_(std::move(socket)),
        buffer_(static_cast<size_t>(server.options.limits.header_bytes) + 65536),
        peer_(peer),
        heartbeat_(server.io) {
    server_.sessions.insert(this);
    ++server_.connections;
  }
  ~Session() {
    if (is_stream_) --server_.streams;
    server_.Gone(this);
  }

  void Read() {
    parser_.emplace();
    parser_->header_limit(static_cast<uint32_t>(server_.options.limits.header_bytes));
    parser_->body_limit(static_cast<uint64_t>(server_.options.limits.body_bytes));
    is_idle_ = true;
    stream_.expires_after(milliseconds(server_.options.limits.request_ms));
    http::async_read_header(
        stream_, buffer_, *parser_,
        [self = shared_from_this()](beast::error_code error, size_t) { self->OnHeader(error); });
  }

  /// Ends the connection as soon as nothing is under way on it.
  void End() {
    ending_ = true;
    if (is_idle_) stream_.close();
    if (is_stream_ && !is_writing_) WriteLastChunk();
  }
  void Close() { stream_.close(); }
  bool is_stream() const { return is_stream_; }

  /// Asks a stream's source for what is new.
  void Pull() {
    if (!is_stream_ || is_writing_) {
      pull_again_ = true;
      return;
    }
    is_writing_ = true;
    pull_again_ = false;
    heartbeat_.cancel();
    net::post(server_.handlers, [self = shared_from_this()]() mutable {
      std::string piece = self->Ask();
      net::io_context& io = self->server_.io;
      net::post(io, [self = std::move(self), piece = std::move(piece)]() mutable {
        self->OnPiece(std::move(piece));
      });
    });
  }

 private:
  void OnHeader(beast::error_code error) {
    is_idle_ = false;
    if (error) return OnReadError(error);
    if (beast::iequals(parser_->get()[http::field::expect], "100-continue")) {
      static constexpr char kContinue[] = "HTTP/1.1 100 Continue\r\n\r\n";
      return net::async_write(stream_, net::buffer(kContinue, sizeof(kContinue) - 1),
                              [self = shared_from_this()](beast::error_code failed, size_t) {
                                if (!failed) self->ReadBody();
                              });
    }
    ReadBody();
  }

  void ReadBody() {
    http::async_read(stream_, buffer_, *parser_,
                     [self = shared_from_this()](beast::error_code error, size_t) {
                       if (error) return self->OnReadError(error);
                       self->OnRequest();
                     });
  }

  /// A request that cannot be read: why, when the client may still listen; then the end.
  void OnReadError(beast::error_code error) {
    if (error.category() != http::make_error_code(http::error::bad_method).category() ||
        error == http::error::end_of_stream || error == http::error::partial_message) {
      return Close();  // the client left, or was too slow
    }
    request_ = {};
    request_.peer = peer_;
    ending_ = true;
    discard_ = true;
    begin_ = Clock::now();
    if (error == http::error::body_limit) {
      Send(Problem(413, "the body has more than " +
                            std::to_string(server_.options.limits.body_bytes) + " bytes"));
    } else if (error == http::error::header_limit || error == http::error::buffer_overflow) {
      Send(Problem(431, "the header has more than " +
                            std::to_string(server_.options.limits.header_bytes) + " bytes"));
    } else {
      Send(Problem(400, "this is not HTTP/1.1: " + error.message()));
    }
  }

  void OnRequest() {
    auto message = parser_->release();
    keep_alive_ = message.keep_alive();
    request_ = {};
    request_.method = std::string(message.method_string());
    request_.target = std::string(message.target());
    for (const auto& field : message) {
      std::string name(field.name_string());
      for (char& letter : name) letter = beast::detail::ascii_tolower(letter);
      request_.headers[name] = std::string(field.value());
    }
    request_.body = std::move(message.body());
    request_.peer = peer_;
    begin_ = Clock::now();
    ++server_.requests;
    net::post(server_.handlers, [self = shared_from_this()]() mutable {
      HttpResponse response = self->Handle();
      net::io_context& io = self->server_.io;
      net::post(io, [self = std::move(self), response = std::move(response)]() mutable {
        self->Send(std::move(response));
      });
    });
  }

  /// In a handler's thread; the request is left alone meanwhile.
  HttpResponse Handle() const {
    return Guarded([this] { return server_.options.handle(request_); });
  }
  template <typename Make>
  static HttpResponse Guarded(const Make& make) {
    try {
      return make();
    } catch (const std::exception& unexpected) {
      return Problem(500, std::string("unexpected failure: ") + unexpected.what());
    }
  }
  std::string Ask() const {
    try {
      return source_();
    } catch (const std::exception&) {
      return "";  // the next call may succeed; the heartbeat goes on
    }
  }

  void Send(HttpResponse response) {
    const uint64_t places = PlacesFor(peer_.role, server_.options.limits.streams);
    if (response.stream && server_.streams >= places) {
      response = Problem(503, "there are " + std::to_string(server_.streams) +
                                  " event streams already; close one");
    }
    if (response.stream) return SendStream(std::move(response));
    if (response.bulk) return SendBulk(std::move(response.bulk));
    if (response.file) return SendFile(std::move(response));
    SendBody(std::move(response));
  }

  template <typename Body>
  void SetHeaders(const HttpResponse& response, http::response<Body>& message) {
    status_ = response.status;
    sent_bytes_ = 0;
    message.result(static_cast<unsigned>(response.status));
    message.reason(ReasonPhrase(response.status));
    message.version(kHttp11);
    message.set(http::field::server, "rotundad");
    message.set(http::field::content_type, response.content_type);
    message.set(http::field::cache_control, "no-store");
    message.set("X-Content-Type-Options", "nosniff");
    for (const auto& [name, value] : response.headers) message.set(name, value);
    message.keep_alive(keep_alive_ && !ending_);
  }

  void SendBody(HttpResponse response) {
    auto answer = std::make_shared<Answer<http::string_body>>();
    SetHeaders(response, answer->response);
    answer->held = std::move(response.held);
    answer->deadline = DeadlineFor(response.body.size());
    answer->response.body() = std::move(response.body);
    answer->response.prepare_payload();
    answer->serializer.emplace(answer->response);
    Write(std::move(answer));
  }

  Clock::time_point DeadlineFor(uint64_t bytes) const {
    const auto rate = static_cast<uint64_t>(server_.options.limits.least_bytes_per_s);
    return Clock::now() + milliseconds(server_.options.limits.write_ms) +
           milliseconds(1000 * bytes / rate);
  }

  Clock::time_point BulkPatience() const {
    return Clock::now() + milliseconds(server_.options.limits.write_ms);
  }

  void SendBulk(std::function<HttpResponse()> make) {
    const auto self = shared_from_this();
    server_.Do({[self, make = std::move(make)] {
                  net::post(self->server_.io, [self, response = Guarded(make)]() mutable {
                    self->Send(std::move(response));
                  });
                },
                [self] { self->SendTooLate(); }, BulkPatience()});
  }

  void SendTooLate() {
    HttpResponse response = Problem(503, kFilesHang);
    response.headers.emplace_back("Retry-After", kFilesRetry_s);
    SendBody(std::move(response));
  }

  void SendFile(HttpResponse response) {
    const auto self = shared_from_this();
    server_.Do({[self, response = std::move(response)] {
                  auto answer = std::make_shared<FileAnswer>();
                  beast::error_code error;
                  answer->file.open(response.file->c_str(), beast::file_mode::scan, error);
                  if (!error) answer->left_bytes = answer->file.size(error);
                  net::post(self->server_.io, [self, response, answer, error] {
                    self->OnFile(response, answer, error);
                  });
                },
                [self] { self->SendTooLate(); }, BulkPatience()});
  }

  void OnFile(const HttpResponse& response, const std::shared_ptr<FileAnswer>& answer,
              beast::error_code error) {
    if (error) {
      return SendBody(Problem(error == beast::errc::no_such_file_or_directory ? 404 : 503,
                              response.file->filename().string() + ": " + error.message()));
    }
    SetHeaders(response, answer->response);
    answer->deadline = DeadlineFor(answer->left_bytes);
    answer->response.content_length(answer->left_bytes);
    answer->serializer.emplace(answer->response);
    ReadPiece(answer);
  }

  void ReadPiece(const std::shared_ptr<FileAnswer>& answer) {
    const auto self = shared_from_this();
    server_.Do({[self, answer] {
                  std::string trouble = NextPiece(*answer);
                  net::post(self->server_.io, [self, answer, trouble = std::move(trouble)] {
                    // Cut off, so that the client does not take it for the whole file.
                    if (!trouble.empty()) return self->CutOff(trouble);
                    self->OnFilePiece(answer);
                  });
                },
                [self] { self->CutOff(kFilesHang); }, BulkPatience()});
  }

  /// What is wrong; empty: nothing.
  static std::string NextPiece(FileAnswer& answer) {
    const uint64_t bytes = std::min(kFilePieceBytes, answer.left_bytes);
    answer.piece.resize(bytes);
    beast::error_code error;
    const size_t read = bytes > 0 ? answer.file.read(answer.piece.data(), bytes, error) : 0;
    if (error) return error.message();
    return read < bytes ? "the file is shorter than it was" : "";
  }

  void OnFilePiece(const std::shared_ptr<FileAnswer>& answer) {
    answer->left_bytes -= answer->piece.size();
    http::buffer_body::value_type& body = answer->response.body();
    body.data = answer->piece.data();
    body.size = answer->piece.size();
    body.more = answer->left_bytes > 0;
    Write(answer);
  }

  /// Piece by piece: each has its own time, so that a large answer may take long and a client that
  /// takes nothing may not; all together have theirs, for a client that takes next to nothing.
  template <typename AnyAnswer>
  void Write(std::shared_ptr<AnyAnswer> answer) {
    const auto piece = Clock::now() + milliseconds(server_.options.limits.write_ms);
    stream_.expires_at(std::min(piece, answer->deadline));
    http::async_write_some(
        stream_, *answer->serializer,
        [self = shared_from_this(), answer](beast::error_code error, size_t bytes) {
          self->sent_bytes_ += bytes;
          if constexpr (std::is_same_v<AnyAnswer, FileAnswer>) {
            if (error == http::error::need_buffer) return self->ReadPiece(answer);
          }
          if (error) return self->OnWriteError();
          if (!answer->serializer->is_done()) return self->Write(answer);
          self->OnAnswered(answer->response.keep_alive());
        });
  }

  void OnWriteError() { CutOff(""); }

  void CutOff(const std::string& trouble) {
    status_ = 0;
    Log(trouble);
    Close();
  }

  void OnAnswered(bool keep_alive) {
    Log();
    if (discard_) return Discard(kDiscardBytes);
    if (keep_alive && !ending_) return Read();
    Close();
  }

  /// Lets a client that is still sending read its answer before the connection goes.
  void Discard(size_t left) {
    beast::error_code ignored;
    stream_.socket().shutdown(Socket::shutdown_send, ignored);
    stream_.expires_after(kDiscardPatience);
    stream_.async_read_some(net::buffer(scrap_), [self = shared_from_this(), left](
                                                     beast::error_code error, size_t bytes) {
      if (error || bytes >= left) return self->Close();
      self->Discard(left - bytes);
    });
  }

  void SendStream(HttpResponse response) {
    is_stream_ = true;
    ++server_.streams;
    source_ = std::move(response.stream);
    stream_head_ = std::make_shared<Answer<http::empty_body>>();
    keep_alive_ = false;
    SetHeaders(response, stream_head_->response);
    stream_head_->response.chunked(true);
    stream_head_->serializer.emplace(stream_head_->response);
    WatchForLeaving();
    is_writing_ = true;
    stream_.expires_after(milliseconds(server_.options.limits.write_ms));
    http::async_write_header(stream_, *stream_head_->serializer,
                             [self = shared_from_this()](beast::error_code error, size_t bytes) {
                               self->OnChunkWritten(error, bytes);
                             });
  }

  /// A client of a stream has nothing more to say: whatever comes, it is over.
  void WatchForLeaving() {
    stream_.expires_never();
    stream_.async_read_some(net::buffer(scrap_),
                            [self = shared_from_this()](beast::error_code, size_t) {
                              self->heartbeat_.cancel();
                              self->Log();
                              self->Close();
                            });
  }

  void OnPiece(std::string piece) {
    is_writing_ = false;
    if (!stream_.socket().is_open()) return;
    if (ending_) return WriteLastChunk();
    if (!piece.empty()) return WriteChunk(std::move(piece));
    if (pull_again_) return Pull();
    heartbeat_.expires_after(milliseconds(server_.options.limits.heartbeat_ms));
    heartbeat_.async_wait([self = shared_from_this()](beast::error_code error) {
      if (!error && !self->is_writing_) self->WriteChunk(": nothing new\n\n");
    });
  }

  void WriteChunk(std::string piece) {
    is_writing_ = true;
    chunk_ = std::move(piece);
    stream_.expires_after(milliseconds(server_.options.limits.write_ms));
    net::async_write(stream_, http::make_chunk(net::buffer(chunk_)),
                     [self = shared_from_this()](beast::error_code error, size_t bytes) {
                       self->OnChunkWritten(error, bytes);
                     });
  }

  void OnChunkWritten(beast::error_code error, size_t bytes) {
    is_writing_ = false;
    sent_bytes_ += bytes;
    if (error) {
      Log();
      return Close();
    }
    if (ending_) return WriteLastChunk();
    Pull();
  }

  void WriteLastChunk() {
    if (is_writing_) return;
    is_writing_ = true;
    heartbeat_.cancel();
    stream_.expires_after(milliseconds(server_.options.limits.write_ms));
    net::async_write(stream_, http::make_chunk_last(),
                     [self = shared_from_this()](beast::error_code, size_t) {
                       self->Log();
                       self->Close();
                     });
  }

  /// Once for each request; a stream's end may be seen by its reading and its writing.
  void Log(const std::string& trouble = "") {
    if (!server_.options.log || (is_stream_ && std::exchange(stream_logged_, true))) return;
    const std::chrono::duration<double> spent = Clock::now() - begin_;
    server_.options.log({peer_, Printable(request_.method), Printable(request_.target), status_,
                         sent_bytes_, spent.count(), trouble});
  }

  Impl& server_;
  Stream stream_;
  beast::flat_buffer buffer_;
  Peer peer_;
  std::optional<http::request_parser<http::string_body>> parser_;
  HttpRequest request_;
  Clock::time_point begin_ = Clock::now();
  int status_ = 0;
  uint64_t sent_bytes_ = 0;
  bool is_idle_ = false;     // waits for a request of which nothing is known yet
  bool keep_alive_ = false;  // as the client wishes
  bool ending_ = false;
  bool discard_ = false;
  std::array<char, 4096> scrap_{};
  // Of streams.
  bool is_stream_ = false;
  bool is_writing_ = false;  // or asks its source
  bool pull_again_ = false;
  bool stream_logged_ = false;
  StreamSource source_;
  std::shared_ptr<Answer<http::empty_body>> stream_head_;
  std::string chunk_;
  net::steady_timer heartbeat_;
};

void HttpServer::Impl::Accept() {
  acceptor.async_accept([this](beast::error_code error, Socket socket) {
    if (stopping || error == net::error::operation_aborted) return;
    if (!error) {
      Accepted(std::move(socket));
      return Accept();
    }
    accept_pause.expires_after(kAcceptPause);
    accept_pause.async_wait([this](beast::error_code stopped) {
      if (!stopped) Accept();
    });
  });
}

void HttpServer::Impl::Accepted(Socket socket) {
  const Peer peer = PeerOf(socket.native_handle(), access);
  if (connections < PlacesFor(peer.role, options.limits.connections)) {
    std::make_shared<Session>(*this, std::move(socket), peer)->Read();
    return;
  }
  ++refused;
  const HttpResponse problem =
      Problem(503, "there are " + std::to_string(connections) + " connections already; close one");
  const std::string answer =
      "HTTP/1.1 503 Service Unavailable\r\nContent-Type: " + problem.content_type +
      "\r\nContent-Length: " + std::to_string(problem.body.size()) +
      "\r\nRetry-After: 1\r\nConnection: close\r\n\r\n" + problem.body;
  beast::error_code ignored;
  socket.non_blocking(true, ignored);
  socket.write_some(net::buffer(answer), ignored);
}

void HttpServer::Impl::Do(Bulk bulk) {
  waiting_bulk.push_back(std::move(bulk));
  Next();
}

void HttpServer::Impl::Next() {
  const int most = std::max(1, options.limits.handler_threads - kNeverBulk);
  if (waiting_bulk.empty() || running_bulk >= most) return;
  ++running_bulk;
  net::post(handlers, [this, work = std::move(waiting_bulk.front().work)]() mutable {
    work();
    net::post(io, [this, done = std::move(work)] {  // and its session, to where that may end
      --running_bulk;
      Next();
    });
  });
  waiting_bulk.pop_front();
}

void HttpServer::Impl::GiveUpLateBulk() {
  // All are as patient: the first waits the longest.
  while (!waiting_bulk.empty() && waiting_bulk.front().patience < Clock::now()) {
    const Bulk late = std::move(waiting_bulk.front());
    waiting_bulk.pop_front();
    late.give_up();
  }
}

void HttpServer::Impl::Beat() {
  GiveUpLateBulk();
  net::post(handlers, [this] { last_beat = Clock::now().time_since_epoch().count(); });
  beat.expires_after(kBeatInterval);
  beat.async_wait([this](beast::error_code error) {
    if (!error) Beat();
  });
}

void HttpServer::Impl::Gone(Session* session) {
  sessions.erase(session);
  const std::lock_guard lock(mutex);
  --connections;
  all_gone.notify_all();
}

void HttpServer::Impl::EndAll(bool at_once) {
  stopping = true;
  beast::error_code ignored;
  acceptor.close(ignored);
  accept_pause.cancel();
  const std::set<Session*> all = sessions;
  for (Session* session : all) at_once ? session->Close() : session->End();
  if (at_once) waiting_bulk.clear();
}

HttpServer::HttpServer() = default;

Result<std::unique_ptr<HttpServer>> HttpServer::Start(int listening_fd, Options options) {
  int listening = 0;
  socklen_t bytes = sizeof(listening);
  if (getsockopt(listening_fd, SOL_SOCKET, SO_ACCEPTCONN, &listening, &bytes) != 0 ||
      listening == 0) {
    return Error{ErrorCode::kInvalidArgument,
                 "descriptor " + std::to_string(listening_fd) + " is not a listening socket", ""};
  }
  std::unique_ptr<HttpServer> server(new HttpServer);
  server->impl_ = std::make_unique<Impl>(std::move(options));
  Impl& impl = *server->impl_;
  beast::error_code error;
  impl.acceptor.assign(Protocol(), listening_fd, error);
  if (error) return Error{ErrorCode::kInvalidArgument, error.message(), "listening socket"};
  impl.Beat();
  impl.thread = std::thread([&impl] { impl.io.run(); });
  return server;
}

HttpServer::~HttpServer() { Stop(milliseconds(0)); }

void HttpServer::Serve() {
  net::post(impl_->io, [this] { impl_->Accept(); });
}

void HttpServer::SetAccess(HttpAccess access) {
  net::post(impl_->io, [this, access = std::move(access)] { impl_->access = access; });
}

void HttpServer::Wake() {
  net::post(impl_->io, [this] {
    for (Impl::Session* session : impl_->sessions) {
      if (session->is_stream()) session->Pull();
    }
  });
}

std::chrono::milliseconds HttpServer::Silence() const {
  const Clock::time_point last{Clock::duration(impl_->last_beat.load())};
  return std::chrono::duration_cast<milliseconds>(Clock::now() - last);
}

HttpCounters HttpServer::counters() const {
  return {impl_->requests, impl_->refused, impl_->connections, impl_->streams};
}

void HttpServer::Stop(std::chrono::milliseconds patience) {
  if (!impl_->thread.joinable()) return;
  net::post(impl_->io, [this, patience] { impl_->EndAll(patience.count() == 0); });
  {
    std::unique_lock lock(impl_->mutex);
    impl_->all_gone.wait_for(lock, patience, [this] { return impl_->connections == 0; });
  }
  net::post(impl_->io, [this] {
    impl_->EndAll(true);
    impl_->beat.cancel();
  });
  impl_->handlers.join();  // their answers find closed connections
  net::post(impl_->io, [this] { impl_->io.stop(); });
  impl_->thread.join();
}

Result<int> ListenOn(const fs::path& path) {
  const auto failed = [&path](const std::string& what) {
    return Error{ErrorCode::kIo, what + ": " + std::strerror(errno), path.string()};
  };
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.native().size() >= sizeof(address.sun_path)) {
    return Error{ErrorCode::kInvalidArgument,
                 "is longer than the " + std::to_string(sizeof(address.sun_path) - 1) +
                     " bytes that a socket's name may have",
                 path.string()};
  }
  std::memcpy(address.sun_path, path.c_str(), path.native().size());
  const auto* name = reinterpret_cast<const sockaddr*>(&address);
  struct stat there {};
  if (lstat(path.c_str(), &there) == 0) {
    if (!S_ISSOCK(there.st_mode)) {
      return Error{ErrorCode::kAlreadyExists, "is there and not a socket", path.string()};
    }
    const int probe = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    const bool answered = probe >= 0 && connect(probe, name, sizeof(address)) == 0;
    if (probe >= 0) close(probe);
    if (answered) {
      return Error{ErrorCode::kAlreadyExists, "another program serves there", path.string()};
    }
    unlink(path.c_str());
  }
  const int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (fd < 0) return failed("no socket");
  if (bind(fd, name, sizeof(address)) != 0 || chmod(path.c_str(), 0660) != 0 ||
      listen(fd, kBacklog) != 0) {
    const Error error = failed("cannot be listened on");
    close(fd);
    return error;
  }
  return fd;
}

}  // namespace rotunda::daemon
