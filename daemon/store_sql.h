#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "sfm/core/result.h"

struct sqlite3;
struct sqlite3_stmt;

// Private to the .cc files of the store: SQLite with its errors as Results.

namespace rotunda::daemon {

class Database;

/// A prepared statement, its parameters bound from the left, its columns read from the left. What
/// goes wrong is kept and told by status(), so that a chain of calls is asked once.
class Statement {
 public:
  Statement(Statement&&) noexcept = default;

  Statement& Bind(std::string_view text);
  Statement& Bind(const char* text) { return Bind(std::string_view(text)); }
  Statement& Bind(const std::string& text) { return Bind(std::string_view(text)); }
  Statement& Bind(int64_t number);
  Statement& Bind(int number) { return Bind(int64_t{number}); }
  Statement& Bind(uint64_t number) { return Bind(static_cast<int64_t>(number)); }
  Statement& Bind(bool value) { return Bind(int64_t{value}); }
  Statement& Bind(double number);
  template <typename T>
  Statement& Bind(const std::optional<T>& value) {
    return value ? Bind(*value) : BindNull();
  }

  /// True when there is a row; false at the end and after an error.
  bool Step();
  /// Runs a statement that gives no rows.
  Status Run();
  /// Ready for other parameters.
  Statement& Reset();
  Status status() const;

  /// The next column of the row; NULL reads as empty, 0.
  std::string Text();
  int64_t Int();
  uint64_t Count() { return static_cast<uint64_t>(Int()); }
  bool Bool() { return Int() != 0; }
  double Real();
  std::optional<std::string> OptionalText();
  /// The name of a folder of ours. Another text (IsStoreId) is an error: who has changed the file
  /// must not lead the daemon out of its state folder.
  std::string Id();
  /// The same; NULL and no text read as unset.
  std::optional<std::string> OptionalId();
  std::optional<double> OptionalReal();

 private:
  friend class Database;
  struct Finalize {
    void operator()(sqlite3_stmt* statement) const;
  };
  Statement(const Database& database, std::string_view sql);
  Statement& BindNull();
  bool NextIsNull();
  void Check(int code);

  const Database* database_;
  std::unique_ptr<sqlite3_stmt, Finalize> statement_;
  int parameter_ = 0, column_ = 0;
  std::optional<Error> error_;
};

/// One connection; one thread at a time.
class Database {
 public:
  enum class Access { kReadWrite, kReadOnly };
  static Result<Database> Open(const std::filesystem::path& file, Access access);

  Statement Prepare(std::string_view sql) { return Statement(*this, sql); }
  /// Statements separated by ';', without parameters.
  Status Execute(const std::string& sql);
  /// The one number of a one-row query.
  Result<int64_t> Number(const std::string& sql);
  int64_t LastInsertedRow() const;
  /// Pages of the database, copied to a file that is new or empty.
  Status CopyTo(const std::filesystem::path& file);

  const std::string& name() const { return name_; }
  Error MakeError(int code) const;

 private:
  friend class Statement;
  struct Close {
    void operator()(sqlite3* database) const;
  };
  std::string name_;
  std::unique_ptr<sqlite3, Close> handle_;
};

}  // namespace rotunda::daemon
