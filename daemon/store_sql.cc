#include "daemon/store_sql.h"

#include <sqlite3.h>

#include <utility>

#include "daemon/store.h"

namespace rotunda::daemon {
namespace {

// Readers never wait in WAL mode and writers are one at a time: only a backup by another program
// can hold a lock, and not for long.
constexpr int kBusyPatience_ms = 5000;
// Enough for all of a database of some thousand captures: SQLite's own 2 MB make every count over
// the drift's history, and the check at start, read the file again.
constexpr int kCache_kb = 64 * 1024;
// Of a name that is none, in the message.
constexpr size_t kShownBytes = 100;

}  // namespace

void Statement::Finalize::operator()(sqlite3_stmt* statement) const { sqlite3_finalize(statement); }
void Database::Close::operator()(sqlite3* database) const { sqlite3_close_v2(database); }

Statement::Statement(const Database& database, std::string_view sql) : database_(&database) {
  sqlite3_stmt* statement = nullptr;
  Check(sqlite3_prepare_v2(database.handle_.get(), sql.data(), static_cast<int>(sql.size()),
                           &statement, nullptr));
  statement_.reset(statement);
}

void Statement::Check(int code) {
  if (code == SQLITE_OK || code == SQLITE_ROW || code == SQLITE_DONE || error_) return;
  error_ = database_->MakeError(code);
}

Statement& Statement::Bind(std::string_view text) {
  if (!error_) {
    Check(sqlite3_bind_text(statement_.get(), ++parameter_, text.data(),
                            static_cast<int>(text.size()), SQLITE_TRANSIENT));
  }
  return *this;
}

Statement& Statement::Bind(int64_t number) {
  if (!error_) Check(sqlite3_bind_int64(statement_.get(), ++parameter_, number));
  return *this;
}

Statement& Statement::Bind(double number) {
  if (!error_) Check(sqlite3_bind_double(statement_.get(), ++parameter_, number));
  return *this;
}

Statement& Statement::BindNull() {
  if (!error_) Check(sqlite3_bind_null(statement_.get(), ++parameter_));
  return *this;
}

bool Statement::Step() {
  if (error_) return false;
  column_ = 0;
  const int code = sqlite3_step(statement_.get());
  Check(code);
  return code == SQLITE_ROW;
}

Status Statement::Run() {
  Step();
  return status();
}

Statement& Statement::Reset() {
  sqlite3_reset(statement_.get());
  parameter_ = 0;
  return *this;
}

Status Statement::status() const { return error_ ? Status(*error_) : Status(); }

std::string Statement::Text() {
  const int column = column_++;
  const unsigned char* text = sqlite3_column_text(statement_.get(), column);
  const auto size = static_cast<size_t>(sqlite3_column_bytes(statement_.get(), column));
  return text == nullptr ? "" : std::string(reinterpret_cast<const char*>(text), size);
}

int64_t Statement::Int() { return sqlite3_column_int64(statement_.get(), column_++); }
double Statement::Real() { return sqlite3_column_double(statement_.get(), column_++); }

bool Statement::NextIsNull() {
  return sqlite3_column_type(statement_.get(), column_) == SQLITE_NULL;
}

std::optional<std::string> Statement::OptionalText() {
  const bool is_null = NextIsNull();
  std::string text = Text();
  return is_null ? std::nullopt : std::optional(std::move(text));
}

std::string Statement::Id() {
  std::string id = Text();
  if (error_ || IsStoreId(id)) return error_ ? "" : id;
  error_ = Error{ErrorCode::kBadInput,
                 "database: has \"" + id.substr(0, kShownBytes) +
                     "\" where the name of a capture, calibration or reconstruction belongs",
                 database_->name()};
  return "";
}

std::optional<std::string> Statement::OptionalId() {
  const int column = column_;
  if (Text().empty()) return std::nullopt;
  column_ = column;
  return Id();
}

std::optional<double> Statement::OptionalReal() {
  const bool is_null = NextIsNull();
  const double number = Real();
  return is_null ? std::nullopt : std::optional(number);
}

Result<Database> Database::Open(const std::filesystem::path& file, Access access) {
  Database database;
  database.name_ = file.string();
  sqlite3* handle = nullptr;
  const int flags = SQLITE_OPEN_NOMUTEX |
                    (access == Access::kReadOnly ? SQLITE_OPEN_READONLY
                                                 : SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE);
  const int code = sqlite3_open_v2(file.c_str(), &handle, flags, nullptr);
  database.handle_.reset(handle);
  if (code != SQLITE_OK) return database.MakeError(code);
  sqlite3_extended_result_codes(handle, 1);
  sqlite3_busy_timeout(handle, kBusyPatience_ms);
  sqlite3_db_config(handle, SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0, nullptr);
  sqlite3_db_config(handle, SQLITE_DBCONFIG_DEFENSIVE, 1, nullptr);
  ROTUNDA_RETURN_IF_ERROR(database.Execute("PRAGMA cache_size = -" + std::to_string(kCache_kb)));
  return database;
}

Status Database::Execute(const std::string& sql) {
  const int code = sqlite3_exec(handle_.get(), sql.c_str(), nullptr, nullptr, nullptr);
  return code == SQLITE_OK ? Status() : Status(MakeError(code));
}

Result<int64_t> Database::Number(const std::string& sql) {
  Statement statement = Prepare(sql);
  const bool has_row = statement.Step();
  ROTUNDA_RETURN_IF_ERROR(statement.status());
  return has_row ? statement.Int() : int64_t{0};
}

int64_t Database::LastInsertedRow() const { return sqlite3_last_insert_rowid(handle_.get()); }

Status Database::CopyTo(const std::filesystem::path& file) {
  ROTUNDA_ASSIGN_OR_RETURN(const Database copy, Open(file, Access::kReadWrite));
  sqlite3_backup* backup = sqlite3_backup_init(copy.handle_.get(), "main", handle_.get(), "main");
  if (backup == nullptr) return copy.MakeError(sqlite3_extended_errcode(copy.handle_.get()));
  const int copied = sqlite3_backup_step(backup, -1);
  const int finished = sqlite3_backup_finish(backup);
  if (copied != SQLITE_DONE) return copy.MakeError(copied);
  return finished == SQLITE_OK ? Status() : Status(copy.MakeError(finished));
}

Error Database::MakeError(int code) const {
  const int kind = code & 0xFF;
  const bool is_damaged = kind == SQLITE_CORRUPT || kind == SQLITE_NOTADB;
  std::string text = handle_ ? sqlite3_errmsg(handle_.get()) : sqlite3_errstr(code);
  if (kind == SQLITE_FULL) text = "No space left on device";
  return {is_damaged ? ErrorCode::kBadInput : ErrorCode::kIo, "database: " + text, name_};
}

}  // namespace rotunda::daemon
