#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

struct sqlite3;

namespace rotunda::test {

/// A database of COLMAP 3.8, written the way COLMAP does. Failures fail the test.
class ColmapDatabaseWriter {
 public:
  explicit ColmapDatabaseWriter(const std::filesystem::path& file);
  ~ColmapDatabaseWriter();
  ColmapDatabaseWriter(const ColmapDatabaseWriter&) = delete;
  ColmapDatabaseWriter& operator=(const ColmapDatabaseWriter&) = delete;

  void Run(const std::string& sql);
  /// A row of `keypoints` (T float), `descriptors` (uint8_t), `matches` or `two_view_geometries`
  /// (uint32_t): an image's or pair's id and a table of rows x cols numbers.
  template <typename T>
  void Put(const std::string& table, int64_t id, int64_t rows, int64_t cols,
           const std::vector<T>& data) {
    PutBytes(table, id, rows, cols, {data.data(), data.size() * sizeof(T)});
  }

 private:
  struct Bytes {
    const void* data;
    size_t size;
  };
  void PutBytes(const std::string& table, int64_t id, int64_t rows, int64_t cols, Bytes bytes);

  sqlite3* database_ = nullptr;
};

/// `smaller` and `larger` are image ids.
int64_t ColmapPairId(int64_t smaller, int64_t larger);

}  // namespace rotunda::test
