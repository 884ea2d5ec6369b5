#include "daemon/http_target.h"

#include <gtest/gtest.h>

namespace rotunda::daemon {
namespace {

using Segments = std::vector<std::string>;

TEST(HttpTarget, IsTakenApartAndDecoded) {
  const auto target = ParseTarget("/v1/captures/2026%2D11?limit=5&after=a+b%20c&flag");
  ASSERT_TRUE(target) << target.error().ToString();
  EXPECT_EQ(target->segments, (Segments{"v1", "captures", "2026-11"}));
  EXPECT_EQ(target->query.at("limit"), "5");
  EXPECT_EQ(target->query.at("after"), "a b c");
  EXPECT_EQ(target->query.at("flag"), "");
  EXPECT_EQ(ParseTarget("/a+b")->segments, Segments{"a+b"}) << "a plus is a space in queries only";
  EXPECT_TRUE(ParseTarget("/")->segments.empty());
}

TEST(HttpTarget, NothingThatCouldNameAnotherFolderPasses) {
  for (const char* target : {"",
                             "v1",
                             "*",
                             "http://host/v1",
                             "//",
                             "/v1//captures",
                             "/v1/",
                             "/v1/..",
                             "/v1/../x",
                             "/v1/%2e%2e/x",
                             "/v1/%2E/x",
                             "/v1/a%2fb",
                             "/v1/a%2F..%2Fb",
                             "/v1/%00",
                             "/v1/a%0d%0ab",
                             "/v1/%7f",
                             "/v1/%",
                             "/v1/%4",
                             "/v1/%zz",
                             "/v1?x=%",
                             "/v1?=1",
                             "/v1?a=1&a=2",
                             "/v1?a=%00"}) {
    const auto parsed = ParseTarget(target);
    EXPECT_TRUE(!parsed && parsed.error().code == ErrorCode::kInvalidArgument) << target;
  }
}

TEST(HttpTarget, TooLongIsRefused) {
  EXPECT_TRUE(ParseTarget("/" + std::string(kMaxTargetBytes - 1, 'a')));
  EXPECT_FALSE(ParseTarget("/" + std::string(kMaxTargetBytes, 'a')));
}

}  // namespace
}  // namespace rotunda::daemon
