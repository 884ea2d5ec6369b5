#pragma once

#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <stop_token>
#include <string>

#include "sfm/core/result.h"

// Private to the .cc files of this folder: no public header shows the JSON library.

namespace rotunda::cli {

inline constexpr char kDefaultSocket[] = "/run/rotunda/api.sock";

/// `text` as a part of a path or a query (RFC 3986): what is not a letter, a digit or one of -._~
/// as %XX.
std::string PercentEncoded(const std::string& text);

/// Asks the daemon. Each call has a connection of its own and ends when `stop` is set (kCancelled).
class ApiClient {
 public:
  ApiClient(std::filesystem::path socket, std::stop_token stop);

  /// The answer's JSON. An error answer is an Error with what the daemon said; kNotFound also when
  /// no daemon listens (says what to do).
  Result<nlohmann::ordered_json> Get(const std::string& target) const;
  /// `body` may be null: none is sent.
  Result<nlohmann::ordered_json> Post(const std::string& target,
                                      const nlohmann::ordered_json& body) const;
  Result<nlohmann::ordered_json> Delete(const std::string& target) const;

  /// Hands over the data of every event of the stream, until `stop`, or the daemon ends it.
  /// `last_id` becomes the stream's latest id, with which another one goes on.
  using OnEvent = std::function<void(const nlohmann::ordered_json& event)>;
  Status Follow(const std::string& target, std::string& last_id, const OnEvent& on_event) const;

 private:
  Result<nlohmann::ordered_json> Ask(const std::string& method, const std::string& target,
                                     const std::string& body) const;

  const std::filesystem::path socket_;
  const std::stop_token stop_;
};

}  // namespace rotunda::cli
