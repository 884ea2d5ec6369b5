#include "daemon/store_events.h"

#include "daemon/store_sql.h"

namespace rotunda::daemon {

Result<std::vector<EventRecord>> ListEvents(Store& store, int64_t after, size_t limit) {
  std::vector<EventRecord> events;
  ROTUNDA_RETURN_IF_ERROR(store.Read([&](Database& database) {
    Statement row = database.Prepare(
        "SELECT number, at, kind, about, data FROM events WHERE number > ? ORDER BY number "
        "LIMIT ?");
    row.Bind(after).Bind(uint64_t{limit});
    while (row.Step()) {
      EventRecord& event = events.emplace_back();
      event.number = row.Int();
      event.at = row.Text();
      event.kind = row.Text();
      event.about = row.Text();
      event.data = row.Text();
    }
    return row.status();
  }));
  return events;
}

Result<int64_t> LastEventNumber(Store& store) {
  Result<int64_t> last = int64_t{0};
  ROTUNDA_RETURN_IF_ERROR(store.Read([&](Database& database) {
    last = database.Number("SELECT max(number) FROM events");
    return Status();
  }));
  return last;
}

}  // namespace rotunda::daemon
