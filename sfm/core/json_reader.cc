#include "sfm/core/json_reader.h"

#include <set>

namespace rotunda {
namespace {

using nlohmann::json;

constexpr size_t kMaxFoundLength = 48;

/// How a value is quoted in a message: short, on one line.
std::string Found(const json* value) {
  if (value == nullptr) return "nothing";
  if (value->is_object()) return "an object";
  if (value->is_array()) return "an array of " + std::to_string(value->size());
  const std::string text = value->dump(-1, ' ', true, json::error_handler_t::replace);
  return text.size() <= kMaxFoundLength ? text : text.substr(0, kMaxFoundLength) + "...";
}

std::string PathOf(const std::string& parent, const std::string& key) {
  return parent.empty() ? key : parent + "." + key;
}

/// The library's text without its "[json.exception.parse_error.101] " in front.
std::string PlainMessage(const json::exception& exception) {
  const std::string text = exception.what();
  const size_t end = text.find("] ");
  return end == std::string::npos ? text : text.substr(end + 2);
}

/// What the parser itself lets pass and a reader of trusted fields must not.
struct StrictParse {
  std::vector<std::set<std::string>> keys;  // of the objects that are open
  std::string problem;

  bool operator()(int depth, json::parse_event_t event, json& parsed) {
    if (event == json::parse_event_t::object_start || event == json::parse_event_t::array_start) {
      if (depth >= kMaxJsonDepth && problem.empty()) {
        problem = "nested deeper than " + std::to_string(kMaxJsonDepth) + " levels";
      }
    }
    if (event == json::parse_event_t::object_start) keys.emplace_back();
    if (event == json::parse_event_t::object_end) keys.pop_back();
    if (event == json::parse_event_t::key) {
      const auto& key = parsed.get_ref<const std::string&>();
      if (!keys.back().insert(key).second && problem.empty()) {
        problem = "the key " + Found(&parsed) + " occurs twice in one object";
      }
    }
    return problem.empty();
  }
};

}  // namespace

Result<json> ParseJson(const std::string& text, const std::string& source) {
  StrictParse strict;
  try {
    json value = json::parse(text, std::ref(strict));
    if (!strict.problem.empty()) return Error{ErrorCode::kBadInput, strict.problem, source};
    return value;
  } catch (const json::exception& exception) {
    return Error{
        ErrorCode::kBadInput,
        strict.problem.empty() ? "is not JSON: " + PlainMessage(exception) : strict.problem,
        source};
  }
}

bool IsUtf8(std::string_view bytes) {
  try {
    json(bytes).dump();
    return true;
  } catch (const json::exception&) {
    return false;
  }
}

JsonField JsonField::operator[](const std::string& key) const {
  const std::string path = PathOf(path_, key);
  if (value_ == nullptr || !value_->is_object()) {
    Refuse("an object");
    return JsonField(reader_, nullptr, path);
  }
  const auto place = value_->find(key);
  return JsonField(reader_, place == value_->end() ? nullptr : &*place, path);
}

void JsonField::Fail(const std::string& message) const {
  if (reader_->error_) return;
  Error error{ErrorCode::kBadInput, message, path_};
  reader_->error_ = error.In(reader_->source_);
}

void JsonField::Refuse(const std::string& expected) const {
  Fail("expected " + expected + ", found " + Found(value_));
}

std::string JsonField::String() const {
  if (present() && value_->is_string()) return value_->get<std::string>();
  Refuse("a string");
  return "";
}

bool JsonField::Bool() const {
  if (present() && value_->is_boolean()) return value_->get<bool>();
  Refuse("true or false");
  return false;
}

double JsonField::Number() const {
  if (present() && value_->is_number()) return value_->get<double>();
  Refuse("a number");
  return 0.0;
}

uint64_t JsonField::Unsigned(uint64_t min, uint64_t max) const {
  if (present() && value_->is_number_unsigned()) {
    const uint64_t number = value_->get<uint64_t>();
    if (number >= min && number <= max) return number;
  }
  Refuse(max == UINT64_MAX
             ? "an integer >= " + std::to_string(min)
             : "an integer from " + std::to_string(min) + " to " + std::to_string(max));
  return min;
}

std::vector<double> JsonField::Numbers(std::optional<size_t> count) const {
  if (!present() || !value_->is_array() || (count && value_->size() != *count)) {
    Refuse(count ? "an array of " + std::to_string(*count) + " numbers" : "an array of numbers");
    return std::vector<double>(count.value_or(0), 0.0);
  }
  std::vector<double> numbers;
  for (const JsonField& item : Items()) numbers.push_back(item.Number());
  return numbers;
}

std::vector<JsonField> JsonField::Items() const {
  std::vector<JsonField> items;
  if (!present() || !value_->is_array()) {
    Refuse("an array");
    return items;
  }
  for (size_t i = 0; i < value_->size(); ++i) {
    items.push_back(JsonField(reader_, &(*value_)[i], path_ + "[" + std::to_string(i) + "]"));
  }
  return items;
}

std::vector<std::pair<std::string, JsonField>> JsonField::Members() const {
  std::vector<std::pair<std::string, JsonField>> members;
  if (!present() || !value_->is_object()) {
    Refuse("an object");
    return members;
  }
  for (const auto& [key, value] : value_->items()) {
    members.emplace_back(key, JsonField(reader_, &value, PathOf(path_, key)));
  }
  return members;
}

void JsonField::ExpectFormat(std::string_view format) const {
  const JsonField field = (*this)["format"];
  if (!field.present() || *field.value_ != format) field.Refuse('"' + std::string(format) + '"');
}

}  // namespace rotunda
