#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "daemon/cli/commands.h"
#include "daemon/cli/terminal.h"
#include "daemon/model_export.h"
#include "sfm/core/file_io.h"
#include "sfm/core/pose_set.h"

namespace rotunda::cli {
namespace {

struct ExportArguments {
  std::filesystem::path reconstruction;
  std::filesystem::path out;
  std::string format;
};

/// Poses that are not to be trusted are written, but not without a word.
std::string VerdictOf(const std::filesystem::path& reconstruction) {
  const Result<PoseSet> poses = ReadPoseSet(reconstruction / "poses.json");
  return poses.ok() ? poses->summary.verdict : "";
}

std::string ContentsOf(const daemon::ExportedModel& model, const std::string& format) {
  const std::string points = std::to_string(model.points) + " points";
  const std::string cameras = std::to_string(model.images) + " cameras";
  if (format == "ply") return points;
  if (format == "metashape" || format == "realitycapture") return cameras;
  return cameras + " and " + points;
}

Status Export(const ExportArguments& arguments, const CommonOptions& common) {
  ROTUNDA_ASSIGN_OR_RETURN(OutputFolder folder, OutputFolder::Begin(arguments.out));
  ROTUNDA_ASSIGN_OR_RETURN(
      const daemon::ExportedModel model,
      daemon::ExportModel(arguments.reconstruction, arguments.format, folder.path()));
  ROTUNDA_RETURN_IF_ERROR(folder.Commit());
  const std::string verdict = VerdictOf(arguments.reconstruction);
  if (verdict == "folded" || verdict == "unsure") {
    std::fprintf(stderr, "rotunda: warning: the verdict on these poses is '%s'\n", verdict.c_str());
  }
  if (common.json) {
    const nlohmann::ordered_json result = {{"out", arguments.out.string()},
                                           {"format", arguments.format},
                                           {"verdict", verdict},
                                           {"images", model.images},
                                           {"points", model.points}};
    std::printf("%s\n", result.dump(1).c_str());
  } else {
    std::printf("Wrote %s as %s to %s\n", ContentsOf(model, arguments.format).c_str(),
                arguments.format.c_str(), arguments.out.c_str());
  }
  return {};
}

}  // namespace

void AddExport(CLI::App& app, CommonOptions& common, Action& chosen) {
  auto arguments = std::make_shared<ExportArguments>();
  CLI::App* command =
      AddCommand(app, common, "export", "Write a reconstruction in another program's format.",
                 "rotunda export out --format colmap-text --out out-text");
  command->add_option("DIR", arguments->reconstruction, "Folder that `rotunda reconstruct` made")
      ->required();
  command
      ->add_option(
          "--format", arguments->format,
          "Format to write. nerfstudio wants the pictures in OUT/images, realitycapture its "
          "files beside the pictures; metashape and realitycapture hold no points, ply "
          "nothing else; Bayer pictures are developed first")
      ->check(CLI::IsMember(daemon::ExportFormats()))
      ->required();
  command
      ->add_option("--out", arguments->out,
                   "Folder to make, in one that exists; if it is there it must be empty")
      ->type_name("DIR")
      ->required();
  command->callback([arguments, &common, &chosen] {
    chosen = [arguments, &common] {
      const Status status = Export(*arguments, common);
      return status.ok() ? kDone : Fail(status.error());
    };
  });
}

}  // namespace rotunda::cli
