#include "sfm/core/checksum.h"

#include <gtest/gtest.h>

namespace rotunda {
namespace {

// As `xxhsum -H3` prints them.
TEST(Xxh3Text, IsTheChecksumInHexadecimalDigits) {
  EXPECT_EQ(Xxh3Text(""), "2d06800538d394c2");
  EXPECT_EQ(Xxh3Text("abc"), "78af5f94892f3950");
}

TEST(ChecksumProblem, NamesBothChecksums) {
  EXPECT_EQ(ChecksumProblem("abc", "78af5f94892f3950"), "");
  EXPECT_EQ(ChecksumProblem("abc", ""), "") << "not known";
  EXPECT_EQ(ChecksumProblem("abd", "78af5f94892f3950"),
            "the picture was changed after the capture: its checksum is " + Xxh3Text("abd") +
                ", the frame set says 78af5f94892f3950");
}

}  // namespace
}  // namespace rotunda
