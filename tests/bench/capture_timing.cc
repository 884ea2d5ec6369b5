#include <arv.h>
#include <unistd.h>
#include <xxhash.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "rig/aravis_camera.h"
#include "rig/capture_session.h"
#include "rig/frame_set_writer.h"
#include "rig/png_encoder.h"
#include "rig/sim/socket_trigger.h"
#include "sfm/core/file_io.h"
#include "tests/bench/process_cost.h"
#include "tests/support/process.h"
#include "tests/support/served_cameras.h"

// What a shot costs with simulated cameras that are another process: the CPU of receiving, beside
// that of a loop over Aravis which throws the frames away, the time of every stage from the pulse
// to a durable frame set, and shots in a row that the disk does not keep up with.

namespace rotunda {
namespace {

using Clock = std::chrono::steady_clock;

struct TimingOptions {
  std::string frame_set;
  std::string out;  // where frame sets are written; empty: the system's temporary folder
  int pulses = 10;
  int rounds = 3;
  std::string block = "127.61.1";
};

/// Where the cameras are, as the command "list" tells: address, name, serial number, state.
std::vector<rig::CameraPlace> PlacesOf(const test::ServedCameras& cameras) {
  std::vector<rig::CameraPlace> places;
  std::istringstream lines(cameras.Send({"list"}).output);
  for (std::string line; std::getline(lines, line);) {
    std::istringstream words(line);
    rig::CameraPlace& place = places.emplace_back();
    words >> place.address >> place.camera >> place.serial;
    place.uplink = "loopback";
  }
  return places;
}

struct Cost {
  double cpu_s = 0;
  double control_s = 0;  // of it, before the pulses: arming, clocks
  int frames = 0;
};

// Not counted, in both: memory is touched for the first time, sockets get their buffers.
constexpr int kWarmUpPulses = 2;

/// The yardstick: what Aravis itself costs. Streams run all the time, with the settings that
/// capture gives them, frames are thrown away.
class BareLoop {
 public:
  explicit BareLoop(const std::vector<rig::CameraPlace>& places) {
    for (const rig::CameraPlace& place : places) Open(place.address);
  }
  ~BareLoop() {
    for (auto& [camera, stream] : open_) {
      arv_camera_stop_acquisition(camera, nullptr);
      g_clear_object(&stream);
      g_clear_object(&camera);
    }
  }
  BareLoop(const BareLoop&) = delete;
  BareLoop& operator=(const BareLoop&) = delete;

  Cost Take(int pulses, rig::TriggerLine& trigger) {
    Count(kWarmUpPulses, trigger);
    return Count(pulses, trigger);
  }

 private:
  Cost Count(int pulses, rig::TriggerLine& trigger) {
    Cost cost;
    const double before = Cpu_s();
    for (int i = 0; i < pulses; ++i) {
      Must(trigger.Pulse(std::chrono::milliseconds(1)));
      for (auto& [camera, stream] : open_) {
        ArvBuffer* buffer = arv_stream_timeout_pop_buffer(stream, 5'000'000);
        if (buffer == nullptr) continue;
        cost.frames += arv_buffer_get_status(buffer) == ARV_BUFFER_STATUS_SUCCESS;
        arv_stream_push_buffer(stream, buffer);
      }
    }
    cost.cpu_s = Cpu_s() - before;
    return cost;
  }

  void Open(const std::string& address) {
    ArvCamera* camera = arv_camera_new(address.c_str(), nullptr);
    if (camera == nullptr) throw std::runtime_error("cannot open " + address);
    arv_camera_gv_set_stream_options(camera, ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED);
    arv_camera_gv_set_packet_size(camera, 9000, nullptr);
    arv_camera_set_trigger(camera, "Line0", nullptr);
    arv_camera_set_acquisition_mode(camera, ARV_ACQUISITION_MODE_CONTINUOUS, nullptr);
    ArvStream* stream = arv_camera_create_stream(camera, nullptr, nullptr, nullptr);
    const guint payload = arv_camera_get_payload(camera, nullptr);
    g_object_set(stream, "socket-buffer", ARV_GV_STREAM_SOCKET_BUFFER_FIXED, "socket-buffer-size",
                 static_cast<gint>(2 * payload), "frame-retention", 1'000'000U, "packet-timeout",
                 100'000U, "packet-request-ratio", 1.0, nullptr);
    for (int i = 0; i < kWarmUpPulses; ++i)
      arv_stream_push_buffer(stream, arv_buffer_new(payload, nullptr));
    arv_camera_start_acquisition(camera, nullptr);
    open_.emplace_back(camera, stream);
  }
  std::vector<std::pair<ArvCamera*, ArvStream*>> open_;
};

struct Pull {
  Clock::time_point at;
  double cpu_s = 0;  // used by then
};

/// Notes when it is pulled: the cameras are armed by then.
class TimedTrigger : public rig::TriggerLine {
 public:
  TimedTrigger(const std::string& socket, Pull& pulled) : line_(socket), pulled_(pulled) {}
  Result<Clock::time_point> Pulse(std::chrono::microseconds width) override {
    pulled_ = {Clock::now(), Cpu_s()};
    return line_.Pulse(width);
  }

