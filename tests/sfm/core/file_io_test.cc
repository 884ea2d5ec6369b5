#include "sfm/core/file_io.h"

#include <gtest/gtest.h>

#include <fstream>
#include <set>

#include "tests/support/own_disk.h"
#include "tests/support/process.h"

namespace rotunda {
namespace {

namespace fs = std::filesystem;
using test::TemporaryFolder;

std::set<std::string> Names(const fs::path& folder) {
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder)) names.insert(entry.path().filename());
  return names;
}

void Put(const fs::path& file, const std::string& text) { std::ofstream(file) << text; }

bool SaysNoSpace(const Status& status) {
  return !status.ok() && status.error().code == ErrorCode::kIo &&
         status.error().message.find("No space left on device") != std::string::npos;
}

TEST(ReadFile, GivesTheBytesOfAnySize) {
  const TemporaryFolder folder;
  for (const size_t size : {0, 1, 65535, 65536, 65537, 1000000}) {
    std::string bytes(size, '\0');
    for (size_t i = 0; i < size; ++i) bytes[i] = static_cast<char>(i * 2654435761u >> 13);
    Put(folder / "file", bytes);
    const auto read = ReadFile(folder / "file");
    ASSERT_TRUE(read.ok()) << read.error().ToString();
    EXPECT_EQ(*read == bytes, true) << size;
  }
}

TEST(ReadFile, SaysWhyItCannot) {
  const TemporaryFolder folder;
  const auto missing = ReadFile(folder / "nothing");
  ASSERT_FALSE(missing.ok());
  EXPECT_EQ(missing.error().code, ErrorCode::kNotFound);
  EXPECT_EQ(missing.error().context, (folder / "nothing").string());
  EXPECT_EQ(missing.error().message, "cannot open: No such file or directory");
  const auto directory = ReadFile(folder.path());
  ASSERT_FALSE(directory.ok());
  EXPECT_EQ(directory.error().message, "cannot read: Is a directory");
}

TEST(WriteFileAtomically, WritesAndReplaces) {
  const TemporaryFolder folder;
  ASSERT_TRUE(WriteFileAtomically(folder / "a.json", "first").ok());
  EXPECT_EQ(*ReadFile(folder / "a.json"), "first");
  ASSERT_TRUE(WriteFileAtomically(folder / "a.json", "second, longer").ok());
  EXPECT_EQ(*ReadFile(folder / "a.json"), "second, longer");
  EXPECT_EQ(Names(folder.path()), std::set<std::string>{"a.json"});
}

TEST(WriteFileAtomically, StepsAsideForALeftOverOfItsName) {
  const TemporaryFolder folder;
  const std::string left_over = ".a.json.tmp-" + std::to_string(getpid()) + "-0";
  Put(folder / left_over, "old");
  ASSERT_TRUE(WriteFileAtomically(folder / "a.json", "new").ok());
  EXPECT_EQ(*ReadFile(folder / "a.json"), "new");
  EXPECT_EQ(*ReadFile(folder / left_over), "old");
}

TEST(WriteFileAtomically, LeavesNothingBehindWhenItFails) {
  const TemporaryFolder folder;
  const Status no_parent = WriteFileAtomically(folder / "none" / "a.json", "text");
  ASSERT_FALSE(no_parent.ok());
  EXPECT_EQ(no_parent.error().code, ErrorCode::kIo);
  EXPECT_NE(no_parent.error().message.find("No such file or directory"), std::string::npos);

  fs::create_directory(folder / "taken");
  Put(folder / "taken" / "inside", "kept");
  const Status taken = WriteFileAtomically(folder / "taken", "text");
  ASSERT_FALSE(taken.ok());
  EXPECT_EQ(taken.error().message, "cannot put into place: Is a directory");
  EXPECT_EQ(Names(folder.path()), std::set<std::string>{"taken"});

  EXPECT_EQ(WriteFileAtomically("", "text").error().code, ErrorCode::kInvalidArgument);
}

