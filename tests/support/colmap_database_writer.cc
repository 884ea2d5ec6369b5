#include "tests/support/colmap_database_writer.h"

#include <gtest/gtest.h>
#include <sqlite3.h>

#include "tests/support/colmap_schema.h"

namespace rotunda::test {

ColmapDatabaseWriter::ColmapDatabaseWriter(const std::filesystem::path& file) {
  EXPECT_EQ(sqlite3_open(file.c_str(), &database_), SQLITE_OK);
  Run("PRAGMA synchronous = OFF");
  Run(kColmapSchema);
}

ColmapDatabaseWriter::~ColmapDatabaseWriter() { sqlite3_close(database_); }

void ColmapDatabaseWriter::Run(const std::string& sql) {
  char* message = nullptr;
  EXPECT_EQ(sqlite3_exec(database_, sql.c_str(), nullptr, nullptr, &message), SQLITE_OK)
      << (message == nullptr ? "" : message);
}

void ColmapDatabaseWriter::PutBytes(const std::string& table, int64_t id, int64_t rows,
                                    int64_t cols, Bytes bytes) {
  const bool two_view = table == "two_view_geometries";
  const std::string sql = "INSERT INTO " + table + " VALUES (?, ?, ?, ?" +
                          (two_view ? ", 2, NULL, NULL, NULL, NULL, NULL)" : ")");
  sqlite3_stmt* statement = nullptr;
  ASSERT_EQ(sqlite3_prepare_v2(database_, sql.c_str(), -1, &statement, nullptr), SQLITE_OK);
  sqlite3_bind_int64(statement, 1, id);
  sqlite3_bind_int64(statement, 2, rows);
  sqlite3_bind_int64(statement, 3, cols);
  sqlite3_bind_blob(statement, 4, bytes.data, static_cast<int>(bytes.size), SQLITE_TRANSIENT);
  EXPECT_EQ(sqlite3_step(statement), SQLITE_DONE);
  sqlite3_finalize(statement);
}

int64_t ColmapPairId(int64_t smaller, int64_t larger) { return 2147483647 * smaller + larger; }

}  // namespace rotunda::test
