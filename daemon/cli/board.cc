#include "rig/board.h"

#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "config/board_config.h"
#include "daemon/cli/commands.h"
#include "daemon/cli/terminal.h"
#include "rig/board_drawing.h"
#include "sfm/core/file_io.h"
#include "sfm/core/html_text.h"

namespace rotunda::cli {
namespace {

enum class DrawingFormat { kPdf, kSvg };

struct DrawArguments {
  std::filesystem::path board;
  std::filesystem::path out;
  DrawingFormat format = DrawingFormat::kPdf;
};

/// Names of the files, one a face.
Result<std::vector<std::string>> WriteFaces(const rig::Board& board, DrawingFormat format,
                                            const OutputFolder& folder) {
  const bool pdf = format == DrawingFormat::kPdf;
  std::vector<std::string> files;
  for (const rig::BoardFace& face : board.faces) {
    ROTUNDA_ASSIGN_OR_RETURN(const std::string text,
                             pdf ? rig::FacePdf(face, board.name) : rig::FaceSvg(face, board.name));
    files.push_back(face.name + (pdf ? ".pdf" : ".svg"));
    const Status written = WriteFileAtomically(folder.path() / files.back(), text);
    if (!written.ok()) return folder.InPlace(written.error());
  }
  return files;
}

Status Draw(const DrawArguments& arguments, const CommonOptions& common) {
  ROTUNDA_ASSIGN_OR_RETURN(const rig::Board board, config::ReadBoard(arguments.board));
  ROTUNDA_ASSIGN_OR_RETURN(OutputFolder folder, OutputFolder::Begin(arguments.out));
  ROTUNDA_ASSIGN_OR_RETURN(const std::vector<std::string> files,
                           WriteFaces(board, arguments.format, folder));
  ROTUNDA_RETURN_IF_ERROR(folder.Commit());
  if (common.json) {
    const nlohmann::ordered_json result = {{"out", arguments.out.string()}, {"files", files}};
    std::printf("%s\n", result.dump(1).c_str());
  } else {
    std::printf("Wrote %s to %s. Print at 100%% (not \"fit to page\") and measure the ruler.\n",
                Counted(files.size(), "face").c_str(), arguments.out.c_str());
  }
  return {};
}

}  // namespace

void AddBoard(CLI::App& app, CommonOptions& common, Action& chosen) {
  CLI::App* board = app.add_subcommand("board", "The calibration target");
  board->require_subcommand(1);
  auto arguments = std::make_shared<DrawArguments>();
  CLI::App* command = AddCommand(
      *board, common, "draw",
      "Draw every face of a board at true scale, one file a face, to be printed and glued on.",
      "rotunda board draw config/cuboid.toml --out prints");
  command->add_option("BOARD", arguments->board, "The board's file, as config/cuboid.toml")
      ->required()
      ->type_name("FILE");
  command
      ->add_option("--out", arguments->out,
                   "Folder to make, in one that exists; if it is there it must be empty")
      ->required()
      ->type_name("FOLDER");
  AddChoice<DrawingFormat>(command, "--format", arguments->format, "pdf (default) or svg",
                           {{"pdf", DrawingFormat::kPdf}, {"svg", DrawingFormat::kSvg}});
  command->callback([arguments, &common, &chosen] {
    chosen = [arguments, &common] {
      const Status status = Draw(*arguments, common);
      return status.ok() ? kDone : Fail(status.error());
    };
  });
}

}  // namespace rotunda::cli
