#include <sys/resource.h>
#include <xxhash.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <optional>
#include <vector>

#include "rig/frame_set_writer.h"
#include "tests/support/process.h"
#include "tests/support/simulated_rig.h"

// Shot after shot with simulated cameras on loopback: every frame's checksum is compared with what
// was served; memory, times and CPU are told along the way.

namespace rotunda {
namespace {

using Clock = std::chrono::steady_clock;

struct SoakOptions {
  int pulses = 1000;
  int cameras = 90;
  int width_px = 1200;
  int height_px = 1600;
  double drop = 0;      // probability that a packet is lost
  int write_every = 0;  // a frame set of every so many shots; 0: none
  int shots = 8;        // different pictures a camera
  std::string block = "127.40.1";
};

double Seconds(Clock::time_point since) {
  return std::chrono::duration<double>(Clock::now() - since).count();
}

double Cpu_s() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_utime.tv_sec + usage.ru_stime.tv_sec) +
         1e-6 * static_cast<double>(usage.ru_utime.tv_usec + usage.ru_stime.tv_usec);
}

double Memory_mb() {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    if (line.starts_with("VmRSS:")) return std::stod(line.substr(6)) / 1024;
  }
  return 0;
}

/// The pictures of all cameras in `shots` shots, made once, and their checksums.
class Served {
 public:
  Served(const SoakOptions& options, const std::vector<sim::SimulatedCamera>& cameras)
      : cameras_(options.cameras) {
    const auto pattern = sim::PatternSource(options.width_px, options.height_px);
    for (int shot = 0; shot < options.shots; ++shot) {
      for (int i = 0; i < options.cameras; ++i) {
        auto image = std::make_shared<sim::ServedImage>();
        image->width_px = options.width_px;
        image->height_px = options.height_px;
        image->format = cameras[i].format;
        image->bytes = test::ServedBytes(pattern, cameras[i], i, shot);
        sums_.push_back(XXH3_64bits(image->bytes.data(), image->bytes.size()));
        images_.push_back(std::move(image));
      }
    }
  }
  sim::FrameSource source() const {
    return [this](const sim::Exposure& exposure) {
      return images_[Place(exposure.camera, exposure.shot)];
    };
  }
  bool Matches(const rig::CameraFrame& frame, int camera, int shot) const {
    const size_t size = static_cast<size_t>(frame.width_px) * frame.height_px;
    return XXH3_64bits(frame.memory.data(), size) == sums_[Place(camera, shot)];
  }

 private:
  size_t Place(int camera, int shot) const {
    const int shots = static_cast<int>(images_.size()) / cameras_;
    return static_cast<size_t>(shot % shots) * cameras_ + camera;
  }
  const int cameras_;
  std::vector<std::shared_ptr<const sim::ServedImage>> images_;
  std::vector<uint64_t> sums_;
};

struct Tally {
  int good_shots = 0;
  int wrong_bytes = 0;
  std::vector<double> receive_s;
  std::vector<double> durable_s;
  uint64_t resent = 0;
  double max_skew_us = 0;
};

double Percentile(std::vector<double> values, double part) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  return values[static_cast<size_t>(part * static_cast<double>(values.size() - 1))];
}

void Count(const rig::Shot& shot, const Served& served, int pulse, Tally& tally) {
  double last_ms = 0;
  for (size_t i = 0; i < shot.cameras.size(); ++i) {
    const rig::CameraShot& camera = shot.cameras[i];
    last_ms = std::max(last_ms, camera.arrival_ms);
    if (camera.frame && !served.Matches(*camera.frame, static_cast<int>(i), pulse)) {
      ++tally.wrong_bytes;
    }
  }
  tally.good_shots += shot.complete();
  tally.receive_s.push_back(1e-3 * last_ms);
  tally.resent += shot.ResentPackets();
  tally.max_skew_us = std::max(tally.max_skew_us, shot.skew.max_us);
}

