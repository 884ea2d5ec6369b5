#pragma once

#include <filesystem>

#include "sfm/core/result.h"
#include "sfm/features.h"
#include "sfm/matching.h"
#include "sfm/tracks.h"
#include "sfm/two_view.h"

namespace rotunda::sfm {

/// Products of stages as little-endian binary files: a line of text with the kind and its version,
/// then counts and arrays. Reading checks kind, version, every count against the file's length,
/// and what the types promise (finite numbers, unit quaternions, tracks of two or more pictures in
/// order): kBadInput names the file and what is wrong.
Status WriteFeatures(const Features& features, const std::filesystem::path& file);
Status WriteMatches(const Matches& matches, const std::filesystem::path& file);
Status WriteTwoViews(const TwoViews& two_views, const std::filesystem::path& file);
Status WriteTracks(const Tracks& tracks, const std::filesystem::path& file);

Result<Features> ReadFeatures(const std::filesystem::path& file);
/// Keypoint ids are checked against `features`; so they are in the others.
Result<Matches> ReadMatches(const std::filesystem::path& file, const Features& features);
Result<TwoViews> ReadTwoViews(const std::filesystem::path& file, const Features& features);
Result<Tracks> ReadTracks(const std::filesystem::path& file, const Features& features);

}  // namespace rotunda::sfm
