#include "sfm/core/result.h"

#include <gtest/gtest.h>

#include <memory>

#include "sfm/core/ids.h"

namespace rotunda {
namespace {

Result<int> Half(int value) {
  if (value % 2 != 0) return Error{ErrorCode::kInvalidArgument, "is odd", std::to_string(value)};
  return value / 2;
}

Result<int> Quarter(int value) {
  ROTUNDA_ASSIGN_OR_RETURN(const int half, Half(value));
  ROTUNDA_ASSIGN_OR_RETURN(const int quarter, Half(half));
  return quarter;
}

Status CheckQuarter(int value) {
  ROTUNDA_RETURN_IF_ERROR(Quarter(value));
  return {};
}

TEST(Result, HoldsAValueOrAnError) {
  ASSERT_TRUE(Half(4).ok());
  EXPECT_EQ(*Half(4), 2);
  ASSERT_FALSE(Half(3).ok());
  EXPECT_EQ(Half(3).error().code, ErrorCode::kInvalidArgument);
}

TEST(Result, MacrosPassTheErrorOn) {
  EXPECT_EQ(*Quarter(8), 2);
  EXPECT_EQ(Quarter(6).error().ToString(), "3: is odd");
  EXPECT_TRUE(CheckQuarter(8).ok());
  EXPECT_EQ(CheckQuarter(5).error().ToString(), "5: is odd");
}

TEST(Result, TakesAValueThatOnlyMoves) {
  Result<std::unique_ptr<int>> result(std::make_unique<int>(7));
  const std::unique_ptr<int> value = std::move(result).value();
  EXPECT_EQ(*value, 7);
}

TEST(Result, ErrorContextGrowsOutwards) {
  const Error error{ErrorCode::kBadInput, "found 3", "width"};
  EXPECT_EQ(error.In("frames[2]").In("set.json").ToString(), "set.json: frames[2]: width: found 3");
  EXPECT_EQ((Error{ErrorCode::kIo, "gone", ""}).ToString(), "gone");
  EXPECT_EQ((Error{ErrorCode::kIo, "gone", ""}).In("a").ToString(), "a: gone");
}

TEST(ResultDeathTest, ReadingTheWrongSideAborts) {
  EXPECT_DEATH((void)*Half(3), "");
  EXPECT_DEATH((void)Half(4).error(), "");
  EXPECT_DEATH((void)Status().error(), "");
}

TEST(Ids, CompareByValueAndIndexVectors) {
  EXPECT_LT(ImageId(1), ImageId(2));
  EXPECT_EQ(ImageId(3).index(), 3u);
  EXPECT_NE(ImageId(), ImageId(0));
  EXPECT_EQ(std::hash<TrackId>()(TrackId(9)), 9u);
}

TEST(Ids, OfDifferentThingsDoNotMix) {
  static_assert(!std::is_convertible_v<ImageId, TrackId>);
  static_assert(!std::is_constructible_v<ImageId, TrackId>);
  static_assert(!std::is_convertible_v<size_t, ImageId>);
  EXPECT_LT((ImagePair{ImageId(0), ImageId(5)}), (ImagePair{ImageId(1), ImageId(2)}));
  EXPECT_LT((Observation{ImageId(1), KeypointId(0)}), (Observation{ImageId(1), KeypointId(4)}));
}

}  // namespace
}  // namespace rotunda
