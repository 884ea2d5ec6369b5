#include "rig/sim/simulate.h"

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "config/board_config.h"
#include "config/sim_config.h"
#include "daemon/cli/commands.h"
#include "daemon/cli/serve_cameras.h"
#include "daemon/cli/terminal.h"

namespace rotunda::cli {
namespace {

struct SimulateArguments {
  std::filesystem::path out;
  std::optional<std::filesystem::path> rig;
  std::optional<std::filesystem::path> board;
  int placements = 0;
  std::optional<int> cameras;  // default: all of the rig
  sim::SimulateOptions options;
  ServeArguments serve;
};

Status Simulate(const SimulateArguments& arguments, const CommonOptions& common) {
  if (!arguments.serve.send.empty()) return SendToCameras(arguments.serve, common);
  sim::RigOptions rig;
  sim::SimulateOptions options = arguments.options;
  if (arguments.rig) {
    ROTUNDA_ASSIGN_OR_RETURN(rig, config::ReadRigOptions(*arguments.rig));
  }
  options.cameras = arguments.cameras.value_or(rig.geometry.columns * rig.geometry.rows);
  if (arguments.board) {
    ROTUNDA_ASSIGN_OR_RETURN(options.board, config::ReadBoard(*arguments.board));
  }
  if (arguments.serve.serve) return ServeCameras(arguments.serve, rig, options, common);
  ThreadPool threads(common.threads);
  ProgressLine progress(!common.json);
  RunContext context{threads, common.stop,
                     [&](std::string_view stage, size_t done, size_t total) {
                       progress.Update(stage, done, total);
                     },
                     options.seed};
  ROTUNDA_RETURN_IF_ERROR(
      arguments.placements > 0
          ? sim::SimulatePlacements(rig, options, arguments.placements, arguments.out, context)
          : sim::SimulateFrameSet(rig, options, arguments.out, context));
  const int shots = std::max(arguments.placements, 1);
  const std::vector<StageCost> costs = progress.Finish();
  if (common.json) {
    const nlohmann::ordered_json result = {
        {"out", arguments.out.string()}, {"cameras", options.cameras}, {"shots", shots}};
    std::printf("%s\n", result.dump(1).c_str());
  } else {
    std::printf("Wrote %d pictures, truth.json and calibration.json to %s\n",
                shots * options.cameras, arguments.out.c_str());
    for (const StageCost& cost : costs) {
      std::printf("  %-16s %8.2f s %8.0f MB\n", cost.stage.c_str(), cost.seconds,
                  cost.peak_memory_mb);
    }
  }
  return {};
}

/// An option that says of cameras by how much each is not where the calibration has it.
void AddMovedOption(CLI::App* command, const std::string& name, const char* type,
                    const char* description, double sim::MovedCamera::*amount,
                    sim::SimulateOptions& options) {
  command
      ->add_option_function<std::vector<std::string>>(
          name,
          [name, amount, &options](const std::vector<std::string>& words) {
            for (size_t i = 0; i + 1 < words.size(); i += 2) {
              sim::MovedCamera& moved = options.moved.emplace_back();
              moved.camera = words[i];
              if (!CLI::detail::lexical_cast(words[i + 1], moved.*amount)) {
                throw CLI::ValidationError(name, "'" + words[i + 1] + "' is no number");
              }
            }
          },
          description)
      ->type_size(2)
      ->expected(1, CLI::detail::expected_max_vector_size)
      ->allow_extra_args(false)
      ->type_name(type);
}

/// What stands in the rig when it is the calibration target.
void AddTargetOptions(CLI::App* command, SimulateArguments& arguments) {
  sim::SimulateOptions& options = arguments.options;
  AddChoice<sim::Target>(command, "--target", options.target,
                         "What stands in the rig: body (default) or the ChArUco cuboid",
                         {{"body", sim::Target::kBody}, {"cuboid", sim::Target::kCuboid}});
  command
      ->add_option("--board", arguments.board,
                   "With the target cuboid: a board file; default: config/cuboid.toml's")
      ->type_name("FILE");
  command
      ->add_option(
          "--board-errors", options.board_errors,
          "With the target cuboid: how far it is from its drawing, times 1 mm, 0.2 deg and "
          "a bow of 0.5 mm a face; the same in every placement of a seed")
      ->capture_default_str();
  command
      ->add_option("--placement", options.placement,
                   "With the target cuboid: where it stands, 0, 1, 2, ...")
      ->check(CLI::Range(0, 10000))
      ->capture_default_str();
  command
      ->add_option(
          "--placements", arguments.placements,
          "With the target cuboid: write that many frame sets, OUT/placement_00 and so on, "
          "for a calibration")
      ->check(CLI::Range(1, 10000));
}

void AddBodyOptions(CLI::App* command, sim::SimulateOptions& options) {
  command->add_option("--body", options.body, "With the target body: procedural, or an .obj file")
      ->capture_default_str()
      ->type_name("procedural|FILE.obj");
  AddChoice<sim::GarmentTexture>(command, "--texture", options.texture,
                                 "What the garment shows: unique = other prints on the back than "
                                 "on the front (default), twin = the "
                                 "same, plaid = periodic, own = the mesh's texture",
                                 {{"unique", sim::GarmentTexture::kUnique},
                                  {"twin", sim::GarmentTexture::kTwin},
                                  {"plaid", sim::GarmentTexture::kPlaid},
                                  {"own", sim::GarmentTexture::kOwn}});
  AddChoice<sim::Relief>(
      command, "--relief", options.relief,
      "natural (default), or symmetric = the back of the garment has the front's shape",
      {{"natural", sim::Relief::kNatural}, {"symmetric", sim::Relief::kSymmetric}});
  AddChoice<sim::Cover>(
      command, "--cover", options.cover,
      "none (default), or head-and-shoes = face and shoes in plain colours, so that only hair and "
      "hands tell the back of a twin garment from the front",
      {{"none", sim::Cover::kNone}, {"head-and-shoes", sim::Cover::kHeadAndShoes}});
  AddChoice<sim::Background>(
      command, "--background", options.background,
      "studio (default: floor marks, poles, curtain) or plain",
      {{"studio", sim::Background::kStudio}, {"plain", sim::Background::kPlain}});
  command->add_option("--height", options.height_m, "Height of the body in metres, 0.8 to 2.2")
      ->capture_default_str();
}

void AddCameraOptions(CLI::App* command, SimulateArguments& arguments) {
  sim::SimulateOptions& options = arguments.options;
  AddSeed(command, options.seed, "Seed of cameras, body, garment and noise");
  command
      ->add_option("--cameras", arguments.cameras,
                   "How many of the rig's cameras, evenly spread, default: all; with fewer than "
                   "about 30 neighbours no longer overlap")
      ->check(CLI::Range(2, 10000));
  command
      ->add_option("--scale", options.picture_scale,
                   "Size of the pictures, above 0.05 to 2; 1 is the rig's")
      ->capture_default_str();
  AddMovedOption(
      command, "--move", "CAMERA MM",
      "Push a camera so many millimetres to its right after the rig was calibrated: "
      "calibration.json has it where it was, truth.json where it is. Once for each camera",
      &sim::MovedCamera::right_mm, options);
  AddMovedOption(
      command, "--turn", "CAMERA DEG",
      "Turn a camera so many degrees to its right after the rig was calibrated. Once for "
      "each camera",
      &sim::MovedCamera::turn_deg, options);
}

}  // namespace

void AddSimulate(CLI::App& app, CommonOptions& common, Action& chosen) {
  auto arguments = std::make_shared<SimulateArguments>();
  CLI::App* command = AddCommand(
      app, common, "simulate",
      "Render what the cameras of a rig would take of a person, as a frame set with truth.json "
      "(the exact cameras) and calibration.json (as a calibration of the rig would have them). Or "
      "be "
      "those cameras: with --serve, GigE Vision devices that any GigE Vision software can use.",
      "rotunda simulate capture --texture twin --relief symmetric --seed 7\n"
      "  rotunda simulate --serve capture      (in another terminal: arv-viewer-0.8)\n"
      "  rotunda simulate --send fault c03r1 drop 0.05\n"
      "  rotunda simulate --send pulse");
  CLI::Option* out = command->add_option(
      "OUT", arguments->out, "Folder to make, in one that exists; if it is there it must be empty");
  command->add_option("--rig", arguments->rig, "Rig to simulate; default: config/rig-90.toml's")
      ->type_name("FILE");
  AddTargetOptions(command, *arguments);
  AddBodyOptions(command, arguments->options);
  AddCameraOptions(command, *arguments);
  AddServeOptions(command, arguments->serve);
  AddThreads(command, common)->excludes("--send");
  command->callback([arguments, out, &common, &chosen] {
    const int tasks = static_cast<int>(out->count() > 0) +
                      static_cast<int>(arguments->serve.serve) +
                      static_cast<int>(!arguments->serve.send.empty());
    if (tasks != 1) throw CLI::ValidationError("OUT", "expected one of OUT, --serve and --send");
    chosen = [arguments, &common] {
      const Status status = Simulate(*arguments, common);
      return status.ok() ? kDone : Fail(status.error());
    };
  });
}

}  // namespace rotunda::cli
