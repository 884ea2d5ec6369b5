#include <xxhash.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "rig/frame_set_writer.h"
#include "tests/bench/process_cost.h"
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
  std::string block = "127.60.1";
};

double Memory_mb() {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    if (line.starts_with("VmRSS:")) return std::stod(line.substr(6)) / 1024;
  }
  return 0;
}

// The kernel's counting of resident pages and the allocator's caches move by a few megabytes; one
// frame a shot that is not given back would be 1.9 MB a pulse.
constexpr double kMemoryNoise_mb = 40;

sim::SimulatedCamera CameraOf(const SoakOptions& options) {
  sim::SimulatedCamera camera;
  camera.width_px = options.width_px;
  camera.height_px = options.height_px;
  return camera;
}

/// The pictures of all cameras in `shots` shots, made once, and their checksums.
class Served {
 public:
  explicit Served(const SoakOptions& options) : cameras_(options.cameras) {
    const auto cameras = sim::MakeCameras(options.cameras, CameraOf(options));
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

double Percentile(std::vector<double> values, double part) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  return values[static_cast<size_t>(part * static_cast<double>(values.size() - 1))];
}

test::SimulatedRig::Options RigOf(const SoakOptions& options, const Served& served) {
  test::SimulatedRig::Options rig;
  rig.block = options.block;
  rig.cameras = options.cameras;
  rig.like = CameraOf(options);
  rig.source = served.source();
  return rig;
}

class Soak {
 public:
  explicit Soak(const SoakOptions& options)
      : options_(options), served_(options), rig_(RigOf(options, served_)), writer_(0) {
    rig_.capture().retries = 0;
    rig_.capture().timing.deadline_ms = 10000;
  }

  /// True when every shot was complete, every byte right and memory stayed.
  bool Run() {
    Open();
    for (int pulse = 0; pulse < options_.pulses; ++pulse) {
      Shoot(pulse);
      // Buffers, pools and the allocator have what they need by then.
      if (pulse + 1 == std::max(5, options_.pulses / 10)) settled_mb_ = Memory_mb();
      if ((pulse + 1) % std::max(1, options_.pulses / 10) == 0) PrintProgress(pulse + 1);
    }
    const double grown_mb = Memory_mb() - settled_mb_;
    std::printf(
        "last frame after the pulse: median %.3f s, 99 %% %.3f s; %llu packets sent again; largest "
        "skew %.1f us; CPU (cameras too) %.2f s a shot; memory grew by %.1f MB\n",
        Percentile(arrivals_s_, 0.5), Percentile(arrivals_s_, 0.99),
        static_cast<unsigned long long>(resent_), max_skew_us_, Cpu_s() / options_.pulses,
        grown_mb);
    return good_shots_ == options_.pulses && wrong_bytes_ == 0 && grown_mb < kMemoryNoise_mb;
  }

 private:
  void Open() {
    const auto begin = Clock::now();
    session_ = Must(rig_.Open());
    const size_t ready = session_->WaitUntilReady(std::chrono::seconds(60));
    std::printf("%zu of %d cameras ready after %.2f s, memory %.0f MB\n", ready, options_.cameras,
                SecondsSince(begin), Memory_mb());
    for (int i = 0; options_.drop > 0 && i < options_.cameras; ++i) {
      const sim::Fault lossy{sim::FaultKind::kDropPackets, options_.drop, 0};
      if (!rig_.server().SetFault(i, lossy)) throw std::runtime_error("cannot set the fault");
    }
    begin_ = Clock::now();
  }

  void Shoot(int pulse) {
    rig_.server().SetShot(pulse);
    rig::Shot shot = Must(session_->Capture());
    Count(shot, pulse);
    RemoveWritten();
    if (options_.write_every == 0 || pulse % options_.write_every != 0 || writing_) return;
    rig::FrameSetOrder order;
    order.out = folder_ / std::to_string(pulse);
    order.id = std::to_string(pulse);
    order.captured_at = "2026-01-01T00:00:00Z";
    order.trigger_source = "simulated";
    writing_ = writer_.Submit(order, std::move(shot));
  }

  void Count(const rig::Shot& shot, int pulse) {
    double last_ms = 0;
    for (size_t i = 0; i < shot.cameras.size(); ++i) {
      const rig::CameraShot& camera = shot.cameras[i];
      last_ms = std::max(last_ms, camera.arrival_ms);
      wrong_bytes_ += camera.frame && !served_.Matches(*camera.frame, static_cast<int>(i), pulse);
    }
    good_shots_ += shot.complete();
    arrivals_s_.push_back(1e-3 * last_ms);
    resent_ += shot.ResentPackets();
    max_skew_us_ = std::max(max_skew_us_, shot.skew.max_us);
    if (!shot.complete()) std::printf("pulse %d: %s\n", pulse, shot.Summary().c_str());
  }

  /// Sets are written while the shots go on; the disk need not hold them all.
  void RemoveWritten() {
    if (!writing_ || writer_.pending() > 0) return;
    std::filesystem::remove_all(Must(writer_.Wait(*writing_)).folder);
    writing_.reset();
    ++written_;
  }

  void PrintProgress(int pulses) const {
    std::printf(
        "%5d pulses: %d good, %d frames with wrong bytes, %d sets written, memory %.0f MB, %.2f s "
        "a shot\n",
        pulses, good_shots_, wrong_bytes_, written_, Memory_mb(), SecondsSince(begin_) / pulses);
    std::fflush(stdout);
  }

  const SoakOptions options_;
  const Served served_;
  const test::TemporaryFolder folder_;
  test::SimulatedRig rig_;
  std::unique_ptr<rig::CaptureSession> session_;
  rig::FrameSetWriter writer_;  // goes first: it holds frames of the session's memory
  std::optional<rig::FrameSetWriter::Ticket> writing_;
  Clock::time_point begin_;
  double settled_mb_ = 0;
  int good_shots_ = 0;
  int wrong_bytes_ = 0;
  int written_ = 0;
  std::vector<double> arrivals_s_;
  uint64_t resent_ = 0;
  double max_skew_us_ = 0;
};

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
  try {
    return rotunda::Soak(options).Run() ? 0 : 1;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "capture_soak: %s\n", error.what());
    return 1;
  }
}
