#include "tests/support/json_schema.h"

#include <algorithm>
#include <regex>
#include <set>

namespace rotunda::test {
namespace {

using Json = nlohmann::json;

bool IsOfType(const Json& value, const std::string& type) {
  if (type == "object") return value.is_object();
  if (type == "array") return value.is_array();
  if (type == "string") return value.is_string();
  if (type == "boolean") return value.is_boolean();
  if (type == "integer") return value.is_number_integer();
  return type == "number" && value.is_number();
}

std::string ObjectProblem(const Json& value, const Json& schema, const Json& schemas,
                          const std::string& place) {
  for (const Json& key : schema.value("required", Json::array())) {
    if (!value.contains(key)) return place + " has no " + key.get<std::string>();
  }
  const Json properties = schema.value("properties", Json::object());
  for (const auto& [key, member] : value.items()) {
    if (properties.contains(key)) {
      const std::string problem =
          SchemaProblem(member, properties[key], schemas, place + "." + key);
      if (!problem.empty()) return problem;
    } else if (!schema.value("additionalProperties", true)) {
      return place + " has " + key + ", which the schema does not know";
    }
  }
  return "";
}

std::string AnyOfProblem(const Json& value, const Json& schema, const Json& schemas,
                         const std::string& place) {
  std::string problems;
  for (const Json& one : schema["anyOf"]) {
    const std::string problem = SchemaProblem(value, one, schemas, place);
    if (problem.empty()) return "";
    problems += problem + "; ";
  }
  return problems;
}

}  // namespace

std::string SchemaProblem(const Json& value, const Json& schema, const Json& schemas,
                          const std::string& place) {
  static const std::set<std::string> known = {
      "$ref",     "type",  "enum",    "required", "properties", "additionalProperties",
      "items",    "anyOf", "minimum", "pattern",  "format",     "description",
      "maxLength"};
  for (const auto& [keyword, unused] : schema.items()) {
    if (!known.contains(keyword)) return place + ": keyword " + keyword + " is not known here";
  }
  if (schema.contains("$ref")) {
    const std::string name = schema["$ref"].get<std::string>();
    const std::string prefix = "#/components/schemas/";
    if (!name.starts_with(prefix) || !schemas.contains(name.substr(prefix.size()))) {
      return place + ": " + name + " is not there";
    }
    return SchemaProblem(value, schemas[name.substr(prefix.size())], schemas, place);
  }
  if (schema.contains("anyOf")) return AnyOfProblem(value, schema, schemas, place);
  if (schema.contains("enum")) {
    const Json& choices = schema["enum"];
    const bool found = std::find(choices.begin(), choices.end(), value) != choices.end();
    return found ? "" : place + " is " + value.dump() + ", expected one of " + choices.dump();
  }
  const std::string type = schema.value("type", "");
  if (!IsOfType(value, type)) return place + " is " + value.dump() + ", expected " + type;
  if (schema.contains("minimum") && value < schema["minimum"]) return place + " is too small";
  if (schema.contains("pattern") &&
      !std::regex_search(value.get<std::string>(),
                         std::regex(schema["pattern"].get<std::string>()))) {
    return place + " is " + value.dump() + ", expected " + schema["pattern"].dump();
  }
  if (type == "object") return ObjectProblem(value, schema, schemas, place);
  if (type == "array") {
    for (size_t i = 0; i < value.size(); ++i) {
      const std::string problem =
          SchemaProblem(value[i], schema["items"], schemas, place + "[" + std::to_string(i) + "]");
      if (!problem.empty()) return problem;
    }
  }
  return "";
}

}  // namespace rotunda::test
