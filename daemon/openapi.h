#pragma once

#include <string>
#include <vector>

#include "daemon/api_routes.h"

namespace rotunda::daemon {

/// The OpenAPI 3.1 document of these routes, as JSON.
std::string OpenApiDocument(const std::vector<Route>& routes, const std::string& version);

/// The schemas it refers to, a JSON object by name (openapi_schemas.cc).
extern const char kOpenApiSchemas[];

}  // namespace rotunda::daemon
