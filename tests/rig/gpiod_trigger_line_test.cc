#include "rig/gpiod_trigger_line.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cstring>
#include <opencv2/imgcodecs.hpp>
#include <vector>

#include "rig/aravis_camera.h"
#include "rig/frame_set_writer.h"
#include "tests/support/mock_gpio.h"
#include "tests/support/process.h"
#include "tests/support/simulated_rig.h"

// The real class over a chip that umockdev plays; ctest runs this under umockdev-wrapper.

namespace rotunda::rig {
namespace {

using namespace std::chrono_literals;
using test::MockGpio;

class GpiodTrigger : public testing::Test {
 protected:
  void SetUp() override {
    if (!MockGpio::Available()) GTEST_SKIP() << "does not run under umockdev-wrapper";
    gpio_ = std::make_unique<MockGpio>();
  }
  std::unique_ptr<MockGpio> gpio_;
};

TEST_F(GpiodTrigger, TakesItsLineAsOutputUnderItsName) {
  auto line = OpenGpiodTriggerLine({"/dev/gpiochip0", 5, false});
  ASSERT_TRUE(line) << line.error().ToString();
  ASSERT_EQ(gpio_->requests().size(), 1u);
  const MockGpio::Request& request = gpio_->requests()[0];
  EXPECT_EQ(request.line, 5u);
  EXPECT_TRUE(request.output);
  EXPECT_FALSE(request.active_low);
  EXPECT_EQ(request.consumer, kGpioConsumer);
  EXPECT_TRUE(gpio_->edges().empty()) << "taking the line must fire nothing";
  EXPECT_TRUE(gpio_->LineIsHeld());
  line->reset();
  EXPECT_FALSE(gpio_->LineIsHeld());
}

TEST_F(GpiodTrigger, AnInvertingDriverIsToldToTheKernel) {
  const auto line = OpenGpiodTriggerLine({"/dev/gpiochip0", 2, true});
  ASSERT_TRUE(line) << line.error().ToString();
  EXPECT_TRUE(gpio_->requests()[0].active_low);
}

TEST_F(GpiodTrigger, APulseRisesWhenItSaysAndIsAsLongAsAsked) {
  const auto line = OpenGpiodTriggerLine({"/dev/gpiochip0", 4, false});
  ASSERT_TRUE(line) << line.error().ToString();
  const auto before = std::chrono::steady_clock::now();
  const auto edge = (*line)->Pulse(3ms);
  const auto after = std::chrono::steady_clock::now();
  ASSERT_TRUE(edge) << edge.error().ToString();
  EXPECT_TRUE(before <= *edge && *edge <= after);
  const auto& edges = gpio_->edges();
  ASSERT_EQ(edges.size(), 2u);
  EXPECT_TRUE(edges[0].high);
  EXPECT_FALSE(edges[1].high);
  EXPECT_GE(edges[1].at_ns - edges[0].at_ns, 3'000'000) << "a pulse must never be shorter";
}

TEST_F(GpiodTrigger, NamesChipAndLineWhenTheyFail) {
  const auto missing = OpenGpiodTriggerLine({"/dev/gpiochip7", 4, false});
  ASSERT_FALSE(missing);
  EXPECT_EQ(missing.error().context, "/dev/gpiochip7 line 4");
  EXPECT_FALSE(OpenGpiodTriggerLine({"/dev/gpiochip0", 8, false})) << "it has lines 0 to 7";
  auto line = OpenGpiodTriggerLine({"/dev/gpiochip0", 4, false});
  ASSERT_TRUE(line) << line.error().ToString();
  gpio_->Break();
  const auto pulse = (*line)->Pulse(1ms);
  ASSERT_FALSE(pulse);
  EXPECT_EQ(pulse.error().code, ErrorCode::kIo);
  EXPECT_EQ(pulse.error().context, "/dev/gpiochip0 line 4");
  line->reset();
  EXPECT_FALSE(gpio_->LineIsHeld());
}

TEST_F(GpiodTrigger, ALineThatDidNotFallIsLoweredOnceMore) {
  auto line = OpenGpiodTriggerLine({"/dev/gpiochip0", 4, false});
  ASSERT_TRUE(line) << line.error().ToString();
  gpio_->BreakNextFall();
  const auto pulse = (*line)->Pulse(1ms);
  ASSERT_FALSE(pulse) << "how long it was is not known";
  EXPECT_EQ(pulse.error().code, ErrorCode::kIo);
  ASSERT_EQ(gpio_->edges().size(), 2u);
  EXPECT_FALSE(gpio_->edges()[1].high);
  EXPECT_TRUE((*line)->Pulse(1ms)) << "the next one is as good as any";
}

TEST_F(GpiodTrigger, ALineThatAnotherProgramHasIsTakenOnceItIsFree) {
  gpio_->Occupy(true);
  const auto taken = OpenGpiodTriggerLine({"/dev/gpiochip0", 4, false});
  ASSERT_FALSE(taken);
  EXPECT_EQ(taken.error().code, ErrorCode::kIo);
  EXPECT_EQ(taken.error().context, "/dev/gpiochip0 line 4");
  EXPECT_NE(taken.error().message.find("busy"), std::string::npos) << taken.error().message;
  EXPECT_TRUE(gpio_->requests().empty());
  gpio_->Occupy(false);
  const auto line = OpenGpiodTriggerLine({"/dev/gpiochip0", 4, false});
  EXPECT_TRUE(line) << line.error().ToString();
}

TEST_F(GpiodTrigger, FromTheLineToTheFrameSet) {
  constexpr int kCameras = 12;
  test::SimulatedRig::Options options;
  options.block = "127.33.1";
  options.cameras = kCameras;
  options.like.width_px = 160;
  options.like.height_px = 120;
  options.source = sim::PatternSource(160, 120);
  test::SimulatedRig rig(options);
  gpio_->OnRise([&] { rig.server().Pulse(0); });
  auto trigger = OpenGpiodTriggerLine({"/dev/gpiochip0", 4, false});
  ASSERT_TRUE(trigger) << trigger.error().ToString();
  const auto session = CaptureSession::Open(rig.capture(), {OpenAravisCamera, std::move(*trigger)});
  ASSERT_TRUE(session) << session.error().ToString();
  ASSERT_EQ((*session)->WaitUntilReady(60s), size_t{kCameras});
  auto shot = (*session)->Capture();
  ASSERT_TRUE(shot) << shot.error().ToString();
  EXPECT_TRUE(shot->complete()) << shot->Summary();
  EXPECT_EQ(shot->pulses, 1);
  const test::TemporaryFolder folder;
  FrameSetWriter writer(2);
  FrameSetOrder order;
  order.out = folder / "set";
  order.id = "chain";
  order.captured_at = "2026-01-01T00:00:00Z";
  order.trigger_source = "gpio";
  const auto written = writer.Wait(writer.Submit(order, std::move(*shot)));
  ASSERT_TRUE(written) << written.error().ToString();
  const auto set = ReadFrameSet(folder / "set");
  ASSERT_TRUE(set) << set.error().ToString();
  ASSERT_EQ(set->frames.size(), size_t{kCameras});
  for (int i = 0; i < kCameras; ++i) {
    const Frame& frame = set->frames[static_cast<size_t>(i)];
    EXPECT_EQ(frame.status, "ok");
    const cv::Mat picture = cv::imread(set->folder / frame.file, cv::IMREAD_UNCHANGED);
    const std::vector<uint8_t> served = rig.Served(i, 0);
    ASSERT_EQ(picture.total() * picture.elemSize(), served.size());
    EXPECT_EQ(std::memcmp(picture.data, served.data(), served.size()), 0) << frame.camera;
  }
  EXPECT_EQ(set->trigger.at("source"), TriggerValue("gpio"));
}

}  // namespace
}  // namespace rotunda::rig
