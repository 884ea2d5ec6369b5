#include <sqlite3.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <map>
#include <memory>
#include <span>
#include <system_error>

#include "sfm/colmap_io.h"

namespace rotunda::sfm {
namespace {

namespace fs = std::filesystem;

/// COLMAP's Database::kMaxNumImages: pair_id = kMaxImages * smaller id + larger id.
constexpr int64_t kMaxImages = 2147483647;

struct CloseDatabase {
  void operator()(sqlite3* database) const { sqlite3_close_v2(database); }
};
struct FinalizeStatement {
  void operator()(sqlite3_stmt* statement) const { sqlite3_finalize(statement); }
};

/// The file's name for SQLite, opened as a file that nobody writes: no lock, no journal.
Result<std::string> ImmutableUri(const fs::path& file) {
  constexpr char kHex[] = "0123456789ABCDEF";
  std::error_code error;
  const fs::path absolute = fs::absolute(file, error);
  if (error) {
    return Error{ErrorCode::kIo, "cannot tell its absolute path: " + error.message(),
                 file.string()};
  }
  std::string uri = "file:";
  for (const unsigned char c : absolute.string()) {
    if (std::isalnum(c) || c == '/' || c == '.' || c == '-' || c == '_') {
      uri += static_cast<char>(c);
    } else {
      uri += {'%', kHex[c >> 4], kHex[c & 15]};
    }
  }
  return uri + "?mode=ro&immutable=1";
}

/// A table of numbers as COLMAP stores it: rows, cols and the bytes.
struct Table {
  size_t rows = 0;
  size_t cols = 0;
  std::span<const char> bytes;
};

/// One SELECT, row by row. `place` ("keypoints") goes into messages.
class Query {
 public:
  Query(sqlite3* database, std::string file, std::string table, const std::string& sql)
      : database_(database), file_(std::move(file)), table_(std::move(table)) {
    sqlite3_stmt* statement = nullptr;
    code_ = sqlite3_prepare_v2(database, sql.c_str(), -1, &statement, nullptr);
    statement_.reset(statement);
  }
  bool Next() {
    if (code_ != SQLITE_OK && code_ != SQLITE_ROW) return false;
    code_ = sqlite3_step(statement_.get());
    ++row_;
    return code_ == SQLITE_ROW;
  }
  /// What ended the rows: their end, or an error of the database.
  Status status() const {
    if (code_ == SQLITE_DONE) return {};
    return Fail("is not COLMAP's: " + std::string(sqlite3_errmsg(database_)));
  }
  Error Fail(const std::string& message) const {
    std::string place = file_ + ": " + table_;
    if (row_ > 0) place += ": row " + std::to_string(row_);
    return {ErrorCode::kBadInput, message, place};
  }

  int64_t Int(int column) { return sqlite3_column_int64(statement_.get(), column); }
  std::string Text(int column) {
    const unsigned char* text = sqlite3_column_text(statement_.get(), column);
    return text == nullptr ? "" : reinterpret_cast<const char*>(text);
  }
  /// Columns first, first + 1, first + 2: rows, cols, data. `item_bytes` is the size of a number.
  Result<Table> Matrix(int first, size_t item_bytes) {
    const int64_t rows = Int(first);
    const int64_t cols = Int(first + 1);
    const void* data = sqlite3_column_blob(statement_.get(), first + 2);
    const auto size = static_cast<size_t>(sqlite3_column_bytes(statement_.get(), first + 2));
    const auto row_items = static_cast<int64_t>(size / item_bytes);
    // `size` is below 2^31: once rows and cols are at most that, the product cannot overflow.
    if (rows < 0 || cols < 0 || (rows > 0 && cols > 0 && (rows > row_items || cols > row_items)) ||
        static_cast<size_t>(rows * cols) * item_bytes != size) {
      return Fail("data has " + std::to_string(size) + " bytes, expected " + std::to_string(rows) +
                  " rows x " + std::to_string(cols) + " cols x " + std::to_string(item_bytes) +
                  " bytes");
    }
    return Table{static_cast<size_t>(rows),
                 static_cast<size_t>(cols),
                 {static_cast<const char*>(data), size}};
  }

