#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <stop_token>
#include <thread>
#include <vector>

#include "rig/sim/camera_server.h"
#include "rig/sim/gige_camera.h"
#include "rig/sim/gige_network.h"

namespace rotunda::sim {

/// Sends the frames of all cameras from one thread, each at its own pace, and again what is asked
/// for. It holds the two latest frames of every camera.
class GigeSender {
 public:
  struct Settings {
    std::vector<int> sockets;  // one a camera, borrowed
    FrameSource source;
    uint64_t seed = 0;
    std::function<int64_t()> now_ns;
    std::function<void(int camera)> on_unplugged;  // a frame came to unplug_at_packet
  };
  explicit GigeSender(Settings settings);
  ~GigeSender();
  GigeSender(const GigeSender&) = delete;
  GigeSender& operator=(const GigeSender&) = delete;

  void Submit(FrameOrder order);
  void Resend(int camera, const ResendOrder& order);
  /// Ends what the camera is sending and forgets its frames.
  void Cut(int camera);
  /// Without missed_pulses, which only the camera knows.
  CameraCounters counters(int camera) const;

 private:
  /// A frame on its way, or sent and still held.
  struct Transmission {
    FrameOrder order;
    std::shared_ptr<const ServedImage> image;  // null until the first packet is due
    uint32_t packets = 0;
    uint32_t next = 0;
    int64_t due_ns = 0;
    std::vector<uint8_t> attempts;  // how often each packet was sent
    std::atomic<bool> is_cut = false;
  };
  struct PerCamera {
    std::deque<std::shared_ptr<Transmission>> held;  // latest last
    CameraCounters counters;
  };
  struct PendingResend {
    int camera = 0;
    ResendOrder order;
  };

  void Run(const std::stop_token& stop);
  void ForgetDone();
  std::shared_ptr<Transmission> Find(int camera, uint16_t block_id) const;
  void AnswerResends();
  void SendBurst(Transmission& transmission, int64_t now_ns);
  void SendAgain(const PendingResend& resend);
  void Append(Transmission& transmission, uint32_t packet);
  void Flush(const Transmission& transmission, bool again);
  bool IsLost(const Transmission& transmission, uint32_t packet) const;

  Settings settings_;
  mutable std::mutex mutex_;  // of all that follows; never held while sending or making pictures
  std::condition_variable_any wake_;
  std::vector<PerCamera> cameras_;
  std::vector<std::shared_ptr<Transmission>> active_;
  std::vector<PendingResend> resends_;
  bool has_news_ = false;
  std::vector<SplitPacket> batch_;  // of the thread alone, as is what follows
  uint64_t lost_ = 0;               // packets of the batch that a fault took
  std::jthread thread_;             // last: ends before the rest goes
};

}  // namespace rotunda::sim