TEST(WriteFileAtomically, KeepsTheOldTextWhenTheDiskIsFull) {
  const TemporaryFolder folder;
  const auto code = test::OnOwnDisk(folder.path(), 0, "size=64k", [&] {
    if (!WriteFileAtomically(folder / "a", "old").ok()) return 1;
    if (!SaysNoSpace(WriteFileAtomically(folder / "a", std::string(1 << 20, 'x')))) return 2;
    if (*ReadFile(folder / "a") != "old") return 3;
    return Names(folder.path()) == std::set<std::string>{"a"} ? 0 : 4;
  });
  if (!code) GTEST_SKIP() << "this machine does not allow to mount a small file system";
  EXPECT_EQ(*code, 0);
}

TEST(OutputFolder, AppearsWhole) {
  const TemporaryFolder parent;
  {
    auto folder = OutputFolder::Begin(parent / "out");
    ASSERT_TRUE(folder.ok()) << folder.error().ToString();
    EXPECT_EQ(folder->path().parent_path(), parent.path());
    EXPECT_EQ(folder->path().filename().string().front(), '.');
    fs::create_directories(folder->path() / "sparse" / "0");
    Put(folder->path() / "sparse" / "0" / "cameras.bin", "bytes");
    EXPECT_FALSE(fs::exists(parent / "out"));
    ASSERT_TRUE(folder->Commit().ok());
  }
  EXPECT_EQ(*ReadFile(parent / "out/sparse/0/cameras.bin"), "bytes");
  EXPECT_EQ(Names(parent.path()), std::set<std::string>{"out"});
}

TEST(OutputFolder, DisappearsWhenNotCommitted) {
  const TemporaryFolder parent;
  {
    auto begun = OutputFolder::Begin(parent / "out");
    ASSERT_TRUE(begun.ok());
    const OutputFolder folder = std::move(begun).value();
    Put(folder.path() / "a", "text");
    EXPECT_EQ(Names(parent.path()).size(), 1u);
  }
  EXPECT_TRUE(Names(parent.path()).empty());
}

TEST(OutputFolder, TakesAnEmptyFolderAndASlashAtTheEnd) {
  const TemporaryFolder parent;
  fs::create_directory(parent / "out");
  auto folder = OutputFolder::Begin(parent.path() / "out/");
  ASSERT_TRUE(folder.ok()) << folder.error().ToString();
  EXPECT_EQ(folder->path().parent_path(), parent.path());
  Put(folder->path() / "a", "text");
  ASSERT_TRUE(folder->Commit().ok());
  EXPECT_EQ(*ReadFile(parent / "out/a"), "text");
}

TEST(OutputFolder, RefusesWhatIsThere) {
  const TemporaryFolder parent;
  fs::create_directory(parent / "full");
  Put(parent / "full/a", "kept");
  Put(parent / "file", "kept");
  fs::create_symlink("full", parent / "link");
  for (const std::string name : {"full", "full/", "file", "link"}) {
    const auto folder = OutputFolder::Begin(parent / name);
    ASSERT_FALSE(folder.ok()) << name;
    EXPECT_EQ(folder.error().code, ErrorCode::kAlreadyExists) << name;
    EXPECT_EQ(folder.error().context, (parent / name).string());
  }
  EXPECT_EQ(OutputFolder::Begin("").error().code, ErrorCode::kInvalidArgument);
  const auto no_parent = OutputFolder::Begin(parent / "none/out");
  ASSERT_FALSE(no_parent.ok());
  EXPECT_EQ(no_parent.error().code, ErrorCode::kIo);
  EXPECT_EQ(Names(parent.path()), (std::set<std::string>{"full", "file", "link"}));
}

TEST(OutputFolder, DoesNotOverwriteWhatCameIntoBeingMeanwhile) {
  const TemporaryFolder parent;
  {
    auto folder = OutputFolder::Begin(parent / "out");
    ASSERT_TRUE(folder.ok());
    fs::create_directory(parent / "out");
    Put(parent / "out/a", "theirs");
    const Status status = folder->Commit();
    ASSERT_FALSE(status.ok());
    EXPECT_EQ(status.error().code, ErrorCode::kAlreadyExists);
  }
  EXPECT_EQ(*ReadFile(parent / "out/a"), "theirs");
  EXPECT_EQ(Names(parent.path()), std::set<std::string>{"out"});
}