 private:
  sqlite3* database_;
  std::string file_;
  std::string table_;
  std::unique_ptr<sqlite3_stmt, FinalizeStatement> statement_;
  int code_ = SQLITE_OK;
  size_t row_ = 0;
};

template <typename T>
T At(const Table& table, size_t row, size_t col) {
  T value;
  std::memcpy(&value, table.bytes.data() + (row * table.cols + col) * sizeof(T), sizeof(T));
  return value;
}

/// Columns x y, x y scale orientation, or x y a11 a12 a21 a22 (COLMAP's FeatureKeypoint).
Keypoint ReadKeypoint(const Table& table, size_t row) {
  Keypoint keypoint;
  keypoint.x_px = At<float>(table, row, 0);
  keypoint.y_px = At<float>(table, row, 1);
  if (table.cols == 4) {
    keypoint.scale_px = At<float>(table, row, 2);
    keypoint.orientation_rad = At<float>(table, row, 3);
  } else if (table.cols == 6) {
    const float a11 = At<float>(table, row, 2), a12 = At<float>(table, row, 3);
    const float a21 = At<float>(table, row, 4), a22 = At<float>(table, row, 5);
    keypoint.scale_px = 0.5F * (std::hypot(a11, a21) + std::hypot(a12, a22));
    keypoint.orientation_rad = std::atan2(a21, a11);
  }
  return keypoint;
}

bool IsFinite(const Keypoint& keypoint) {
  return std::isfinite(keypoint.x_px) && std::isfinite(keypoint.y_px) &&
         std::isfinite(keypoint.scale_px) && std::isfinite(keypoint.orientation_rad);
}

class DatabaseReader {
 public:
  DatabaseReader(const fs::path& file, const FrameSet& set) : file_(file.string()), set_(set) {}

  Result<ColmapDatabase> Read() {
    ROTUNDA_RETURN_IF_ERROR(Open());
    ROTUNDA_RETURN_IF_ERROR(CheckTables());
    result_.features.images.resize(set_.frames.size());
    ROTUNDA_RETURN_IF_ERROR(ReadImages());
    ROTUNDA_RETURN_IF_ERROR(ReadKeypoints());
    ROTUNDA_RETURN_IF_ERROR(ReadDescriptors());
    ROTUNDA_RETURN_IF_ERROR(ReadPairs("matches", result_.matches));
    ROTUNDA_RETURN_IF_ERROR(ReadPairs("two_view_geometries", result_.verified_inliers));
    return std::move(result_);
  }

 private:
  Error Fail(const std::string& message) const { return {ErrorCode::kBadInput, message, file_}; }

  Status Open() {
    std::error_code error;
    if (!fs::is_regular_file(file_, error)) {
      return Error{ErrorCode::kNotFound, "expected a COLMAP database, found no such file", file_};
    }
    // Read as immutable, what stands in the log alone would be missed without a word.
    const auto log_bytes = fs::file_size(file_ + "-wal", error);
    if (!error && log_bytes > 0) {
      return Fail("has a write-ahead log beside it: it is open elsewhere or was not closed");
    }
    ROTUNDA_ASSIGN_OR_RETURN(const std::string uri, ImmutableUri(file_));
    sqlite3* database = nullptr;
    const int code =
        sqlite3_open_v2(uri.c_str(), &database,
                        SQLITE_OPEN_READONLY | SQLITE_OPEN_URI | SQLITE_OPEN_NOMUTEX, nullptr);
    database_.reset(database);
    if (code != SQLITE_OK) return Fail("cannot open: " + std::string(sqlite3_errmsg(database)));
    sqlite3_db_config(database, SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0, nullptr);
    return {};
  }

  Query Select(const std::string& table, const std::string& sql) {
    return Query(database_.get(), file_, table, sql);
  }

  /// Only plain tables are read: a view could run any query.
  Status CheckTables() {
    for (const std::string table :
         {"cameras", "images", "keypoints", "descriptors", "matches", "two_view_geometries"}) {
      Query query =
          Select("sqlite_master",
                 "SELECT 1 FROM sqlite_master WHERE type = 'table' AND name = '" + table + "'");
      if (query.Next()) continue;
      const Status status = query.status();
      if (!status)
        return Fail("is not a database: " + std::string(sqlite3_errmsg(database_.get())));
      return Fail("is not a COLMAP database: it has no table " + table);
    }
    return {};
  }

