#include "sfm/core/plain_text.h"

#include <cstdint>
#include <cstdio>
#include <optional>

#include "sfm/core/json_reader.h"

namespace rotunda {
namespace {

struct ControlCharacter {
  uint32_t code = 0;
  size_t at = 0;
  size_t bytes = 1;
};

bool Continues(char byte) { return (static_cast<uint8_t>(byte) & 0xC0) == 0x80; }

/// The code of the three bytes from `at` on when it breaks lines or turns the direction of writing:
/// U+2028 to U+202E, U+2066 to U+2069; 0 when it does not.
uint32_t LayoutControl(std::string_view text, size_t at) {
  if (text.size() - at < 3 || static_cast<uint8_t>(text[at]) != 0xE2) return 0;
  if (!Continues(text[at + 1]) || !Continues(text[at + 2])) return 0;
  const uint32_t code = 0x2000 + ((static_cast<uint8_t>(text[at + 1]) & 0x3Fu) << 6) +
                        (static_cast<uint8_t>(text[at + 2]) & 0x3Fu);
  const bool controls = (code >= 0x2028 && code <= 0x202E) || (code >= 0x2066 && code <= 0x2069);
  return controls ? code : 0;
}

/// The first one from byte `from` on, in UTF-8.
std::optional<ControlCharacter> FindControl(std::string_view text, size_t from) {
  for (size_t at = from; at < text.size(); ++at) {
    const auto byte = static_cast<uint8_t>(text[at]);
    if (byte < 0x20 || byte == 0x7F) return ControlCharacter{byte, at, 1};
    if (const uint32_t code = LayoutControl(text, at)) return ControlCharacter{code, at, 3};
    if (byte != 0xC2 || at + 1 == text.size()) continue;
    const auto next = static_cast<uint8_t>(text[at + 1]);
    if (next >= 0x80 && next < 0xA0) return ControlCharacter{next, at, 2};
  }
  return std::nullopt;
}

}  // namespace

std::string NotPlain(std::string_view text) {
  if (!IsUtf8(text)) return "bytes that are not UTF-8";
  const auto control = FindControl(text, 0);
  if (!control) return "";
  char name[16];
  std::snprintf(name, sizeof(name), "U+%04X", control->code);
  return std::string("the control character ") + name + " at byte " + std::to_string(control->at);
}

std::string Printable(std::string_view text) {
  std::string printable;
  size_t from = 0;
  while (const auto control = FindControl(text, from)) {
    printable += std::string(text.substr(from, control->at - from)) + '?';
    from = control->at + control->bytes;
  }
  return printable += text.substr(from);
}

}  // namespace rotunda
