#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "sfm/core/result.h"

// For .cc files of this folder and of the daemon: no public header shows the JSON library.

namespace rotunda {

/// Parses one JSON text. kBadInput, with `source` as context: a syntax error (line and column), an
/// object with one key twice, nesting deeper than kMaxJsonDepth, bytes that are not UTF-8.
Result<nlohmann::json> ParseJson(const std::string& text, const std::string& source);
inline constexpr int kMaxJsonDepth = 32;

bool IsUtf8(std::string_view bytes);

class JsonReader;

/// A place in a JSON text that knows its path ("frames[3].width"). Reading it as a type it does not
/// have records the error in the reader and gives an empty value, so a parser reads all its fields
/// in a row and asks the reader once. Only the first error is kept.
class JsonField {
 public:
  /// A field of an object; `present()` is false when the object does not have it.
  JsonField operator[](const std::string& key) const;
  bool present() const { return value_ != nullptr; }
  /// The value itself, for what may have several types; null when it is not present.
  const nlohmann::json* value() const { return value_; }

  std::string String() const;
  bool Bool() const;
  double Number() const;
  uint64_t Unsigned(uint64_t min = 0, uint64_t max = UINT64_MAX) const;
  /// `count` numbers; any number of them when it is not given.
  std::vector<double> Numbers(std::optional<size_t> count = std::nullopt) const;
  std::vector<JsonField> Items() const;                            // of an array
  std::vector<std::pair<std::string, JsonField>> Members() const;  // of an object, by key

  /// Records "expected `expected`, found ..." for this place.
  void Refuse(const std::string& expected) const;
  /// Records `message` for this place.
  void Fail(const std::string& message) const;
  void ExpectFormat(std::string_view format) const;

 private:
  friend class JsonReader;
  JsonField(JsonReader* reader, const nlohmann::json* value, std::string path)
      : reader_(reader), value_(value), path_(std::move(path)) {}

  JsonReader* reader_;
  const nlohmann::json* value_;
  std::string path_;
};

/// Borrows the parsed text; holds the first error.
class JsonReader {
 public:
  JsonReader(std::string source, const nlohmann::json& root)
      : source_(std::move(source)), root_(root) {}
  JsonReader(const JsonReader&) = delete;
  JsonReader& operator=(const JsonReader&) = delete;

  JsonField root() { return JsonField(this, &root_, ""); }
  /// Success, or the first error, its context "source: path".
  Status status() const { return error_ ? Status(*error_) : Status(); }

 private:
  friend class JsonField;
  std::string source_;
  const nlohmann::json& root_;
  std::optional<Error> error_;
};

}  // namespace rotunda
