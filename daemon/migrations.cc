#include "daemon/migrations.h"

#include <array>
#include <cstdio>

namespace rotunda::daemon {
namespace {

// Times are RFC 3339 in UTC with milliseconds: their order as text is that of time.
constexpr std::string_view kFirstSchema = R"sql(
CREATE TABLE calibrations (
  id            TEXT PRIMARY KEY,
  created_at    TEXT NOT NULL,
  source        TEXT NOT NULL,
  cameras       INTEGER NOT NULL,
  rms_px        REAL,
  held_out_px   REAL,
  active        INTEGER NOT NULL DEFAULT 0,
  activated_at  TEXT,
  files_gone    INTEGER NOT NULL DEFAULT 0
) STRICT, WITHOUT ROWID;
CREATE INDEX calibrations_by_time ON calibrations(created_at, id);
CREATE UNIQUE INDEX one_active_calibration ON calibrations(active) WHERE active = 1;

CREATE TABLE captures (
  id            TEXT PRIMARY KEY,
  captured_at   TEXT NOT NULL,
  subject       TEXT,
  ok_frames     INTEGER NOT NULL,
  frames        INTEGER NOT NULL,
  calibration   TEXT,             -- as its frame set says; need not be one of ours
  files_gone    INTEGER NOT NULL DEFAULT 0
) STRICT, WITHOUT ROWID;
CREATE INDEX captures_by_time ON captures(captured_at, id);

CREATE TABLE frames (
  capture       TEXT NOT NULL REFERENCES captures(id) ON DELETE CASCADE,
  camera        TEXT NOT NULL,
  serial        TEXT NOT NULL,
  file          TEXT NOT NULL,
  status        TEXT NOT NULL,
  xxh3          TEXT NOT NULL,
  width_px      INTEGER NOT NULL,
  height_px     INTEGER NOT NULL,
  PRIMARY KEY (capture, camera)
) STRICT, WITHOUT ROWID;

CREATE TABLE reconstructions (
  id                 TEXT PRIMARY KEY,
  capture            TEXT NOT NULL REFERENCES captures(id) ON DELETE CASCADE,
  calibration        TEXT,
  created_at         TEXT NOT NULL,
  method             TEXT NOT NULL,
  registered         INTEGER NOT NULL,
  of_cameras         INTEGER NOT NULL,
  rms_px             REAL NOT NULL,
  verdict            TEXT NOT NULL,
  verdict_reason     TEXT NOT NULL,
  folded             INTEGER NOT NULL,
  used_for_drift     INTEGER NOT NULL,
  mean_rotation_deg  REAL,
  mean_position_mm   REAL,
  files_gone         INTEGER NOT NULL DEFAULT 0
) STRICT, WITHOUT ROWID;
CREATE INDEX reconstructions_of_capture ON reconstructions(capture, created_at, id);

-- Outlives captures and reconstructions that the retention policy removes.
CREATE TABLE drift (
  calibration         TEXT NOT NULL,
  camera              TEXT NOT NULL,
  captured_at         TEXT NOT NULL,
  capture             TEXT NOT NULL,
  reconstruction      TEXT NOT NULL,
  rotation_deg        REAL NOT NULL,
  position_mm         REAL NOT NULL,
  rotation_sigma_deg  REAL,
  position_sigma_mm   REAL,
  beyond_limit        INTEGER NOT NULL,
  swapped_with        TEXT,
  PRIMARY KEY (calibration, camera, captured_at, capture)
) STRICT, WITHOUT ROWID;
CREATE INDEX drift_of_camera ON drift(camera, captured_at, capture);
CREATE INDEX drift_of_capture ON drift(capture);

-- How many captures a camera was compared in: counting rows is slow with thousands of them.
CREATE TABLE drift_counts (
  calibration  TEXT NOT NULL,
  camera       TEXT NOT NULL,
  captures     INTEGER NOT NULL,
  PRIMARY KEY (calibration, camera)
) STRICT, WITHOUT ROWID;
CREATE TRIGGER drift_added AFTER INSERT ON drift BEGIN
  INSERT INTO drift_counts VALUES (new.calibration, new.camera, 1)
  ON CONFLICT (calibration, camera) DO UPDATE SET captures = captures + 1;
END;
CREATE TRIGGER drift_removed AFTER DELETE ON drift BEGIN
  UPDATE drift_counts SET captures = captures - 1
  WHERE calibration = old.calibration AND camera = old.camera;
END;

CREATE TABLE jobs (
  number            INTEGER PRIMARY KEY AUTOINCREMENT,
  kind              TEXT NOT NULL,
  state             TEXT NOT NULL,
  stage             TEXT NOT NULL DEFAULT '',
  done              INTEGER NOT NULL DEFAULT 0,
  total             INTEGER NOT NULL DEFAULT 0,
  idempotency_key   TEXT UNIQUE,
  body              TEXT NOT NULL,
  product           TEXT NOT NULL DEFAULT '',
  result            TEXT NOT NULL DEFAULT '',
  error             TEXT NOT NULL DEFAULT '',
  created_at        TEXT NOT NULL,
  started_at        TEXT,
  ended_at          TEXT,
  cancel_requested  INTEGER NOT NULL DEFAULT 0
) STRICT;
CREATE INDEX jobs_by_state ON jobs(state, number);

CREATE TABLE events (
  number  INTEGER PRIMARY KEY AUTOINCREMENT,
  at      TEXT NOT NULL,
  kind    TEXT NOT NULL,
  about   TEXT NOT NULL,
  data    TEXT NOT NULL
) STRICT;
CREATE INDEX events_about ON events(kind, about);
)sql";

// For ids that are reserved, and for follow-ups that are queued already.
constexpr std::string_view kJobIndexes = R"sql(
CREATE INDEX jobs_by_product ON jobs(product);
CREATE INDEX jobs_by_body ON jobs(kind, body);
)sql";

