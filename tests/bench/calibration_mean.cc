#include "tests/bench/calibration_mean.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <string>

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

struct World {
  sim::RigOptions rig;
  sim::SimulateOptions options;
  Calibration truth;
  rig::ShotPictures pictures;
  rig::BoardSightings sightings;

  size_t Cameras() const { return truth.cameras.size(); }
  size_t Shots() const { return pictures.shots.size(); }
};

World Render(const test::TemporaryFolder& folder, ThreadPool& threads) {
  constexpr int kShots = 6;
  RunContext context{threads};
  World world;
  world.options.target = sim::Target::kCuboid;
  world.options.cameras = 18;
  world.options.picture_scale = 0.5;
  world.options.seed = 1;
  const std::filesystem::path shots = folder / "shots";
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

/// What detection and calibration say: of rejected markers all reasons but those that ordinary
/// pictures have too.
void PrintWords(const World& world, const CalibrationRun& run, const World& clean) {
  const auto print = [](const std::string& who, const std::string& what) {
    std::printf("      %s: %s\n", who.c_str(), what.c_str());
  };
  for (size_t s = 0; s < world.Shots(); ++s) {
    if (!run.result.shot_problem[s].empty()) {
      print(world.sightings.shots[s].id, run.result.shot_problem[s]);
    }
  }
  for (size_t c = 0; c < world.Cameras(); ++c) {
    if (!run.result.camera_problem[c].empty()) {
      print(world.sightings.cameras[c].camera, run.result.camera_problem[c]);
    }
  }
  for (const rig::DroppedPicture& dropped : run.result.dropped) {
    if (!dropped.camera) continue;
    print(world.sightings.cameras[*dropped.camera].camera + " in " +
              world.sightings.shots[dropped.shot].id,
          dropped.reason);
  }
  size_t rejected = 0;
  std::string first;
  for (size_t s = 0; s < world.Shots(); ++s) {
    for (size_t c = 0; c < world.Cameras(); ++c) {
      const auto& now = world.sightings.sightings[s][c].detection->rejected;
      const auto& before = clean.sightings.sightings[s][c].detection->rejected;
      for (const rig::RejectedMarker& marker : now) {
        const bool usual = std::any_of(before.begin(), before.end(), [&](const auto& other) {
          return other.id == marker.id && other.reason == marker.reason;
        });
        if (usual) continue;
        if (rejected++ == 0) first = "marker " + std::to_string(marker.id) + ": " + marker.reason;
      }
    }
  }
  if (rejected > 0) print(std::to_string(rejected) + " markers rejected, first", first);
}

void PrintRow(const std::string& name, const World& world, const World& clean,
              const std::optional<Calibration>& earlier, ThreadPool& threads) {
  const CalibrationRun run =
      Calibrate(world.options.board, world.sightings, {.validate = false}, threads);
  const Evaluation errors = OrDie(EvaluateCalibration(run.file, world.truth));
  std::printf("  %-44s %2zu of %zu cameras, mean %.4f deg, %.3f mm\n", name.c_str(),
              errors.registered, errors.of, errors.mean_rotation_deg, errors.mean_position_mm);
  PrintWords(world, run, clean);
  if (!earlier) return;
  for (const rig::CameraChange& change :
       OrDie(rig::CompareCalibrations(*earlier, run.file, {})).cameras) {
    if (!change.moved) continue;
    std::printf("      %s: moved by %.1f mm since the earlier calibration%s%s\n",
                change.camera.c_str(), change.position_mm,
                change.swapped_with ? ", stands where this one was: " : "",
                change.swapped_with.value_or("").c_str());
  }
}

/// One way to spoil the pictures.
struct MeanInput {
  std::string name;
  std::function<void(World&)> spoil;
  bool compare = false;  // with the calibration from the pictures as they were
};

std::vector<MeanInput> MeanInputs(ThreadPool& threads) {
  constexpr size_t kShot = 2, kCamera = 3, kOther = 11;
  constexpr double kBlur_px = 6;
  const auto shot = [](void (*change)(const World&, cv::Mat&)) {
    return [change](World& world) {
      ChangeShot(world, kShot, [&](cv::Mat& picture) { change(world, picture); });
    };
  };
  const auto flip = [](cv::Mat& picture) { cv::flip(picture, picture, 1); };
  const auto blur = [](const World&, cv::Mat& picture) {
    cv::GaussianBlur(picture, picture, {}, kBlur_px);
  };
  const auto swap = [](std::vector<rig::BoardSighting>& sightings) {
    std::swap(sightings[kCamera], sightings[kOther]);
  };
  return {
      {"another board in view, in one shot", shot(PasteOtherBoard)},
      {"an id twice in all pictures of a shot", shot(DuplicateMarker)},
      {"a camera's pictures mirrored",
       [flip](World& world) { ChangeCamera(world, kCamera, flip); }},
      {"a shot blurred", shot(blur)},
      {"a face hidden", [](World& world) { HideFace(world, 1); }},
      {"a camera upside down", [](World& world) { TurnUpsideDown(world, kCamera); }},
      {"two cameras swapped, in all shots",
       [swap](World& world) {
         for (auto& row : world.sightings.sightings) swap(row);
       },
       true},
      {"two cameras swapped, in one shot",
       [swap](World& world) { swap(world.sightings.sightings[kShot]); }},
      {"the cuboid moved by 3 mm during a shot",
       [&threads](World& world) { MoveBoard(world, kShot, threads); }},
  };
}

}  // namespace

void BenchMeanInputs(ThreadPool& threads) {
  const test::TemporaryFolder folder;
  const World clean = Render(folder, threads);
  std::printf("\nMean inputs, rendered: %zu cameras of 600x800, %zu shots\n", clean.Cameras(),
              clean.Shots());
  const Calibration earlier =
      Calibrate(clean.options.board, clean.sightings, {.validate = false}, threads).file;
  PrintRow("nothing wrong", clean, clean, earlier, threads);
  for (const MeanInput& input : MeanInputs(threads)) {
    World world = clean;
    input.spoil(world);
    PrintRow(input.name, world, clean, input.compare ? std::optional(earlier) : std::nullopt,
             threads);
    std::fflush(stdout);
  }
}

}  // namespace rotunda::bench
