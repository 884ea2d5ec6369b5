#pragma once

#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "daemon/store_jobs.h"
#include "daemon/store_records.h"
#include "daemon/store_sql.h"
#include "sfm/core/result.h"

// Private to the .cc files of the store: what its tables share.

namespace rotunda::daemon {

using Json = nlohmann::ordered_json;

/// One line; bytes that are not UTF-8 become U+FFFD.
inline std::string OneLine(const Json& value) {
  return value.dump(-1, ' ', false, Json::error_handler_t::replace);
}

inline EventRecord MakeEvent(std::string kind, std::string about, const Json& data) {
  return {0, "", std::move(kind), std::move(about), OneLine(data)};
}

inline Error NotFound(const std::string& what, const std::string& id) {
  return {ErrorCode::kNotFound, "there is no " + what + " \"" + id + "\"", ""};
}

/// Of reconstructions of one capture, in SQL; of those of the same time r10 is newer than r9.
inline constexpr char kNewestReconstructionFirst[] = "created_at DESC, length(id) DESC, id DESC";

Status CheckPage(const Page& page);

/// Where a list goes on: what the last item of a page has in the columns that the list is sorted
/// by. Good also when the item is gone.
using Place = std::vector<std::string>;
/// As `next` of a listing, which is `after` of the next page.
std::string PlaceText(const Place& place);
/// What `after` says: a place of `columns` columns, or an item by its id, whose place `place_of`
/// knows. kInvalidArgument: a place in another list.
Result<Place> PlaceAfter(const std::string& after, size_t columns,
                         const std::function<Result<Place>(const std::string& id)>& place_of);

/// The one row of a query; nullopt: there is none.
template <typename ReadRow>
auto ReadOne(Statement& row, ReadRow read_row) -> Result<std::optional<decltype(read_row(row))>> {
  std::optional<decltype(read_row(row))> record;
  if (row.Step()) record = read_row(row);
  ROTUNDA_RETURN_IF_ERROR(row.status());
  return record;
}

/// Reads the rows of a query that asked for one more than `limit`; `next_of` gives the `next` of a
/// page that ends with the item.
template <typename T, typename ReadRow, typename NextOf>
Result<Listing<T>> ReadListing(Statement& rows, size_t limit, ReadRow read_row, NextOf next_of) {
  Listing<T> listing;
  while (rows.Step()) listing.items.push_back(read_row(rows));
  ROTUNDA_RETURN_IF_ERROR(rows.status());
  if (listing.items.size() > limit) {
    listing.items.pop_back();
    listing.next = next_of(listing.items.back());
  }
  return listing;
}

/// The newest job that has reserved the name for what it makes.
Result<std::optional<JobRecord>> FindJobByProduct(Store& store, const std::string& id);

/// AddJob within a transaction.
Result<JobRecord> AddJobRow(Database& database, const NewJob& job, const std::string& now,
                            std::vector<EventRecord>& events);

}  // namespace rotunda::daemon
