#include <xxhash.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "rig/frame_set_writer.h"
#include "sfm/core/frame_set.h"
#include "sfm/core/run_context.h"
#include "tests/bench/process_cost.h"
#include "tests/support/process.h"
#include "tests/support/simulated_rig.h"

// Shot after shot with simulated cameras on loopback, first with nothing lost, then with packets
// that are: every frame's checksum and number are compared with what was served, frame sets are
// written meanwhile and read back; memory, times and CPU are told along the way.

namespace rotunda {
namespace {

using Clock = std::chrono::steady_clock;

struct SoakOptions {
  int pulses = 1000;
  int lossy_pulses = 50;
  double drop = 0.05;  // probability that a packet is lost in the lossy ones
  int cameras = 90;
  int width_px = 1200;
  int height_px = 1600;
  int write_every = 20;  // a frame set of every so many shots; 0: none
  int shots = 8;         // different pictures a camera
  std::string block = "127.60.1";
};

/// Pulses in a row with the same cameras.
struct Phase {
  const char* name;
  int pulses;
  double drop;
  bool ids_restart;  // at 1 whenever a camera is armed; else they count on
};

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
  /// Whether these are the bytes that `camera` saw in `shot`.
  bool Matches(const uint8_t* bytes, size_t size, int camera, int shot) const {
    return XXH3_64bits(bytes, size) == sums_[Place(camera, shot)];
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

test::SimulatedRig::Options RigOf(const SoakOptions& options, const Phase& phase,
                                  const Served& served) {
  test::SimulatedRig::Options rig;
  rig.block = options.block;
  rig.cameras = options.cameras;
  rig.like = CameraOf(options);
  rig.restart_frame_ids = phase.ids_restart;
  rig.source = served.source();
  return rig;
}

class Soak {
 public:
  Soak(const SoakOptions& options, const Phase& phase, const Served& served)
      : options_(options),
        phase_(phase),
        served_(served),
        rig_(RigOf(options, phase, served)),
        writer_(0) {
    rig_.capture().retries = 0;
    rig_.capture().timing.deadline_ms = 10000;
  }

  /// True when nothing was broken.
  bool Run() {
    std::printf("%s:\n", phase_.name);
    Open();
    const double cpu_s = Cpu_s();
    for (int pulse = 0; pulse < phase_.pulses; ++pulse) {
      Shoot(pulse);
      // Buffers, pools and the allocator have what they need by then.
      if (pulse + 1 == std::min(phase_.pulses, std::max(5, phase_.pulses / 10))) {
        settled_ = FootprintNow();
      }
      if ((pulse + 1) % std::max(1, phase_.pulses / 10) == 0) PrintProgress(pulse + 1);
    }
    if (writing_) CheckWritten();
    std::printf(
        "last frame after the pulse: median %.3f s, 99 %% %.3f s; %llu packets sent again; largest "
        "skew %.1f us; CPU (cameras too) %.2f s a shot\n",
        Percentile(arrivals_s_, 0.5), Percentile(arrivals_s_, 0.99),
        static_cast<unsigned long long>(resent_), max_skew_us_, (Cpu_s() - cpu_s) / phase_.pulses);
    const bool flat = StayedFlat();
    return IsWhole() && flat;
  }

 private:
  void Open() {
    const auto begin = Clock::now();
    session_ = Must(rig_.Open());
    const size_t ready = session_->WaitUntilReady(std::chrono::seconds(60));
    std::printf("%zu of %d cameras ready after %.2f s, memory %.0f MB\n", ready, options_.cameras,
                SecondsSince(begin), FootprintNow().memory_mb);
    for (const rig::CameraState& state : session_->States()) {
      warm_up_ids_.push_back(state.last_frame_id.value_or(0));
    }
    for (int i = 0; phase_.drop > 0 && i < options_.cameras; ++i) {
      const sim::Fault lossy{sim::FaultKind::kDropPackets, phase_.drop, 0};
      if (!rig_.server().SetFault(i, lossy)) throw std::runtime_error("cannot set the fault");
    }
    begin_ = Clock::now();
  }

  void Shoot(int pulse) {
    rig_.server().SetShot(pulse);
    while_writing_ += writer_.pending() > 0;
    rig::Shot shot = Must(session_->Capture());
    Count(shot, pulse);
    if (writing_ && writer_.pending() == 0) CheckWritten();
    if (options_.write_every == 0 || pulse % options_.write_every != 0 || writing_) return;
    rig::FrameSetOrder order;
    order.out = folder_ / std::to_string(pulse);
    order.id = std::to_string(pulse);
    order.captured_at = "2026-01-01T00:00:00Z";
    order.trigger_source = "simulated";
    writing_ = Writing{writer_.Submit(order, std::move(shot)), pulse};
  }

  void Count(const rig::Shot& shot, int pulse) {
    double last_ms = 0;
    for (size_t i = 0; i < shot.cameras.size(); ++i) {
      const rig::CameraShot& camera = shot.cameras[i];
      last_ms = std::max(last_ms, camera.arrival_ms.value_or(0));
      if (!camera.frame) continue;
      const rig::CameraFrame& frame = *camera.frame;
      const size_t size = static_cast<size_t>(frame.width_px) * frame.height_px;
      const uint64_t next_id = warm_up_ids_[i] + 1 + static_cast<uint64_t>(pulse);
      wrong_ids_ += frame.frame_id != (phase_.ids_restart ? 1 : next_id);
      wrong_bytes_ += !served_.Matches(frame.memory.data(), size, static_cast<int>(i), pulse);
    }
    good_shots_ += shot.complete() && shot.cameras.size() == static_cast<size_t>(options_.cameras);
    arrivals_s_.push_back(1e-3 * last_ms);
    resent_ += shot.ResentPackets();
    max_skew_us_ = std::max(max_skew_us_, shot.skew.max_us);
    if (!shot.complete()) std::printf("pulse %d: %s\n", pulse, shot.Summary().c_str());
  }

  /// Waits for the set that is being written, decodes its files and compares them too. Removes it:
  /// the disk need not hold them all.
  void CheckWritten() {
    const rig::WrittenSet written = Must(writer_.Wait(writing_->ticket));
    const FrameSet set = Must(ReadFrameSet(written.folder));
    std::atomic<int> same = 0;
    readers_.ParallelFor(set.frames.size(), [&](size_t i) {
      const std::string file = (set.folder / set.frames[i].file).string();
      const cv::Mat picture = cv::imread(file, cv::IMREAD_UNCHANGED);
      same += picture.type() == CV_8UC1 && picture.isContinuous() &&
              served_.Matches(picture.data, picture.total(), static_cast<int>(i), writing_->pulse);
    });
    const bool whole = same == options_.cameras && set.trigger.at("complete") == TriggerValue(true);
    wrong_sets_ += !whole;
    ++written_;
    std::filesystem::remove_all(written.folder);
    writing_.reset();
  }

  void PrintProgress(int pulses) const {
    std::printf(
        "%5d pulses: %d good, %d frames with wrong bytes, %d with a wrong number, %d sets written, "
        "memory %.0f MB, %.2f s a shot\n",
        pulses, good_shots_, wrong_bytes_, wrong_ids_, written_, FootprintNow().memory_mb,
        SecondsSince(begin_) / pulses);
    std::fflush(stdout);
  }

  bool StayedFlat() const {
    const Footprint now = FootprintNow();
    const double grown_mb = now.memory_mb - settled_.memory_mb;
    std::printf(
        "since it had settled: memory %+.1f MB, threads %+d, descriptors %+d; frames may take "
        "%.0f MB\n",
        grown_mb, now.threads - settled_.threads, now.descriptors - settled_.descriptors,
        1e-6 * static_cast<double>(session_->MemoryLimit_bytes()));
    // A camera that is just being asked whether it is still there has a descriptor more.
    const int spare = options_.cameras;
    const bool flat = grown_mb < kMemoryNoise_mb && now.threads <= settled_.threads + spare &&
                      now.descriptors <= settled_.descriptors + spare;
    if (!flat) std::printf("BROKEN: it grows\n");
    return flat;
  }

  bool IsWhole() const {
    const bool frames = good_shots_ == phase_.pulses && wrong_bytes_ == 0 && wrong_ids_ == 0;
    if (!frames) {
      std::printf("BROKEN: %d of %d shots good, %d frames with wrong bytes, %d wrong numbers\n",
                  good_shots_, phase_.pulses, wrong_bytes_, wrong_ids_);
    }
    const bool lossy = phase_.drop == 0 || resent_ > 0;
    if (!lossy) std::printf("BROKEN: packets were to be lost, and none was sent again\n");
    std::printf("%d sets written and read back, %d not as served; %d pulses meanwhile\n", written_,
                wrong_sets_, while_writing_);
    if (wrong_sets_ > 0) std::printf("BROKEN: sets are not what was served\n");
    const bool overlapped = written_ == 0 || phase_.pulses == 1 || while_writing_ > 0;
    if (!overlapped) std::printf("BROKEN: no pulse was taken while a set was being written\n");
    return frames && lossy && wrong_sets_ == 0 && overlapped;
  }

  struct Writing {
    rig::FrameSetWriter::Ticket ticket = 0;
    int pulse = 0;
  };
  const SoakOptions options_;
  const Phase phase_;
  const Served& served_;
  const test::TemporaryFolder folder_;
  test::SimulatedRig rig_;
  std::unique_ptr<rig::CaptureSession> session_;
  rig::FrameSetWriter writer_;  // goes before the session, whose memory the frames are
  ThreadPool readers_;
  std::optional<Writing> writing_;
  std::vector<uint64_t> warm_up_ids_;
  Clock::time_point begin_;
  Footprint settled_;
  int good_shots_ = 0;
  int wrong_bytes_ = 0;
  int wrong_ids_ = 0;
  int wrong_sets_ = 0;
  int written_ = 0;
  int while_writing_ = 0;  // pulses
  std::vector<double> arrivals_s_;
  uint64_t resent_ = 0;
  double max_skew_us_ = 0;
};

/// True when no phase found anything broken.
bool RunPhases(const SoakOptions& options) {
  const Served served(options);
  const Phase phases[] = {
      {"no packet lost, frame numbers begin again with every shot", options.pulses, 0, true},
      {"packets lost and sent again, frame numbers count on", options.lossy_pulses, options.drop,
       false}};
  bool whole = true;
  for (const Phase& phase : phases) {
    if (phase.pulses > 0 && !Soak(options, phase, served).Run()) whole = false;
  }
  return whole;
}

}  // namespace
}  // namespace rotunda

int main(int argc, char** argv) {
  rotunda::SoakOptions options;
  CLI::App app("Takes shot after shot with simulated cameras and checks every byte");
  app.add_option("--pulses", options.pulses, "With nothing lost")->capture_default_str();
  app.add_option("--lossy-pulses", options.lossy_pulses, "With packets lost, after the others")
      ->capture_default_str();
  app.add_option("--drop", options.drop, "Part of the packets that is lost then")
      ->capture_default_str();
  app.add_option("--cameras", options.cameras)->capture_default_str();
  app.add_option("--width", options.width_px)->capture_default_str();
  app.add_option("--height", options.height_px)->capture_default_str();
  app.add_option("--write-every", options.write_every,
                 "Write the frame set of every Nth shot and read it back; 0: none")
      ->capture_default_str();
  app.add_option("--block", options.block)->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  try {
    return rotunda::RunPhases(options) ? 0 : 1;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "capture_soak: %s\n", error.what());
    return 1;
  }
}
