#pragma once

#include <filesystem>
#include <string>

// What gpiod_trigger_line.cc uses of libgpiod 2's C++ interface, as its headers declare it, and
// nothing behind it: Debian 12 has version 1, and the code for version 2 is to compile all the
// same.

namespace gpiod {

namespace line {

class offset {
 public:
  offset(unsigned int off = 0) : offset_(off) {}
  operator unsigned int() const noexcept { return offset_; }

 private:
  unsigned int offset_;
};
enum class value { INACTIVE = 0, ACTIVE = 1 };
enum class direction { AS_IS = 1, INPUT, OUTPUT };

}  // namespace line

class line_settings final {
 public:
  line_settings();
  ~line_settings();
  line_settings& set_direction(line::direction direction);
  line_settings& set_active_low(bool active_low);
  line_settings& set_output_value(line::value value);
};

class line_request final {
 public:
  line_request(const line_request&) = delete;
  line_request(line_request&& other) noexcept;
  ~line_request();
  line_request& set_value(line::offset offset, line::value value);
};

class request_builder final {
 public:
  request_builder(const request_builder&) = delete;
  request_builder(request_builder&& other) noexcept;
  ~request_builder();
  request_builder& set_consumer(const std::string& consumer) noexcept;
  request_builder& add_line_settings(line::offset offset, const line_settings& settings);
  line_request do_request();
};

class chip final {
 public:
  explicit chip(const std::filesystem::path& path);
  ~chip();
  request_builder prepare_request();
};

}  // namespace gpiod
