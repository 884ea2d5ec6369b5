#include "tests/support/mock_gpio.h"

#include <fcntl.h>
#include <linux/gpio.h>
#include <umockdev.h>

#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <stdexcept>
#include <utility>

namespace rotunda::test {

struct MockGpio::Impl {
  UMockdevTestbed* testbed = nullptr;
  std::vector<UMockdevIoctlBase*> handlers;
  std::mutex mutex;
  std::vector<Request> requests;
  std::vector<Edge> edges;
  bool high = false;
  bool broken = false;
  bool next_fall_fails = false;
  bool occupied = false;
  std::function<void()> on_rise;

  bool Handle(UMockdevIoctlClient* client);
  bool Set(bool to_high);
};

namespace {

constexpr char kDevices[] =
    "P: /devices/platform/mock/gpiochip0\nN: gpiochip0\nE: SUBSYSTEM=gpio\n"
    "E: DEVNAME=/dev/gpiochip0\nA: dev=254:0\\n\n\n"
    "P: /devices/platform/mock/gpioline0\nN: gpioline0\nE: SUBSYSTEM=gpio\n"
    "E: DEVNAME=/dev/gpioline0\nA: dev=254:1\\n\n";
constexpr char kChip[] = "/dev/gpiochip0";
constexpr char kLine[] = "/dev/gpioline0";  // what a line handle is opened as

template <typename T>
T Argument(UMockdevIoctlData* argument) {
  UMockdevIoctlData* data = umockdev_ioctl_data_resolve(argument, 0, sizeof(T), nullptr);
  T value{};
  std::memcpy(&value, data->data, sizeof(T));
  return value;
}

template <typename T>
void Answer(UMockdevIoctlData* argument, T value) {
  UMockdevIoctlData* data = umockdev_ioctl_data_resolve(argument, 0, sizeof(T), nullptr);
  umockdev_ioctl_data_update(data, 0, reinterpret_cast<guint8*>(&value), sizeof(T));
}

gboolean OnIoctl(UMockdevIoctlBase*, UMockdevIoctlClient* client, gpointer impl) {
  return static_cast<MockGpio::Impl*>(impl)->Handle(client) ? TRUE : FALSE;
}

}  // namespace

/// False: it fails.
bool MockGpio::Impl::Set(bool to_high) {
  if (broken || (!to_high && std::exchange(next_fall_fails, false))) return false;
  const bool rises = to_high && !high;
  high = to_high;
  const auto now = std::chrono::steady_clock::now().time_since_epoch();
  edges.push_back({to_high, std::chrono::duration_cast<std::chrono::nanoseconds>(now).count()});
  if (rises && on_rise) on_rise();
  return true;
}

bool MockGpio::Impl::Handle(UMockdevIoctlClient* client) {
  const std::lock_guard lock(mutex);
  UMockdevIoctlData* argument = umockdev_ioctl_client_get_arg(client);
  int result = 0, error = 0;
  switch (static_cast<unsigned>(umockdev_ioctl_client_get_request(client))) {
    case static_cast<unsigned>(GPIO_GET_CHIPINFO_IOCTL): {
      gpiochip_info info{};
      std::strcpy(info.name, "gpiochip0");
      std::strcpy(info.label, "mock");
      info.lines = 8;
      Answer(argument, info);
      break;
    }
    case static_cast<unsigned>(GPIO_GET_LINEINFO_IOCTL): {
      auto info = Argument<gpioline_info>(argument);
      info.flags = 0;
      Answer(argument, info);
      break;
    }
    case static_cast<unsigned>(GPIO_GET_LINEHANDLE_IOCTL): {
      if (occupied) {
        result = -1;
        error = EBUSY;
        break;
      }
      auto request = Argument<gpiohandle_request>(argument);
      request.fd = ::open(kLine, O_RDWR | O_CLOEXEC);
      requests.push_back({request.lineoffsets[0], (request.flags & GPIOHANDLE_REQUEST_OUTPUT) != 0,
                          (request.flags & GPIOHANDLE_REQUEST_ACTIVE_LOW) != 0,
                          request.consumer_label, request.fd});
      Answer(argument, request);
      break;
    }
    case static_cast<unsigned>(GPIOHANDLE_SET_LINE_VALUES_IOCTL): {
      const auto data = Argument<gpiohandle_data>(argument);
      if (!Set(data.values[0] != 0)) {
        result = -1;
        error = EIO;
      }
      break;
    }
    default:
      return false;
  }
  umockdev_ioctl_client_complete(client, result, error);
  return true;
}

MockGpio::MockGpio() : impl_(std::make_unique<Impl>()) {
  impl_->testbed = umockdev_testbed_new();
  GError* error = nullptr;
  if (!umockdev_testbed_add_from_string(impl_->testbed, kDevices, &error)) {
    throw std::runtime_error(error->message);
  }
  // libgpiod looks a chip up in sysfs before it believes that it is one.
  gchar* root = umockdev_testbed_get_root_dir(impl_->testbed);
  const std::filesystem::path bus = std::filesystem::path(root) / "sys/bus/gpio/devices/gpiochip0";
  g_free(root);
  std::filesystem::create_directories(bus);
  std::ofstream(bus / "dev") << "254:0\n";
  for (const char* device : {kChip, kLine}) {
    UMockdevIoctlBase* handler = umockdev_ioctl_base_new();
    g_signal_connect(handler, "handle-ioctl", G_CALLBACK(&OnIoctl), impl_.get());
    if (!umockdev_testbed_attach_ioctl(impl_->testbed, device, handler, &error)) {
      throw std::runtime_error(error->message);
    }
    impl_->handlers.push_back(handler);
  }
}

MockGpio::~MockGpio() {
  umockdev_testbed_detach_ioctl(impl_->testbed, kChip, nullptr);
  umockdev_testbed_detach_ioctl(impl_->testbed, kLine, nullptr);
  for (UMockdevIoctlBase* handler : impl_->handlers) g_object_unref(handler);
  g_object_unref(impl_->testbed);
}

bool MockGpio::Available() {
  const char* preloaded = std::getenv("LD_PRELOAD");
  return preloaded != nullptr && std::strstr(preloaded, "umockdev") != nullptr;
}

const std::vector<MockGpio::Request>& MockGpio::requests() const { return impl_->requests; }
const std::vector<MockGpio::Edge>& MockGpio::edges() const { return impl_->edges; }

void MockGpio::Break() {
  const std::lock_guard lock(impl_->mutex);
  impl_->broken = true;
}

void MockGpio::BreakNextFall() {
  const std::lock_guard lock(impl_->mutex);
  impl_->next_fall_fails = true;
}

void MockGpio::Occupy(bool occupied) {
  const std::lock_guard lock(impl_->mutex);
  impl_->occupied = occupied;
}

void MockGpio::OnRise(std::function<void()> call) {
  const std::lock_guard lock(impl_->mutex);
  impl_->on_rise = std::move(call);
}

bool MockGpio::LineIsHeld() const {
  return !impl_->requests.empty() && ::fcntl(impl_->requests.back().fd, F_GETFD) >= 0;
}

}  // namespace rotunda::test
