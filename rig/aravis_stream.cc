#include "rig/aravis_stream.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <thread>

namespace rotunda::rig {
namespace {

using std::chrono::milliseconds;

// A busy machine may not get to a camera's packets for hundreds of milliseconds; Aravis' own 100 ms
// loses frames then.
constexpr guint kFrameRetention_us = 1'000'000;
// Lost packets are asked for again after this. With Aravis' 20 ms a camera that only paused is
// taken for one that loses packets: a third of all was sent twice on a busy machine.
constexpr guint kPacketTimeout_us = 100'000;
// Of a frame's packets so many may be asked for again. Aravis' own quarter gives frames up that a
// busy machine was only late to read.
constexpr double kPacketRequestRatio = 1.0;
// The kernel counts a packet with its bookkeeping, about twice its bytes: with this a whole frame
// waits in the socket when the thread that reads it does not get to run.
constexpr int kSocketBufferPerPayload = 2;

// Packets of an earlier frame: none for so long means that no more come.
constexpr auto kQuietTime = milliseconds(20);
constexpr auto kQuietPatience = milliseconds(400);

constexpr char kLeaderLost[] =
    "its first packet, the leader, was lost, and with it the frame's number and size";

// Counters of Aravis' streams, by name.
constexpr char kReceivedPackets[] = "n_received_packets";
constexpr char kIgnoredPackets[] = "n_ignored_packets";
constexpr char kResentPackets[] = "n_resent_packets";
constexpr char kMissingPackets[] = "n_missing_packets";
constexpr char kFramesWithoutBuffer[] = "n_underruns";

void DeleteBlock(gpointer block) { delete static_cast<FrameBlock*>(block); }

/// A buffer for Aravis over memory of ours, which comes back when the buffer goes.
GObjectPtr<ArvBuffer> MakeBuffer(FrameBlock memory, size_t payload_bytes) {
  auto* block = new FrameBlock(std::move(memory));
  return GObjectPtr<ArvBuffer>(
      arv_buffer_new_full(payload_bytes, block->data(), block, &DeleteBlock));
}

FrameBlock TakeMemory(ArvBuffer* buffer) {
  auto* block = static_cast<FrameBlock*>(const_cast<void*>(arv_buffer_get_user_data(buffer)));
  return std::move(*block);
}

struct PixelFormatName {
  ArvPixelFormat format;
  const char* name;
};
constexpr std::array<PixelFormatName, 6> kPixelFormats = {{
    {ARV_PIXEL_FORMAT_MONO_8, "Mono8"},
    {ARV_PIXEL_FORMAT_BAYER_RG_8, "BayerRG8"},
    {ARV_PIXEL_FORMAT_BAYER_GB_8, "BayerGB8"},
    {ARV_PIXEL_FORMAT_BAYER_GR_8, "BayerGR8"},
    {ARV_PIXEL_FORMAT_BAYER_BG_8, "BayerBG8"},
    {ARV_PIXEL_FORMAT_RGB_8_PACKED, "RGB8"},
}};

std::string NameOf(ArvPixelFormat format) {
  for (const PixelFormatName& known : kPixelFormats) {
    if (known.format == format) return known.name;
  }
  return "pixel format " + std::to_string(format);
}

bool IsKnown(const std::string& pixel_format) {
  return std::any_of(std::begin(kPixelFormats), std::end(kPixelFormats),
                     [&](const PixelFormatName& known) { return known.name == pixel_format; });
}

std::string WhyIncomplete(ArvBufferStatus status, uint64_t missing_packets) {
  switch (status) {
    case ARV_BUFFER_STATUS_TIMEOUT:
    case ARV_BUFFER_STATUS_MISSING_PACKETS:
      return "packets lost" + (missing_packets == 0 ? "" : ": " + std::to_string(missing_packets));
    case ARV_BUFFER_STATUS_WRONG_PACKET_ID:
      return "packets came in a wrong order";
    case ARV_BUFFER_STATUS_SIZE_MISMATCH:
      return "the camera sent more or less than its payload size says";
    default:
      return "receiving ended with status " + std::to_string(status);
  }
}

/// What is wrong with the picture of a buffer that was filled; empty: nothing. The camera says how
/// large it is and how much it has sent, and its word is not enough to read memory by.
std::string ProblemOf(const CameraFrame& frame, ArvBuffer* buffer) {
  int padding_x = 0, padding_y = 0;
  arv_buffer_get_image_padding(buffer, &padding_x, &padding_y);
  if (padding_x != 0 || padding_y != 0) return "rows are padded, which no 8-bit format of ours is";
  const size_t told = BytesPerPixel(frame.pixel_format) *
                      static_cast<size_t>(std::max(0, frame.width_px)) *
                      static_cast<size_t>(std::max(0, frame.height_px));
  size_t held = 0;
  arv_buffer_get_data(buffer, &held);
  if (told > 0 && told <= held && IsKnown(frame.pixel_format)) return "";
  return "says it is " + std::to_string(frame.width_px) + "x" + std::to_string(frame.height_px) +
         " of " + frame.pixel_format + " and has " + std::to_string(held) + " bytes";
}

}  // namespace

Result<std::unique_ptr<AravisStream>> AravisStream::Open(ArvCamera* camera,
                                                         const CameraSettings& settings) {
  GErrorSlot error;
  arv_camera_gv_set_stream_options(camera, ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED);
  arv_camera_gv_set_packet_size(camera, settings.packet_size_bytes, error.out());
  ROTUNDA_RETURN_IF_ERROR(
      error.status("packet size " + std::to_string(settings.packet_size_bytes)));
  // A test packet of that size is sent when the stream is made; the size shrinks when it is lost.
  arv_camera_gv_set_packet_size_adjustment(camera, ARV_GV_PACKET_SIZE_ADJUSTMENT_ON_FAILURE);
  GObjectPtr<ArvStream> stream(arv_camera_create_stream(camera, nullptr, nullptr, error.out()));
  if (!stream) return error.ToError("stream");
  const size_t payload_bytes = arv_camera_get_payload(camera, error.out());
  ROTUNDA_RETURN_IF_ERROR(error.status("payload size"));
  g_object_set(
      stream.get(), "socket-buffer", ARV_GV_STREAM_SOCKET_BUFFER_FIXED, "socket-buffer-size",
      static_cast<gint>(kSocketBufferPerPayload * payload_bytes), "frame-retention",
      kFrameRetention_us, "packet-timeout", kPacketTimeout_us, "packet-request-ratio",
      kPacketRequestRatio, "packet-resend",
      settings.resend ? ARV_GV_STREAM_PACKET_RESEND_ALWAYS : ARV_GV_STREAM_PACKET_RESEND_NEVER,
      nullptr);
  return std::unique_ptr<AravisStream>(new AravisStream(std::move(stream), payload_bytes));
}

AravisStream::~AravisStream() {
  End();
  arv_stream_start_thread(stream_.get());  // which the stream's end wants to stop
}

Status AravisStream::CheckMemory(const FrameBlock& memory) const {
  if (memory.size() >= payload_bytes_) return {};
  return Error{
      ErrorCode::kInvalidArgument,
      std::to_string(memory.size()) + " bytes for a frame of " + std::to_string(payload_bytes_),
      "frame memory"};
}

/// Ids restart at AcquisitionStart on many cameras; a stream that goes on would take every frame
/// for an old one. Restarting its thread forgets the last id and keeps the socket.
void AravisStream::Begin(FrameBlock memory) {
  End();
  Lend(std::move(memory));
  arv_stream_start_thread(stream_.get());
  receiving_ = true;
  unasked_at_begin_ = Counter(kFramesWithoutBuffer);
}

void AravisStream::Lend(FrameBlock memory) {
  missing_when_lent_ = Counter(kMissingPackets);
  ++lent_;
  arv_stream_push_buffer(stream_.get(), MakeBuffer(std::move(memory), payload_bytes_).release());
}

void AravisStream::End() {
  lent_ = 0;
  if (receiving_) arv_stream_stop_thread(stream_.get(), TRUE);
  receiving_ = false;
}

std::optional<CameraFrame> AravisStream::Fetch(Clock::time_point deadline) {
  while (true) {
    const auto left =
        std::chrono::duration_cast<std::chrono::microseconds>(deadline - Clock::now());
    const guint64 patience_us = static_cast<guint64>(std::max<int64_t>(0, left.count()));
    const GObjectPtr<ArvBuffer> buffer(arv_stream_timeout_pop_buffer(stream_.get(), patience_us));
    if (!buffer) return std::nullopt;
    if (arv_buffer_get_status(buffer.get()) == ARV_BUFFER_STATUS_ABORTED) continue;
    --lent_;
    return Describe(buffer.get());
  }
}

CameraFrame AravisStream::Describe(ArvBuffer* buffer) const {
  CameraFrame frame;
  const ArvBufferStatus status = arv_buffer_get_status(buffer);
  if (status != ARV_BUFFER_STATUS_SUCCESS) {
    // Without the leader Aravis knows neither id nor size, and counts every packet as missing.
    frame.problem = arv_buffer_get_frame_id(buffer) == 0
                        ? kLeaderLost
                        : WhyIncomplete(status, Counter(kMissingPackets) - missing_when_lent_);
    return frame;
  }
  frame.frame_id = arv_buffer_get_frame_id(buffer);
  frame.timestamp_ns = arv_buffer_get_timestamp(buffer);
  frame.width_px = arv_buffer_get_image_width(buffer);
  frame.height_px = arv_buffer_get_image_height(buffer);
  frame.pixel_format = NameOf(arv_buffer_get_image_pixel_format(buffer));
  frame.problem = ProblemOf(frame, buffer);
  if (!frame.problem.empty()) return frame;
  frame.complete = true;
  frame.memory = TakeMemory(buffer);
  return frame;
}

void AravisStream::WaitForStragglers() const {
  if (lent_ == 0 && Counter(kFramesWithoutBuffer) == unasked_at_begin_) return;
  const auto deadline = Clock::now() + kQuietPatience;
  uint64_t received = Counter(kReceivedPackets);
  while (Clock::now() < deadline) {
    std::this_thread::sleep_for(kQuietTime);
    const uint64_t now = Counter(kReceivedPackets);
    if (now == received) return;
    received = now;
  }
}

StreamCounters AravisStream::counters() const {
  return {Counter(kReceivedPackets), Counter(kIgnoredPackets), Counter(kResentPackets),
          Counter(kMissingPackets), Counter(kFramesWithoutBuffer)};
}

}  // namespace rotunda::rig
