#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "daemon/cli/commands.h"
#include "daemon/cli/terminal.h"
#include "sfm/colmap_io.h"
#include "sfm/core/file_io.h"

namespace rotunda::cli {
namespace {

struct ExportArguments {
  std::filesystem::path reconstruction;
  std::filesystem::path out;
  std::string format;
};

Status WriteFormat(const ExportArguments& arguments, const sfm::ColmapModel& model,
                   const std::filesystem::path& folder) {
  if (arguments.format == "ply") {
    return sfm::WritePly(model.reconstruction, folder / "points.ply");
  }
  FrameSet names;
  for (const std::string& name : model.image_names) names.frames.emplace_back().file = name;
  const auto encoding =
      arguments.format == "colmap" ? sfm::ColmapEncoding::kBinary : sfm::ColmapEncoding::kText;
  return sfm::WriteColmapModel(model.reconstruction, model.features, names, folder, encoding);
}

Status Export(const ExportArguments& arguments, const CommonOptions& common) {
  ROTUNDA_ASSIGN_OR_RETURN(const sfm::ColmapModel model,
                           sfm::ReadColmapModel(arguments.reconstruction / "sparse" / "0"));
  ROTUNDA_ASSIGN_OR_RETURN(OutputFolder folder, OutputFolder::Begin(arguments.out));
  ROTUNDA_RETURN_IF_ERROR(WriteFormat(arguments, model, folder.path()));
  ROTUNDA_RETURN_IF_ERROR(folder.Commit());
  const size_t images = sfm::RegisteredCount(model.reconstruction);
  const size_t points = model.reconstruction.points.size();
  if (common.json) {
    const nlohmann::ordered_json result = {{"out", arguments.out.string()},
                                           {"format", arguments.format},
                                           {"images", images},
                                           {"points", points}};
    std::printf("%s\n", result.dump(1).c_str());
  } else {
    std::printf("Wrote %zu images and %zu points as %s to %s\n", images, points,
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
  command->add_option("--format", arguments->format, "Format to write")
      ->check(CLI::IsMember({"colmap", "colmap-text", "ply"}))
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
