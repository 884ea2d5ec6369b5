#pragma once

#include <string>

#include "daemon/http_message.h"
#include "sfm/core/result.h"

namespace rotunda::daemon {

/// An error answer, application/problem+json (RFC 9457). `detail` says what was found and expected.
HttpResponse Problem(int status, const std::string& detail);
/// The status that fits the error: what the caller gave (kInvalidArgument) 400, not there 404, in
/// the way 409, the machine refused (disk full, ...) 503, the work failed, or a file of our own
/// cannot be read (kBadInput), 500.
HttpResponse Problem(const Error& error);

/// As in the first line of an answer: "Not Found".
std::string ReasonPhrase(int status);

}  // namespace rotunda::daemon
