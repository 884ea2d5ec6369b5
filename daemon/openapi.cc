#include "daemon/openapi.h"

#include <nlohmann/json.hpp>

namespace rotunda::daemon {
namespace {

using Json = nlohmann::ordered_json;

Json SchemaOf(const std::string& name) { return {{"$ref", "#/components/schemas/" + name}}; }

Json PathParameters(const std::string& path) {
  Json parameters = Json::array();
  for (size_t open = path.find('{'); open != std::string::npos; open = path.find('{', open + 1)) {
    const size_t close = path.find('}', open);
    parameters.push_back({{"name", path.substr(open + 1, close - open - 1)},
                          {"in", "path"},
                          {"required", true},
                          {"schema", SchemaOf("Name")}});
  }
  return parameters;
}

Json Parameters(const Route& route) {
  Json parameters = PathParameters(route.path);
  for (const QueryParameter& query : route.query) {
    Json schema = {{"type", "string"}};
    if (!query.choices.empty()) schema["enum"] = query.choices;
    parameters.push_back({{"name", query.name},
                          {"in", "query"},
                          {"description", query.description},
                          {"required", query.required},
                          {"schema", schema}});
  }
  if (!route.request_schema.empty()) {
    parameters.push_back(
        {{"name", "Idempotency-Key"},
         {"in", "header"},
         {"description",
          "The same key with the same request gives the job of the first time (run again if it was "
          "interrupted); with another request 409. It is known as long as its job is."},
         {"required", false},
         {"schema",
          {{"type", "string"}, {"minLength", 1}, {"maxLength", 200}, {"pattern", "^[!-~]+$"}}}});
  }
  if (route.content_type == "text/event-stream") {
    parameters.push_back({{"name", "Last-Event-ID"},
                          {"in", "header"},
                          {"description", "Begin after this event."},
                          {"required", false},
                          {"schema", {{"type", "string"}, {"pattern", "^(0|[1-9][0-9]{0,17})$"}}}});
  }
  return parameters;
}

/// `headers`: those that it may have.
Json Response(const std::string& description, const std::string& content_type, const Json& schema,
              const std::vector<ResponseHeader>& headers) {
  Json response = {{"description", description}};
  for (const ResponseHeader& header : headers) {
    response["headers"][header.name] = {{"description", header.description},
                                        {"required", header.always},
                                        {"schema", {{"type", "string"}}}};
  }
  response["content"] = {{content_type, {{"schema", schema}}}};
  return response;
}

Json Refusal(const std::string& why, const std::vector<ResponseHeader>& headers = {}) {
  return Response(why, "application/problem+json", SchemaOf("Problem"), headers);
}

/// What the answer is when it is a success.
Json AnswerSchema(const Route& route) {
  if (!route.schema.empty()) return SchemaOf(route.schema);
  if (route.content_type == "application/json") return {{"type", "object"}};
  if (route.content_type.starts_with("text/")) return {{"type", "string"}};
  return {{"contentMediaType", route.content_type}};
}

/// What the router refuses of any route that takes a body.
Json BodyRefusal() {
  return Refusal("Content-Type is another than application/json, or the body is packed",
                 {{"Accept", "Of another Content-Type: what is taken", false},
                  {"Accept-Encoding", "Of a packed body: what is taken", false}});
}

/// Whether an object of this schema has fields that must be there: then no empty body will do.
bool NeedsFields(const Json& schema) {
  return schema.contains("required") && !schema["required"].empty();
}

Json Operation(const Route& route, const Json& schemas) {
  Json operation = {{"operationId", route.operation},
                    {"summary", route.summary},
                    {"x-role", route.role == Role::kOperator ? "operator" : "viewer"}};
  if (Json parameters = Parameters(route); !parameters.empty()) {
    operation["parameters"] = std::move(parameters);
  }
  if (!route.request_schema.empty()) {
    operation["requestBody"] = {
        {"required", NeedsFields(schemas[route.request_schema])},
        {"content", {{"application/json", {{"schema", SchemaOf(route.request_schema)}}}}}};
  }
  Json& responses = operation["responses"];
  responses[std::to_string(route.status)] =
      Response("Done", route.content_type, AnswerSchema(route), route.headers);
  for (const auto& [status, why] : route.refusals) {
    responses[std::to_string(status)] = Refusal(why);
  }
  if (!route.request_schema.empty()) responses["415"] = BodyRefusal();
  responses["default"] =
      Refusal("Refused or failed: `detail` says why",
              {{"Allow", "Of 405: the methods that the path has", false},
               {"Retry-After", "Of 503: in how many seconds it is worth another try", false}});
  return operation;
}

}  // namespace

std::string OpenApiDocument(const std::vector<Route>& routes, const std::string& version) {
  const Json schemas = Json::parse(kOpenApiSchemas);
  Json paths = Json::object();
  for (const Route& route : routes) {
    std::string method = route.method;
    for (char& letter : method) letter = static_cast<char>(letter - 'A' + 'a');
    paths[route.path][method] = Operation(route, schemas);
  }
  const Json document = {
      {"openapi", "3.1.0"},
      {"info",
       {{"title", "Rotunda"},
        {"version", version},
        {"description",
         "Cameras, captures, calibrations and reconstructions of a body-scanning rig. Served on a "
         "UNIX socket; who connects has a role by their groups: viewers may read, operators may "
         "act (x-role). Lists come newest first in pages: `limit`, and `after` as `next` of the "
         "page before."}}},
      {"servers", Json::array({{{"url", "http://localhost"}}})},
      {"paths", paths},
      {"components", {{"schemas", schemas}}}};
  return document.dump(1) + "\n";
}

}  // namespace rotunda::daemon
