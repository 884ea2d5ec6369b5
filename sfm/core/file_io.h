#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

#include "sfm/core/result.h"

namespace rotunda {

/// Whole file as bytes. kNotFound, kIo; the error's context is the path.
Result<std::string> ReadFile(const std::filesystem::path& file);

/// Writes a file that is not there yet, without making it durable: for the files of an
/// OutputFolder, whose Commit() does.
Status WriteNewFile(const std::filesystem::path& file, std::string_view bytes);

/// Writes beside `file`, fsyncs and renames over it: a reader sees the old text or the new one.
Status WriteFileAtomically(const std::filesystem::path& file, std::string_view bytes);

/// Whether WriteFileAtomically can put `file` into place, before the work that makes it:
/// kInvalidArgument when it is a folder or its folder may not be written, kNotFound when that is
/// not there.
Status CheckOutputFile(const std::filesystem::path& file);

/// Whether `target` can become a folder with `bytes` in it, now and by this user. What will not
/// pass by itself: kNotFound when the folder it is to stand in is not there, kInvalidArgument when
/// that may not be written, kAlreadyExists as OutputFolder::Begin. kIo: too little room, or any
/// other refusal.
Status CheckOutputPlace(const std::filesystem::path& target, uint64_t bytes);

/// A folder that appears whole or not at all. Begin() makes a hidden temporary folder beside
/// `target`; Commit() fsyncs every file below and renames it into place; the destructor removes it
/// when Commit() was not reached (error, Ctrl-C).
class OutputFolder {
 public:
  /// kAlreadyExists when `target` is there and is not an empty folder; kIo when the parent cannot
  /// be written.
  static Result<OutputFolder> Begin(const std::filesystem::path& target);
  OutputFolder(OutputFolder&& other) noexcept;
  OutputFolder& operator=(OutputFolder&&) = delete;
  ~OutputFolder();

  /// Where to write.
  const std::filesystem::path& path() const { return temporary_; }
  /// The error of writing there, about the place where it was to be in the end.
  Error InPlace(const Error& error) const;
  /// kIo (with errno's text, e.g. "No space left on device") when a file cannot be made durable.
  Status Commit();

 private:
  OutputFolder(std::filesystem::path target, std::filesystem::path temporary);
  std::filesystem::path target_;
  std::filesystem::path temporary_;  // empty once committed or moved from
};

}  // namespace rotunda