int Run(const SoakOptions& options) {
  test::SimulatedRig::Options rig_options;
  rig_options.block = options.block;
  rig_options.cameras = options.cameras;
  rig_options.like.width_px = options.width_px;
  rig_options.like.height_px = options.height_px;
  const Served served(options, sim::MakeCameras(options.cameras, rig_options.like));
  rig_options.source = served.source();
  test::SimulatedRig rig(rig_options);
  rig.capture().retries = 0;
  rig.capture().timing.deadline_ms = 10000;
  const auto opening = Clock::now();
  const auto session = rig.Open();
  if (!session) throw std::runtime_error(session.error().ToString());
  const size_t ready = (*session)->WaitUntilReady(std::chrono::seconds(60));
  std::printf("%zu of %d cameras ready after %.2f s, memory %.0f MB\n", ready, options.cameras,
              Seconds(opening), Memory_mb());
  if (options.drop > 0) {
    for (int i = 0; i < options.cameras; ++i) {
      static_cast<void>(rig.server().SetFault(i, {sim::FaultKind::kDropPackets, options.drop, 0}));
    }
  }
  const test::TemporaryFolder folder;
  rig::FrameSetWriter writer(0);
  Tally tally;
  std::optional<std::pair<rig::FrameSetWriter::Ticket, Clock::time_point>> writing;
  const auto begin = Clock::now();
  for (int pulse = 0; pulse < options.pulses; ++pulse) {
    rig.server().SetShot(pulse);
    const auto pulsed = Clock::now();
    auto shot = (*session)->Capture();
    if (!shot) throw std::runtime_error(shot.error().ToString());
    Count(*shot, served, pulse, tally);
    if (!shot->complete()) std::printf("pulse %d: %s\n", pulse, shot->Summary().c_str());
    if (writing && writer.pending() == 0) {
      const auto written = writer.Wait(writing->first);
      if (!written) throw std::runtime_error(written.error().ToString());
      std::filesystem::remove_all(written->folder);
      writing.reset();
    }
    if (options.write_every > 0 && pulse % options.write_every == 0 && !writing) {
      rig::FrameSetOrder order;
      order.out = folder / std::to_string(pulse);
      order.id = std::to_string(pulse);
      order.trigger_source = "simulated";
      writing.emplace(writer.Submit(order, std::move(*shot)), pulsed);
      if (pulse == 0) {  // nothing else goes on: from pulse to durable
        const auto written = writer.Wait(writing->first);
        if (!written) throw std::runtime_error(written.error().ToString());
        tally.durable_s.push_back(Seconds(pulsed));
        std::printf("pulse to durable frame set %.2f s, %.0f MB\n", Seconds(pulsed),
                    1e-6 * static_cast<double>(written->bytes));
        std::filesystem::remove_all(written->folder);
        writing.reset();
      }
    }
    const int step = std::max(1, options.pulses / 10);
    if ((pulse + 1) % step == 0) {
      std::printf(
          "%5d pulses: %d good, %d frames with wrong bytes, memory %.0f MB, %.2f s a shot\n",
          pulse + 1, tally.good_shots, tally.wrong_bytes, Memory_mb(),
          Seconds(begin) / (pulse + 1));
      std::fflush(stdout);
    }
  }
  std::printf(
      "last frame after the pulse: median %.3f s, 99 %% %.3f s; %llu packets sent again; largest "
      "skew %.1f us; CPU (cameras too) %.2f s a shot\n",
      Percentile(tally.receive_s, 0.5), Percentile(tally.receive_s, 0.99),
      static_cast<unsigned long long>(tally.resent), tally.max_skew_us, Cpu_s() / options.pulses);
  return tally.good_shots == options.pulses && tally.wrong_bytes == 0 ? 0 : 1;
}

}  // namespace
}  // namespace rotunda

int main(int argc, char** argv) {
  rotunda::SoakOptions options;
  CLI::App app("Takes shot after shot with simulated cameras and checks every byte");
  app.add_option("--pulses", options.pulses)->capture_default_str();
  app.add_option("--cameras", options.cameras)->capture_default_str();
  app.add_option("--width", options.width_px)->capture_default_str();
  app.add_option("--height", options.height_px)->capture_default_str();
  app.add_option("--drop", options.drop, "Part of the packets that is lost")->capture_default_str();
  app.add_option("--write-every", options.write_every, "Write the frame set of every Nth shot")
      ->capture_default_str();
  app.add_option("--block", options.block)->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  return rotunda::Run(options);
}
