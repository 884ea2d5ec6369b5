#include "sfm/core/checksum.h"

#include <gtest/gtest.h>

namespace rotunda {
namespace {

// As `xxhsum -H3` prints them.
TEST(Xxh3Text, IsTheChecksumInHexadecimalDigits) {
  EXPECT_EQ(Xxh3Text(""), "2d06800538d394c2");
  EXPECT_EQ(Xxh3Text("abc"), "78af5f94892f3950");
}

}  // namespace
}  // namespace rotunda
