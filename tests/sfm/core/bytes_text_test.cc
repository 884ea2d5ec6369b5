#include "sfm/core/bytes_text.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <initializer_list>
#include <limits>
#include <string>
#include <utility>

namespace rotunda {
namespace {

TEST(BytesText, HasThreeDigitsAndTheUnitThatSuits) {
  for (const auto& [bytes, text] : std::initializer_list<std::pair<uint64_t, std::string>>{
           {0, "0 bytes"},
           {999, "999 bytes"},
           {1000, "1.00 kB"},
           {9994, "9.99 kB"},
           {9996, "10.0 kB"},
           {99960, "100 kB"},
           {999'499, "999 kB"},
           {999'500, "1.00 MB"},
           {20'000'000, "20.0 MB"},
           {20'000'000'000, "20.0 GB"},
           {std::numeric_limits<uint64_t>::max(), "18.4 EB"}}) {
    EXPECT_EQ(BytesText(bytes), text) << bytes;
  }
}

}  // namespace
}  // namespace rotunda
