#include "rig/sim/camera_server.h"

#include <arv.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <fstream>
#include <memory>
#include <set>
#include <string>
#include <thread>

#include "rig/sim/socket_trigger.h"
#include "tests/support/process.h"

// The simulated cameras as Aravis sees them: the library as Debian ships it, nothing of ours
// between.

namespace rotunda::sim {
namespace {

constexpr int kPacket_bytes = 9000;
constexpr int kSocketBuffer_bytes = 4 << 20;
/// Aravis asks for so many packets of a frame at most, those asked for twice counted twice: on a
/// busy machine it asks again before the answer has come.
constexpr double kRequestRatio = 2.0;
/// Until Aravis gives a frame up: long, so that a busy machine does not look like a lossy network;
/// short where frames are meant to be lost.
constexpr unsigned kPatient_us = 10'000'000;
constexpr unsigned kImpatient_us = 300'000;
/// How often it asks for a packet in that time.
constexpr unsigned kAsks = 50;

struct Unref {
  void operator()(void* object) const { g_object_unref(object); }
};
template <typename T>
using Owned = std::unique_ptr<T, Unref>;

void Expect(GError*& error, const char* what) {
  if (error) ADD_FAILURE() << what << ": " << error->message;
  g_clear_error(&error);
}

/// One camera opened through Aravis, triggered by Line0.
class Client {
 public:
  explicit Client(const std::string& address, unsigned retention_us = kPatient_us,
                  int packet_delay_ns = 0) {
    GError* error = nullptr;
    camera_.reset(arv_camera_new(address.c_str(), &error));
    Expect(error, "open");
    if (!camera_) return;
    ArvCamera* camera = camera_.get();
    arv_camera_gv_set_stream_options(camera, ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED);
    arv_camera_gv_set_packet_size(camera, kPacket_bytes, &error);
    Expect(error, "packet size");
    if (packet_delay_ns > 0) arv_camera_gv_set_packet_delay(camera, packet_delay_ns, &error);
    Expect(error, "packet delay");
    arv_camera_set_trigger(camera, "Line0", &error);
    Expect(error, "trigger");
    arv_camera_set_exposure_time(camera, 1000, &error);
    Expect(error, "exposure time");
    stream_.reset(arv_camera_create_stream(camera, nullptr, nullptr, &error));
    Expect(error, "stream");
    if (!stream_) return;
    g_object_set(stream_.get(), "socket-buffer", ARV_GV_STREAM_SOCKET_BUFFER_FIXED,
                 "socket-buffer-size", kSocketBuffer_bytes, "frame-retention", retention_us,
                 "packet-timeout", retention_us / kAsks, "packet-request-ratio", kRequestRatio,
                 nullptr);
    const size_t payload = arv_camera_get_payload(camera, &error);
    Expect(error, "payload");
    for (int i = 0; i < 2; ++i) {
      arv_stream_push_buffer(stream_.get(), arv_buffer_new(payload, nullptr));
    }
    arv_camera_start_acquisition(camera, &error);
    Expect(error, "start");
  }
  ~Client() {
    if (camera_) arv_camera_stop_acquisition(camera_.get(), nullptr);
  }
  Client(Client&&) = default;

  /// The next buffer, which goes back to the stream with the returned object.
  struct GiveBack {
    ArvStream* stream;
    void operator()(ArvBuffer* buffer) const { arv_stream_push_buffer(stream, buffer); }
  };
  using Buffer = std::unique_ptr<ArvBuffer, GiveBack>;
  Buffer Pop(std::chrono::microseconds patience = std::chrono::seconds(20)) {
    return {arv_stream_timeout_pop_buffer(stream_.get(), static_cast<guint64>(patience.count())),
            GiveBack{stream_.get()}};
  }
  ArvCamera* camera() { return camera_.get(); }

