#pragma once

#include <functional>
#include <map>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "daemon/http_message.h"
#include "daemon/http_target.h"

namespace rotunda::daemon {

/// A request that fits its route: the path's and the query's values are there by name, decoded; ids
/// in the path can name nothing outside of their folder.
struct ApiRequest {
  const HttpRequest& http;
  std::map<std::string, std::string> path;
  std::map<std::string, std::string> query;
};

struct QueryParameter {
  std::string name;
  std::string description;
  std::vector<std::string> choices = {};  // empty: any text
  bool required = false;
};

/// A header of answers, beside those that HTTP has in any.
struct ResponseHeader {
  std::string name;
  std::string description;
  bool always = true;
};

/// One operation of the API: what the router does and what the OpenAPI document says of it.
struct Route {
  std::string method;  // "GET"
  std::string path;    // "/v1/captures/{capture}"
  Role role = Role::kViewer;
  std::string operation;  // its name in the document
  std::string summary;
  std::vector<QueryParameter> query = {};
  std::string request_schema = {};  // of the body; empty: takes none
  int status = 200;                 // of success
  std::string content_type = "application/json";
  std::string schema = {};                   // of the answer, when it is JSON
  std::vector<ResponseHeader> headers = {};  // of the answer, when it is a success
  // Statuses with which it refuses for reasons of its own.
  std::vector<std::pair<int, std::string>> refusals = {};
  std::function<HttpResponse(const ApiRequest&)> handle = nullptr;
};

/// Finds the route of a request, refuses what does not fit it (problem+json), calls its handler.
class Router {
 public:
  /// `groups`: of whom must one be to have a role, in words, for the refusal.
  Router(std::vector<Route> routes, std::map<Role, std::string> groups);

  HttpResponse Handle(const HttpRequest& request) const;
  /// For refusals from now on.
  void SetGroups(std::map<Role, std::string> groups);
  const std::vector<Route>& routes() const { return routes_; }

 private:
  const Route* Find(const HttpTarget& target, const std::string& method,
                    std::vector<std::string>& allowed) const;
  HttpResponse Forbidden(const Route& route, const Peer& peer) const;
  HttpResponse Call(const Route& route, const HttpTarget& target, const HttpRequest& request) const;

  const std::vector<Route> routes_;
  mutable std::mutex mutex_;
  std::map<Role, std::string> groups_;
};

}  // namespace rotunda::daemon
