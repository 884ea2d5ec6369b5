#include <algorithm>
#include <span>

#include "rig/sim/camera_fault.h"
#include "rig/sim/gige_camera.h"
#include "rig/sim/gige_genicam.h"
#include "tests/fuzz/fuzz_input.h"

namespace {

using namespace rotunda;

/// What must hold whatever a client has sent.
void RequireSound(const sim::CameraActions& actions) {
  constexpr size_t kHeader_bytes = 8;
  fuzz::Require(actions.answer.size() <= kHeader_bytes + sim::kGvcpMaxData,
                "an answer fits a GVCP packet");
  for (const sim::FrameOrder& order : actions.frames) {
    size_t joined = 0;
    const uint32_t packets = sim::PacketCount(order.frame);
    // The ends, where a cut could go wrong; a frame may have a hundred thousand packets.
    for (const uint32_t packet : {0u, 1u, packets / 2, packets - 2, packets - 1}) {
      const sim::PayloadRange range = sim::PayloadOfPacket(order.frame, packet);
      joined = std::max(joined, range.offset + range.size);
    }
    fuzz::Require(joined == order.frame.payload_bytes, "the packets end where the frame does");
    fuzz::Require(order.frame.block_id != 0, "a frame has an id");
  }
}

}  // namespace

/// GVCP requests, each with its length (two bytes) and a byte of what else happens before it.
extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  static const std::string xml = sim::GenicamXml();
  sim::GigeCamera::Settings settings;
  settings.address = 0x7F000101;
  settings.camera = sim::MakeCameras(1, {}).front();
  sim::GigeCamera camera(settings, xml);
  int64_t now_ns = 1'000'000'000;
  std::span<const uint8_t> rest(data, size);
  while (rest.size() >= 3) {
    const size_t length = std::min<size_t>(sim::ReadBig16(rest, 0), rest.size() - 3);
    const uint8_t event = rest[2];
    now_ns += int64_t{event} * 10'000'000;
    if (event & 1) RequireSound(camera.Pulse({event >> 1 & 1, now_ns}, 0));
    const auto request = sim::ParseGvcpRequest(rest.subspan(3, length));
    const sim::Endpoint from = {0x7F000001, static_cast<uint16_t>(event >> 7)};
    if (request) RequireSound(camera.Handle(*request, from, now_ns, 0));
    fuzz::Require(camera.NextTick_ns(now_ns) > now_ns, "time goes on");
    rest = rest.subspan(3 + length);
  }
  return 0;
}
