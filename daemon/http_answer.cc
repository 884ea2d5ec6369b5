#include "daemon/http_answer.h"

#include <algorithm>
#include <type_traits>
#include <vector>

namespace rotunda::daemon {
namespace {

using std::chrono::milliseconds;

// Of a file, in memory at a time for each client that takes one.
constexpr uint64_t kFilePieceBytes = uint64_t{1} << 18;
constexpr char kFilesRetry_s[] = "10";
constexpr char kFilesHang[] = "the files are not read in time: does their disk or share answer?";

}  // namespace

template <typename Body>
struct AnswerSender::Answer {
  http::response<Body> response;
  std::optional<http::response_serializer<Body>> serializer;  // made when `response` is whole
  Clock::time_point deadline = {};                            // for all of it
  std::shared_ptr<const void> held = nullptr;
};

struct AnswerSender::FileAnswer : Answer<http::buffer_body> {
  beast::file file;
  uint64_t left_bytes = 0;
  std::vector<char> piece;
};

void AnswerSender::SendBody(HttpResponse response) {
  if (connection_.request.IsHead()) return SendHead(response, response.body.size());
  auto answer = std::make_shared<Answer<http::string_body>>();
  connection_.SetHeaders(response, answer->response);
  answer->held = std::move(response.held);
  answer->deadline = DeadlineFor(response.body.size());
  answer->response.body() = std::move(response.body);
  answer->response.prepare_payload();
  answer->serializer.emplace(answer->response);
  Write(std::move(answer));
}

void AnswerSender::SendHead(const HttpResponse& response, std::optional<uint64_t> bytes) {
  auto answer = std::make_shared<Answer<http::empty_body>>();
  connection_.SetHeaders(response, answer->response);
  answer->deadline = DeadlineFor(0);
  if (bytes) answer->response.content_length(*bytes);
  answer->serializer.emplace(answer->response);
  Write(std::move(answer));
}

void AnswerSender::SendTooLate() {
  HttpResponse response = Problem(503, kFilesHang);
  response.headers.emplace_back("Retry-After", kFilesRetry_s);
  SendBody(std::move(response));
}

Clock::time_point AnswerSender::DeadlineFor(uint64_t bytes) const {
  const auto rate = static_cast<uint64_t>(connection_.server.options.limits.least_bytes_per_s);
  return connection_.Patience() + milliseconds(1000 * bytes / rate);
}

void AnswerSender::SendFile(HttpResponse response) {
  const auto keep = connection_.shared_from_this();
  connection_.server.bulk.Do(
      {[this, keep, response = std::move(response)] {
         auto answer = std::make_shared<FileAnswer>();
         beast::error_code error;
         answer->file.open(response.file->c_str(), beast::file_mode::scan, error);
         if (!error) answer->left_bytes = answer->file.size(error);
         net::post(connection_.server.io,
                   [this, keep, response, answer, error] { OnFile(response, answer, error); });
       },
       [this, keep] { SendTooLate(); }, connection_.Patience()});
}

void AnswerSender::OnFile(const HttpResponse& response, const std::shared_ptr<FileAnswer>& answer,
                          beast::error_code error) {
  if (error) {
    return SendBody(Problem(error == beast::errc::no_such_file_or_directory ? 404 : 503,
                            response.file->filename().string() + ": " + error.message()));
  }
  if (connection_.request.IsHead()) return SendHead(response, answer->left_bytes);
  connection_.SetHeaders(response, answer->response);
  answer->deadline = DeadlineFor(answer->left_bytes);
  answer->response.content_length(answer->left_bytes);
  answer->serializer.emplace(answer->response);
  ReadPiece(answer);
}

void AnswerSender::ReadPiece(const std::shared_ptr<FileAnswer>& answer) {
  const auto keep = connection_.shared_from_this();
  connection_.server.bulk.Do(
      {[this, keep, answer] {
         std::string trouble = NextPiece(*answer);
         net::post(connection_.server.io, [this, keep, answer, trouble = std::move(trouble)] {
           // Cut off, so that the client does not take it for the whole file.
           if (!trouble.empty()) return connection_.CutOff(trouble);
           OnFilePiece(answer);
         });
       },
       [this, keep] { connection_.CutOff(kFilesHang); }, connection_.Patience()});
}

/// What is wrong; empty: nothing.
std::string AnswerSender::NextPiece(FileAnswer& answer) {
  const uint64_t bytes = std::min(kFilePieceBytes, answer.left_bytes);
  answer.piece.resize(bytes);
  beast::error_code error;
  const size_t read = bytes > 0 ? answer.file.read(answer.piece.data(), bytes, error) : 0;
  if (error) return error.message();
  return read < bytes ? "the file is shorter than it was" : "";
}

void AnswerSender::OnFilePiece(const std::shared_ptr<FileAnswer>& answer) {
  answer->left_bytes -= answer->piece.size();
  http::buffer_body::value_type& body = answer->response.body();
  body.data = answer->piece.data();
  body.size = answer->piece.size();
  body.more = answer->left_bytes > 0;
  Write(answer);
}

template <typename AnyAnswer>
void AnswerSender::Write(std::shared_ptr<AnyAnswer> answer) {
  connection_.stream.expires_at(std::min(connection_.Patience(), answer->deadline));
  http::async_write_some(
      connection_.stream, *answer->serializer,
      [this, keep = connection_.shared_from_this(), answer](beast::error_code error, size_t bytes) {
        connection_.sent_bytes += bytes;
        if constexpr (std::is_same_v<AnyAnswer, FileAnswer>) {
          if (error == http::error::need_buffer) return ReadPiece(answer);
        }
        if (error) return connection_.CutOff("");
        if (!answer->serializer->is_done()) return Write(answer);
        connection_.OnAnswered(answer->response.keep_alive());
      });
}

}  // namespace rotunda::daemon
