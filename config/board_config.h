#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "rig/board.h"
#include "sfm/core/result.h"

namespace rotunda::config {

/// A calibration target from the text of a TOML file (config/cuboid.toml and config/boards show
/// every key): either a [cuboid], or a list of [[face]] with their places. Refused with kBadInput,
/// naming `source`, the line, the key and what is allowed: bad TOML, a key that is not known, a
/// wrong type, a value out of range, ids on two faces.
Result<rig::Board> ParseBoard(const std::string& text, const std::string& source);
Result<rig::Board> ReadBoard(const std::filesystem::path& file);

/// The same, with every key that is wrong instead of the first.
struct CheckedBoard {
  rig::Board board;  // to be used only when there are no problems
  std::vector<Error> problems;
};
CheckedBoard CheckBoard(const std::string& text, const std::string& source);

}  // namespace rotunda::config
