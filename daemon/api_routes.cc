#include "daemon/api_routes.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "daemon/http_problem.h"
#include "daemon/store.h"
#include "sfm/core/name_list.h"

namespace rotunda::daemon {
namespace {

std::vector<std::string> SegmentsOf(const std::string& path) {
  std::vector<std::string> segments;
  size_t begin = 1;
  while (begin <= path.size()) {
    const size_t end = std::min(path.find('/', begin), path.size());
    segments.push_back(path.substr(begin, end - begin));
    begin = end + 1;
  }
  return segments;
}

/// "{capture}" or "{camera}.png": the parameter's name and what follows it. nullopt: plain text.
struct Placeholder {
  std::string name;
  std::string ending;
};
std::optional<Placeholder> PlaceholderOf(const std::string& segment) {
  if (segment.empty() || segment.front() != '{') return std::nullopt;
  const size_t close = segment.find('}');
  return Placeholder{segment.substr(1, close - 1), segment.substr(close + 1)};
}

/// The path's values, when the route's path fits.
std::optional<std::map<std::string, std::string>> Fit(const Route& route,
                                                      const std::vector<std::string>& segments) {
  const std::vector<std::string> wanted = SegmentsOf(route.path);
  if (wanted.size() != segments.size()) return std::nullopt;
  std::map<std::string, std::string> values;
  for (size_t i = 0; i < wanted.size(); ++i) {
    const auto placeholder = PlaceholderOf(wanted[i]);
    if (!placeholder) {
      if (wanted[i] != segments[i]) return std::nullopt;
      continue;
    }
    const std::string& ending = placeholder->ending;
    if (segments[i].size() < ending.size() || !segments[i].ends_with(ending)) return std::nullopt;
    values[placeholder->name] = segments[i].substr(0, segments[i].size() - ending.size());
  }
  return values;
}

/// What is wrong with the query; empty when nothing is.
std::string QueryProblem(const Route& route, const std::map<std::string, std::string>& query) {
  for (const auto& [key, value] : query) {
    const auto known = std::find_if(route.query.begin(), route.query.end(),
                                    [&key = key](const auto& p) { return p.name == key; });
    if (known == route.query.end()) {
      std::vector<std::string> names;
      for (const QueryParameter& parameter : route.query) names.push_back(parameter.name);
      return "query: '" + key + "' is not known; " +
             (names.empty() ? "none is taken here" : "allowed are " + Joined(names));
    }
    const std::vector<std::string>& choices = known->choices;
    if (!choices.empty() && std::find(choices.begin(), choices.end(), value) == choices.end()) {
      return "query: " + key + " is '" + value + "', expected one of " + Joined(choices);
    }
  }
  for (const QueryParameter& parameter : route.query) {
    if (parameter.required && !query.contains(parameter.name)) {
      return "query: " + parameter.name + " is missing" +
             (parameter.choices.empty() ? "" : ", expected one of " + Joined(parameter.choices));
    }
  }
  return "";
}

std::string InLowerCase(std::string text) {
  for (char& c : text) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return text;
}

/// Of a Content-Type without its parameters, in lower case: "application/json".
std::string MediaType(const std::string& content_type) {
  constexpr char kBlank[] = " \t";
  std::string type = content_type.substr(0, content_type.find(';'));
  type.erase(0, type.find_first_not_of(kBlank));
  type.erase(type.find_last_not_of(kBlank) + 1);
  return InLowerCase(type);
}

HttpResponse NotOfTheKind(const std::string& why, const std::string& header,
                          const std::string& expected) {
  HttpResponse response = Problem(415, why + ", expected " + expected);
  response.headers.emplace_back(header, expected);
  return response;
}

/// nullopt: the body is of the kind that the route takes.
std::optional<HttpResponse> BodyProblem(const Route& route, const HttpRequest& request) {
  if (request.body.empty()) return std::nullopt;
  if (route.request_schema.empty()) return Problem(400, "body: this request takes none");
  const std::string encoding = request.Header("content-encoding");
  if (!encoding.empty() && InLowerCase(encoding) != "identity") {
    return NotOfTheKind("Content-Encoding is '" + encoding + "'", "Accept-Encoding", "identity");
  }
  const std::string type = request.Header("content-type");
  const std::string kind = MediaType(type);
  // curl's --data says "form" unless told otherwise; the body is parsed as JSON or refused anyway.
  if (kind.empty() || kind == "application/json" || kind == "application/x-www-form-urlencoded") {
    return std::nullopt;
  }
  return NotOfTheKind("Content-Type is '" + type + "'", "Accept", "application/json");
}

}  // namespace

Router::Router(std::vector<Route> routes, std::map<Role, std::string> groups)
    : routes_(std::move(routes)), groups_(std::move(groups)) {}

const Route* Router::Find(const HttpTarget& target, const std::string& method,
                          std::vector<std::string>& allowed) const {
  for (const Route& route : routes_) {
    if (!Fit(route, target.segments)) continue;
    if (route.method == method) return &route;
    allowed.push_back(route.method);
    if (route.method == "GET") allowed.push_back("HEAD");
  }
  return nullptr;
}

HttpResponse Router::Handle(const HttpRequest& request) const {
  const Result<HttpTarget> target = ParseTarget(request.target);
  if (!target) return Problem(target.error());
  std::vector<std::string> allowed;
  const Route* route = Find(*target, request.IsHead() ? "GET" : request.method, allowed);
  if (route == nullptr && allowed.empty()) {
    return Problem(404, "nothing is served there; /v1/openapi.json lists what is");
  }
  if (route == nullptr) {
    HttpResponse response =
        Problem(405, request.method + " is not served there, only " + Joined(allowed));
    response.headers.emplace_back("Allow", Joined(allowed));
    return response;
  }
  if (request.peer.role < route->role) return Forbidden(*route, request.peer);
  return Call(*route, *target, request);
}

void Router::SetGroups(std::map<Role, std::string> groups) {
  const std::lock_guard lock(mutex_);
  groups_ = std::move(groups);
}

HttpResponse Router::Forbidden(const Route& route, const Peer& peer) const {
  const std::lock_guard lock(mutex_);
  const auto group = groups_.find(route.role);
  return Problem(403, "user " + std::to_string(peer.uid) + " may not do this; it takes " +
                          (group == groups_.end() ? "another role" : group->second));
}

HttpResponse Router::Call(const Route& route, const HttpTarget& target,
                          const HttpRequest& request) const {
  ApiRequest call{request, *Fit(route, target.segments), target.query};
  for (const auto& [name, value] : call.path) {
    if (!IsStoreId(value)) {
      return Problem(404, name + ": '" + value.substr(0, 100) +
                              "' is no name: expected 1 to 100 letters, digits, '-', '_' and '.', "
                              "the first a letter or digit");
    }
  }
  const std::string wrong = QueryProblem(route, call.query);
  if (!wrong.empty()) return Problem(400, wrong);
  if (auto problem = BodyProblem(route, request)) return *std::move(problem);
  return route.handle(call);
}

}  // namespace rotunda::daemon
