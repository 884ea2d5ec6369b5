#include "rig/sim/gige_sender.h"

#include <algorithm>
#include <chrono>
#include <utility>

#include "rig/sim/noise.h"
#include "sfm/core/run_context.h"

namespace rotunda::sim {
namespace {

/// Between two rounds the receivers, which have their share of the same machine, empty their
/// sockets.
constexpr int64_t kRound_ns = 200'000;
/// What one camera sends in a row at most: less than the smallest receive buffer Linux gives.
constexpr uint32_t kBurst_bytes = 64 * 1024;
/// Frames a camera has memory for, the one it is sending included.
constexpr size_t kHeldFrames = 2;

/// The picture as the camera's settings cut it.
std::shared_ptr<const ServedImage> Develop(const FrameSource& source, const FrameOrder& order) {
  const GvspFrame& frame = order.frame;
  std::shared_ptr<const ServedImage> image = source(order.exposure);
  const PixelFormat format = order.exposure.format;
  if (!image || image->bytes.size() != ImageBytes(*image)) image = std::make_shared<ServedImage>();
  if (image->format != format) {
    image = std::make_shared<const ServedImage>(ConvertImage(*image, format));
  }
  const ImageRegion region = {static_cast<int>(frame.offset_x_px),
                              static_cast<int>(frame.offset_y_px), static_cast<int>(frame.width_px),
                              static_cast<int>(frame.height_px)};
  const bool is_whole = region.x == 0 && region.y == 0 && region.width_px == image->width_px &&
                        region.height_px == image->height_px;
  if (is_whole) return image;
  return std::make_shared<const ServedImage>(CropImage(*image, region));
}

}  // namespace

GigeSender::GigeSender(Settings settings)
    : settings_(std::move(settings)),
      cameras_(settings_.sockets.size()),
      thread_([this](const std::stop_token& stop) { Run(stop); }) {}

GigeSender::~GigeSender() = default;

void GigeSender::Submit(FrameOrder order) {
  auto transmission = std::make_shared<Transmission>();
  transmission->packets = PacketCount(order.frame);
  transmission->due_ns = order.start_ns;
  transmission->attempts.resize(transmission->packets);
  transmission->order = std::move(order);
  const std::lock_guard lock(mutex_);
  const int camera = transmission->order.camera;
  const auto waiting = std::count_if(active_.begin(), active_.end(), [&](const auto& other) {
    return other->order.camera == camera && !other->is_cut;
  });
  if (static_cast<size_t>(waiting) >= kHeldFrames) return;
  auto& held = cameras_[static_cast<size_t>(camera)].held;
  held.push_back(transmission);
  if (held.size() > kHeldFrames) held.pop_front();
  active_.push_back(std::move(transmission));
  has_news_ = true;
  wake_.notify_one();
}

void GigeSender::Resend(int camera, const ResendOrder& order) {
  const std::lock_guard lock(mutex_);
  resends_.push_back({camera, order});
  has_news_ = true;
  wake_.notify_one();
}

void GigeSender::Cut(int camera) {
  const std::lock_guard lock(mutex_);
  cameras_[static_cast<size_t>(camera)].held.clear();
  for (const auto& transmission : active_) {
    if (transmission->order.camera == camera) transmission->is_cut = true;
  }
}

CameraCounters GigeSender::counters(int camera) const {
  const std::lock_guard lock(mutex_);
  return cameras_[static_cast<size_t>(camera)].counters;
}

/// Only frames that still have packets to send stay active.
void GigeSender::ForgetDone() {
  const auto is_done = [](const auto& t) { return t->is_cut || t->next == t->packets; };
  active_.erase(std::remove_if(active_.begin(), active_.end(), is_done), active_.end());
}

void GigeSender::Run(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  while (!stop.stop_requested()) {
    const auto active = active_;
    has_news_ = false;
    lock.unlock();
    AnswerResends();
    const int64_t now_ns = settings_.now_ns();
    int64_t next_ns = INT64_MAX;
    std::vector<const Transmission*> sending(cameras_.size());
    for (const auto& transmission : active) {
      if (transmission->is_cut || transmission->next == transmission->packets) continue;
      // A camera sends one frame after the other.
      const Transmission*& first = sending[static_cast<size_t>(transmission->order.camera)];
      if (first != nullptr) {
        transmission->due_ns = std::max(transmission->due_ns, first->due_ns);
        next_ns = std::min(next_ns, transmission->due_ns);
        continue;
      }
      first = transmission.get();
      if (transmission->due_ns <= now_ns && !transmission->is_cut) {
        SendBurst(*transmission, now_ns);
        AnswerResends();  // a client asks only so often
      }
      if (transmission->next < transmission->packets) {
        next_ns = std::min(next_ns, transmission->due_ns);
      }
    }
    const int64_t pause_ns = std::max(kRound_ns, next_ns - settings_.now_ns());
    lock.lock();
    ForgetDone();
    const auto news = [this] { return has_news_; };
    if (next_ns == INT64_MAX) {
      wake_.wait(lock, stop, news);
    } else {
      wake_.wait_for(lock, stop, std::chrono::nanoseconds(pause_ns), news);
    }
  }
}

void GigeSender::AnswerResends() {
  std::vector<PendingResend> resends;
  {
    const std::lock_guard lock(mutex_);
    resends.swap(resends_);
  }
  for (const PendingResend& resend : resends) SendAgain(resend);
}

void GigeSender::SendBurst(Transmission& transmission, int64_t now_ns) {
  const FrameOrder& order = transmission.order;
  if (!transmission.image) transmission.image = Develop(settings_.source, order);
  const int64_t late_ns = now_ns - transmission.due_ns;
  const uint32_t most = std::max(1u, kBurst_bytes / order.frame.packet_size_bytes);
  const auto due = static_cast<uint32_t>(
      std::min<int64_t>(most, 1 + late_ns / std::max<int64_t>(1, order.packet_interval_ns)));
  const uint32_t end = std::min(transmission.packets, transmission.next + due);
  bool is_unplugged = false;
  uint32_t packet = transmission.next;
  for (; packet < end && !is_unplugged; ++packet) {
    is_unplugged = order.unplug_at_packet && packet >= *order.unplug_at_packet;
    if (!is_unplugged) Append(transmission, packet);
  }
  transmission.due_ns += order.packet_interval_ns * (packet - transmission.next);
  transmission.next = packet;
  Flush(transmission, false);
  if (is_unplugged) settings_.on_unplugged(order.camera);
}

std::shared_ptr<GigeSender::Transmission> GigeSender::Find(int camera, uint16_t block_id) const {
  const std::lock_guard lock(mutex_);
  const auto& held = cameras_[static_cast<size_t>(camera)].held;
  const auto found = std::find_if(held.rbegin(), held.rend(), [&](const auto& transmission) {
    return transmission->order.frame.block_id == block_id;
  });
  return found == held.rend() ? nullptr : *found;
}

void GigeSender::SendAgain(const PendingResend& resend) {
  const ResendOrder& order = resend.order;
  const auto transmission = Find(resend.camera, order.block_id);
  if (!transmission) {
    const GvspHead head = EncodeGvspUnavailable(order.block_id, order.first);
    const SplitPacket packet = {head, {}};
    SendPackets(settings_.sockets[static_cast<size_t>(resend.camera)], order.to, {&packet, 1});
    return;
  }
  if (!transmission->order.resend) return;
  const uint32_t end = std::min(transmission->next, order.last + 1);
  for (uint32_t packet = order.first; packet < end; ++packet) Append(*transmission, packet);
  Flush(*transmission, true);
}

/// Puts a packet into the batch, or counts it as lost.
void GigeSender::Append(Transmission& transmission, uint32_t packet) {
  ++transmission.attempts[packet];
  if (IsLost(transmission, packet)) {
    ++lost_;
    return;
  }
  const PayloadRange range = PayloadOfPacket(transmission.order.frame, packet);
  batch_.push_back({EncodeGvspHead(transmission.order.frame, packet),
                    std::span(transmission.image->bytes).subspan(range.offset, range.size)});
}

/// A function of seed, camera, frame, packet and attempt: the same packets are lost in every run.
bool GigeSender::IsLost(const Transmission& transmission, uint32_t packet) const {
  const FrameOrder& order = transmission.order;
  const bool is_leader = packet == 0;
  const bool is_trailer = packet + 1 == transmission.packets;
  if (is_leader && order.drop_leader) return true;
  if (is_trailer && order.drop_trailer) return true;
  if (!is_leader && !is_trailer && order.drop_data) return true;
  if (order.drop_probability <= 0) return false;
  const uint64_t frame =
      DeriveSeed(DeriveSeed(settings_.seed, static_cast<uint64_t>(order.camera)), order.number);
  const uint64_t draw = uint64_t{packet} << 8 | transmission.attempts[packet];
  return Random(DeriveSeed(frame, draw)).Chance(order.drop_probability);
}

void GigeSender::Flush(const Transmission& transmission, bool again) {
  const FrameOrder& order = transmission.order;
  const int socket = settings_.sockets[static_cast<size_t>(order.camera)];
  const size_t sent = SendPackets(socket, order.to, batch_);
  batch_.clear();
  const std::lock_guard lock(mutex_);
  CameraCounters& counters = cameras_[static_cast<size_t>(order.camera)].counters;
  counters.packets += sent;
  counters.packets_dropped += std::exchange(lost_, 0);
  if (again) {
    counters.packets_resent += sent;
  } else if (transmission.next == transmission.packets) {
    ++counters.frames;
  }
}

}  // namespace rotunda::sim
