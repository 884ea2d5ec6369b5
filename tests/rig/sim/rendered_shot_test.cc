#include "rig/sim/rendered_shot.h"

#include <gtest/gtest.h>

#include "sfm/core/frame_set.h"
#include "tests/support/process.h"

namespace rotunda::sim {
namespace {

TEST(RenderShot, ShowsWhatTheSimulatedFrameSetHas) {
  const test::TemporaryFolder folder;
  SimulateOptions options;
  options.target = Target::kCuboid;
  options.cameras = 3;
  options.picture_scale = 0.1;
  options.seed = 5;
  ThreadPool threads(2);
  RunContext context{threads};
  const auto rendered = RenderShot({}, options, PixelFormat::kBayerGB8, context);
  ASSERT_TRUE(rendered) << rendered.error().ToString();
  const Status written = SimulateFrameSet({}, options, folder / "set", context);
  ASSERT_TRUE(written) << written.error().ToString();
  const auto loaded = LoadShots({folder / "set"}, PixelFormat::kBayerGB8, context);
  ASSERT_TRUE(loaded) << loaded.error().ToString();
  EXPECT_EQ(rendered->cameras, loaded->cameras);
  EXPECT_EQ(rendered->serials, loaded->serials);
  EXPECT_EQ(rendered->width_px, loaded->width_px);
  EXPECT_EQ(rendered->height_px, loaded->height_px);
  EXPECT_EQ(rendered->format, loaded->format);
  ASSERT_EQ(rendered->cameras.size(), 3u);
  for (int i = 0; i < 3; ++i) {
    const Exposure exposure{i, 0, PixelFormat::kBayerGB8, 0, 0};
    EXPECT_EQ(rendered->source(exposure)->bytes, loaded->source(exposure)->bytes) << i;
  }
  EXPECT_NE(rendered->source({0, 0, PixelFormat::kBayerGB8, 0, 0})->bytes,
            rendered->source({1, 0, PixelFormat::kBayerGB8, 0, 0})->bytes);
}

}  // namespace
}  // namespace rotunda::sim
