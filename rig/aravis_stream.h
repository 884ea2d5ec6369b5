#pragma once

#include <memory>
#include <optional>
#include <utility>

#include "rig/aravis_object.h"
#include "rig/camera.h"

namespace rotunda::rig {

/// The way of a camera's frames into memory that is lent for them: Aravis' thread and its socket.
class AravisStream {
 public:
  using Clock = Camera::Clock;

  /// Negotiates the size of packets and makes the socket. `camera` outlives the stream. On success
  /// the thread runs, without memory for a frame.
  static Result<std::unique_ptr<AravisStream>> Open(ArvCamera* camera,
                                                    const CameraSettings& settings);
  ~AravisStream();
  AravisStream(const AravisStream&) = delete;
  AravisStream& operator=(const AravisStream&) = delete;

  size_t payload_bytes() const { return payload_bytes_; }

  /// kInvalidArgument when no frame fits into `memory`.
  Status CheckMemory(const FrameBlock& memory) const;
  /// Forgets what came before, the last frame's id too, and waits for one frame.
  void Begin(FrameBlock memory);
  /// Memory for one more frame.
  void Lend(FrameBlock memory);
  /// The next frame, complete or not; nullopt when none came until `deadline`.
  std::optional<CameraFrame> Fetch(Clock::time_point deadline);
  /// After the camera was told to stop: waits while packets of a frame that nobody took still come.
  void WaitForStragglers() const;
  /// Takes back all memory that was lent.
  void End();

  /// Counts since it was opened.
  StreamCounters counters() const;

 private:
  AravisStream(GObjectPtr<ArvStream> stream, size_t payload_bytes)
      : stream_(std::move(stream)), payload_bytes_(payload_bytes) {}
  uint64_t Counter(const char* name) const {
    return arv_stream_get_info_uint64_by_name(stream_.get(), name);
  }
  CameraFrame Describe(ArvBuffer* buffer) const;

  GObjectPtr<ArvStream> stream_;
  size_t payload_bytes_;
  bool receiving_ = true;  // the thread runs
  int lent_ = 0;           // buffers that no frame has come for
  uint64_t missing_when_lent_ = 0;
  uint64_t unasked_at_begin_ = 0;
};

}  // namespace rotunda::rig
