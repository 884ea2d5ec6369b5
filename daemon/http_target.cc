#include "daemon/http_target.h"

#include <algorithm>
#include <optional>

namespace rotunda::daemon {
namespace {

Error Bad(const std::string& message) { return {ErrorCode::kInvalidArgument, message, "target"}; }

std::optional<int> HexDigit(char digit) {
  if (digit >= '0' && digit <= '9') return digit - '0';
  if (digit >= 'a' && digit <= 'f') return digit - 'a' + 10;
  if (digit >= 'A' && digit <= 'F') return digit - 'A' + 10;
  return std::nullopt;
}

bool IsControl(char byte) {
  return static_cast<unsigned char>(byte) < 0x20 || static_cast<unsigned char>(byte) == 0x7F;
}

/// `plus_is_space`: in a query.
Result<std::string> Decode(std::string_view text, bool plus_is_space) {
  std::string decoded;
  for (size_t i = 0; i < text.size(); ++i) {
    char byte = text[i];
    if (byte == '%') {
      const auto high = i + 2 < text.size() ? HexDigit(text[i + 1]) : std::nullopt;
      const auto low = i + 2 < text.size() ? HexDigit(text[i + 2]) : std::nullopt;
      if (!high || !low) return Bad("has a '%' that two hexadecimal digits do not follow");
      byte = static_cast<char>(*high * 16 + *low);
      i += 2;
    } else if (byte == '+' && plus_is_space) {
      byte = ' ';
    }
    if (IsControl(byte)) return Bad("has a control character");
    decoded += byte;
  }
  return decoded;
}

Status ReadPath(std::string_view path, HttpTarget& target) {
  if (path.empty() || path.front() != '/') return Bad("does not begin with '/'");
  path.remove_prefix(1);
  while (!path.empty()) {
    const size_t end = std::min(path.find('/'), path.size());
    ROTUNDA_ASSIGN_OR_RETURN(std::string segment, Decode(path.substr(0, end), false));
    if (segment.empty() || segment == "." || segment == ".." ||
        segment.find('/') != std::string::npos) {
      return Bad("has a part that is empty, '.', '..' or holds a '/'");
    }
    target.segments.push_back(std::move(segment));
    if (end + 1 == path.size()) return Bad("ends with '/'");
    path.remove_prefix(std::min(end + 1, path.size()));
  }
  return {};
}

Status ReadQuery(std::string_view query, HttpTarget& target) {
  while (!query.empty()) {
    const std::string_view pair = query.substr(0, query.find('&'));
    query.remove_prefix(std::min(pair.size() + 1, query.size()));
    const size_t equals = std::min(pair.find('='), pair.size());
    ROTUNDA_ASSIGN_OR_RETURN(const std::string key, Decode(pair.substr(0, equals), true));
    ROTUNDA_ASSIGN_OR_RETURN(std::string value,
                             Decode(pair.substr(std::min(equals + 1, pair.size())), true));
    if (key.empty()) return Bad("has a query value without a key");
    if (!target.query.emplace(key, std::move(value)).second) {
      return Bad("has the query key '" + key + "' twice");
    }
  }
  return {};
}

}  // namespace

Result<HttpTarget> ParseTarget(std::string_view target) {
  if (target.size() > kMaxTargetBytes) {
    return Bad("has " + std::to_string(target.size()) + " bytes, at most " +
               std::to_string(kMaxTargetBytes) + " are read");
  }
  HttpTarget parsed;
  const size_t question = std::min(target.find('?'), target.size());
  ROTUNDA_RETURN_IF_ERROR(ReadPath(target.substr(0, question), parsed));
  ROTUNDA_RETURN_IF_ERROR(ReadQuery(target.substr(std::min(question + 1, target.size())), parsed));
  return parsed;
}

}  // namespace rotunda::daemon
