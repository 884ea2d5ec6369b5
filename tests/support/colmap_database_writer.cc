#include "tests/support/colmap_database_writer.h"

#include <gtest/gtest.h>
#include <sqlite3.h>

namespace rotunda::test {
namespace {

/// COLMAP 3.8, src/base/database.cc.
constexpr char kSchema[] = R"(
CREATE TABLE cameras (camera_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, model INTEGER NOT NULL,
  width INTEGER NOT NULL, height INTEGER NOT NULL, params BLOB, prior_focal_length INTEGER NOT NULL);
CREATE TABLE images (image_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, name TEXT NOT NULL UNIQUE,
  camera_id INTEGER NOT NULL, prior_qw REAL, prior_qx REAL, prior_qy REAL, prior_qz REAL,
  prior_tx REAL, prior_ty REAL, prior_tz REAL);
CREATE TABLE keypoints (image_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL,
  cols INTEGER NOT NULL, data BLOB);
CREATE TABLE descriptors (image_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL,
  cols INTEGER NOT NULL, data BLOB);
CREATE TABLE matches (pair_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL,
  cols INTEGER NOT NULL, data BLOB);
CREATE TABLE two_view_geometries (pair_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL,
  cols INTEGER NOT NULL, data BLOB, config INTEGER NOT NULL, F BLOB, E BLOB, H BLOB, qvec BLOB,
  tvec BLOB);
)";

}  // namespace

ColmapDatabaseWriter::ColmapDatabaseWriter(const std::filesystem::path& file) {
  EXPECT_EQ(sqlite3_open(file.c_str(), &database_), SQLITE_OK);
  Run("PRAGMA synchronous = OFF");
  Run(kSchema);
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
