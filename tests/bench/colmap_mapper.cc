#include "tests/bench/colmap_mapper.h"

#include <sqlite3.h>

#include <cstdint>

#include "sfm/colmap_io.h"
#include "tests/bench/bench_process.h"
#include "tests/support/colmap_schema.h"

namespace rotunda::bench {
namespace {

namespace fs = std::filesystem;

/// COLMAP's Database::kMaxNumImages.
constexpr int64_t kMaxImages = 2147483647;

class Database {
 public:
  explicit Database(const fs::path& file) {
    if (sqlite3_open(file.c_str(), &database_) != SQLITE_OK) Die("cannot open " + file.string());
  }
  ~Database() { sqlite3_close(database_); }
  Database(const Database&) = delete;
  Database& operator=(const Database&) = delete;

  void Execute(const std::string& sql) {
    char* message = nullptr;
    if (sqlite3_exec(database_, sql.c_str(), nullptr, nullptr, &message) != SQLITE_OK) {
      Die("database: " + std::string(message));
    }
  }
  sqlite3* get() { return database_; }

 private:
  sqlite3* database_ = nullptr;
};

/// One statement with its parameters bound in their order.
class Statement {
 public:
  Statement(Database& database, const std::string& sql) : database_(database.get()) {
    if (sqlite3_prepare_v2(database_, sql.c_str(), -1, &statement_, nullptr) != SQLITE_OK) {
      Die("database: " + std::string(sqlite3_errmsg(database_)));
    }
  }
  ~Statement() { sqlite3_finalize(statement_); }
  Statement(const Statement&) = delete;
  Statement& operator=(const Statement&) = delete;

  Statement& Int(int64_t value) {
    sqlite3_bind_int64(statement_, ++bound_, value);
    return *this;
  }
  Statement& Text(const std::string& value) {
    sqlite3_bind_text(statement_, ++bound_, value.c_str(), -1, SQLITE_TRANSIENT);
    return *this;
  }
  template <typename T>
  Statement& Blob(const std::vector<T>& values) {
    sqlite3_bind_blob(statement_, ++bound_, values.data(),
                      static_cast<int>(values.size() * sizeof(T)), SQLITE_TRANSIENT);
    return *this;
  }
  void Run() {
    if (sqlite3_step(statement_) != SQLITE_DONE) {
      Die("database: " + std::string(sqlite3_errmsg(database_)));
    }
  }

