#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <list>
#include <map>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include "rig/shot.h"
#include "sfm/core/frame_set.h"
#include "sfm/core/result.h"
#include "sfm/core/run_context.h"

namespace rotunda::rig {

/// Tells a black, burnt-out or unsharp picture from a good one. Over one of the two greens of a
/// Bayer pattern, else over the grey or green channel.
struct PictureFigures {
  double mean_level = 0;    // 0..255
  double clipped_part = 0;  // of the pixels, at 255
  // Sum of the squared Laplacian over the sum of levels. Shot noise grows with the level, so its
  // part in this is the same in dark and bright pictures.
  double sharpness = 0;
};
PictureFigures MeasurePicture(const CameraFrame& frame);

/// Where a shot goes and what its frame set says of it.
struct FrameSetOrder {
  std::filesystem::path out;
  std::string id;
  std::string captured_at;  // RFC 3339
  std::optional<std::string> subject;
  std::string trigger_source;              // "gpio" or "simulated"
  std::optional<std::string> calibration;  // in force: the text of its file, for the set's own
};

/// A shot as it lies on the disk.
struct WrittenSet {
  std::filesystem::path folder;
  std::map<std::string, PictureFigures> figures;  // by camera, of those with a picture
  uint64_t bytes = 0;
};

/// Turns shots into durable frame sets, one after the other, off the path that receives frames: on
/// `threads` threads of low priority, while the next pulse is taken. A frame's memory is given back
/// as soon as its set is durable. When the disk refuses nothing is lost: what is in memory stays.
/// What may pass by itself (disk full, device slow) is tried again until it works, or Abandon(),
/// and later sets wait. What will not (no such folder, no permission, read-only) is told at once:
/// the set is set aside until Redirect() or Abandon(), and later sets go on.
class FrameSetWriter {
 public:
  using Ticket = uint64_t;
  struct Trouble {
    std::filesystem::path out;
    Error error;
    bool tried_again = true;  // false: set aside
  };

  explicit FrameSetWriter(int threads);
  /// Waits for what can be written; sets in trouble are dropped.
  ~FrameSetWriter();
  FrameSetWriter(const FrameSetWriter&) = delete;
  FrameSetWriter& operator=(const FrameSetWriter&) = delete;

  /// Takes the shot over and returns at once.
  Ticket Submit(FrameSetOrder order, Shot shot);
  /// Waits until the set is durable; kCancelled when `stop` was set before (it is still being
  /// written then), else the error for which it was set aside (it stays in memory and may be waited
  /// for again) or given up.
  Result<WrittenSet> Wait(Ticket ticket, std::stop_token stop = {});
  /// Writes a set that was set aside to another place, or to the same once that is mended.
  /// kNotFound: none is set aside under this ticket.
  Status Redirect(Ticket ticket, std::filesystem::path out);
  /// Gives up a set that cannot be written; its frames are lost. It stays when it is already being
  /// written and that succeeds.
  void Abandon(Ticket ticket);

  size_t pending() const;
  /// Why the oldest set in trouble cannot be written; unset while all is well.
  std::optional<Trouble> trouble() const;
  /// Rises with every picture that is written and every attempt that has failed: while sets are
  /// pending and this stands still, the disk hangs.
  uint64_t signs_of_life() const { return signs_of_life_; }

 private:
  struct Job;
  void Run();
  std::list<Job>::iterator NextJob();
  Result<WrittenSet> Write(const Job& job);
  /// All files of the set, not yet durable.
  Result<WrittenSet> Fill(const Job& job, const std::filesystem::path& folder);

  ThreadPool threads_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::list<Job> jobs_;  // the one being written stays in its place while others are given up
  std::map<Ticket, Result<WrittenSet>> done_;
  Ticket last_ticket_ = 0;
  Ticket writing_ = 0;  // 0: none
  bool abandon_writing_ = false;
  bool quit_ = false;
  std::atomic<uint64_t> signs_of_life_ = 0;
  std::thread thread_;
};

}  // namespace rotunda::rig
