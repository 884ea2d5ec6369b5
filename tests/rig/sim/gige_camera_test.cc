#include "rig/sim/gige_camera.h"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>

#include "rig/sim/gige_genicam.h"

namespace rotunda::sim {
namespace {

constexpr int64_t kMs = 1'000'000;
constexpr Endpoint kClient = {0x7F000001, 40000};
constexpr Endpoint kOther = {0x7F000001, 40001};

/// A camera and the requests of a client, at a time the test chooses.
class Rig {
 public:
  explicit Rig(SimulatedCamera like = {}, uint64_t seed = 1)
      : xml_(GenicamXml()), camera_(Settings(std::move(like), seed), xml_) {}

  GigeCamera& operator*() { return camera_; }
  GigeCamera* operator->() { return &camera_; }

  CameraActions Ask(GvcpCommand command, const Bytes& body, const Endpoint& from = kClient) {
    Bytes bytes(8);
    bytes[0] = 0x42;
    bytes[1] = 1;
    WriteBig16(bytes, 2, static_cast<uint16_t>(command));
    WriteBig16(bytes, 4, static_cast<uint16_t>(body.size()));
    WriteBig16(bytes, 6, ++id_);
    bytes.insert(bytes.end(), body.begin(), body.end());
    return camera_.Handle(*ParseGvcpRequest(bytes), from, now_ns, 0);
  }
  /// The status of the answer; last_actions has the rest.
  GvcpStatus Write(uint32_t address, uint32_t value, const Endpoint& from = kClient) {
    Bytes body(8);
    WriteBig32(body, 0, address);
    WriteBig32(body, 4, value);
    last_actions = Ask(GvcpCommand::kWriteRegister, body, from);
    return static_cast<GvcpStatus>(ReadBig16(last_actions.answer, 0));
  }
  GvcpStatus WriteFloat(uint32_t address, double value) {
    Bytes body(12);
    const auto bits = std::bit_cast<uint64_t>(value);
    WriteBig32(body, 0, address);
    WriteBig32(body, 4, static_cast<uint32_t>(bits >> 32));
    WriteBig32(body, 8, static_cast<uint32_t>(bits));
    return static_cast<GvcpStatus>(ReadBig16(Ask(GvcpCommand::kWriteMemory, body).answer, 0));
  }
  /// The value of a register, or nothing when the camera refuses.
  std::optional<uint32_t> Read(uint32_t address, const Endpoint& from = kClient) {
    Bytes body(4);
    WriteBig32(body, 0, address);
    const Bytes answer = Ask(GvcpCommand::kReadRegister, body, from).answer;
    if (answer.size() != 12 || ReadBig16(answer, 0) != 0) return std::nullopt;
    return ReadBig32(answer, 8);
  }
  /// Control, a stream, hardware trigger, acquisition.
  void Arm() {
    Write(reg::kControlPrivilege, value::kControlAccess);
    Write(reg::kStreamPort, 50000);
    Write(reg::kStreamAddress, 0x7F000001);
    Write(reg::kTriggerMode, 1);
    WriteFloat(reg::kExposureTime, 4000);
    ASSERT_EQ(Write(reg::kAcquisition, 1), GvcpStatus::kSuccess);
  }
  /// The frames that a pulse now gives.
  std::vector<FrameOrder> Pulse() { return camera_.Pulse({0, now_ns}, 5).frames; }
  void Break(FaultKind kind, double value = 0, int frames = 0) {
    camera_.SetFault({kind, value, frames}, now_ns);
  }

  int64_t now_ns = 1000 * kMs;
  CameraActions last_actions;

