#include <algorithm>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "daemon/api.h"
#include "daemon/calibration_request.h"
#include "daemon/capture_job.h"
#include "daemon/reconstruction_request.h"
#include "tests/fuzz/fuzz_input.h"

namespace {

using namespace rotunda;
namespace fs = std::filesystem;

/// The API over an empty store; jobs are checked as in the daemon, and do nothing.
class Api {
 public:
  Api() {
    folder_ = fs::temp_directory_path();
    folder_ += "/rotunda-api-fuzz-XXXXXX";
    fuzz::Require(mkdtemp(folder_.data()) != nullptr, "a folder can be made");
    auto store = daemon::Store::Open(
        {folder_ + "/state", [] { return std::chrono::system_clock::time_point(); }, {}}, events_);
    fuzz::Require(store.ok(), "a store can be made");
    store_ = std::move(*store);
    daemon::JobHandlers handlers{daemon::MakeCaptureHandler(*store_, station_, {}),
                                 daemon::CalibrationRequests(*store_),
                                 daemon::ReconstructionRequests(*store_)};
    for (auto* handler : {&handlers.capture, &handlers.calibration, &handlers.reconstruction}) {
      handler->run = [](const daemon::JobRecord&, daemon::JobContext&) -> Result<std::string> {
        return std::string("{}");
      };
    }
    jobs_ = std::make_unique<daemon::JobQueue>(*store_, std::move(handlers),
                                               daemon::JobQueue::Options());
    router_ = std::make_unique<daemon::Router>(
        daemon::ApiRoutes({*store_, *jobs_, station_, "0", "", [] { return uint64_t{0}; },
                           [] { return daemon::HttpCounters(); }}),
        std::map<daemon::Role, std::string>{});
  }
  ~Api() {
    router_.reset();
    jobs_.reset();
    store_.reset();
    std::error_code ignored;
    fs::remove_all(folder_, ignored);
  }

  void Check(const daemon::HttpRequest& request) {
    daemon::HttpResponse response = router_->Handle(request);
    if (response.bulk) response = response.bulk();
    if (response.stream) response.stream();
    if (response.file) {
      fuzz::Require(response.file->native().starts_with(folder_ + "/state/"),
                    "a file is inside of the state folder");
      fuzz::Require(std::none_of(response.file->begin(), response.file->end(),
                                 [](const fs::path& part) { return part == ".."; }),
                    "a file's path does not go up");
    }
    if (response.status < 300) return;
    const auto problem = nlohmann::json::parse(response.body, nullptr, false);
    fuzz::Require(problem.is_object() && problem.contains("detail"), "a refusal says why");
    fuzz::Require(response.status < 500 || response.status == 503, "no failure of our own");
  }

 private:
  std::string folder_;
  daemon::EventHub events_;
  std::unique_ptr<daemon::Store> store_;
  daemon::CaptureStation station_{daemon::CaptureStation::Options()};
  std::unique_ptr<daemon::JobQueue> jobs_;
  std::unique_ptr<daemon::Router> router_;
};

}  // namespace

/// "METHOD TARGET", then lines of headers up to an empty one, then the body; by an operator.
extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  static Api api;
  const std::string text(reinterpret_cast<const char*>(data), size);
  daemon::HttpRequest request;
  request.peer.role = daemon::Role::kOperator;
  size_t end = std::min(text.find('\n'), text.size());
  const size_t space = std::min(text.find(' '), end);
  request.method = text.substr(0, space);
  request.target = text.substr(std::min(space + 1, end), end - std::min(space + 1, end));
  for (size_t begin = end + 1; begin < text.size(); begin = end + 1) {
    end = std::min(text.find('\n', begin), text.size());
    if (end == begin) {
      request.body = text.substr(std::min(end + 1, text.size()));
      break;
    }
    const std::string line = text.substr(begin, end - begin);
    const size_t colon = std::min(line.find(": "), line.size());
    request.headers[line.substr(0, colon)] = line.substr(std::min(colon + 2, line.size()));
  }
  api.Check(request);
  return 0;
}
