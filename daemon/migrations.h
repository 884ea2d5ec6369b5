#pragma once

#include <span>
#include <string>
#include <string_view>

#include "daemon/store_sql.h"
#include "sfm/core/result.h"

// Private to the .cc files of the store.

namespace rotunda::daemon {

/// In the file's header: this is a database of ours ("Rotu").
inline constexpr int kApplicationId = 0x526F7475;

/// The schema's steps, in order; after step i (from 0) PRAGMA user_version is i + 1. A step that
/// was shipped is never changed.
std::span<const std::string_view> SchemaSteps();

/// Whether Migrate() can be begun; refuses, naming what was found: a database of another program, a
/// newer version. Changes nothing.
Status CheckSchema(Database& database, std::span<const std::string_view> steps);

/// Takes an empty database or one of an earlier version through the missing steps, each whole or
/// not at all.
Status Migrate(Database& database, std::span<const std::string_view> steps);

}  // namespace rotunda::daemon
