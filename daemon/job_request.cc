#include "daemon/job_request.h"

#include <algorithm>

#include "sfm/core/name_list.h"

namespace rotunda::daemon {
namespace {

constexpr char kSource[] = "request";

Error Refusal(const Error& error) {
  return {ErrorCode::kInvalidArgument, error.message, error.context};
}

}  // namespace

Status ReadRequest(const std::string& body, const std::vector<std::string>& keys,
                   const std::function<void(const JsonField& root)>& read) {
  const Result<nlohmann::json> json = ParseJson(body, kSource);
  if (!json) return Refusal(json.error());
  JsonReader reader(kSource, *json);
  const JsonField root = reader.root();
  for (const auto& [key, field] : root.Members()) {
    if (std::find(keys.begin(), keys.end(), key) == keys.end()) {
      field.Fail("is not known, expected only: " + Joined(keys));
    }
  }
  if (reader.status()) read(root);
  return reader.status() ? Status() : Status(Refusal(reader.status().error()));
}

}  // namespace rotunda::daemon