TEST(OutputFolder, NothingRemainsOfAFullDisk) {
  const TemporaryFolder folder;
  const auto code = test::OnOwnDisk(folder.path(), 0, "size=64k", [&] {
    {
      auto out = OutputFolder::Begin(folder / "out");
      if (!out.ok()) return 1;
      if (!SaysNoSpace(WriteFileAtomically(out->path() / "a", std::string(1 << 20, 'x')))) return 2;
    }
    return Names(folder.path()).empty() ? 0 : 3;
  });
  if (!code) GTEST_SKIP() << "this machine does not allow to mount a small file system";
  EXPECT_EQ(*code, 0);
}

TEST(CheckOutputFile, TellsBeforehandWhatWouldFail) {
  const TemporaryFolder folder;
  EXPECT_TRUE(CheckOutputFile(folder / "new.json").ok());
  Put(folder / "old.json", "old");
  EXPECT_TRUE(CheckOutputFile(folder / "old.json").ok());
  EXPECT_EQ(Names(folder.path()), std::set<std::string>{"old.json"});
  const Status a_folder = CheckOutputFile(folder.path());
  ASSERT_FALSE(a_folder.ok());
  EXPECT_NE(a_folder.error().message.find("is a folder"), std::string::npos);
  EXPECT_EQ(a_folder.error().context, folder.path().string());
  const Status nowhere = CheckOutputFile(folder / "none" / "new.json");
  ASSERT_FALSE(nowhere.ok());
  EXPECT_EQ(nowhere.error().code, ErrorCode::kNotFound);
  EXPECT_NE(nowhere.error().message.find("make it first"), std::string::npos);
  EXPECT_FALSE(CheckOutputFile(folder / "old.json" / "new.json").ok());
}

TEST(OutputFolder, ErrorsNameThePlaceThatWasAskedFor) {
  const TemporaryFolder folder;
  const auto out = OutputFolder::Begin(folder / "prints");
  ASSERT_TRUE(out.ok());
  const Status failed = WriteFileAtomically(out->path() / "none" / "front.pdf", "text");
  ASSERT_FALSE(failed.ok());
  EXPECT_EQ(out->InPlace(failed.error()).context, (folder / "prints/none/front.pdf").string());
  const Error elsewhere = {ErrorCode::kIo, "cannot write", "/elsewhere"};
  EXPECT_EQ(out->InPlace(elsewhere).context, "/elsewhere");
}

TEST(CheckOutputPlace, TellsBeforehandWhatWouldFail) {
  const test::TemporaryFolder folder;
  EXPECT_TRUE(CheckOutputPlace(folder / "set", 1000));
  EXPECT_TRUE(fs::is_empty(folder.path())) << "nothing stays";
  EXPECT_EQ(CheckOutputPlace(folder / "none/set", 0).error().code, ErrorCode::kNotFound);
  ASSERT_TRUE(WriteNewFile(folder / "file", "no folder"));
  const Status below_file = CheckOutputPlace(folder / "file/set", 0);
  EXPECT_EQ(below_file.error().code, ErrorCode::kNotFound);
  EXPECT_NE(below_file.error().message.find("is not a folder"), std::string::npos);
  EXPECT_EQ(CheckOutputPlace(folder / "file", 0).error().code, ErrorCode::kAlreadyExists);
  EXPECT_EQ(CheckOutputPlace("/proc/rotunda", 0).ok(), false);
  const Status full = CheckOutputPlace(folder / "set", uint64_t{1} << 62);
  EXPECT_EQ(full.error().code, ErrorCode::kIo);
  EXPECT_NE(full.error().message.find("has room for"), std::string::npos) << full.error().message;
}

}  // namespace
}  // namespace rotunda