 private:
  sim::SocketTrigger line_;
  Pull& pulled_;
};

std::unique_ptr<rig::CaptureSession> OpenSession(const std::vector<rig::CameraPlace>& places,
                                                 std::unique_ptr<rig::TriggerLine> trigger) {
  rig::CaptureOptions options;
  options.cameras = places;
  options.uplinks = {{"loopback", 100000, 10000}};
  options.timing.deadline_ms = 10000;
  options.retries = 0;
  auto session =
      Must(rig::CaptureSession::Open(options, {rig::OpenAravisCamera, std::move(trigger)}));
  const size_t ready = session->WaitUntilReady(std::chrono::seconds(60));
  if (ready != places.size()) throw std::runtime_error("not all cameras are ready");
  return session;
}

Cost TakeShots(rig::CaptureSession& session, int pulses, const Pull& pulled) {
  Cost cost;
  for (int i = 0; i < pulses; ++i) {
    const double before = Cpu_s();
    cost.frames += static_cast<int>(Must(session.Capture()).OkCount());
    cost.cpu_s += Cpu_s() - before;
    cost.control_s += pulled.cpu_s - before;
  }
  return cost;
}

void Add(const Cost& more, Cost& sum) {
  sum.cpu_s += more.cpu_s;
  sum.control_s += more.control_s;
  sum.frames += more.frames;
}

// Receiving may take so many times the CPU of Aravis alone.
constexpr double kReceivingLimit = 1.2;

/// True when every frame came and receiving is within its limit.
bool CompareReceiving(const TimingOptions& options, const std::vector<rig::CameraPlace>& places,
                      const std::string& socket) {
  sim::SocketTrigger trigger(socket);
  Cost bare, ours;
  for (int round = 0; round < options.rounds; ++round) {
    Add(BareLoop(places).Take(options.pulses, trigger), bare);
    Pull pulled;
    const auto session = OpenSession(places, std::make_unique<TimedTrigger>(socket, pulled));
    TakeShots(*session, kWarmUpPulses, pulled);
    Add(TakeShots(*session, options.pulses, pulled), ours);
  }
  const int pulses = options.pulses * options.rounds;
  const double receiving_s = ours.cpu_s - ours.control_s;
  std::printf(
      "CPU a pulse: bare Aravis loop %.3f s (%d frames); capture receives %d frames with %.3f s: "
      "%.2fx; arming and clocks %.3f s: all together %.2fx\n",
      bare.cpu_s / pulses, bare.frames, ours.frames, receiving_s / pulses, receiving_s / bare.cpu_s,
      ours.control_s / pulses, ours.cpu_s / bare.cpu_s);
  const int all = pulses * static_cast<int>(places.size());
  const bool whole = ours.frames == all && bare.frames == all;
  if (!whole) std::printf("BROKEN: not all of %d frames came\n", all);
  const bool cheap = receiving_s <= kReceivingLimit * bare.cpu_s;
  if (!cheap) std::printf("BROKEN: receiving takes more than %.1fx\n", kReceivingLimit);
  return whole && cheap;
}

/// What one core needs for the files of a shot, stage by stage.
void ProfileFiles(const rig::Shot& shot, const std::filesystem::path& out) {
  std::vector<std::string> files;
  auto begin = Clock::now();
  for (const rig::CameraShot& camera : shot.cameras) {
    const rig::CameraFrame& frame = *camera.frame;
    const size_t size = static_cast<size_t>(frame.width_px) * frame.height_px;
    files.push_back(
        Must(rig::EncodePng({{frame.memory.data(), size}, frame.width_px, frame.height_px, 1})));
  }
  const double encode_s = SecondsSince(begin);
  begin = Clock::now();
  double level = 0;
  for (const rig::CameraShot& camera : shot.cameras) {
    level += rig::MeasurePicture(*camera.frame).mean_level;
  }
  const double measure_s = SecondsSince(begin);
  begin = Clock::now();
  uint64_t sum = 0;
  for (const std::string& file : files) sum ^= XXH3_64bits(file.data(), file.size());
  const double hash_s = SecondsSince(begin);
  begin = Clock::now();
  OutputFolder folder = Must(OutputFolder::Begin(out));
  for (size_t i = 0; i < files.size(); ++i) {
    if (!WriteNewFile(folder.path() / std::to_string(i), files[i])) {
      throw std::runtime_error("cannot write");
    }
  }
  const double write_s = SecondsSince(begin);
  begin = Clock::now();
  if (!folder.Commit()) throw std::runtime_error("cannot make durable");
  std::printf(
      "files, on one core: PNG %.2f s, figures %.2f s, checksums %.2f s, writing %.2f s, "
      "fsync and rename %.2f s (mean level %.1f, sum %llx)\n",
      encode_s, measure_s, hash_s, write_s, SecondsSince(begin),
      level / static_cast<double>(files.size()), static_cast<unsigned long long>(sum));
}

rig::FrameSetOrder OrderTo(const std::filesystem::path& out) {
  rig::FrameSetOrder order;
  order.out = out;
  order.id = out.filename().string();
  order.captured_at = "2026-01-01T00:00:00Z";
  order.trigger_source = "simulated";
  return order;
}

/// When the last frame was there, after the pulse.
double LastFrame_s(const rig::Shot& shot) {
  double last_ms = 0;
  for (const rig::CameraShot& camera : shot.cameras) {
    last_ms = std::max(last_ms, camera.arrival_ms.value_or(0));
  }
  return 1e-3 * last_ms;
}

/// One shot after the other, each written before the next. True when every one was complete.
bool TimeStages(rig::CaptureSession& session, int shots, const Pull& pulled,
                const std::filesystem::path& out) {
  rig::FrameSetWriter writer(0);
  bool complete = true;
  for (int i = 0; i < shots; ++i) {
    const auto begin = Clock::now();
    rig::Shot shot = Must(session.Capture());
    const double done_s = SecondsSince(pulled.at);
    const double arm_s = std::chrono::duration<double>(pulled.at - begin).count();
    std::printf(
        "shot %d: %zu/%zu ok; arm %.3f s; after the pulse: last frame %.3f s, verdict %.3f s", i,
        shot.OkCount(), shot.cameras.size(), arm_s, LastFrame_s(shot), done_s);
    if (!shot.complete()) std::printf("\nBROKEN: %s\n", shot.Summary().c_str());
    complete = complete && shot.complete();
    if (i == 0 && shot.complete()) {
      std::printf("\n");
      ProfileFiles(shot, out / "profile");
      continue;
    }
    const double cpu_s = Cpu_s();
    const auto submitted = Clock::now();
    const auto ticket = writer.Submit(OrderTo(out / ("shot" + std::to_string(i))), std::move(shot));
    const rig::WrittenSet written = Must(writer.Wait(ticket));
    std::printf(", durable set %.3f s (%.0f MB, %.1f cores busy)\n", SecondsSince(pulled.at),
                1e-6 * static_cast<double>(written.bytes),
                (Cpu_s() - cpu_s) / SecondsSince(submitted));
  }
  return complete;
}

// Besides frames: files on their way to the disk, the allocator's caches.
constexpr double kOtherMemory_mb = 40;
// So many times what memory may hold: the disk does not keep up with that.
constexpr int kTimesMemory = 3;

/// Shots as fast as they can be taken, all of them written. True when every one was complete,
/// frames took no more memory than is said, and shots that found it full were told so.
bool OutrunTheDisk(rig::CaptureSession& session, const std::filesystem::path& out) {
  rig::FrameSetWriter writer(0);
  const size_t shots = static_cast<size_t>(kTimesMemory * session.options().sets_in_memory);
  std::vector<rig::FrameSetWriter::Ticket> tickets;
  const double before_mb = FootprintNow().memory_mb;
  double most_mb = before_mb, slowest_s = 0;
  int refused = 0;
  bool complete = true;
  while (tickets.size() < shots) {
    Result<rig::Shot> shot = session.Capture();
    most_mb = std::max(most_mb, FootprintNow().memory_mb);
    if (!shot && shot.error().message.starts_with("memory is full") && !writer.trouble()) {
      ++refused;
      continue;
    }
    rig::Shot taken = Must(std::move(shot));
    slowest_s = std::max(slowest_s, LastFrame_s(taken));
    complete = complete && taken.complete();
    if (!taken.complete()) std::printf("BROKEN: %s\n", taken.Summary().c_str());
    const std::string name = "row" + std::to_string(tickets.size());
    tickets.push_back(writer.Submit(OrderTo(out / name), std::move(taken)));
  }
  for (const auto ticket : tickets) Must(writer.Wait(ticket));
  const double limit_mb = 1e-6 * static_cast<double>(session.MemoryLimit_bytes());
  std::printf(
      "%zu shots in a row, all written: last frame after at most %.3f s, %d more refused while "
      "memory was full; memory %+.0f MB, frames may take %.0f MB\n",
      shots, slowest_s, refused, most_mb - before_mb, limit_mb);
  const bool bounded = most_mb - before_mb <= limit_mb + kOtherMemory_mb;
  if (!bounded) std::printf("BROKEN: that is more than is said\n");
  return complete && bounded;
}

/// True when every shot was complete and memory as it is said.
bool TimeWriting(const TimingOptions& options, const std::vector<rig::CameraPlace>& places,
                 const std::string& socket, const std::filesystem::path& out) {
  Pull pulled;
  const auto opening = Clock::now();
  const auto session = OpenSession(places, std::make_unique<TimedTrigger>(socket, pulled));
  std::printf("opening %zu cameras with a warm-up frame each: %.2f s\n", places.size(),
              SecondsSince(opening));
  const bool bounded = OutrunTheDisk(*session, out);
  return TimeStages(*session, options.rounds, pulled, out) && bounded;
}

/// A folder of our own below another, removed in the end.
class WorkFolder {
 public:
  explicit WorkFolder(const std::filesystem::path& parent)
      : path_(parent / ("capture_timing-" + std::to_string(::getpid()))) {
    std::filesystem::create_directory(path_);
  }
  ~WorkFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  WorkFolder(const WorkFolder&) = delete;
  WorkFolder& operator=(const WorkFolder&) = delete;
  const std::filesystem::path& path() const { return path_; }

