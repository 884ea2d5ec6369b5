#include "daemon/cli/api_client.h"

#include <sys/un.h>

#include <utility>
// <utility> must be there before Boost 1.74's Asio under C++20.
#include <boost/asio/io_context.hpp>
#include <boost/asio/local/stream_protocol.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <chrono>
#include <optional>

namespace rotunda::cli {
namespace {

namespace net = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
using Json = nlohmann::ordered_json;
using Protocol = net::local::stream_protocol;
using ErrorValue = beast::error_code;

constexpr auto kStopInterval = std::chrono::milliseconds(50);
constexpr int kHttp11 = 11;
// Lists and results are far smaller; pictures and archives are not asked for here.
constexpr uint64_t kMaxAnswerBytes = 256u << 20;

/// A connection whose operations end early when `stop` is set.
class Connection {
 public:
  explicit Connection(std::stop_token stop) : stop_(std::move(stop)) {}

  Status Open(const std::filesystem::path& path) {
    ErrorValue error;
    // Asio throws for a name that is too long for a socket.
    if (path.native().size() >= sizeof(sockaddr_un::sun_path)) {
      error = net::error::name_too_long;
    } else {
      socket_.connect(Protocol::endpoint(path.string()), error);
    }
    if (!error) return {};
    return Error{ErrorCode::kNotFound,
                 error == net::error::access_denied
                     ? "you may not use this socket; ask to be made a member of its group"
                     : "no daemon serves there (" + error.message() +
                           "); start it (systemctl start rotunda), or give another --socket",
                 path.string()};
  }

  /// Runs what was begun until `done`.
  Status Wait(const std::optional<ErrorValue>& done) {
    while (!done && !stop_.stop_requested()) {
      io_.restart();
      io_.run_for(kStopInterval);
    }
    if (!done) return Error{ErrorCode::kCancelled, "interrupted", ""};
    if (*done) return Error{ErrorCode::kIo, "the connection broke: " + done->message(), "daemon"};
    return {};
  }

  Status Send(const http::request<http::string_body>& request) {
    std::optional<ErrorValue> done;
    http::async_write(socket_, request, [&](ErrorValue error, size_t) { done = error; });
    return Wait(done);
  }

  template <typename Parser>
  Status ReadAll(Parser& parser) {
    std::optional<ErrorValue> done;
    http::async_read(socket_, buffer_, parser, [&](ErrorValue error, size_t) { done = error; });
    return Wait(done);
  }
  template <typename Parser>
  Status ReadHeader(Parser& parser) {
    std::optional<ErrorValue> done;
    http::async_read_header(socket_, buffer_, parser,
                            [&](ErrorValue error, size_t) { done = error; });
    return Wait(done);
  }
  template <typename Parser>
  Status ReadSome(Parser& parser) {
    std::optional<ErrorValue> done;
    http::async_read_some(socket_, buffer_, parser,
                          [&](ErrorValue error, size_t) { done = error; });
    return Wait(done);
  }

 private:
  const std::stop_token stop_;
  net::io_context io_{1};
  Protocol::socket socket_{io_};
  beast::flat_buffer buffer_;
};

http::request<http::string_body> MakeRequest(const std::string& method, const std::string& target,
                                             const std::string& body) {
  http::request<http::string_body> request(http::string_to_verb(method), target, kHttp11);
  request.set(http::field::host, "localhost");
  request.set(http::field::user_agent, "rotunda");
  if (!body.empty()) request.set(http::field::content_type, "application/json");
  request.body() = body;
  request.prepare_payload();
  return request;
}

/// What an error answer says.
Error Refused(unsigned status, const std::string& body) {
  const Json problem = Json::parse(body, nullptr, false);
  const bool says_why = problem.is_object() && problem.contains("detail");
  return {status == 404 ? ErrorCode::kNotFound : ErrorCode::kFailed,
          says_why ? problem["detail"].get<std::string>()
                   : "it answered with status " + std::to_string(status),
          "daemon"};
}

/// Takes whole events out of `text` and hands over their data.
void HandOver(std::string& text, const ApiClient::OnEvent& on_event) {
  for (size_t end; (end = text.find("\n\n")) != std::string::npos; text.erase(0, end + 2)) {
    const std::string block = "\n" + text.substr(0, end) + "\n";
    const size_t data = block.find("\ndata: ");
    if (data == std::string::npos) continue;
    const size_t begin = data + 7;
    const Json event =
        Json::parse(block.substr(begin, block.find('\n', begin) - begin), nullptr, false);
    if (event.is_object()) on_event(event);
  }
}

}  // namespace

ApiClient::ApiClient(std::filesystem::path socket, std::stop_token stop)
    : socket_(std::move(socket)), stop_(std::move(stop)) {}

Result<Json> ApiClient::Get(const std::string& target) const { return Ask("GET", target, ""); }
Result<Json> ApiClient::Post(const std::string& target, const Json& body) const {
  return Ask("POST", target, body.is_null() ? "" : body.dump());
}
Result<Json> ApiClient::Delete(const std::string& target) const {
  return Ask("DELETE", target, "");
}

Result<Json> ApiClient::Ask(const std::string& method, const std::string& target,
                            const std::string& body) const {
  Connection connection(stop_);
  ROTUNDA_RETURN_IF_ERROR(connection.Open(socket_));
  ROTUNDA_RETURN_IF_ERROR(connection.Send(MakeRequest(method, target, body)));
  http::response_parser<http::string_body> parser;
  parser.body_limit(kMaxAnswerBytes);
  ROTUNDA_RETURN_IF_ERROR(connection.ReadAll(parser));
  const auto& answer = parser.get();
  if (answer.result_int() >= 300) return Refused(answer.result_int(), answer.body());
  Json value = Json::parse(answer.body(), nullptr, false);
  if (!value.is_discarded()) return value;
  return Error{ErrorCode::kFailed, "its answer is not JSON", "daemon"};
}

Status ApiClient::Follow(const std::string& target, const OnEvent& on_event) const {
  Connection connection(stop_);
  ROTUNDA_RETURN_IF_ERROR(connection.Open(socket_));
  ROTUNDA_RETURN_IF_ERROR(connection.Send(MakeRequest("GET", target, "")));
  http::response_parser<http::string_body> parser;
  parser.body_limit(boost::none);
  ROTUNDA_RETURN_IF_ERROR(connection.ReadHeader(parser));
  if (parser.get().result_int() != 200) {
    ROTUNDA_RETURN_IF_ERROR(connection.ReadAll(parser));
    return Refused(parser.get().result_int(), parser.get().body());
  }
  std::string text;
  while (!parser.is_done()) {
    ROTUNDA_RETURN_IF_ERROR(connection.ReadSome(parser));
    text += std::exchange(parser.get().body(), "");
    HandOver(text, on_event);
  }
  return {};
}

}  // namespace rotunda::cli
