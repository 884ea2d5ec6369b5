#include "tests/support/served_cameras.h"

#include <chrono>
#include <stdexcept>
#include <utility>

namespace rotunda::test {

ServedCameras::ServedCameras(Options options) : options_(std::move(options)) {
  server_ = std::thread([this] {
    std::vector<std::string> arguments = {
        options_.command, "simulate",     "--serve",  options_.frame_set.string(),
        "--block",        options_.block, "--socket", socket()};
    arguments.insert(arguments.end(), options_.more.begin(), options_.more.end());
    outcome_ = RunProcess(arguments, [this] { return done_.load(); });
    ended_ = true;
  });
  while (!ended_ && Send({"list"}).exit_code != 0) {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  if (!ended_) return;
  End();
  throw std::runtime_error("the simulated cameras did not start: " + outcome_.errors);
}

ProcessOutcome ServedCameras::Send(std::vector<std::string> words) const {
  words.insert(words.begin(), {options_.command, "simulate", "--socket", socket(), "--send"});
  return RunProcess(words);
}

const ProcessOutcome& ServedCameras::End() {
  done_ = true;
  if (server_.joinable()) server_.join();
  return outcome_;
}

}  // namespace rotunda::test