 private:
  sqlite3* database_;
  sqlite3_stmt* statement_ = nullptr;
  int bound_ = 0;
};

std::string ImageName(const Frame& frame) { return fs::path(frame.file).filename().string(); }

const CameraIntrinsics& IntrinsicsOf(const Frame& frame, const Calibration& calibration) {
  const CalibratedCamera* camera = calibration.Find(frame.camera);
  if (camera == nullptr) Die("the calibration has no camera " + frame.camera);
  return camera->intrinsics;
}

void PutImages(Database& database, const MapperInput& input) {
  for (size_t i = 0; i < input.set.frames.size(); ++i) {
    const Frame& frame = input.set.frames[i];
    const CameraIntrinsics& intrinsics = IntrinsicsOf(frame, input.calibration);
    const auto id = static_cast<int64_t>(i + 1);
    Statement(database, "INSERT INTO cameras VALUES (?, ?, ?, ?, ?, 1)")
        .Int(id)
        .Int(ColmapModelId(intrinsics.model))
        .Int(intrinsics.width_px)
        .Int(intrinsics.height_px)
        .Blob(intrinsics.params)
        .Run();
    Statement(database, "INSERT INTO images (image_id, name, camera_id) VALUES (?, ?, ?)")
        .Int(id)
        .Text(ImageName(frame))
        .Int(id)
        .Run();
  }
}

void PutKeypoints(Database& database, const sfm::Features& features) {
  for (size_t i = 0; i < features.images.size(); ++i) {
    std::vector<float> rows;
    for (const sfm::Keypoint& keypoint : features.images[i].keypoints) {
      rows.insert(rows.end(),
                  {keypoint.x_px, keypoint.y_px, keypoint.scale_px, keypoint.orientation_rad});
    }
    Statement(database, "INSERT INTO keypoints VALUES (?, ?, 4, ?)")
        .Int(static_cast<int64_t>(i + 1))
        .Int(static_cast<int64_t>(features.images[i].keypoints.size()))
        .Blob(rows)
        .Run();
  }
}

/// COLMAP's TwoViewGeometry::ConfigurationType.
int Configuration(sfm::TwoViewKind kind) {
  switch (kind) {
    case sfm::TwoViewKind::kCalibrated:
      return 2;
    case sfm::TwoViewKind::kUncalibrated:
      return 3;
    case sfm::TwoViewKind::kPlanar:
      return 4;
    case sfm::TwoViewKind::kPanoramic:
      return 5;
  }
  Die("a two-view geometry of an unknown kind");
}

void PutPairs(Database& database, const sfm::TwoViews& two_views) {
  for (const sfm::TwoView& view : two_views.pairs) {
    std::vector<uint32_t> rows;
    for (const sfm::Match& match : view.inliers) {
      rows.push_back(static_cast<uint32_t>(match.first.index()));
      rows.push_back(static_cast<uint32_t>(match.second.index()));
    }
    const int64_t pair_id = kMaxImages * static_cast<int64_t>(view.pair.first.index() + 1) +
                            static_cast<int64_t>(view.pair.second.index() + 1);
    const auto count = static_cast<int64_t>(view.inliers.size());
    Statement(database, "INSERT INTO matches VALUES (?, ?, 2, ?)")
        .Int(pair_id)
        .Int(count)
        .Blob(rows)
        .Run();
    Statement(database,
              "INSERT INTO two_view_geometries VALUES (?, ?, 2, ?, ?, NULL, NULL, NULL, NULL, "
              "NULL)")
        .Int(pair_id)
        .Int(count)
        .Blob(rows)
        .Int(Configuration(view.kind))
        .Run();
  }
}

PoseSet PosesOf(const sfm::ColmapModel& model, const Calibration& truth) {
  PoseSet poses;
  for (const CalibratedCamera& camera : truth.cameras) {
    poses.cameras.emplace_back().camera = camera.camera;
  }
  for (size_t i = 0; i < model.image_names.size(); ++i) {
    const std::string camera = fs::path(model.image_names[i]).stem().string();
    for (CameraPose& pose : poses.cameras) {
      if (pose.camera != camera || !model.reconstruction.cam_from_model[i]) continue;
      pose.registered = true;
      pose.cam_from_rig = *model.reconstruction.cam_from_model[i];
    }
  }
  return poses;
}

}  // namespace

void WriteKnownIntrinsics(const fs::path& file, const FrameSet& set,
                          const Calibration& calibration) {
  Database database(file);
  for (const Frame& frame : set.frames) {
    const CameraIntrinsics& intrinsics = IntrinsicsOf(frame, calibration);
    Statement(database,
              "UPDATE cameras SET model = ?, params = ?, prior_focal_length = 1 WHERE "
              "camera_id = (SELECT camera_id FROM images WHERE name = ?)")
        .Int(ColmapModelId(intrinsics.model))
        .Blob(intrinsics.params)
        .Text(ImageName(frame))
        .Run();
    if (sqlite3_changes(database.get()) != 1) {
      Die("colmap's database has no camera for " + ImageName(frame));
    }
  }
  database.Execute("PRAGMA wal_checkpoint(TRUNCATE)");
}

void WriteMatchedDatabase(const fs::path& file, const MapperInput& input) {
  fs::remove(file);
  Database database(file);
  database.Execute("PRAGMA synchronous = OFF");
  database.Execute(test::kColmapSchema);
  database.Execute("BEGIN");
  PutImages(database, input);
  PutKeypoints(database, input.features);
  PutPairs(database, input.two_views);
  database.Execute("COMMIT");
}

std::vector<std::string> MapperCommand(const fs::path& database, const fs::path& pictures,
                                       const fs::path& models) {
  return {"colmap",
          "mapper",
          "--database_path",
          database,
          "--image_path",
          pictures,
          "--output_path",
          models,
          "--Mapper.ba_refine_focal_length",
          "0",
          "--Mapper.ba_refine_principal_point",
          "0",
          "--Mapper.ba_refine_extra_params",
          "0"};
}

MapperModels ReadMapperModels(const fs::path& folder, const Calibration& truth) {
  MapperModels models;
  size_t most = 0;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const sfm::ColmapModel model = OrDie(sfm::ReadColmapModel(entry.path()));
    ++models.count;
    const size_t registered = sfm::RegisteredCount(model.reconstruction);
    if (registered <= most) continue;
    most = registered;
    models.largest = PosesOf(model, truth);
  }
  return models;
}

}  // namespace rotunda::bench
