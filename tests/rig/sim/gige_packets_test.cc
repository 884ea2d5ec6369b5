#include "rig/sim/gige_packets.h"

#include <gtest/gtest.h>

#include <numeric>

#include "rig/sim/camera_fault.h"

namespace rotunda::sim {
namespace {

TEST(GvcpRequest, ReadsWhatClientsSend) {
  // As Aravis 0.8.26 sends it to 255.255.255.255.
  const Bytes discovery = {0x42, 0x01, 0x00, 0x02, 0x00, 0x00, 0xFF, 0xFF};
  const auto found = ParseGvcpRequest(discovery);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->command, 2);
  EXPECT_EQ(found->id, 0xFFFF);
  EXPECT_TRUE(found->wants_answer);
  EXPECT_EQ(found->status, GvcpStatus::kSuccess);

  const Bytes write = {0x42, 0x01, 0x00, 0x82, 0x00, 0x10, 0x00, 0x05, 0, 0, 0x0A, 0,
                       0,    0,    0,    2,    0,    0,    0x0D, 0,    0, 0, 0x12, 0x34};
  const auto writes = ParseGvcpRequest(write);
  ASSERT_TRUE(writes);
  ASSERT_EQ(writes->writes.size(), 2u);
  EXPECT_EQ(writes->writes[0].address, 0x0A00u);
  EXPECT_EQ(writes->writes[0].data, (Bytes{0, 0, 0, 2}));
  EXPECT_EQ(writes->writes[1].address, 0x0D00u);