 private:
  const std::filesystem::path path_;
};

/// True when no limit was broken.
bool Run(const TimingOptions& options) {
  const WorkFolder folder(options.out.empty() ? std::filesystem::temp_directory_path()
                                              : std::filesystem::path(options.out));
  // As sensors give them: developing a simulated frame set's colours is no cost of a real rig.
  const test::ServedCameras cameras(
      {ROTUNDA_COMMAND, options.frame_set, options.block, {"--pixel-format", "BayerRG8"}});
  const std::vector<rig::CameraPlace> places = PlacesOf(cameras);
  // First, while no memory has been used before.
  const bool written = TimeWriting(options, places, cameras.socket(), folder.path());
  return CompareReceiving(options, places, cameras.socket()) && written;
}

}  // namespace
}  // namespace rotunda

int main(int argc, char** argv) {
  rotunda::TimingOptions options;
  CLI::App app(
      "What a shot costs: CPU of receiving beside Aravis alone, time of every stage, "
      "memory when the disk does not keep up");
  app.add_option("FRAMESET", options.frame_set,
                 "What the cameras show; the limits are for 90 cameras of 1200x1600: of smaller "
                 "pictures the bytes cost less and the rest as much")
      ->required();
  app.add_option("--out", options.out, "Folder on the disk to measure");
  app.add_option("--pulses", options.pulses, "Of a round")->capture_default_str();
  app.add_option("--rounds", options.rounds)->capture_default_str();
  app.add_option("--block", options.block)->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  try {
    return rotunda::Run(options) ? 0 : 1;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "capture_timing: %s\n", error.what());
    return 1;
  }
}
