#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>

#include "tests/bench/disambiguation_methods.h"

namespace rotunda::bench {

/// What is kept of a cell: capture, method, "options", "revision" of the sources, "seconds" of the
/// whole program from reading the two-view geometries on, "stages", "models", "registered", "of",
/// "evaluation" (as `rotunda evaluate --json`, where there is truth), what poses.json says of
/// itself, the checksum of its poses, and which cameras it names beside those it should; of
/// photographs "scene", whether it is "right" and why; or "error", and whether it was "refused" as
/// impossible, which is a result.
using CellRecord = nlohmann::ordered_json;

/// Of the sources that this program is built of, as `git describe --always --dirty` has it.
extern const char* const kRevision;

/// The record that an earlier run wrote; nullopt when there is none.
std::optional<CellRecord> ReadCell(const Cell& cell, const std::filesystem::path& work);

/// Makes what is missing of the capture, runs the method on it and writes the record.
CellRecord RunCell(const Cell& cell, const std::filesystem::path& work);

}  // namespace rotunda::bench
