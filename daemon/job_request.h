#pragma once

#include <functional>
#include <string>
#include <vector>

#include "sfm/core/json_reader.h"
#include "sfm/core/result.h"

// Private to the .cc files of the jobs: no public header shows the JSON library.

namespace rotunda::daemon {

/// Reads a request's body, a JSON object, by `read`. kInvalidArgument names the field: bad JSON, a
/// key that is not in `keys`, what `read` has refused.
Status ReadRequest(const std::string& body, const std::vector<std::string>& keys,
                   const std::function<void(const JsonField& root)>& read);

}  // namespace rotunda::daemon