  /// The frame a database name stands for: its file with the folder, else without it.
  std::map<std::string, std::vector<size_t>> FramesByName() const {
    std::map<std::string, std::vector<size_t>> frames;
    for (size_t i = 0; i < set_.frames.size(); ++i) {
      const fs::path file(set_.frames[i].file);
      if (!file.empty()) frames[file.filename().string()].push_back(i);
    }
    return frames;
  }

  Status ReadImages() {
    const auto frames_by_name = FramesByName();
    std::vector<int64_t> id_of_frame(set_.frames.size(), 0);
    Query query = Select("images",
                         "SELECT images.image_id, images.name, cameras.width, cameras.height "
                         "FROM images LEFT JOIN cameras ON images.camera_id = cameras.camera_id");
    while (query.Next()) {
      const int64_t id = query.Int(0);
      const std::string name = query.Text(1);
      const auto frames = frames_by_name.find(fs::path(name).filename().string());
      if (frames == frames_by_name.end()) continue;
      if (id <= 0 || id >= kMaxImages) {
        return query.Fail("image id " + std::to_string(id) + " is out of range");
      }
      ROTUNDA_ASSIGN_OR_RETURN(const size_t frame, ChooseFrame(query, name, frames->second));
      if (id_of_frame[frame] != 0) {
        return query.Fail("\"" + name + "\" is the second image for file \"" +
                          set_.frames[frame].file + "\"");
      }
      id_of_frame[frame] = id;
      frame_of_id_[id] = ImageId(frame);
      ROTUNDA_RETURN_IF_ERROR(SetSize(query, frame));
    }
    ROTUNDA_RETURN_IF_ERROR(query.status());
    for (size_t i = 0; i < id_of_frame.size(); ++i) {
      if (id_of_frame[i] == 0 && set_.frames[i].status == "ok") {
        return Fail("has no image named \"" + set_.frames[i].file + "\" (camera \"" +
                    set_.frames[i].camera + "\")");
      }
    }
    return {};
  }

  Result<size_t> ChooseFrame(const Query& query, const std::string& name,
                             const std::vector<size_t>& frames) const {
    for (const size_t frame : frames) {
      if (set_.frames[frame].file == name) return frame;
    }
    if (frames.size() == 1) return frames.front();
    return query.Fail("\"" + name + "\" could be \"" + set_.frames[frames[0]].file + "\" or \"" +
                      set_.frames[frames[1]].file + "\"");
  }

  Status SetSize(Query& query, size_t frame) {
    const int64_t width_px = query.Int(2);
    const int64_t height_px = query.Int(3);
    const Frame& expected = set_.frames[frame];
    if (width_px <= 0 || height_px <= 0 || width_px > INT32_MAX || height_px > INT32_MAX ||
        (expected.width_px > 0 &&
         (expected.width_px != width_px || expected.height_px != height_px))) {
      return query.Fail("\"" + expected.file + "\" has size " + std::to_string(width_px) + "x" +
                        std::to_string(height_px) + ", expected " +
                        (expected.width_px > 0 ? std::to_string(expected.width_px) + "x" +
                                                     std::to_string(expected.height_px)
                                               : "a positive size"));
    }
    result_.features.images[frame].width_px = static_cast<int>(width_px);
    result_.features.images[frame].height_px = static_cast<int>(height_px);
    return {};
  }

  Status ReadKeypoints() {
    Query query = Select("keypoints", "SELECT image_id, rows, cols, data FROM keypoints");
    while (query.Next()) {
      const auto frame = frame_of_id_.find(query.Int(0));
      if (frame == frame_of_id_.end()) continue;
      ROTUNDA_ASSIGN_OR_RETURN(const Table table, query.Matrix(1, sizeof(float)));
      if (table.rows > 0 && table.cols != 2 && table.cols != 4 && table.cols != 6) {
        return query.Fail("expected 2, 4 or 6 columns, found " + std::to_string(table.cols));
      }
      auto& keypoints = result_.features.images[frame->second.index()].keypoints;
      keypoints.clear();
      for (size_t i = 0; i < table.rows; ++i) {
        keypoints.push_back(ReadKeypoint(table, i));
        if (!IsFinite(keypoints.back())) {
          return query.Fail("keypoint " + std::to_string(i) + " is not finite numbers");
        }
      }
    }
    return query.status();
  }

