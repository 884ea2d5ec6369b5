#include "tests/support/simulated_rig.h"

#include <unistd.h>

#include <cstdio>
#include <cstring>
#include <filesystem>
#include <stdexcept>

#include "rig/aravis_camera.h"
#include "rig/sim/socket_trigger.h"

namespace rotunda::test {

SimulatedRig::SimulatedRig(const Options& options) : options_(options) {
  sim::CameraServerOptions server;
  server.block = sim::ParseAddressBlock(options.block).value();
  server.cameras = sim::MakeCameras(options.cameras, options.like);
  server.restart_frame_ids = options.restart_frame_ids;
  if (!options_.source) {
    options_.source = sim::PatternSource(options.like.width_px, options.like.height_px);
  }
  server.source = options_.source;
  server.socket = std::filesystem::temp_directory_path() /
                  ("rotunda-" + options.block + "-" + std::to_string(::getpid()));
  auto started = sim::CameraServer::Start(server);
  if (!started) throw std::runtime_error(started.error().ToString());
  server_ = std::move(*started);

  capture_.uplinks = {{"loop", 100000, 10000}};
  capture_.settings.pixel_format = sim::PixelFormatName(options.like.format);
  for (int i = 0; i < options.cameras; ++i) {
    capture_.cameras.push_back(
        {CameraName(i), server_->camera(i).serial, server_->address(i), "loop"});
  }
}

std::string SimulatedRig::CameraName(int camera) const {
  char name[16];
  std::snprintf(name, sizeof(name), "c%03d", camera);
  return name;
}

Result<std::unique_ptr<rig::CaptureSession>> SimulatedRig::Open() {
  return rig::CaptureSession::Open(
      capture_, {rig::OpenAravisCamera, std::make_unique<sim::SocketTrigger>(server_->socket())});
}

std::vector<uint8_t> SimulatedRig::Served(int camera, int shot) const {
  return ServedBytes(options_.source, server_->camera(camera), camera, shot);
}

bool SimulatedRig::IsAsServed(const rig::CameraFrame& frame, int camera, int shot) const {
  const std::vector<uint8_t> bytes = Served(camera, shot);
  const size_t size = rig::BytesPerPixel(frame.pixel_format) * static_cast<size_t>(frame.width_px) *
                      static_cast<size_t>(frame.height_px);
  return frame.complete && size == bytes.size() &&
         std::memcmp(frame.memory.data(), bytes.data(), size) == 0;
}

int SimulatedRig::ExactFrames(const rig::Shot& taken, int shot) const {
  int exact = 0;
  for (size_t i = 0; i < taken.cameras.size(); ++i) {
    const auto& frame = taken.cameras[i].frame;
    exact += frame && IsAsServed(*frame, static_cast<int>(i), shot);
  }
  return exact;
}

std::vector<uint8_t> ServedBytes(const sim::FrameSource& source, const sim::SimulatedCamera& camera,
                                 int index, int shot) {
  sim::Exposure exposure;
  exposure.camera = index;
  exposure.shot = shot;
  exposure.format = camera.format;
  const auto image = source(exposure);
  return sim::CropImage(sim::ConvertImage(*image, camera.format),
                        {0, 0, camera.width_px, camera.height_px})
      .bytes;
}

}  // namespace rotunda::test