  const Bytes resend = {0x42, 0, 0, 0x40, 0, 12, 0, 7, 0, 0, 0, 9, 0xFF, 0, 0, 3, 0, 0, 0, 4};
  const auto again = ParseGvcpRequest(resend);
  ASSERT_TRUE(again);
  EXPECT_EQ(again->block_id, 9);
  EXPECT_EQ(again->first_packet, 3u);  // the highest byte is reserved
  EXPECT_EQ(again->last_packet, 4u);
  EXPECT_FALSE(again->wants_answer);
}

TEST(GvcpRequest, TellsWhatIsWrong) {
  EXPECT_FALSE(ParseGvcpRequest(Bytes{}));
  EXPECT_FALSE(ParseGvcpRequest(Bytes{0x42, 1, 0, 2, 0, 0, 0}));     // cut
  EXPECT_FALSE(ParseGvcpRequest(Bytes{0x41, 1, 0, 2, 0, 0, 0, 1}));  // another protocol
  const struct {
    Bytes bytes;
    GvcpStatus status;
  } rows[] = {
      {{0x42, 1, 0, 2, 0, 0, 0, 0}, GvcpStatus::kInvalidHeader},           // id 0
      {{0x42, 1, 0, 2, 0, 4, 0, 1}, GvcpStatus::kInvalidHeader},           // wrong length
      {{0x42, 1, 0, 0x80, 0, 0, 0, 1}, GvcpStatus::kInvalidHeader},        // reads nothing
      {{0x42, 1, 0, 0x80, 0, 2, 0, 1, 0, 0}, GvcpStatus::kInvalidHeader},  // half an address
      {{0x42, 1, 0, 0x82, 0, 4, 0, 1, 0, 0, 0, 0}, GvcpStatus::kInvalidHeader},
      {{0x42, 1, 0, 0x86, 0, 4, 0, 1, 0, 0, 0, 0}, GvcpStatus::kInvalidHeader},
      {{0x42, 1, 0, 0x84, 0, 8, 0, 1, 0, 0, 0, 0, 0, 0, 0xFF, 0xFF}, GvcpStatus::kInvalidHeader},
      {{0x42, 1, 0, 4, 0, 0, 0, 1}, GvcpStatus::kNotImplemented},
      {{0x42, 0, 0, 0x40, 0, 12, 0, 7, 0, 0, 0, 9, 0, 0, 0, 5, 0, 0, 0, 4},
       GvcpStatus::kInvalidHeader},  // last before first
      {{0x42, 0x10, 0, 0x40, 0, 12, 0, 7, 0, 0, 0, 9, 0, 0, 0, 3, 0, 0, 0, 4},
       GvcpStatus::kNotImplemented},  // 64-bit ids
  };
  for (const auto& row : rows) {
    const auto request = ParseGvcpRequest(row.bytes);
    ASSERT_TRUE(request);
    EXPECT_EQ(request->status, row.status) << ::testing::PrintToString(row.bytes);
  }
}

TEST(GvcpAnswer, EchoesIdAndNamesTheCommand) {
  GvcpRequest request;
  request.command = 0x80;
  request.id = 0x1234;
  EXPECT_EQ(EncodeGvcpAnswer(request, GvcpStatus::kSuccess, Bytes{1, 2, 3, 4}),
            (Bytes{0, 0, 0, 0x81, 0, 4, 0x12, 0x34, 1, 2, 3, 4}));
  EXPECT_EQ(EncodeGvcpAnswer(request, GvcpStatus::kAccessDenied),
            (Bytes{0x80, 0x06, 0, 0x81, 0, 0, 0x12, 0x34}));
}

TEST(GvspPacket, HeadsAsTheStandardHasThem) {
  GvspFrame frame;
  frame.block_id = 0x0102;
  frame.timestamp_ticks = 0x1122334455667788;
  frame.pixel_format = 0x01080009;
  frame.width_px = 1200;
  frame.height_px = 1600;
  frame.offset_x_px = 4;
  frame.offset_y_px = 8;
  frame.payload_bytes = size_t{1200} * 1600;
  frame.packet_size_bytes = 9000;
  ASSERT_EQ(PacketCount(frame), 2u + 215u);  // 1920000 / 8964, rounded up
  const GvspHead leader = EncodeGvspHead(frame, 0);
  const Bytes leader_bytes(leader.bytes.begin(), leader.bytes.begin() + leader.size);
  EXPECT_EQ(leader_bytes,
            (Bytes{0,    0,    1,    2,    1,    0, 0, 0, 0, 0, 0, 1, 0x11, 0x22, 0x33,
                   0x44, 0x55, 0x66, 0x77, 0x88, 1, 8, 0, 9, 0, 0, 4, 0xB0, 0,    0,
                   6,    0x40, 0,    0,    0,    4, 0, 0, 0, 8, 0, 0, 0,    0}));
  const GvspHead data = EncodeGvspHead(frame, 215);
  EXPECT_EQ(data.size, 8u);
  EXPECT_EQ(ReadBig32(data.bytes, 4), 0x030000D7u);
  const GvspHead trailer = EncodeGvspHead(frame, 216);
  EXPECT_EQ(Bytes(trailer.bytes.begin(), trailer.bytes.begin() + trailer.size),
            (Bytes{0, 0, 1, 2, 2, 0, 0, 216, 0, 0, 0, 1, 0, 0, 6, 0x40}));
  const GvspHead gone = EncodeGvspUnavailable(7, 3);
  EXPECT_EQ(Bytes(gone.bytes.begin(), gone.bytes.begin() + gone.size),
            (Bytes{0x80, 0x0C, 0, 7, 3, 0, 0, 3}));
}

TEST(GvspPacket, PayloadsJoinToTheFrame) {
  for (const size_t payload : {1u, 539u, 540u, 541u, 1080u, 100003u}) {
    for (const uint32_t packet_size : {576u, 1500u, 9000u}) {
      GvspFrame frame;
      frame.payload_bytes = payload;
      frame.packet_size_bytes = packet_size;
      size_t next = 0;
      for (uint32_t packet = 1; packet + 1 < PacketCount(frame); ++packet) {
        const PayloadRange range = PayloadOfPacket(frame, packet);
        EXPECT_EQ(range.offset, next);
        EXPECT_GT(range.size, 0u);
        EXPECT_LE(range.size + kGvspOverhead_bytes, packet_size);
        next += range.size;
      }
      EXPECT_EQ(next, payload);
      EXPECT_EQ(PayloadOfPacket(frame, 0).size, 0u);
      EXPECT_EQ(PayloadOfPacket(frame, PacketCount(frame) - 1).size, 0u);
      EXPECT_EQ(PayloadOfPacket(frame, PacketCount(frame) + 5).size, 0u);
    }
  }
}

TEST(ServerCommand, ReadsEveryKind) {
  using Kind = ServerCommand::Kind;
  const auto pulse = ParseServerCommand("pulse 1 123456789012 500\n");
  ASSERT_TRUE(pulse.ok());
  EXPECT_EQ(pulse->kind, Kind::kPulse);
  EXPECT_EQ(pulse->line, 1);
  EXPECT_EQ(pulse->edge_ns, 123456789012);
  EXPECT_EQ(pulse->width_us, 500);
  EXPECT_FALSE(ParseServerCommand("pulse")->edge_ns);
  EXPECT_EQ(ParseServerCommand("shot 7")->shot, 7);
  EXPECT_EQ(ParseServerCommand("clear c001")->camera, "c001");
  EXPECT_EQ(ParseServerCommand("clear")->camera, "all");
  EXPECT_EQ(ParseServerCommand("list")->kind, Kind::kList);
  for (const FaultText& text : FaultTexts()) {
    const auto fault = ParseServerCommand(std::string("fault 127.0.1.5 ") + text.name + " 0.5 3");
    ASSERT_TRUE(fault.ok()) << text.name;
    EXPECT_EQ(fault->fault.kind, text.kind);
    EXPECT_EQ(fault->fault.value, 0.5);
    EXPECT_EQ(fault->fault.frames, 3);
    EXPECT_EQ(fault->camera, "127.0.1.5");
  }
}

TEST(ServerCommand, NamesWhatItDoesNotUnderstand) {
  const struct {
    const char* text;
    const char* said;
  } rows[] = {{"", "expected pulse"},
              {"pulse one", "line is \"one\""},
              {"pulse 0 1 2 3", "expected pulse"},
              {"pulse 0 1 9223372036854775807", "width is 9223372036854775807, expected 0 to 6"},
              {"pulse 0 1 -1", "width is -1"},
              {"pulse 0 9223372036854775807", "edge is 9223372036854775807"},
              {"fault c1 breaks", "expected one of drop, no-resend"},
              {"fault c1 drop 1.5", "value of \"drop\" is 1.5, expected 0 to 1"},
              {"fault c1 drop nan", "value of \"drop\""},
              {"fault c1 drop", "\"drop\" needs a value, 0..1: each packet is lost"},
              {"fault c1 steal", "\"steal\" needs a value, 0 or 1"},
              {"fault c1 mute 0 -1", "frames of \"mute\" is -1"},
              {"shot", "expected pulse"}};
  for (const auto& row : rows) {
    const auto command = ParseServerCommand(row.text);
    ASSERT_FALSE(command.ok()) << row.text;
    EXPECT_NE(command.error().message.find(row.said), std::string::npos)
        << command.error().ToString();
  }
}

}  // namespace
}  // namespace rotunda::sim
