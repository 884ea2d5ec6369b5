#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>

#include "daemon/store.h"
#include "sfm/core/calibration.h"
#include "sfm/core/file_io.h"
#include "sfm/core/frame_set.h"
#include "tests/support/process.h"

namespace rotunda::test {

/// A wall clock that goes on by a second at every look, from 2026-01-01T00:00:00Z.
class SteppingClock {
 public:
  daemon::WallClock Source() {
    return
        [this] { return std::chrono::system_clock::time_point(std::chrono::seconds(++seconds_)); };
  }
  void Advance(std::chrono::seconds by) { seconds_ += by.count(); }

 private:
  std::atomic<int64_t> seconds_ = 1767225600;
};

/// A state folder and what a daemon needs to open it; Reopen() is what a restart does.
class DaemonState {
 public:
  DaemonState() { Reopen(); }

  daemon::Store& store() { return *store_; }
  daemon::EventHub& hub() { return hub_; }
  SteppingClock& clock() { return clock_; }
  const std::filesystem::path& folder() const { return folder_.path(); }
  void Close() { store_.reset(); }
  Result<std::unique_ptr<daemon::Store>> TryOpen() {
    return daemon::Store::Open({folder_.path(), clock_.Source(), {}, follow_up_}, hub_);
  }
  /// As StoreOptions has it, from the next opening on.
  void SetFollowUp(decltype(daemon::StoreOptions::follow_up) follow_up) {
    follow_up_ = std::move(follow_up);
  }
  daemon::Store& Reopen() {
    store_.reset();
    auto opened = TryOpen();
    if (!opened) throw std::runtime_error(opened.error().ToString());
    store_ = std::move(*opened);
    return *store_;
  }

 private:
  TemporaryFolder folder_;
  SteppingClock clock_;
  decltype(daemon::StoreOptions::follow_up) follow_up_;
  daemon::EventHub hub_;
  std::unique_ptr<daemon::Store> store_;
};

/// A frame set whose pictures are a few bytes that nobody decodes: cameras c0, c1, ...
inline void WriteTinyFrameSet(const std::filesystem::path& folder, const std::string& captured_at,
                              int cameras = 2) {
  std::filesystem::create_directories(folder / "frames");
  FrameSet set;
  set.id = folder.filename();
  set.captured_at = captured_at;
  for (int i = 0; i < cameras; ++i) {
    Frame& frame = set.frames.emplace_back();
    frame.camera = "c" + std::to_string(i);
    frame.serial = "S" + std::to_string(i);
    frame.file = "frames/" + frame.camera + ".png";
    frame.width_px = frame.height_px = 8;
    frame.pixel_format = "Mono8";
    frame.xxh3 = "0123456789abcdef";
    if (!WriteNewFile(folder / frame.file, "picture")) throw std::runtime_error("cannot write");
  }
  if (!WriteNewFile(folder / "frameset.json", FrameSetToJson(set))) {
    throw std::runtime_error("cannot write");
  }
}

/// calibrations/<id>/calibration.json.
inline void WriteCalibrationFolder(const std::filesystem::path& folder, Calibration calibration) {
  std::filesystem::create_directories(folder);
  calibration.id = folder.filename();
  if (!WriteCalibration(calibration, folder / "calibration.json")) {
    throw std::runtime_error("cannot write");
  }
}

}  // namespace rotunda::test
