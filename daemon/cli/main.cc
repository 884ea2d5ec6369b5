#include <CLI/CLI.hpp>
#include <cstdio>

#include "daemon/cli/commands.h"
#include "daemon/cli/terminal.h"

namespace rotunda::cli {

CLI::App* AddCommand(CLI::App& app, CommonOptions& common, const std::string& name,
                     const std::string& description, const std::string& example) {
  CLI::App* command = app.add_subcommand(name, description);
  command->add_flag("--json", common.json, "Print the result as JSON on standard output");
  command->footer("Example:\n  " + example +
                  "\n\nExit status: 0 done, 1 the work failed (reason in one line), 2 wrong usage, "
                  "130 interrupted by Ctrl-C.");
  return command;
}

CLI::Option* AddThreads(CLI::App* command, CommonOptions& common) {
  return command->add_option("--threads", common.threads, "Threads to use; 0: all cores")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
}

void AddSeed(CLI::App* command, uint64_t& seed, const std::string& help) {
  const CLI::Validator whole(
      [](const std::string& text) {
        constexpr size_t kMaxDigits = 18;
        const bool fine = !text.empty() && text.size() <= kMaxDigits &&
                          text.find_first_not_of("0123456789") == std::string::npos;
        return fine ? std::string() : "'" + text + "' is not a whole number of at most 18 digits";
      },
      "");
  command->add_option("--seed", seed, help)->check(whole)->capture_default_str();
}

std::vector<CLI::Option*> AddLensFlags(CLI::App* command, std::optional<bool>& refine) {
  CLI::Option* fix = command->add_flag_callback(
      "--fix-intrinsics", [&refine] { refine = false; },
      "Keep intrinsics (default when they are calibrated)");
  CLI::Option* anew = command->add_flag_callback(
      "--refine-intrinsics", [&refine] { refine = true; },
      "Refine focal length and distortion (default without a calibration)");
  return {fix, anew->excludes(fix)};
}

namespace {

/// What is said to be lacking may be there, misspelt: then that is what to name.
std::string NameUnknownWord(const CLI::App& app, const CLI::ParseError& wrong) {
  const bool names_it = dynamic_cast<const CLI::ExtrasError*>(&wrong) != nullptr;
  const bool no_command = app.get_subcommands().empty();
  for (const std::string& word : app.remaining(/*recurse=*/true)) {
    if (names_it || word == "--") break;
    if (no_command || word.starts_with('-')) return "'" + word + "' is not known";
  }
  return wrong.what();
}

}  // namespace

int Main(int argc, char** argv) {
  const InterruptWatch interrupt;
  CommonOptions common;
  common.stop = interrupt.token();
  Action chosen;

  CLI::App app("Rotunda: camera poses of a body-scanning rig, from its pictures", "rotunda");
  app.require_subcommand(1);
  app.set_version_flag("--version", ROTUNDA_VERSION);
  app.footer("`rotunda COMMAND --help` tells a command's options and shows an example.");
  AddSimulate(app, common, chosen);
  AddCalibrate(app, common, chosen);
  AddBoard(app, common, chosen);
  AddReconstruct(app, common, chosen);
  AddEvaluate(app, common, chosen);
  AddCompare(app, common, chosen);
  AddExport(app, common, chosen);
  AddCapture(app, common, chosen);
  AddCameras(app, common, chosen);
  AddStatus(app, common, chosen);
  AddJobs(app, common, chosen);
  AddCaptures(app, common, chosen);
  AddCalibrations(app, common, chosen);
  AddDrift(app, common, chosen);
  AddEvents(app, common, chosen);
  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& help) {
    const std::vector<std::string> unknown = app.remaining();
    if (unknown.empty() || !app.get_subcommands().empty()) return app.exit(help);
    std::fprintf(stderr, "rotunda: '%s' is not known (see --help)\n", unknown.front().c_str());
    return kWrongUsage;
  } catch (const CLI::ParseError& wrong) {
    const std::string what = NameUnknownWord(app, wrong);
    std::fprintf(stderr, "rotunda: %s (see --help)\n", what.c_str());
    return kWrongUsage;
  }
  try {
    return chosen();
  } catch (const std::exception& unexpected) {  // a bug, or no memory left; folders are cleaned up
    return Fail({ErrorCode::kFailed, unexpected.what(), "unexpected failure"});
  }
}

}  // namespace rotunda::cli

int main(int argc, char** argv) { return rotunda::cli::Main(argc, argv); }
