#include "daemon/job_request.h"

#include <algorithm>

namespace rotunda::daemon {
namespace {

constexpr char kSource[] = "request";

Error Refusal(const Error& error) {
  return {ErrorCode::kInvalidArgument, error.message, error.context};
}

bool IsOneOf(const std::string& name, const std::vector<std::string>& names) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

}  // namespace

Status ReadRequest(const std::string& body, const std::vector<std::string>& keys,
                   const std::function<void(const JsonField& root)>& read,
                   const std::string& added) {
  const Result<nlohmann::json> json = ParseJson(body, kSource);
  if (!json) return Refusal(json.error());
  JsonReader reader(kSource, *json);
  const JsonField root = reader.root();
  for (const auto& [key, field] : root.Members()) {
    if (key != added && !IsOneOf(key, keys))
      field.Fail("is not known, expected only: " + Joined(keys));
  }
  if (reader.status()) read(root);
  return reader.status() ? Status() : Status(Refusal(reader.status().error()));
}

std::string ReadName(const JsonField& field, const std::vector<std::string>& names,
                     const std::string& usual) {
  if (!field.present()) return usual;
  std::string name = field.String();
  if (IsOneOf(name, names)) return name;
  std::string quoted;
  for (const std::string& each : names) quoted += (quoted.empty() ? "\"" : ", \"") + each + "\"";
  field.Refuse("one of " + quoted);
  return usual;
}

}  // namespace rotunda::daemon
