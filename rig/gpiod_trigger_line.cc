#include "rig/gpiod_trigger_line.h"

#include <exception>
#include <gpiod.hpp>
#include <thread>

namespace rotunda::rig {
namespace {

std::string NameOf(const GpiodLineOptions& options) {
  return options.chip + " line " + std::to_string(options.line);
}

/// The only place that knows which version of libgpiod this is. Its functions throw.
class RequestedLine {
 public:
#if GPIOD_API_MAJOR >= 2
  explicit RequestedLine(const GpiodLineOptions& options)
      : offset_(static_cast<unsigned>(options.line)),
        request_(
            gpiod::chip(options.chip)
                .prepare_request()
                .set_consumer(kGpioConsumer)
                .add_line_settings(offset_, gpiod::line_settings()
                                                .set_direction(gpiod::line::direction::OUTPUT)
                                                .set_active_low(options.active_low)
                                                .set_output_value(gpiod::line::value::INACTIVE))
                .do_request()) {}
  void Set(bool active) {
    request_.set_value(offset_, active ? gpiod::line::value::ACTIVE : gpiod::line::value::INACTIVE);
  }

 private:
  gpiod::line::offset offset_;
  gpiod::line_request request_;
#else
  explicit RequestedLine(const GpiodLineOptions& options)
      : chip_(options.chip, gpiod::chip::OPEN_BY_PATH),
        line_(chip_.get_line(static_cast<unsigned>(options.line))) {
    const auto flags =
        options.active_low ? gpiod::line_request::FLAG_ACTIVE_LOW : std::bitset<32>();
    line_.request({kGpioConsumer, gpiod::line_request::DIRECTION_OUTPUT, flags}, 0);
  }
  ~RequestedLine() {
    try {
      line_.release();
    } catch (const std::exception&) {  // the chip is gone: nothing is left to release
    }
  }
  RequestedLine(const RequestedLine&) = delete;
  RequestedLine& operator=(const RequestedLine&) = delete;
  void Set(bool active) { line_.set_value(active ? 1 : 0); }

 private:
  gpiod::chip chip_;
  gpiod::line line_;
#endif
};

class GpiodTriggerLine final : public TriggerLine {
 public:
  explicit GpiodTriggerLine(const GpiodLineOptions& options)
      : name_(NameOf(options)), line_(options) {}

  Result<Clock::time_point> Pulse(std::chrono::microseconds width) override {
    try {
      const auto before = Clock::now();
      line_.Set(true);
      const auto after = Clock::now();
      std::this_thread::sleep_until(after + width);
      line_.Set(false);
      return before + (after - before) / 2;
    } catch (const std::exception& error) {
      Lower();
      return Error{ErrorCode::kIo, std::string("cannot be set: ") + error.what(), name_};
    }
  }

 private:
  void Lower() {
    try {
      line_.Set(false);
    } catch (const std::exception&) {  // the first failure is the one to tell
    }
  }

  const std::string name_;
  RequestedLine line_;
};

}  // namespace

Result<std::unique_ptr<TriggerLine>> OpenGpiodTriggerLine(const GpiodLineOptions& options) {
  try {
    return std::unique_ptr<TriggerLine>(std::make_unique<GpiodTriggerLine>(options));
  } catch (const std::exception& error) {
    return Error{ErrorCode::kIo,
                 std::string("cannot be taken as trigger output: ") + error.what() +
                     " (does `gpioinfo` show it free, and may this user open the chip?)",
                 NameOf(options)};
  }
}

}  // namespace rotunda::rig