 private:
  Owned<ArvCamera> camera_;
  Owned<ArvStream> stream_;
};

bool IsGood(ArvBuffer* buffer) {
  return buffer && arv_buffer_get_status(buffer) == ARV_BUFFER_STATUS_SUCCESS;
}

bool HasBytes(ArvBuffer* buffer, const ServedImage& image) {
  size_t size = 0;
  const void* data = arv_buffer_get_data(buffer, &size);
  return size == image.bytes.size() &&
         std::equal(image.bytes.begin(), image.bytes.end(), static_cast<const uint8_t*>(data));
}

/// A server of its own block of addresses.
std::unique_ptr<CameraServer> Serve(uint8_t block, int count, SimulatedCamera like = {},
                                    std::filesystem::path socket = {}) {
  CameraServerOptions options;
  options.block.bytes = {127, 41, block};
  options.cameras = MakeCameras(count, like);
  options.socket = std::move(socket);
  options.seed = 11;
  auto server = CameraServer::Start(std::move(options));
  EXPECT_TRUE(server.ok()) << server.error().ToString();
  return server.ok() ? std::move(*server) : nullptr;
}

SimulatedCamera Small() {
  SimulatedCamera camera;
  camera.width_px = 320;
  camera.height_px = 240;
  return camera;
}

std::vector<Client> OpenAll(const CameraServer& server, unsigned retention_us = kPatient_us) {
  std::vector<Client> clients;
  for (int i = 0; i < server.size(); ++i) clients.emplace_back(server.address(i), retention_us);
  return clients;
}

double Resident_mb() {
  std::ifstream statm("/proc/self/statm");
  double total = 0, resident = 0;
  statm >> total >> resident;
  return resident * static_cast<double>(::getpagesize()) / 1e6;
}

/// Pulses `server` and counts the frames that are what shot `shot` looks like.
int GoodFrames(CameraServer& server, std::vector<Client>& clients, int shot) {
  const SimulatedCamera& like = server.camera(0);
  const FrameSource source = PatternSource(like.width_px, like.height_px);
  server.Pulse();
  int good = 0;
  for (int i = 0; i < server.size(); ++i) {
    const auto buffer = clients[static_cast<size_t>(i)].Pop();
    good += IsGood(buffer.get()) && HasBytes(buffer.get(), *source({i, shot, like.format, 0, 0}));
  }
  return good;
}

TEST(CameraServer, NinetyCamerasLoseNothing) {
  const auto server = Serve(1, 90);
  auto clients = OpenAll(*server);
  double resident_mb = 0;
  constexpr int kPulses = 20;
  for (int shot = 0; shot < kPulses; ++shot) {
    EXPECT_EQ(GoodFrames(*server, clients, shot), 90) << "pulse " << shot;
    if (shot == kPulses / 4) resident_mb = Resident_mb();
  }
  // Three quarters of the pulses later: less than one frame of 1.9 MB in ten has stayed.
  EXPECT_LT(Resident_mb() - resident_mb, 17);
  EXPECT_EQ(server->counters(89).frames, uint64_t{kPulses});
}

TEST(CameraServer, LostPacketsAreSentAgain) {
  const auto server = Serve(2, 90);
  auto clients = OpenAll(*server);
  for (int i = 0; i < 90; ++i) {
    ASSERT_TRUE(server->SetFault(i, {FaultKind::kDropPackets, 0.05}).ok());
  }
  for (int shot = 0; shot < 3; ++shot) EXPECT_EQ(GoodFrames(*server, clients, shot), 90);
  uint64_t dropped = 0, resent = 0;
  for (int i = 0; i < 90; ++i) {
    dropped += server->counters(i).packets_dropped;
    resent += server->counters(i).packets_resent;
  }
  // 3 * 90 * 217 packets, and those sent again: 2929 lost the first time, 54 standard deviations.
  EXPECT_NEAR(static_cast<double>(dropped), 3 * 90 * 217 * 0.05 / 0.95, 4 * 54 + 60);
  EXPECT_GE(resent, 2600u);
}

TEST(CameraServer, TheSamePacketsAreLostInEveryRun) {
  const auto lost = [](uint8_t block) {
    const auto server = Serve(block, 2);
    auto clients = OpenAll(*server, kImpatient_us);
    std::vector<uint64_t> dropped;
    for (int i = 0; i < 2; ++i) {
      EXPECT_TRUE(server->SetFault(i, {FaultKind::kDropPackets, 0.2}).ok());
      EXPECT_TRUE(server->SetFault(i, {FaultKind::kNoResend, 0}).ok());
    }
    for (int shot = 0; shot < 2; ++shot) GoodFrames(*server, clients, shot);
    for (int i = 0; i < 2; ++i) dropped.push_back(server->counters(i).packets_dropped);
    return dropped;
  };
  const auto first = lost(3);
  EXPECT_EQ(first, lost(4));
  EXPECT_NE(first[0], first[1]);
  EXPECT_GT(first[0], 0u);
}

TEST(CameraServer, StampsAreTheEdgesOfTheTriggerLine) {
  const test::TemporaryFolder folder;
  SimulatedCamera like = Small();
  like.exposure_delay_us = 50;
  const auto server = Serve(5, 3, like, folder / "pulse.sock");
  auto clients = OpenAll(*server);
  SocketTrigger trigger(folder / "pulse.sock");
  for (int shot = 0; shot < 3; ++shot) {
    const auto edge = trigger.Pulse(std::chrono::microseconds(1000));
    ASSERT_TRUE(edge.ok()) << edge.error().ToString();
    const auto edge_ns = std::chrono::nanoseconds(edge->time_since_epoch()).count();
    for (Client& client : clients) {
      const auto buffer = client.Pop();
      ASSERT_TRUE(IsGood(buffer.get()));
      EXPECT_EQ(arv_buffer_get_timestamp(buffer.get()), static_cast<guint64>(edge_ns + 50'000));
      EXPECT_EQ(arv_buffer_get_frame_id(buffer.get()), static_cast<guint64>(shot + 1));
    }
  }
}

TEST(CameraServer, PacketsKeepTheirDistance) {
  const auto server = Serve(6, 1, Small());
  Client client(server->address(0), kPatient_us, 20'000'000);
  const auto begin = std::chrono::steady_clock::now();
  server->Pulse();
  ASSERT_TRUE(IsGood(client.Pop().get()));
  // 76800 bytes are 9 packets, a leader and a trailer: ten distances.
  EXPECT_GE(std::chrono::steady_clock::now() - begin, std::chrono::milliseconds(10 * 20));
}

TEST(CameraServer, AravisFindsThemAndReadsThem) {
  SimulatedCamera like = Small();
  like.serial = "FIND";  // others may serve cameras on this machine
  const auto server = Serve(7, 3, like);
  arv_update_device_list();
  std::set<std::string> found;
  for (unsigned i = 0; i < arv_get_n_devices(); ++i) found.insert(arv_get_device_address(i));
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(found.count(server->address(i))) << server->address(i);
  Client client(server->address(1));
  GError* error = nullptr;
  EXPECT_STREQ(arv_camera_get_device_serial_number(client.camera(), &error), "FIND00002");
  Expect(error, "serial number");
  EXPECT_STREQ(arv_camera_get_string(client.camera(), "DeviceUserID", &error), "c002");
  Expect(error, "user id");
  EXPECT_NEAR(arv_camera_get_float(client.camera(), "DeviceTemperature", &error), 41, 3);
  Expect(error, "temperature");
  EXPECT_TRUE(arv_camera_get_boolean(client.camera(), "TriggerArmed", &error));
  Expect(error, "trigger armed");
  EXPECT_NEAR(arv_camera_get_exposure_time(client.camera(), &error), 1000, 0);
  Expect(error, "exposure time");
}

TEST(CameraServer, SendsTheFormatAndRegionItIsSetTo) {
  const auto server = Serve(8, 1, Small());
  Owned<ArvCamera> camera(arv_camera_new(server->address(0).c_str(), nullptr));
  GError* error = nullptr;
  arv_camera_set_region(camera.get(), 16, 8, 100, 60, &error);
  Expect(error, "region");
  arv_camera_set_pixel_format_from_string(camera.get(), "RGB8", &error);
  Expect(error, "pixel format");
  arv_camera_gv_set_stream_options(camera.get(), ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED);
  // Free running: one frame, as a preview would ask for it.
  const Owned<ArvBuffer> buffer(arv_camera_acquisition(camera.get(), 5'000'000, &error));
  Expect(error, "acquisition");
  ASSERT_TRUE(IsGood(buffer.get()));
  EXPECT_EQ(arv_buffer_get_image_width(buffer.get()), 100);
  const auto whole = PatternSource(320, 240)({0, 0, PixelFormat::kRgb8, 0, 0});
  EXPECT_TRUE(HasBytes(buffer.get(), CropImage(*whole, {16, 8, 100, 60})));
}

/// What a fault makes of one shot of the camera that has it.
struct FaultRow {
  Fault fault;
  bool comes;  // a buffer, good or not
  bool good;
};

TEST(CameraServer, FaultsShowInTheBuffers) {
  const auto server = Serve(9, 2, Small());
  auto clients = OpenAll(*server, kImpatient_us);
  using K = FaultKind;
  const FaultRow rows[] = {
      {{K::kMute, 0, 1}, false, false},       {{K::kDropLeader, 0, 1}, true, false},
      {{K::kDropTrailer, 0, 1}, true, false}, {{K::kLate, 300, 1}, true, true},
      {{K::kSkew, 2.5, 1}, true, true},       {{K::kUnplugInFrame, 0.5}, true, false}};
  for (const FaultRow& row : rows) {
    ASSERT_TRUE(server->SetFault(0, row.fault).ok());
    server->Pulse();
    const auto well = clients[1].Pop();
    EXPECT_TRUE(IsGood(well.get()));
    const auto ill = clients[0].Pop(std::chrono::seconds(row.comes ? 20 : 1));
    const char* name = FaultTexts()[static_cast<size_t>(row.fault.kind)].name;
    EXPECT_EQ(ill != nullptr, row.comes) << name;
    EXPECT_EQ(IsGood(ill.get()), row.good) << name;
    const double skew_ms = row.fault.kind == K::kSkew ? 2.5 : 0;
    if (row.good && IsGood(ill.get())) {
      EXPECT_EQ(arv_buffer_get_timestamp(ill.get()),
                arv_buffer_get_timestamp(well.get()) + static_cast<guint64>(skew_ms * 1e6));
    }
  }
  server->ClearFaults();  // or closing the camera takes Aravis seconds
}

TEST(CameraServer, AddressesAndSocketsAreTakenOnce) {
  const test::TemporaryFolder folder;
  const auto first = Serve(10, 2, Small(), folder / "a.sock");
  CameraServerOptions options;
  options.block.bytes = {127, 41, 10};
  options.cameras = MakeCameras(1, Small());
  const auto second = CameraServer::Start(options);
  ASSERT_FALSE(second.ok());
  EXPECT_NE(second.error().ToString().find("127.41.10.1:3956: cannot bind"), std::string::npos)
      << second.error().ToString();
  options.block.bytes = {127, 41, 11};
  options.socket = folder / "a.sock";
  const auto third = CameraServer::Start(options);
  ASSERT_FALSE(third.ok());
  EXPECT_EQ(third.error().code, ErrorCode::kAlreadyExists);
  options.socket = folder / "notes.txt";
  std::ofstream(options.socket) << "kept";
  const auto fourth = CameraServer::Start(options);
  ASSERT_FALSE(fourth.ok());
  EXPECT_NE(fourth.error().ToString().find("notes.txt: is there and not a socket"),
            std::string::npos)
      << fourth.error().ToString();
  EXPECT_EQ(std::filesystem::file_size(options.socket), 4u) << "what is no socket is not replaced";
  options.cameras[0].serial = "";
  EXPECT_EQ(CameraServer::Start(options).error().code, ErrorCode::kInvalidArgument);
}

TEST(CameraServer, TakesCommands) {
  const test::TemporaryFolder folder;
  const std::filesystem::path socket = folder / "b.sock";
  EXPECT_EQ(SendServerCommand(socket, "pulse").error().code, ErrorCode::kNotFound);
  {
    const auto server = Serve(12, 2, Small(), socket);
    EXPECT_EQ(*SendServerCommand(socket, "fault c002 drop 0.5"), "1 camera");
    EXPECT_EQ(*SendServerCommand(socket, "fault all late 3"), "2 cameras");
    EXPECT_EQ(*SendServerCommand(socket, "clear"), "2 cameras");
    EXPECT_EQ(*SendServerCommand(socket, "shot 4"), "shot 4");
    EXPECT_FALSE(SendServerCommand(socket, "shot -1").ok());
    EXPECT_EQ(SendServerCommand(socket, "fault c009 drop 0.5").error().code, ErrorCode::kFailed);
    EXPECT_EQ(SendServerCommand(socket, "explode").error().code, ErrorCode::kFailed);
    const auto list = SendServerCommand(socket, "list");
    ASSERT_TRUE(list.ok());
    EXPECT_NE(list->find("127.41.12.2 c002 SIM00002 free"), std::string::npos) << *list;
  }
  EXPECT_FALSE(std::filesystem::exists(socket));
}

}  // namespace
}  // namespace rotunda::sim
