#pragma once

#include <functional>
#include <map>
#include <string>
#include <vector>

#include "sfm/core/json_reader.h"
#include "sfm/core/name_list.h"
#include "sfm/core/result.h"

// Private to the .cc files of the jobs: no public header shows the JSON library.

namespace rotunda::daemon {

/// Reads a request's body, a JSON object, by `read`. kInvalidArgument names the field: bad JSON, a
/// key that is neither in `keys` nor `added`, what `read` has refused. `added` is the key that the
/// path of the request gives, and not its sender, who is not told of it.
Status ReadRequest(const std::string& body, const std::vector<std::string>& keys,
                   const std::function<void(const JsonField& root)>& read,
                   const std::string& added = "");

/// The field's text, which must be one of `names`; `usual` when the field is not there.
std::string ReadName(const JsonField& field, const std::vector<std::string>& names,
                     const std::string& usual);

/// Likewise the value of that name.
template <typename T>
T ReadChoice(const JsonField& field, const std::map<std::string, T>& by_name, T usual) {
  const auto found = by_name.find(ReadName(field, NamesIn(by_name), ""));
  return found == by_name.end() ? usual : found->second;
}

}  // namespace rotunda::daemon
