#include "daemon/cli/api_client.h"

#include <grp.h>
#include <sys/stat.h>
#include <sys/un.h>

#include <utility>
// <utility> must be there before Boost 1.74's Asio under C++20.
#include <boost/asio/io_context.hpp>
#include <boost/asio/local/stream_protocol.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <cctype>
#include <chrono>
#include <cstring>
#include <limits>
#include <optional>
#include <sstream>

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

/// Who may use the socket, as far as it can be seen.
std::string GroupOf(const std::filesystem::path& socket) {
  struct stat found {};
  const ::group* const group =
      ::stat(socket.c_str(), &found) == 0 ? ::getgrgid(found.st_gid) : nullptr;
  if (group == nullptr) return "its group";
  const std::string name = group->gr_name;
  return "its group (usermod -aG " + name + " NAME)";
}

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
                     ? "you may not use this socket; ask to be made a member of " + GroupOf(path)
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

/// The value of a field of a block of a stream; empty when it is not there.
std::string FieldIn(const std::string& block, const std::string& name) {
  std::istringstream lines(block);
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with(name + ": ")) return line.substr(name.size() + 2);
  }
  return "";
}

/// Takes whole blocks out of `text`, hands over the data of those that are events, and keeps the
/// last id.
void HandOver(std::string& text, std::string& last_id, const ApiClient::OnEvent& on_event) {
  for (size_t end; (end = text.find("\n\n")) != std::string::npos; text.erase(0, end + 2)) {
    const std::string block = text.substr(0, end);
    const Json event = Json::parse(FieldIn(block, "data"), nullptr, false);
    if (event.is_object()) on_event(event);
    if (std::string id = FieldIn(block, "id"); !id.empty()) last_id = std::move(id);
  }
}

}  // namespace

std::string PercentEncoded(const std::string& text) {
  constexpr char kDigits[] = "0123456789ABCDEF";
  std::string encoded;
  for (const char letter : text) {
    const auto byte = static_cast<unsigned char>(letter);
    if (byte < 0x80 && (std::isalnum(byte) != 0 || std::strchr("-._~", letter) != nullptr)) {
      encoded += letter;
    } else {
      encoded += {'%', kDigits[byte >> 4], kDigits[byte & 0xF]};
    }
  }
  return encoded;
}

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

Status ApiClient::Follow(const std::string& target, std::string& last_id,
                         const OnEvent& on_event) const {
  Connection connection(stop_);
  ROTUNDA_RETURN_IF_ERROR(connection.Open(socket_));
  ROTUNDA_RETURN_IF_ERROR(connection.Send(MakeRequest("GET", target, "")));
  http::response_parser<http::string_body> parser;
  // Boost 1.74 takes boost::none for less than any Content-Length, and an error answer has one.
  parser.body_limit(std::numeric_limits<uint64_t>::max());
  ROTUNDA_RETURN_IF_ERROR(connection.ReadHeader(parser));
  if (parser.get().result_int() != 200) {
    ROTUNDA_RETURN_IF_ERROR(connection.ReadAll(parser));
    return Refused(parser.get().result_int(), parser.get().body());
  }
  std::string text;
  while (!parser.is_done()) {
    ROTUNDA_RETURN_IF_ERROR(connection.ReadSome(parser));
    text += std::exchange(parser.get().body(), "");
    HandOver(text, last_id, on_event);
  }
  return {};
}

}  // namespace rotunda::cli
