#include "sfm/core/plain_text.h"

#include <gtest/gtest.h>

#include <string>

namespace rotunda {
namespace {

using namespace std::string_literals;

TEST(PlainText, HasNoControlCharacters) {
  for (const std::string& plain :
       {""s, "person 1"s, "Zo\u00EB \u00A0\u4EBA \U0001F600"s, "\u00BF~ \u0142"s}) {
    EXPECT_EQ(NotPlain(plain), "") << plain;
    EXPECT_EQ(Printable(plain), plain);
  }
  EXPECT_EQ(NotPlain("a\nb\t"), "the control character U+000A at byte 1");
  EXPECT_EQ(NotPlain("Zo\u00EB\x1b[31m"), "the control character U+001B at byte 4");
  EXPECT_EQ(NotPlain("\x7F"), "the control character U+007F at byte 0");
  EXPECT_EQ(NotPlain("\0"s), "the control character U+0000 at byte 0");
  EXPECT_EQ(NotPlain("x\u009Bm"), "the control character U+009B at byte 1");
  EXPECT_EQ(NotPlain("x\u202Eexe.png"), "the control character U+202E at byte 1");
  EXPECT_EQ(NotPlain("\u2028"), "the control character U+2028 at byte 0");
  EXPECT_EQ(NotPlain("\u2069"), "the control character U+2069 at byte 0");
  EXPECT_EQ(NotPlain("\u2014 \u2026 \u200D"), "");
  EXPECT_EQ(NotPlain("caf\xE9"), "bytes that are not UTF-8");
  EXPECT_EQ(NotPlain("\xC2"), "bytes that are not UTF-8");
}

TEST(PlainText, IsShownWithoutControlCharacters) {
  EXPECT_EQ(Printable("Zo\u00EB\t\x1b[31m\u009B!"), "Zo\u00EB??[31m?!");
  EXPECT_EQ(Printable("\0\0"s), "??");
  EXPECT_EQ(Printable("x\u202Egnp"), "x?gnp");
  EXPECT_EQ(Printable("\xE2@h"), "\xE2@h");
  EXPECT_EQ(Printable("a\xC2"), "a\xC2");
}

}  // namespace
}  // namespace rotunda
