#pragma once

#include <nlohmann/json.hpp>
#include <string>

namespace rotunda::test {

/// What is wrong with `value` by `schema` (the part of JSON Schema that our OpenAPI document uses;
/// another keyword is an error itself), with the place; empty: nothing. "$ref" is looked up in
/// `schemas`.
std::string SchemaProblem(const nlohmann::json& value, const nlohmann::json& schema,
                          const nlohmann::json& schemas, const std::string& place = "");

}  // namespace rotunda::test
