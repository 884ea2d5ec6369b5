#include "tests/support/simulated_daemon.h"

#include <fstream>
#include <stdexcept>
#include <thread>
#include <utility>

#include "tests/support/unix_http.h"

namespace rotunda::test {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;
using std::chrono::milliseconds;

constexpr auto kLook = milliseconds(50);
// Cameras that have not come by then never will.
constexpr auto kCamerasPatience = milliseconds(300000);

}  // namespace

bool WaitUntil(milliseconds patience, const std::function<bool()>& condition) {
  const auto deadline = std::chrono::steady_clock::now() + patience;
  while (!condition()) {
    if (std::chrono::steady_clock::now() > deadline) return false;
    std::this_thread::sleep_for(kLook);
  }
  return true;
}

std::string CaptureToml(const FrameSet& set, const std::string& block) {
  std::string text = "[capture]\nwidth_px = 0\nheight_px = 0\npixel_format = \"" +
                     set.frames.front().pixel_format + "\"\n[uplinks.u]\n";
  for (size_t i = 0; i < set.frames.size(); ++i) {
    text += "[cameras." + set.frames[i].camera + "]\nserial = \"" + set.frames[i].serial +
            "\"\naddress = \"" + block + "." + std::to_string(i + 1) + "\"\n";
  }
  return text;
}

SimulatedDaemon::SimulatedDaemon(Options options) : options_(std::move(options)) {
  const auto set = ReadFrameSet(options_.frame_sets.front());
  if (!set) throw std::runtime_error(set.error().ToString());
  const std::string cameras_socket = folder_ / "cameras.sock";
  std::ofstream(folder_ / "capture.toml") << CaptureToml(*set, options_.block);
  std::ofstream(folder_ / "rotundad.toml")
      << "[service]\nsocket = \"" << Socket().string() << "\"\nstate_folder = \""
      << State().string() << "\"\n[devices]\nboard = \"" << options_.board.string()
      << "\"\nsimulated_socket = \"" << cameras_socket << "\"\n"
      << options_.more_config;
  BackgroundProcess::Options serve;
  serve.arguments = {options_.command, "simulate", "--serve"};
  serve.arguments.insert(serve.arguments.end(), options_.frame_sets.begin(),
                         options_.frame_sets.end());
  serve.arguments.insert(serve.arguments.end(),
                         {"--block", options_.block, "--socket", cameras_socket});
  if (options_.hold) serve.arguments.push_back("--hold");
  serve.output = folder_ / "cameras.log";
  cameras_ = std::make_unique<BackgroundProcess>(serve);
  const bool there = WaitUntil(kCamerasPatience, [&] {
    if (!cameras_->Running()) return true;
    return RunProcess({options_.command, "simulate", "--socket", cameras_socket, "--send", "list"})
               .exit_code == 0;
  });
  if (!there || !cameras_->Running()) {
    throw std::runtime_error("the simulated cameras did not start:\n" + cameras_->Output());
  }
}

std::unique_ptr<BackgroundProcess> SimulatedDaemon::Start(
    const std::map<std::string, std::string>& environment) const {
  return std::make_unique<BackgroundProcess>(BackgroundProcess::Options{
      {options_.daemon, "--config", folder_ / "rotundad.toml"}, environment, {}, folder_ / "log"});
}

std::string SimulatedDaemon::Log() const {
  std::ifstream log(folder_ / "log");
  return std::string(std::istreambuf_iterator<char>(log), {});
}

void SimulatedDaemon::SendToCameras(std::vector<std::string> words) const {
  words.insert(words.begin(),
               {options_.command, "simulate", "--socket", folder_ / "cameras.sock", "--send"});
  const ProcessOutcome outcome = RunProcess(words);
  if (outcome.exit_code != 0) throw std::runtime_error(outcome.errors);
}

Json SimulatedDaemon::Ask(const std::string& method, const std::string& target,
                          const std::string& body) const {
  try {
    const auto answer = test::Ask(Socket(), method, target, body,
                                  body.empty() ? "" : "Content-Type: application/json\r\n");
    if (answer.status == 0 || answer.status >= 500) return nullptr;
    Json json = Json::parse(answer.body, nullptr, false);
    return json.is_discarded() ? Json() : json;
  } catch (const std::exception&) {
    return nullptr;
  }
}

std::optional<std::vector<Json>> SimulatedDaemon::All(const std::string& target) const {
  std::vector<Json> items;
  for (std::string after;;) {
    const Json page = Get(target + "?limit=500" + (after.empty() ? "" : "&after=" + after));
    if (!page.is_object() || !page.contains("items")) return std::nullopt;
    items.insert(items.end(), page["items"].begin(), page["items"].end());
    if (!page.contains("next")) return items;
    after = page["next"];
  }
}

bool SimulatedDaemon::WaitForCameras(size_t cameras, milliseconds patience) const {
  return WaitUntil(patience, [&] {
    const Json status = Get("/v1/status");
    return status.is_object() && status["cameras"]["ready"] == cameras;
  });
}

Json SimulatedDaemon::Ended(const Json& job, milliseconds patience) const {
  if (!job.is_object() || !job.contains("id")) {
    throw std::runtime_error("not a job: " + job.dump() + "\n" + Log());
  }
  const std::string target = "/v1/jobs/" + job["id"].dump();
  Json now;
  const bool ended = WaitUntil(patience, [&] {
    now = Get(target);
    return now.is_object() && now["state"] != "queued" && now["state"] != "running";
  });
  if (!ended) throw std::runtime_error("the job does not end: " + now.dump() + "\n" + Log());
  return now;
}

}  // namespace rotunda::test
