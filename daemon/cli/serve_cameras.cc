#include "daemon/cli/serve_cameras.h"

#include <unistd.h>

#include <algorithm>
#include <condition_variable>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <utility>

#include "daemon/cli/terminal.h"
#include "rig/sim/camera_server.h"
#include "rig/sim/rendered_shot.h"
#include "rig/sim/served_image.h"

namespace rotunda::cli {
namespace {

std::filesystem::path SocketOf(const ServeArguments& arguments) {
  return arguments.socket ? *arguments.socket : DefaultCameraSocket();
}

Result<sim::ServedShots> LoadOrRender(const ServeArguments& arguments, const sim::RigOptions& rig,
                                      const sim::SimulateOptions& simulate,
                                      const CommonOptions& common) {
  ThreadPool threads(common.threads);
  ProgressLine progress(!common.json);
  RunContext context{threads, common.stop,
                     [&](std::string_view stage, size_t done, size_t total) {
                       progress.Update(stage, done, total);
                     },
                     simulate.seed};
  const auto format = sim::PixelFormatOfName(arguments.format);
  if (!arguments.frame_sets.empty()) {
    return sim::LoadShots(arguments.frame_sets, format, context);
  }
  return sim::RenderShot(rig, simulate, format.value_or(sim::PixelFormat::kBayerRG8), context);
}

void PrintCameras(const sim::CameraServer& server, const sim::ServedShots& shots, bool json) {
  const int last = server.size() - 1;
  if (json) {
    nlohmann::ordered_json result = {{"socket", server.socket().string()},
                                     {"cameras", nlohmann::ordered_json::array()}};
    for (int i = 0; i <= last; ++i) {
      result["cameras"].push_back({{"address", server.address(i)},
                                   {"camera", server.camera(i).name},
                                   {"serial", server.camera(i).serial}});
    }
    std::printf("%s\n", result.dump(1).c_str());
  } else {
    std::printf("%d cameras at %s to %s: %dx%d %s\n", last + 1, server.address(0).c_str(),
                server.address(last).c_str(), shots.width_px, shots.height_px,
                sim::PixelFormatName(shots.format));
    std::printf("Trigger and faults: rotunda simulate --socket %s --send pulse\n",
                server.socket().c_str());
    std::printf("Ctrl-C ends.\n");
  }
  std::fflush(stdout);
}

void WaitForStop(const std::stop_token& stop) {
  std::mutex mutex;
  std::condition_variable_any ended;
  std::unique_lock lock(mutex);
  ended.wait(lock, stop, [] { return false; });
}

std::vector<std::string> FormatNames() {
  std::vector<std::string> names;
  for (const sim::PixelFormat format : sim::PixelFormats()) {
    names.emplace_back(sim::PixelFormatName(format));
  }
  return names;
}

std::string FaultHelp() {
  std::string text =
      "Send one command to cameras that are served:\n"
      "pulse [LINE [EDGE_NS [WIDTH_US]]]   (the trigger cable of input 0 or 1, default 0, rises, "
      "now or at EDGE_NS of the steady clock, for WIDTH_US: armed cameras take a picture)\n"
      "shot NUMBER    (which of the frame sets they see next, from 0)\n"
      "list   (address, name, serial number, state, frames sent, faults in force)\n"
      "clear [CAMERA]   (no more faults)\n"
      "fault CAMERA|all KIND [VALUE [FRAMES]]   with KIND one of these, and VALUE where it has one";
  for (const sim::FaultText& fault : sim::FaultTexts()) {
    text += std::string("\n  ") + fault.name + (*fault.unit ? " " : "") + fault.unit + ": " +
            fault.help;
  }
  return text;
}

}  // namespace

std::filesystem::path DefaultCameraSocket() {
  const char* runtime = std::getenv("XDG_RUNTIME_DIR");
  if (runtime != nullptr && *runtime != '\0') {
    return std::filesystem::path(runtime) / "rotunda-cameras.sock";
  }
  return "/tmp/rotunda-cameras-" + std::to_string(::getuid()) + ".sock";
}

void AddServeOptions(CLI::App* command, ServeArguments& arguments) {
  const std::string group = "Cameras on loopback";
  command
      ->add_option_function<std::vector<std::string>>(
          "--serve",
          [&arguments](const std::vector<std::string>& folders) {
            arguments.serve = true;
            for (const std::string& folder : folders) {
              if (!folder.empty()) arguments.frame_sets.emplace_back(folder);
            }
          },
          "Be GigE Vision cameras that show these frame sets, one a pulse, or, without any, what "
          "would be rendered; until Ctrl-C, which is its ordinary end: exit status 0")
      ->expected(0, -1)
      ->type_name("FRAMESET")
      ->group(group);
  command->add_option("--send", arguments.send, FaultHelp())
      ->expected(1, 8)
      ->type_name("WORD")
      ->group(group);
  command->add_option("--block", arguments.block, "Addresses: camera i is BLOCK.i")
      ->check([](const std::string& text) {
        const auto block = sim::ParseAddressBlock(text);
        return block.ok() ? std::string() : block.error().message;
      })
      ->type_name("127.A.B")
      ->capture_default_str()
      ->group(group);
  command
      ->add_option("--socket", arguments.socket,
                   "Where the cameras take commands; default: rotunda-cameras.sock in "
                   "$XDG_RUNTIME_DIR, else /tmp/rotunda-cameras-UID.sock")
      ->type_name("FILE")
      ->group(group);
  command
      ->add_option("--pixel-format", arguments.format,
                   "What the cameras send unless they are told; default: the frame set's, or "
                   "BayerRG8 when rendered")
      ->check(CLI::IsMember(FormatNames()))
      ->group(group);
  command
      ->add_flag("--hold", arguments.hold,
                 "Show the same shot at every pulse until \"shot NUMBER\" is sent")
      ->group(group);
  command
      ->add_option("--exposure-delay", arguments.delay_us,
                   "From the pulse to the begin of the exposure")
      ->check(CLI::Range(0.0, 1e6))
      ->type_name("US")
      ->group(group);
  command->add_option("--exposure-jitter", arguments.jitter_us, "Standard deviation of that delay")
      ->check(CLI::Range(0.0, 1e6))
      ->type_name("US")
      ->group(group);
}

Status ServeCameras(const ServeArguments& arguments, const sim::RigOptions& rig,
                    const sim::SimulateOptions& simulate, const CommonOptions& common) {
  sim::CameraServerOptions options;
  ROTUNDA_ASSIGN_OR_RETURN(options.block, sim::ParseAddressBlock(arguments.block));
  ROTUNDA_ASSIGN_OR_RETURN(const sim::ServedShots shots,
                           LoadOrRender(arguments, rig, simulate, common));
  options.cameras = sim::CamerasOf(shots);
  for (sim::SimulatedCamera& camera : options.cameras) {
    camera.exposure_delay_us = arguments.delay_us;
    camera.exposure_jitter_us = arguments.jitter_us;
  }
  options.source = shots.source;
  options.shots = std::max(1, static_cast<int>(shots.shots.size()));  // what is rendered is one
  options.socket = SocketOf(arguments);
  options.pulse_advances_shot = !arguments.hold;
  options.seed = simulate.seed;
  ROTUNDA_ASSIGN_OR_RETURN(const std::unique_ptr<sim::CameraServer> server,
                           sim::CameraServer::Start(std::move(options)));
  PrintCameras(*server, shots, common.json);
  WaitForStop(common.stop);
  return {};
}

Status SendToCameras(const ServeArguments& arguments, const CommonOptions& common) {
  std::string command;
  for (const std::string& word : arguments.send) command += (command.empty() ? "" : " ") + word;
  ROTUNDA_ASSIGN_OR_RETURN(const std::string answer,
                           sim::SendServerCommand(SocketOf(arguments), command));
  if (common.json) {
    std::printf("%s\n", nlohmann::ordered_json({{"answer", answer}}).dump(1).c_str());
  } else {
    std::printf("%s%s", answer.c_str(), answer.ends_with('\n') ? "" : "\n");
  }
  return {};
}

}  // namespace rotunda::cli