// Cameras without a pose in captures that are newer than all that the camera was compared in.
constexpr std::string_view kUnregistered = R"sql(
CREATE TABLE unregistered (
  calibration  TEXT NOT NULL,
  camera       TEXT NOT NULL,
  captured_at  TEXT NOT NULL,
  capture      TEXT NOT NULL,
  reason       TEXT NOT NULL,
  PRIMARY KEY (calibration, camera, captured_at, capture)
) STRICT, WITHOUT ROWID;
)sql";

// For how long a camera has been beyond its limit: without it thousands of rows are read for one
// that stays there.
constexpr std::string_view kDriftIndex = R"sql(
CREATE INDEX drift_by_limit ON drift(calibration, camera, beyond_limit, captured_at, capture);
)sql";

// Why a frame is not usable; what a calibration was made from, a JSON object, empty: not known.
constexpr std::string_view kOrigins = R"sql(
ALTER TABLE frames ADD COLUMN reason TEXT NOT NULL DEFAULT '';
ALTER TABLE calibrations ADD COLUMN made_from TEXT NOT NULL DEFAULT '';
)sql";

// Before there was a choice.
constexpr std::string_view kChoices = R"sql(
ALTER TABLE reconstructions ADD COLUMN preset TEXT NOT NULL DEFAULT '';
ALTER TABLE reconstructions ADD COLUMN prior TEXT NOT NULL DEFAULT 'none';
UPDATE reconstructions SET preset = 'rig' WHERE method = 'tc-sfm';
)sql";

constexpr std::array<std::string_view, 6> kSteps = {kFirstSchema, kJobIndexes, kUnregistered,
                                                    kDriftIndex,  kOrigins,    kChoices};

Status CheckOwner(Database& database, int64_t version) {
  ROTUNDA_ASSIGN_OR_RETURN(const int64_t owner, database.Number("PRAGMA application_id"));
  ROTUNDA_ASSIGN_OR_RETURN(const int64_t tables,
                           database.Number("SELECT count(*) FROM sqlite_schema"));
  if (owner == kApplicationId || (owner == 0 && version == 0 && tables == 0)) return {};
  char found[32];
  std::snprintf(found, sizeof(found), "0x%08llx", static_cast<unsigned long long>(owner));
  return Error{ErrorCode::kBadInput,
               "is a database of another program (application id " + std::string(found) + ", " +
                   std::to_string(tables) +
                   " tables and indexes), expected rotundad's or none: give the daemon another "
                   "state folder, or move this file away",
               database.name()};
}

Status RunStep(Database& database, std::string_view step, int64_t version) {
  ROTUNDA_RETURN_IF_ERROR(database.Execute("BEGIN IMMEDIATE"));
  const Status status = database.Execute(
      std::string(step) + ";PRAGMA application_id = " + std::to_string(kApplicationId) +
      ";PRAGMA user_version = " + std::to_string(version) + ";COMMIT");
  if (!status) static_cast<void>(database.Execute("ROLLBACK"));
  return status;
}

}  // namespace

std::span<const std::string_view> SchemaSteps() { return kSteps; }

Status CheckSchema(Database& database, std::span<const std::string_view> steps) {
  ROTUNDA_ASSIGN_OR_RETURN(const int64_t version, database.Number("PRAGMA user_version"));
  ROTUNDA_RETURN_IF_ERROR(CheckOwner(database, version));
  const auto known = static_cast<int64_t>(steps.size());
  if (version >= 0 && version <= known) return {};
  return Error{ErrorCode::kBadInput,
               "has schema version " + std::to_string(version) + ", this rotundad knows 1 to " +
                   std::to_string(known) +
                   ": install the rotundad that wrote it, or a newer one; nothing was changed",
               database.name()};
}

Status Migrate(Database& database, std::span<const std::string_view> steps) {
  ROTUNDA_RETURN_IF_ERROR(CheckSchema(database, steps));
  ROTUNDA_ASSIGN_OR_RETURN(const int64_t version, database.Number("PRAGMA user_version"));
  for (auto step = static_cast<size_t>(version); step < steps.size(); ++step) {
    ROTUNDA_RETURN_IF_ERROR(RunStep(database, steps[step], static_cast<int64_t>(step) + 1));
  }
  return {};
}

}  // namespace rotunda::daemon
