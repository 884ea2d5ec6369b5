#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <map>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "sfm/core/name_list.h"

namespace rotunda::cli {

/// What every command takes besides its own options.
struct CommonOptions {
  bool json = false;
  int threads = 0;  // 0: the machine's cores
  std::stop_token stop;
};

/// Adds the command to `app`. When it is the one that was called, `chosen` is set to what runs it
/// and gives the exit code.
using Action = std::function<int()>;
void AddSimulate(CLI::App& app, CommonOptions& common, Action& chosen);
void AddCalibrate(CLI::App& app, CommonOptions& common, Action& chosen);
void AddBoard(CLI::App& app, CommonOptions& common, Action& chosen);
void AddReconstruct(CLI::App& app, CommonOptions& common, Action& chosen);
void AddEvaluate(CLI::App& app, CommonOptions& common, Action& chosen);
void AddCompare(CLI::App& app, CommonOptions& common, Action& chosen);
void AddExport(CLI::App& app, CommonOptions& common, Action& chosen);
void AddCapture(CLI::App& app, CommonOptions& common, Action& chosen);
void AddCameras(CLI::App& app, CommonOptions& common, Action& chosen);
void AddStatus(CLI::App& app, CommonOptions& common, Action& chosen);
void AddJobs(CLI::App& app, CommonOptions& common, Action& chosen);
void AddCaptures(CLI::App& app, CommonOptions& common, Action& chosen);
void AddCalibrations(CLI::App& app, CommonOptions& common, Action& chosen);
void AddDrift(CLI::App& app, CommonOptions& common, Action& chosen);
void AddEvents(CLI::App& app, CommonOptions& common, Action& chosen);

/// A sub-command with --json and an example under its help.
CLI::App* AddCommand(CLI::App& app, CommonOptions& common, const std::string& name,
                     const std::string& description, const std::string& example);

/// --threads, of a command that computes.
CLI::Option* AddThreads(CLI::App* command, CommonOptions& common);

/// An option whose values have names.
template <typename T>
CLI::Option* AddChoice(CLI::App* command, const std::string& name, T& value,
                       const std::string& help, const std::map<std::string, T>& choices) {
  return command
      ->add_option_function<std::string>(
          name, [&value, choices](const std::string& choice) { value = choices.at(choice); }, help)
      ->check(CLI::IsMember(NamesIn(choices)));
}

/// --fix-intrinsics and --refine-intrinsics; gives both.
std::vector<CLI::Option*> AddLensFlags(CLI::App* command, std::optional<bool>& refine);

/// --seed: a whole number, nothing else.
void AddSeed(CLI::App* command, uint64_t& seed, const std::string& help);

}  // namespace rotunda::cli
