#include "tests/bench/calibration_mean.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "rig/calibration_comparison.h"
#include "rig/marker_detection.h"
#include "rig/sim/board_object.h"
#include "rig/sim/lighting.h"
#include "rig/sim/simulate.h"
#include "sfm/core/evaluate.h"
#include "tests/bench/bench_process.h"
#include "tests/bench/calibration_run.h"

namespace rotunda::bench {
namespace {

namespace fs = std::filesystem;

constexpr int kShots = 6;
constexpr size_t kCameras = 18;
/// Pictures as they are give 0.0007 deg and 0.010 mm; a shot or a face less up to twice as much.
/// What is wrong and taken for right costs ten times as much.
constexpr double kMaxRotation_deg = 0.002, kMaxPosition_mm = 0.03;

struct World {
  sim::RigOptions rig;
  sim::SimulateOptions options;
  Calibration truth;
  rig::ShotPictures pictures;
  rig::BoardSightings sightings;

  size_t Cameras() const { return truth.cameras.size(); }
  size_t Shots() const { return pictures.shots.size(); }
  const std::string& CameraName(size_t camera) const { return sightings.cameras[camera].camera; }
  const std::string& ShotName(size_t shot) const { return sightings.shots[shot].id; }
  std::string PictureName(size_t shot, size_t camera) const {
    return CameraName(camera) + " in " + ShotName(shot);
  }
};

World Render(const test::TemporaryFolder& folder, ThreadPool& threads) {
  RunContext context{threads};
  World world;
  world.options.target = sim::Target::kCuboid;
  world.options.cameras = static_cast<int>(kCameras);
  world.options.picture_scale = 0.5;
  world.options.seed = 1;
  const fs::path shots = folder / "shots";
  OrDie(sim::SimulatePlacements(world.rig, world.options, kShots, shots, context));
  world.truth = OrDie(ReadCalibration(shots / "placement_00" / "truth.json"));
  world.pictures = OrDie(rig::FindShots({shots}));
  world.sightings = OrDie(rig::DetectBoards(world.pictures, world.options.board, {}, context));
  return world;
}

/// Puts what `change` makes of a picture in its place.
void Change(World& world, size_t shot, size_t camera, const std::function<void(cv::Mat&)>& change) {
  rig::BoardSighting& sighting = world.sightings.sightings[shot][camera];
  cv::Mat picture = cv::imread(sighting.picture.string(), cv::IMREAD_GRAYSCALE);
  change(picture);
  sighting.detection = OrDie(rig::DetectBoard(picture, world.options.board, {}));
}

void ChangeShot(World& world, size_t shot, const std::function<void(cv::Mat&)>& change) {
  for (size_t c = 0; c < world.Cameras(); ++c) Change(world, shot, c, change);
}

void ChangeCamera(World& world, size_t camera, const std::function<void(cv::Mat&)>& change) {
  for (size_t s = 0; s < world.Shots(); ++s) Change(world, s, camera, change);
}

/// A print with two of the board's ids and more that are not, over the picture's corner.
void PasteOtherBoard(const World& world, cv::Mat& picture) {
  rig::BoardFace other = world.options.board.faces[0];
  other.columns = 7;
  other.rows = 9;
  other.first_id = world.options.board.faces.back().first_id +
                   world.options.board.faces.back().MarkerCount() - 2;
  constexpr double kPxPerSquare = 24;
  const double scale = kPxPerSquare / other.square_m;
  const auto px = [&](double m) { return 12 + static_cast<int>(std::lround(m * scale)); };
  picture(cv::Range(0, px(other.Height_m()) + 12), cv::Range(0, px(other.Width_m()) + 12)) = 200;
  for (const rig::InkRectangle& r : OrDie(rig::FaceInk(other))) {
    picture(cv::Range(px(r.top_m), px(r.bottom_m)), cv::Range(px(r.left_m), px(r.right_m))) = 30;
  }
}

/// The largest marker once more, in the picture's corner.
void DuplicateMarker(const World& world, cv::Mat& picture) {
  const auto markers =
      OrDie(rig::DetectMarkers(picture, world.options.board.faces[0].dictionary, {}));
  const auto largest =
      std::max_element(markers.begin(), markers.end(),
                       [](const auto& a, const auto& b) { return a.Side_px() < b.Side_px(); });
  if (largest == markers.end()) return;
  std::vector<cv::Point2f> outline;
  for (const Eigen::Vector2d& corner : largest->corners_px) {
    outline.emplace_back(static_cast<float>(corner.x()), static_cast<float>(corner.y()));
  }
  constexpr int kWhite_px = 3;
  cv::Rect box = cv::boundingRect(outline);
  box -= cv::Point(kWhite_px, kWhite_px);
  box += cv::Size(2 * kWhite_px, 2 * kWhite_px);
  box &= cv::Rect(0, 0, picture.cols, picture.rows);
  const cv::Mat marker = picture(box).clone();
  picture(cv::Rect(0, 0, box.width + 20, box.height + 20)) = 200;
  marker.copyTo(picture(cv::Rect(10, 10, box.width, box.height)));
}

/// Paints over a face.
void HideFace(World& world, size_t face_index) {
  const rig::BoardFace& face = world.options.board.faces[face_index];
  const double w = face.Width_m(), h = face.Height_m();
  for (size_t s = 0; s < world.Shots(); ++s) {
    const Rigid3 rig_from_board = sim::BoardPlacement(static_cast<int>(s));
    for (size_t c = 0; c < world.Cameras(); ++c) {
      const CalibratedCamera& camera = world.truth.cameras[c];
      const Rigid3 cam_from_face = camera.cam_from_rig * rig_from_board * face.board_from_face;
      if ((cam_from_face.rotation * Eigen::Vector3d::UnitZ())
              .dot(cam_from_face * rig::FaceMiddle(face)) <= 0) {
        continue;  // seen from behind
      }
      std::vector<cv::Point> outline;
      for (const Eigen::Vector2d& at : {Eigen::Vector2d(0, 0), Eigen::Vector2d(w, 0),
                                        Eigen::Vector2d(w, h), Eigen::Vector2d(0, h)}) {
        const Eigen::Vector3d x = cam_from_face * Eigen::Vector3d(at.x(), at.y(), 0);
        const Eigen::Vector2d pixel = camera.intrinsics.PixelFromNormalized(x.hnormalized());
        outline.emplace_back(static_cast<int>(pixel.x()), static_cast<int>(pixel.y()));
      }
      Change(world, s, c,
             [&](cv::Mat& picture) { cv::fillConvexPoly(picture, outline, cv::Scalar(90)); });
    }
  }
}

/// A camera mounted upside down: its pictures, and where it truly is.
void TurnUpsideDown(World& world, size_t camera) {
  ChangeCamera(world, camera,
               [](cv::Mat& picture) { cv::rotate(picture, picture, cv::ROTATE_180); });
  CalibratedCamera& real = world.truth.cameras[camera];
  const Eigen::Quaterniond half_turn(0, 0, 0, 1);
  real.cam_from_rig = Rigid3{half_turn, Eigen::Vector3d::Zero()} * real.cam_from_rig;
  std::vector<double>& p = real.intrinsics.params;
  p[2] = real.intrinsics.width_px - p[2];
  p[3] = real.intrinsics.height_px - p[3];
  p[6] = -p[6];  // decentring
  p[7] = -p[7];
}

/// Every other camera took the shot when the target had moved by 3 mm.
void MoveBoard(World& world, size_t shot, ThreadPool& threads) {
  sim::SimulateOptions options = world.options;
  options.background = sim::Background::kPlain;
  options.placement = static_cast<int>(shot);
  Rigid3 later = sim::BoardPlacement(options.placement);
  later.translation += Eigen::Vector3d(0.002, -0.002, 0.001);
  sim::World moved;
  moved.objects.push_back(OrDie(sim::MakeBoardObject(options.board, world.truth.board, later)));
  OrDie(sim::BakeLight(&moved, threads));
  const sim::RayScene scene = OrDie(sim::RayScene::Build(moved, false));
  for (size_t c = 0; c < world.Cameras(); c += 2) {
    sim::Picture rgb =
        sim::RenderPicture(moved, scene, world.truth.cameras[c], world.rig.sensor, options);
    Change(world, shot, c, [&](cv::Mat& picture) {
      cv::cvtColor(cv::Mat(rgb.height, rgb.width, CV_8UC3, rgb.rgb.data()), picture,
                   cv::COLOR_RGB2GRAY);
    });
  }
}

/// Who, and what is said of it.
struct Named {
  std::string who, what;
};

/// Shots, cameras and single pictures that were left out, with the reason.
std::vector<Named> LeftOut(const World& world, const rig::RigCalibration& result) {
  std::vector<Named> left_out;
  for (size_t s = 0; s < world.Shots(); ++s) {
    if (!result.shot_problem[s].empty()) {
      left_out.push_back({world.ShotName(s), result.shot_problem[s]});
    }
  }
  for (size_t c = 0; c < world.Cameras(); ++c) {
    if (!result.camera_problem[c].empty()) {
      left_out.push_back({world.CameraName(c), result.camera_problem[c]});
    }
  }
  for (const rig::DroppedPicture& dropped : result.dropped) {
    if (!dropped.camera) continue;
    left_out.push_back({world.PictureName(dropped.shot, *dropped.camera), dropped.reason});
  }
  return left_out;
}

/// Markers that were rejected, but for those that are in the pictures as they were, too.
std::vector<Named> Rejected(const World& world, const World& clean) {
  std::vector<Named> rejected;
  for (size_t s = 0; s < world.Shots(); ++s) {
    for (size_t c = 0; c < world.Cameras(); ++c) {
      const auto& now = world.sightings.sightings[s][c].detection->rejected;
      const auto& before = clean.sightings.sightings[s][c].detection->rejected;
      for (const rig::RejectedMarker& marker : now) {
        const bool usual = std::any_of(before.begin(), before.end(), [&](const auto& other) {
          return other.id == marker.id && other.reason == marker.reason;
        });
        if (!usual) rejected.push_back({"marker " + std::to_string(marker.id), marker.reason});
      }
    }
  }
  return rejected;
}

/// Cameras that moved since the calibration from the pictures as they were.
std::vector<Named> Moved(const Calibration& earlier, const Calibration& now) {
  std::vector<Named> moved;
  for (const rig::CameraChange& change :
       OrDie(rig::CompareCalibrations(earlier, now, {})).cameras) {
    if (change.moved) moved.push_back({change.camera, rig::VerdictOn(change)});
  }
  return moved;
}

/// What must come of spoilt pictures; a Named's `what` is in what is said.
struct Expected {
  size_t calibrated = kCameras;
  std::vector<Named> left_out = {};  // these, and nothing else
  std::string rejected = "";         // in the reason of one marker at least
  std::vector<Named> moved = {};     // these, and nothing else; empty: they are not compared
};

/// One way to spoil the pictures.
struct MeanInput {
  std::string name;
  std::function<void(World&)> spoil;
  Expected expected;
};

bool Says(const Named& said, const Named& expected) {
  return said.who == expected.who && said.what.find(expected.what) != std::string::npos;
}

/// Whether exactly the expected is said.
void MustSay(const std::string& name, const std::vector<Named>& said,
             const std::vector<Named>& expected, Verdict& verdict) {
  for (const Named& one : expected) {
    verdict.Must(name + ": '" + one.who + "' is named with '" + one.what + "'",
                 std::any_of(said.begin(), said.end(),
                             [&](const Named& other) { return Says(other, one); }));
  }
  for (const Named& one : said) {
    verdict.Must(name + ": '" + one.who + "' is not named, as nothing is wrong with it",
                 std::any_of(expected.begin(), expected.end(),
                             [&](const Named& other) { return Says(one, other); }));
  }
}

void Print(const std::vector<Named>& said) {
  for (const Named& one : said) std::printf("      %s: %s\n", one.who.c_str(), one.what.c_str());
}

/// Single pictures, shots and cameras that are wrong make neither the board file nor the
/// calibration as a whole doubtful.
void KeepTrust(const std::string& name, const World& world, const CalibrationRun& run,
               Verdict& verdict) {
  for (const std::string& doubt : DoubtsOn(world.options.board, world.sightings, run)) {
    verdict.Must(name + ": no doubt of '" + doubt + "'", false);
  }
}

/// The calibration is read back from its file as it was written.
void KeepFile(const std::string& name, const Calibration& calibration, Verdict& verdict) {
  const test::TemporaryFolder folder;
  const fs::path file = folder / "calibration.json";
  OrDie(WriteCalibration(calibration, file));
  verdict.Must(name + ": the file written is read as it was",
               CalibrationToJson(OrDie(ReadCalibration(file))) == CalibrationToJson(calibration));
}

/// Spoils the pictures, calibrates, prints what came of it and judges that.
void BenchRow(const MeanInput& input, const World& clean, const Calibration& earlier,
              ThreadPool& threads, Verdict& verdict) {
  World world = clean;
  input.spoil(world);
  const CalibrationRun run =
      Calibrate(world.options.board, world.sightings, {.validate = false}, threads);
  const Evaluation errors = OrDie(EvaluateCalibration(run.file, world.truth));
  std::printf("  %-44s %2zu of %zu cameras, mean %.4f deg, %.3f mm\n", input.name.c_str(),
              errors.registered, errors.of, errors.mean_rotation_deg, errors.mean_position_mm);
  const Expected& expected = input.expected;
  verdict.Must(input.name + ": " + std::to_string(expected.calibrated) + " cameras are calibrated",
               errors.registered == expected.calibrated);
  verdict.AtMost(input.name + ": mean rotation, deg", errors.mean_rotation_deg, kMaxRotation_deg);
  verdict.AtMost(input.name + ": mean position, mm", errors.mean_position_mm, kMaxPosition_mm);
  KeepTrust(input.name, world, run, verdict);
  KeepFile(input.name, run.file, verdict);
  const std::vector<Named> left_out = LeftOut(world, run.result);
  Print(left_out);
  MustSay(input.name, left_out, expected.left_out, verdict);
  const std::vector<Named> rejected = Rejected(world, clean);
  if (!rejected.empty()) {
    std::printf("      %zu markers rejected, the first:\n", rejected.size());
    Print({rejected.front()});
  }
  verdict.Must(input.name + ": a marker is rejected with '" + expected.rejected + "'",
               expected.rejected.empty() ||
                   std::any_of(rejected.begin(), rejected.end(), [&](const Named& marker) {
                     return marker.what.find(expected.rejected) != std::string::npos;
                   }));
  if (!expected.moved.empty()) {
    const std::vector<Named> moved = Moved(earlier, run.file);
    Print(moved);
    MustSay(input.name, moved, expected.moved, verdict);
  }
  std::fflush(stdout);
}

/// Spoils every picture of a shot.
std::function<void(World&)> InShot(size_t shot, void (*change)(const World&, cv::Mat&)) {
  return [=](World& world) {
    ChangeShot(world, shot, [&](cv::Mat& picture) { change(world, picture); });
  };
}

void Blur(const World&, cv::Mat& picture) {
  constexpr double kBlur_px = 6;
  cv::GaussianBlur(picture, picture, {}, kBlur_px);
}

/// Two cameras' cables in each other's place, from the first shot to the last.
void SwapThroughout(World& world, size_t a, size_t b) {
  for (auto& row : world.sightings.sightings) std::swap(row[a], row[b]);
  std::swap(world.truth.cameras[a].cam_from_rig, world.truth.cameras[b].cam_from_rig);
  std::swap(world.truth.cameras[a].intrinsics, world.truth.cameras[b].intrinsics);
}

std::vector<MeanInput> MeanInputs(const World& clean, ThreadPool& threads) {
  constexpr size_t kShot = 2, kOne = 3, kOther = 11;
  const std::string shot = clean.ShotName(kShot);
  const std::string one = clean.CameraName(kOne), other = clean.CameraName(kOther);
  return {
      {"nothing wrong", [](World&) {}, {}},
      {"another board in view, in one shot",
       InShot(kShot, PasteOtherBoard),
       {.rejected = "is on no face of the board"}},
      {"an id twice in all pictures of a shot",
       InShot(kShot, DuplicateMarker),
       {.rejected = "not where its neighbours"}},
      {"a camera's pictures mirrored",
       [](World& world) {
         ChangeCamera(world, kOne, [](cv::Mat& picture) { cv::flip(picture, picture, 1); });
       },
       {.calibrated = kCameras - 1, .left_out = {{one, "mirrored"}}}},
      {"a shot blurred", InShot(kShot, Blur), {.left_out = {{shot, "blurred"}}}},
      {"a face hidden", [](World& world) { HideFace(world, 1); }, {}},
      {"a camera upside down", [](World& world) { TurnUpsideDown(world, kOne); }, {}},
      {"two cameras swapped, in all shots",
       [](World& world) { SwapThroughout(world, kOne, kOther); },
       {.moved = {{one, "stands where " + other}, {other, "stands where " + one}}}},
      {"two cameras swapped, in one shot",
       [](World& world) {
         std::swap(world.sightings.sightings[kShot][kOne],
                   world.sightings.sightings[kShot][kOther]);
       },
       {.left_out = {{clean.PictureName(kShot, kOne), "is the picture of " + other},
                     {clean.PictureName(kShot, kOther), "is the picture of " + one}}}},
      {"the cuboid moved by 3 mm during a shot",
       [&threads](World& world) { MoveBoard(world, kShot, threads); },
       {.left_out = {{shot, "the board moved"}}}},
  };
}

}  // namespace

void BenchMeanInputs(ThreadPool& threads, Verdict& verdict) {
  const test::TemporaryFolder folder;
  const World clean = Render(folder, threads);
  std::printf("\nMean inputs, rendered: %zu cameras of 600x800, %zu shots\n", clean.Cameras(),
              clean.Shots());
  const Calibration earlier =
      Calibrate(clean.options.board, clean.sightings, {.validate = false}, threads).file;
  for (const MeanInput& input : MeanInputs(clean, threads)) {
    BenchRow(input, clean, earlier, threads, verdict);
  }
}

}  // namespace rotunda::bench