  Status ReadDescriptors() {
    Query query = Select("descriptors", "SELECT image_id, rows, cols, data FROM descriptors");
    while (query.Next()) {
      const auto frame = frame_of_id_.find(query.Int(0));
      if (frame == frame_of_id_.end()) continue;
      ROTUNDA_ASSIGN_OR_RETURN(const Table table, query.Matrix(1, 1));
      ImageFeatures& image = result_.features.images[frame->second.index()];
      if (table.rows != image.keypoints.size() ||
          (table.rows > 0 && table.cols != kDescriptorSize)) {
        return query.Fail("expected " + std::to_string(image.keypoints.size()) +
                          " descriptors of " + std::to_string(kDescriptorSize) + " bytes, found " +
                          std::to_string(table.rows) + " of " + std::to_string(table.cols));
      }
      image.descriptors.assign(table.bytes.begin(), table.bytes.end());
    }
    return query.status();
  }

  Status ReadPairs(const std::string& table, Matches& matches) {
    Query query = Select(table, "SELECT pair_id, rows, cols, data FROM " + table);
    while (query.Next()) {
      const int64_t pair_id = query.Int(0);
      const auto first = frame_of_id_.find(pair_id / kMaxImages);
      const auto second = frame_of_id_.find(pair_id % kMaxImages);
      if (first == frame_of_id_.end() || second == frame_of_id_.end()) continue;
      if (first == second) return query.Fail("is a pair of one image with itself");
      ROTUNDA_ASSIGN_OR_RETURN(const Table data, query.Matrix(1, sizeof(uint32_t)));
      if (data.rows == 0) continue;
      if (data.cols != 2) {
        return query.Fail("expected 2 columns, found " + std::to_string(data.cols));
      }
      ROTUNDA_ASSIGN_OR_RETURN(PairMatches pair,
                               ReadPair(query, data, first->second, second->second));
      matches.pairs.push_back(std::move(pair));
    }
    ROTUNDA_RETURN_IF_ERROR(query.status());
    std::sort(matches.pairs.begin(), matches.pairs.end(),
              [](const PairMatches& a, const PairMatches& b) { return a.pair < b.pair; });
    return {};
  }

  /// `a` and `b` in the order of COLMAP's ids, which need not be that of the frames.
  Result<PairMatches> ReadPair(const Query& query, const Table& data, ImageId a, ImageId b) const {
    const size_t count_a = result_.features.image(a).keypoints.size();
    const size_t count_b = result_.features.image(b).keypoints.size();
    const bool swapped = b < a;
    PairMatches pair;
    pair.pair = swapped ? ImagePair{b, a} : ImagePair{a, b};
    for (size_t i = 0; i < data.rows; ++i) {
      const auto in_a = At<uint32_t>(data, i, 0);
      const auto in_b = At<uint32_t>(data, i, 1);
      if (in_a >= count_a || in_b >= count_b) {
        return query.Fail("match " + std::to_string(i) + " is " + std::to_string(in_a) + " - " +
                          std::to_string(in_b) + ", but the images have " +
                          std::to_string(count_a) + " and " + std::to_string(count_b) +
                          " keypoints");
      }
      pair.matches.push_back(swapped ? Match{KeypointId(in_b), KeypointId(in_a)}
                                     : Match{KeypointId(in_a), KeypointId(in_b)});
    }
    std::sort(pair.matches.begin(), pair.matches.end());
    return pair;
  }

  std::string file_;
  const FrameSet& set_;
  std::unique_ptr<sqlite3, CloseDatabase> database_;
  std::map<int64_t, ImageId> frame_of_id_;
  ColmapDatabase result_;
};

}  // namespace

Result<ColmapDatabase> ReadColmapDatabase(const fs::path& file, const FrameSet& set) {
  return DatabaseReader(file, set).Read();
}

}  // namespace rotunda::sfm