 private:
  static GigeCamera::Settings Settings(SimulatedCamera like, uint64_t seed) {
    GigeCamera::Settings settings;
    settings.address = 0x7F000105;
    settings.camera = std::move(like);
    settings.camera.name = "c005";
    settings.camera.serial = "SIM00005";
    settings.seed = seed;
    return settings;
  }
  std::string xml_;
  GigeCamera camera_;
  uint16_t id_ = 0;
};

TEST(GigeCamera, AnswersDiscoveryWithWhoItIs) {
  Rig rig;
  const Bytes answer = rig.Ask(GvcpCommand::kDiscovery, {}).answer;
  ASSERT_EQ(answer.size(), 8u + 0xF8u);
  const auto text = [&](uint32_t at) {
    return std::string(reinterpret_cast<const char*>(&answer[8 + at]));
  };
  EXPECT_EQ(text(reg::kSerialNumber), "SIM00005");
  EXPECT_EQ(text(reg::kUserName), "c005");
  EXPECT_EQ(ReadBig32(answer, 8 + reg::kCurrentIp), 0x7F000105u);
}

TEST(GigeCamera, DescriptionIsReadInBlocksToItsEnd) {
  Rig rig;
  const std::string xml = GenicamXml();
  std::string read;
  while (read.size() < xml.size()) {
    Bytes body(8);
    WriteBig32(body, 0, reg::kXml + static_cast<uint32_t>(read.size()));
    WriteBig16(body, 6, 512);
    const Bytes answer = rig.Ask(GvcpCommand::kReadMemory, body).answer;
    ASSERT_EQ(answer.size(), 8u + 4u + 512u);
    read.append(answer.begin() + 12, answer.end());
  }
  EXPECT_EQ(read.substr(0, xml.size()), xml);
}

TEST(GigeCamera, OneClientHasControl) {
  Rig rig;
  EXPECT_EQ(rig.Write(reg::kWidth, 100), GvcpStatus::kAccessDenied);
  EXPECT_EQ(rig.Write(reg::kControlPrivilege, value::kControlAccess), GvcpStatus::kSuccess);
  EXPECT_EQ(rig.Write(reg::kControlPrivilege, value::kControlAccess, kOther),
            GvcpStatus::kAccessDenied);
  EXPECT_EQ(rig.Write(reg::kWidth, 100, kOther), GvcpStatus::kAccessDenied);
  EXPECT_EQ(rig.Read(reg::kWidth, kOther), 1200u);  // control leaves reading to others
  EXPECT_EQ(rig.Write(reg::kControlPrivilege, value::kExclusiveAccess), GvcpStatus::kSuccess);
  EXPECT_FALSE(rig.Read(reg::kWidth, kOther));
  EXPECT_EQ(rig.Write(reg::kControlPrivilege, 0), GvcpStatus::kSuccess);
  EXPECT_EQ(rig.Write(reg::kControlPrivilege, value::kControlAccess, kOther), GvcpStatus::kSuccess);
}

TEST(GigeCamera, ControlLapsesWithoutHeartbeat) {
  Rig rig;
  rig.Arm();
  for (int i = 0; i < 5; ++i) {
    rig.now_ns += 2900 * kMs;
    EXPECT_EQ(rig.Read(reg::kControlPrivilege), value::kControlAccess);
  }
  rig.now_ns += 2900 * kMs;
  EXPECT_FALSE(rig->Tick(rig.now_ns, 0).cut);
  EXPECT_EQ(rig->NextTick_ns(rig.now_ns), rig.now_ns + 100 * kMs);
  rig.now_ns += 101 * kMs;
  EXPECT_TRUE(rig->Tick(rig.now_ns, 0).cut);
  EXPECT_FALSE(rig->is_acquiring());
  EXPECT_EQ(rig.Read(reg::kStreamPort), 0u);
  EXPECT_TRUE(rig.Pulse().empty());
}

TEST(GigeCamera, ChecksWhatIsWritten) {
  Rig rig;
  rig.Write(reg::kControlPrivilege, value::kControlAccess);
  const struct {
    uint32_t address;
    uint32_t value;
    GvcpStatus status;
  } rows[] = {
      {reg::kWidth, 600, GvcpStatus::kSuccess},
      {reg::kOffsetX, 601, GvcpStatus::kInvalidParameter},  // beyond the sensor
      {reg::kOffsetX, 600, GvcpStatus::kSuccess},
      {reg::kWidth, 601, GvcpStatus::kInvalidParameter},
      {reg::kWidth, 0, GvcpStatus::kInvalidParameter},
      {reg::kPixelFormat, 0x01080001, GvcpStatus::kSuccess},
      {reg::kPixelFormat, 0x01100003, GvcpStatus::kInvalidParameter},  // Mono10
      {reg::kTriggerSource, 7, GvcpStatus::kInvalidParameter},
      {reg::kStreamPacketSize, 100, GvcpStatus::kInvalidParameter},
      {reg::kChunkMode, 1, GvcpStatus::kInvalidParameter},
      {reg::kChunkMode, 0, GvcpStatus::kSuccess},
      {reg::kSerialNumber, 1, GvcpStatus::kWriteProtect},
      {reg::kSensorWidth, 1, GvcpStatus::kWriteProtect},
      {reg::kWidth + 1, 1, GvcpStatus::kBadAlignment},
      {0x00F00000, 1, GvcpStatus::kInvalidAddress},
      {reg::kExposureTime, 1, GvcpStatus::kInvalidParameter},  // half of a float
  };
  for (const auto& row : rows) {
    EXPECT_EQ(rig.Write(row.address, row.value), row.status) << std::hex << row.address;
  }
  EXPECT_EQ(rig.WriteFloat(reg::kExposureTime, 5), GvcpStatus::kInvalidParameter);
  EXPECT_EQ(rig.WriteFloat(reg::kExposureTime, std::nan("")), GvcpStatus::kInvalidParameter);
  EXPECT_EQ(rig.WriteFloat(reg::kGain, 6.5), GvcpStatus::kSuccess);
  rig.Write(reg::kAcquisition, 1);
  EXPECT_EQ(rig.Write(reg::kWidth, 300), GvcpStatus::kWriteProtect);  // while it takes pictures
}

TEST(GigeCamera, PacketSizeIsNegotiatedByTestPackets) {
  Rig rig;
  rig.Arm();
  rig.Write(reg::kAcquisition, 0);
  EXPECT_EQ(rig.Write(reg::kStreamPacketSize, 0x80000000u | 9000), GvcpStatus::kSuccess);
  ASSERT_TRUE(rig.last_actions.test_packet);
  EXPECT_EQ(rig.last_actions.test_packet->second, 9000u - 28u);
  EXPECT_EQ(rig.last_actions.test_packet->first, (Endpoint{0x7F000001, 50000}));
  EXPECT_EQ(rig.Read(reg::kStreamPacketSize), 9000u);
  rig.Write(reg::kStreamPacketSize, 0x80000000u | 9004);  // longer than the path takes
  EXPECT_FALSE(rig.last_actions.test_packet);
}

TEST(GigeCamera, ExposureFollowsTheEdge) {
  SimulatedCamera like;
  like.exposure_delay_us = 35;
  like.clock_offset_ns = 777'000;
  Rig rig(like);
  rig.Arm();
  EXPECT_EQ(rig.Read(reg::kTriggerArmed), 1u);
  const auto frames = rig.Pulse();
  ASSERT_EQ(frames.size(), 1u);
  const FrameOrder& order = frames[0];
  EXPECT_EQ(order.frame.timestamp_ticks, static_cast<uint64_t>(rig.now_ns + 35'000 + 777'000));
  EXPECT_EQ(order.start_ns, rig.now_ns + 35'000 + 4 * kMs);  // sent when it is exposed
  EXPECT_EQ(order.exposure.shot, 5);
  EXPECT_EQ(order.frame.block_id, 1);
  EXPECT_EQ(order.frame.payload_bytes, size_t{1200} * 1600);
  // Not before the exposure is over.
  rig.now_ns += 2 * kMs;
  EXPECT_EQ(rig.Read(reg::kTriggerArmed), 0u);
  EXPECT_TRUE(rig.Pulse().empty());
  EXPECT_EQ(rig->missed_pulses(), 1u);
  rig.now_ns += 3 * kMs;
  EXPECT_EQ(rig.Read(reg::kTriggerArmed), 1u);
  EXPECT_EQ(rig.Pulse().at(0).frame.block_id, 2);
  // Another line; the falling edge; by software.
  rig.now_ns += 10 * kMs;
  EXPECT_TRUE(rig->Pulse({1, rig.now_ns}, 0).frames.empty());
  rig.Write(reg::kTriggerActivation, value::kFallingEdge);
  EXPECT_EQ(rig.Pulse().at(0).frame.timestamp_ticks,
            static_cast<uint64_t>(rig.now_ns + kMs + 35'000 + 777'000));
  rig.now_ns += 10 * kMs;
  rig.Write(reg::kTriggerSource, value::kSourceSoftware);
  EXPECT_TRUE(rig.Pulse().empty());
  rig.Write(reg::kTriggerSoftware, 1);
  EXPECT_EQ(rig.last_actions.frames.size(), 1u);
}

TEST(GigeCamera, JitterHasItsSpreadAndIsRepeatable) {
  SimulatedCamera like;
  like.exposure_delay_us = 100;
  like.exposure_jitter_us = 5;
  const auto delays_us = [&](uint64_t seed) {
    Rig rig(like, seed);
    rig.Arm();
    std::vector<double> delays;
    for (int i = 0; i < 400; ++i) {
      rig.now_ns += 10 * kMs;
      const auto stamp = static_cast<int64_t>(rig.Pulse().at(0).frame.timestamp_ticks);
      delays.push_back(static_cast<double>(stamp - rig.now_ns) / 1e3);
      rig.Read(reg::kControlPrivilege);  // heartbeat
    }
    return delays;
  };
  const auto delays = delays_us(7);
  double mean = 0, square = 0;
  for (const double delay : delays) mean += delay / 400;
  for (const double delay : delays) square += (delay - mean) * (delay - mean) / 399;
  EXPECT_NEAR(mean, 100, 4 * 5 / std::sqrt(400.0));
  EXPECT_NEAR(std::sqrt(square), 5, 4 * 5 / std::sqrt(800.0));
  EXPECT_EQ(delays, delays_us(7));
  EXPECT_NE(delays, delays_us(8));
}

TEST(GigeCamera, FrameIdsRestartWithTheAcquisition) {
  Rig rig;
  rig.Arm();
  rig.Pulse();
  rig.now_ns += 10 * kMs;
  EXPECT_EQ(rig.Pulse().at(0).frame.block_id, 2);
  rig.Write(reg::kAcquisition, 0);
  rig.Write(reg::kAcquisition, 1);
  rig.now_ns += 10 * kMs;
  EXPECT_EQ(rig.Pulse().at(0).frame.block_id, 1);
}

TEST(GigeCamera, PacketsFollowEachOtherAsTheLinkAndTheDelaySay) {
  Rig rig;
  rig.Write(reg::kControlPrivilege, value::kControlAccess);
  rig.Write(reg::kStreamPacketSize, 9000);
  rig.Write(reg::kStreamPacketDelay, 723'000);
  rig.Arm();
  // 9038 bytes of 8 bits at 1 Gbit/s, and the delay.
  EXPECT_EQ(rig.Pulse().at(0).packet_interval_ns, 72'304 + 723'000);
}

TEST(GigeCamera, RunsFreeAtItsFrameRate) {
  Rig rig;
  rig.Arm();
  rig.Write(reg::kAcquisition, 0);
  rig.Write(reg::kTriggerMode, 0);
  rig.WriteFloat(reg::kFrameRate, 10);
  rig.Write(reg::kAcquisition, 1);
  int frames = 0;
  for (int ms = 0; ms < 1000; ++ms, rig.now_ns += kMs) {
    frames += static_cast<int>(rig->Tick(rig.now_ns, 0).frames.size());
    if (ms % 500 == 0) rig.Read(reg::kControlPrivilege);
  }
  EXPECT_NEAR(frames, 10, 1);
}

TEST(GigeCamera, PtpFindsItsMaster) {
  SimulatedCamera like;
  like.clock_offset_ns = 5'000'000'000;
  Rig rig(like);
  rig.Arm();
  EXPECT_EQ(rig.Read(reg::kPtpStatus), value::kPtpDisabled);
  rig.Write(reg::kPtpEnable, 1);
  EXPECT_EQ(rig.Read(reg::kPtpStatus), value::kPtpListening);
  rig.now_ns += 200 * kMs;
  EXPECT_EQ(rig.Read(reg::kPtpStatus), value::kPtpUncalibrated);
  rig.now_ns += 200 * kMs;
  EXPECT_EQ(rig.Read(reg::kPtpStatus), value::kPtpSlave);
  const auto offset_ns = static_cast<int32_t>(*rig.Read(reg::kPtpOffset + 4));
  EXPECT_LE(std::abs(offset_ns), 200);
  rig.Write(reg::kTimestampControl, value::kLatchTimestamp);
  const int64_t latched = static_cast<int64_t>(*rig.Read(reg::kTimestampLatched)) << 32 |
                          *rig.Read(reg::kTimestampLatched + 4);
  EXPECT_EQ(latched, rig.now_ns + offset_ns);
}

TEST(GigeCameraFault, ChangesTheFrame) {
  Rig rig;
  rig.Arm();
  const auto next = [&] {
    rig.now_ns += 100 * kMs;
    rig.Read(reg::kControlPrivilege);
    return rig.Pulse();
  };
  rig.Break(FaultKind::kDropPackets, 0.25, 1);
  EXPECT_EQ(next().at(0).drop_probability, 0.25);
  EXPECT_EQ(next().at(0).drop_probability, 0);  // one frame was asked for
  rig.Break(FaultKind::kDropLeader, 0, 1);
  EXPECT_TRUE(next().at(0).drop_leader);
  rig.Break(FaultKind::kDropTrailer, 0, 1);
  EXPECT_TRUE(next().at(0).drop_trailer);
  rig.Break(FaultKind::kNoResend, 0, 1);
  EXPECT_FALSE(next().at(0).resend);
  rig.Break(FaultKind::kLate, 800, 1);
  const FrameOrder late = next().at(0);
  EXPECT_EQ(late.start_ns, rig.now_ns + 804 * kMs);
  EXPECT_EQ(late.frame.timestamp_ticks, static_cast<uint64_t>(rig.now_ns));
  rig.Break(FaultKind::kSkew, 2.5, 1);
  const FrameOrder skewed = next().at(0);
  EXPECT_EQ(skewed.frame.timestamp_ticks, static_cast<uint64_t>(rig.now_ns + 2'500'000));
  rig.Break(FaultKind::kWrongFrameId, 10, 1);
  EXPECT_EQ(next().at(0).frame.block_id, 8 + 10);
  rig.Break(FaultKind::kRestartIds);
  EXPECT_EQ(next().at(0).frame.block_id, 1);
  EXPECT_EQ(next().at(0).frame.block_id, 2);
  rig.Break(FaultKind::kSecondPulse, 20, 1);
  const auto twice = next();
  ASSERT_EQ(twice.size(), 2u);
  EXPECT_EQ(twice[1].frame.timestamp_ticks - twice[0].frame.timestamp_ticks, 20'000'000u);
  rig.Break(FaultKind::kMute);
  EXPECT_TRUE(next().empty());
  EXPECT_TRUE(next().empty());
  rig->ClearFault(FaultKind::kMute);
  EXPECT_EQ(next().size(), 1u);
  rig.Break(FaultKind::kUnplugInFrame, 0.5);
  const FrameOrder cut = next().at(0);
  EXPECT_EQ(cut.unplug_at_packet, PacketCount(cut.frame) / 2);
}

TEST(GigeCameraFault, FirstFrameAfterIdlingIsLost) {
  Rig rig;
  rig.Break(FaultKind::kFirstFrameLost, 2000);
  rig.Arm();
  EXPECT_TRUE(rig.Pulse().empty());  // freshly armed
  rig.now_ns += 1000 * kMs;
  EXPECT_EQ(rig.Pulse().size(), 1u);
  rig.now_ns += 2500 * kMs;
  EXPECT_TRUE(rig.Pulse().empty());
  rig.now_ns += 100 * kMs;
  EXPECT_EQ(rig.Pulse().size(), 1u);
}

TEST(GigeCameraFault, StolenControlComesBack) {
  Rig rig;
  rig.Arm();
  rig.Break(FaultKind::kStealControl);
  EXPECT_EQ(rig.Read(reg::kControlPrivilege), 0u);  // the former owner sees that it has none
  EXPECT_EQ(rig.Write(reg::kControlPrivilege, value::kControlAccess), GvcpStatus::kAccessDenied);
  EXPECT_TRUE(rig.Pulse().empty());
  rig.now_ns += 60'000 * kMs;
  EXPECT_EQ(rig.Write(reg::kControlPrivilege, value::kControlAccess), GvcpStatus::kAccessDenied);
  rig->ClearFault(FaultKind::kStealControl);
  rig.Arm();
  EXPECT_EQ(rig.Pulse().size(), 1u);
  rig.Break(FaultKind::kStealControl, 1);
  EXPECT_EQ(rig.Read(reg::kControlPrivilege), value::kExclusiveAccess);
  EXPECT_FALSE(rig.Read(reg::kWidth));
}

TEST(GigeCameraFault, UnpluggedAndRebooted) {
  Rig rig;
  rig.Arm();
  rig.Write(reg::kGainAuto, 2);
  rig.Break(FaultKind::kUnplug);
  EXPECT_FALSE(rig.Read(reg::kWidth));
  EXPECT_TRUE(rig.Pulse().empty());
  rig->ClearFault(FaultKind::kUnplug);
  EXPECT_EQ(rig.Read(reg::kControlPrivilege), 0u);
  EXPECT_EQ(rig.Read(reg::kGainAuto), 0u);  // it was without power
  rig.Arm();
  rig.Break(FaultKind::kReboot, 300);
  rig.now_ns += 299 * kMs;
  EXPECT_FALSE(rig.Read(reg::kWidth));
  rig.now_ns += 2 * kMs;
  EXPECT_EQ(rig.Read(reg::kControlPrivilege), 0u);
}

TEST(GenicamXml, RegistersOfFeaturesDoNotOverlap) {
  for (const Feature& a : Features()) {
    for (const Feature& b : Features()) {
      if (a.address == b.address) {
        EXPECT_EQ(a.bytes, b.bytes) << a.name << " and " << b.name;
        continue;
      }
      EXPECT_TRUE(a.address + a.bytes <= b.address || b.address + b.bytes <= a.address)
          << a.name << " and " << b.name;
    }
  }
}

}  // namespace
}  // namespace rotunda::sim
