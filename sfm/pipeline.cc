#include "sfm/pipeline.h"

#include <algorithm>
#include <string>
#include <system_error>

#include "sfm/colmap_io.h"
#include "sfm/core/file_io.h"
#include "sfm/core/name_list.h"
#include "sfm/covariance.h"
#include "sfm/intrinsics.h"
#include "sfm/pairs.h"
#include "sfm/pose_description.h"
#include "sfm/presets.h"
#include "sfm/report.h"
#include "sfm/rig_alignment.h"
#include "sfm/stage_io.h"
#include "sfm/tracks.h"
#include "sfm/view_graph.h"

namespace rotunda::sfm {
namespace {

constexpr size_t kMinPictures = 3;

/// Everything up to the tracks: what incremental reconstruction borrows.
struct FrontEnd {
  Features features;
  Intrinsics intrinsics;
  TwoViews two_views;
  ViewGraph view_graph;
  Tracks tracks;  // only of the plain method: tc-sfm judges the pairs first
};

/// One run of the pipeline: knows which products are read and which are written.
struct Run {
  const FrameSet& set;
  const std::optional<Calibration>& calibration;
  const PipelineOptions& options;
  RunContext& context;

  bool Reads(Stage stage) const { return options.start_from && stage <= *options.start_from; }
  std::filesystem::path File(const char* name) const { return *options.stages_folder / name; }
};

Status CheckStopped(const RunContext& context) {
  if (context.Stopped()) return Error{ErrorCode::kCancelled, "interrupted", ""};
  return {};
}

/// Reads the product when the run starts behind it, else makes it and, if asked for, writes it.
template <typename Product, typename Read, typename Make, typename Write>
Result<Product> ReadOrMake(const Run& run, Stage stage, const Read& read, const Make& make,
                           const Write& write) {
  if (run.Reads(stage)) return read();
  Result<Product> product = make();
  if (product.ok() && run.options.stages_folder) ROTUNDA_RETURN_IF_ERROR(write(*product));
  ROTUNDA_RETURN_IF_ERROR(CheckStopped(run.context));
  return product;
}

Result<std::vector<ImagePair>> SelectPairs(const Run& run) {
  if (run.options.pairs == PairSelection::kExhaustive) {
    return ExhaustivePairs(run.set.frames.size());
  }
  if (!run.calibration) {
    return Error{ErrorCode::kInvalidArgument,
                 "pairs of neighbours need a calibration, and there is none", ""};
  }
  return NeighbourPairs(run.set, *run.calibration);
}

Result<Features> MakeFeatures(const Run& run) {
  return ReadOrMake<Features>(
      run, Stage::kFeatures, [&] { return ReadFeatures(run.File("features.bin")); },
      [&] { return BuildFeatures(run.set, run.options.features, run.context); },
      [&](const Features& made) { return WriteFeatures(made, run.File("features.bin")); });
}

Result<Matches> MakeMatches(const Run& run, const Features& features) {
  return ReadOrMake<Matches>(
      run, Stage::kMatches, [&] { return ReadMatches(run.File("matches.bin"), features); },
      [&]() -> Result<Matches> {
        ROTUNDA_ASSIGN_OR_RETURN(const std::vector<ImagePair> pairs, SelectPairs(run));
        return BuildMatches(features, pairs, run.options.matching, run.context);
      },
      [&](const Matches& made) { return WriteMatches(made, run.File("matches.bin")); });
}

Result<TwoViews> MakeTwoViews(const Run& run, const FrontEnd& front, const Matches& matches) {
  return ReadOrMake<TwoViews>(
      run, Stage::kTwoViews,
      [&] { return ReadTwoViews(run.File("two_views.bin"), front.features); },
      [&] {
        return BuildTwoViews(front.features, front.intrinsics, matches, run.options.two_view,
                             run.context);
      },
      [&](const TwoViews& made) { return WriteTwoViews(made, run.File("two_views.bin")); });
}

Result<Tracks> MakeTracks(const Run& run, const FrontEnd& front) {
  return ReadOrMake<Tracks>(
      run, Stage::kTracks, [&] { return ReadTracks(run.File("tracks.bin"), front.features); },
      [&]() -> Result<Tracks> {
        run.context.Report("tracks", 0, 1);
        return BuildTracks(front.features, front.two_views, front.view_graph);
      },
      [&](const Tracks& made) { return WriteTracks(made, run.File("tracks.bin")); });
}

/// Of which set the products in the folder of the stages are stands beside them. A folder without
/// that was made by other hands.
Status CheckStages(const Run& run) {
  if (!run.options.stages_folder) return {};
  const std::filesystem::path file = run.File("frameset.txt");
  if (!run.options.start_from) return WriteFileAtomically(file, run.set.id + "\n");
  const Result<std::string> text = ReadFile(file);
  if (!text.ok() && text.error().code == ErrorCode::kNotFound) return {};
  if (!text.ok()) return text.error();
  const std::string made = text->substr(0, text->find('\n'));
  if (made == run.set.id) return {};
  return Error{ErrorCode::kBadInput,
               "the stages are of the frame set '" + made + "', expected '" + run.set.id + "'",
               run.options.stages_folder->string()};
}

/// Features that were made before are of this set: as many pictures, of its sizes, none of frames
/// that are left out.
Status CheckFeatures(const FrameSet& set, const Features& features) {
  const auto other = [&](const std::string& what) {
    return Error{ErrorCode::kBadInput, "the features at hand are of another frame set: " + what,
                 set.folder.string()};
  };
  if (features.images.size() != set.frames.size()) {
    return other(std::to_string(features.images.size()) + " pictures, expected " +
                 std::to_string(set.frames.size()));
  }
  for (size_t i = 0; i < set.frames.size(); ++i) {
    const Frame& frame = set.frames[i];
    const ImageFeatures& image = features.images[i];
    if (frame.status != "ok") {
      if (image.keypoints.empty()) continue;
      return other(frame.camera + " has keypoints, though its frame is " + frame.status + " now");
    }
    if (frame.width_px == 0) continue;
    if (image.width_px != frame.width_px || image.height_px != frame.height_px) {
      return other("the size of " + frame.camera + "'s picture differs");
    }
  }
  return {};
}

/// Features and matches of a COLMAP database in place of our own.
Result<Matches> TakeDatabase(const Run& run, Features& features) {
  run.context.Report("database", 0, 1);
  ROTUNDA_ASSIGN_OR_RETURN(ColmapDatabase database,
                           ReadColmapDatabase(*run.options.database, run.set));
  ROTUNDA_ASSIGN_OR_RETURN(features, ColoredFeatures(database.features, run.set, run.context));
  Matches matches =
      std::move(database.matches.pairs.empty() ? database.verified_inliers : database.matches);
  if (run.options.stages_folder) {
    ROTUNDA_RETURN_IF_ERROR(WriteFeatures(features, run.File("features.bin")));
    ROTUNDA_RETURN_IF_ERROR(WriteMatches(matches, run.File("matches.bin")));
  }
  return matches;
}

Result<FrontEnd> RunFrontEnd(const Run& run) {
  FrontEnd front;
  Matches matches;
  if (run.options.database) {
    ROTUNDA_ASSIGN_OR_RETURN(matches, TakeDatabase(run, front.features));
  } else {
    ROTUNDA_ASSIGN_OR_RETURN(front.features, MakeFeatures(run));
  }
  ROTUNDA_RETURN_IF_ERROR(CheckFeatures(run.set, front.features));
  ROTUNDA_ASSIGN_OR_RETURN(front.intrinsics,
                           BuildIntrinsics(run.set, front.features, run.calibration));
  if (!run.options.database) {
    ROTUNDA_ASSIGN_OR_RETURN(matches, MakeMatches(run, front.features));
  }
  ROTUNDA_ASSIGN_OR_RETURN(front.two_views, MakeTwoViews(run, front, matches));
  front.view_graph = BuildViewGraph(front.features, front.two_views);
  if (run.options.method == Method::kPlain) {
    ROTUNDA_ASSIGN_OR_RETURN(front.tracks, MakeTracks(run, front));
  }
  return front;
}

std::map<std::string, std::string> DescribeOptions(const Run& run, bool refine_intrinsics) {
  std::map<std::string, std::string> described = {
      {"pairs",
       run.options.database ? "database" : NameIn(PairSelectionsByName(), run.options.pairs)},
      {"intrinsics", refine_intrinsics ? "refined" : "fixed"},
      {"max_keypoints", std::to_string(run.options.features.max_keypoints)},
      {"seed", std::to_string(run.context.seed)}};
  if (run.options.method != Method::kPlain) described[kPresetOption] = run.options.preset;
  if (run.options.calibration_prior) described[kPriorOption] = NameIn(PriorsByName(), true);
  if (!run.options.front_camera.empty()) described["front"] = run.options.front_camera;
  for (const auto& [name, value] : run.options.settings) described["set " + name] = value;
  return described;
}

/// What the poses are known by, besides themselves; what fails leaves a note, not a lost result.
struct Reference {
  std::optional<PoseCovariances> covariances;
  std::optional<RigAlignment> alignment;
  std::vector<std::string> notes;
};

Reference MeasureReference(const Run& run, const Reconstruction& model, const Features& features,
                           bool lenses_moved) {
  Reference reference;
  if (!model.intrinsics.known) {
    reference.notes.push_back(
        "no uncertainties and no check: the lenses are not calibrated, and an error of a principal "
        "point that is taken to be in the middle cannot be seen in the residuals");
    return reference;
  }
  Result<PoseCovariances> covariances =
      BuildPoseCovariances(model, features, lenses_moved, run.context);
  if (!covariances.ok()) {
    reference.notes.push_back("no uncertainties: " + covariances.error().ToString());
    return reference;
  }
  reference.covariances = std::move(*covariances);
  Result<RigAlignment> alignment = AlignToCalibration(model, run.set, *run.calibration,
                                                      *reference.covariances, run.context.seed);
  if (alignment.ok()) {
    reference.alignment = std::move(*alignment);
  } else {
    reference.notes.push_back("not aligned to the calibration, scale arbitrary: " +
                              alignment.error().ToString());
  }
  return reference;
}

/// The models of any method; `tc_sfm` only of that, the last two only of the literal one.
struct Built {
  IncrementalResult models;
  std::optional<TcSfmResult> tc_sfm;
  std::optional<Segments> segments;
  std::optional<double> view_graph_margin;
  std::vector<std::string> notes;
};

/// Labels: communities of the tracks that the poses confirmed, and which of them look alike.
Result<Segments> LabelSegments(const Run& run, const FrontEnd& front, const TcSfmResult& result) {
  ROTUNDA_ASSIGN_OR_RETURN(const std::vector<Superpixels> superpixels,
                           BuildSuperpixels(run.set, run.options.superpixels, run.context));
  run.context.Report("communities", 0, 1);
  const Tracks tracks = BuildTracks(front.features, result.two_views, result.view_graph);
  const TrackGraph graph =
      BuildTrackGraph(front.features, tracks, superpixels, run.options.track_graph);
  ROTUNDA_ASSIGN_OR_RETURN(const Communities communities,
                           BuildCommunities(graph.graph, run.options.communities));
  return BuildSegments({front.features, front.two_views, front.view_graph, result.verdicts, tracks,
                        superpixels, graph, communities},
                       run.options.segments);
}

/// The calibrated poses, when they are to be a prior.
CalibratedPoses PriorPosesOf(const Run& run) {
  CalibratedPoses poses;
  if (!run.options.calibration_prior) return poses;
  for (const Frame& frame : run.set.frames) {
    const CalibratedCamera* camera = run.calibration->Find(frame.camera);
    poses.push_back(camera ? std::optional(camera->cam_from_rig) : std::nullopt);
  }
  return poses;
}

Result<Built> BuildModels(const Run& run, const FrontEnd& front,
                          const IncrementalOptions& incremental) {
  Built built;
  if (run.options.method == Method::kPlain) {
    const IncrementalInput input{front.features, front.intrinsics, front.two_views,
                                 front.view_graph, front.tracks};
    ROTUNDA_ASSIGN_OR_RETURN(built.models, BuildReconstructions(input, incremental, run.context));
    return built;
  }
  const TcSfmInput input{front.features, front.intrinsics, front.two_views, front.view_graph,
                         PriorPosesOf(run)};
  if (run.options.method == Method::kLiteral) {
    ROTUNDA_ASSIGN_OR_RETURN(
        LiteralResult literal,
        RunLiteralTcSfm(run.set, input, run.options.literal, incremental, run.context));
    built.models = std::move(literal.models);
    built.segments = std::move(literal.segments);
    built.view_graph_margin = literal.view_graph_margin;
    built.notes = std::move(literal.notes);
    return built;
  }
  ROTUNDA_ASSIGN_OR_RETURN(built.tc_sfm,
                           RunTcSfm(input, run.options.tc_sfm, incremental, run.context));
  built.models = std::move(built.tc_sfm->models);
  Result<Segments> segments = LabelSegments(run, front, *built.tc_sfm);
  if (segments.ok()) {
    built.segments = std::move(*segments);
  } else if (segments.error().code == ErrorCode::kCancelled) {
    return segments.error();
  } else {
    built.tc_sfm->notes.push_back("no segments: " + segments.error().ToString());
  }
  return built;
}

/// Cameras that what they see hardly puts on their side, and those that their strongest pair puts
/// on another.
void NoteDoubtfulSides(const FrameSet& set, const TcSfmResult& result,
                       std::vector<std::string>& notes) {
  constexpr double kDoubtfulCertainty = 3.0;  // log-likelihood
  std::string by_likeness, doubtful;
  for (size_t i = 0; i < result.certainty.size(); ++i) {
    if (result.certainty[i] >= kDoubtfulCertainty) continue;
    by_likeness += (by_likeness.empty() ? "" : ", ") + set.frames[i].camera;
  }
  for (const ImageId image : result.doubtful) {
    doubtful += (doubtful.empty() ? "" : ", ") + set.frames[image.index()].camera;
  }
  if (!by_likeness.empty()) {
    notes.push_back("hardly told apart from the look-alike side: " + by_likeness);
  }
  if (!doubtful.empty()) {
    notes.push_back("more like a picture that contradicts their pose than like any that agrees: " +
                    doubtful);
  }
}

/// Of those that have a pose: what little others show may be wrong matches.
void NoteUnusedPrior(const FrameSet& set, const TcSfmResult& result,
                     std::vector<std::string>& notes) {
  std::vector<std::string> names;
  for (const ImageId image : result.not_as_calibrated) {
    if (!result.models.models.front().Registered(image)) continue;
    names.push_back(set.frames[image.index()].camera);
  }
  if (names.empty()) return;
  notes.push_back(
      "the calibration was no prior for cameras whose pictures contradict it (moved, "
      "swapped?): " +
      ListOfNames(names));
}

size_t FrameOf(const FrameSet& set, const std::string& camera) {
  const auto found = std::find_if(set.frames.begin(), set.frames.end(),
                                  [&](const Frame& frame) { return frame.camera == camera; });
  return static_cast<size_t>(found - set.frames.begin());
}

/// The front is where the options say.
void NameSides(const Run& run, const Reconstruction& model, PoseSet& poses,
               std::vector<std::string>& notes) {
  const std::string& front = run.options.front_camera;
  const ImageId image(FrameOf(run.set, front));
  if (AddSides(model, image, poses)) return;
  notes.push_back(model.Registered(image)
                      ? "no sides: the cameras do not stand upright around the subject"
                      : "no sides: camera " + front + " has no pose");
}

/// Nobody would miss them otherwise.
void NoteAbsentCameras(const Run& run, const PoseSet& poses, std::vector<std::string>& notes) {
  if (!run.calibration) return;
  const std::vector<std::string> absent = CamerasWithoutFrame(*run.calibration, poses.cameras);
  if (absent.empty()) return;
  notes.push_back("not in the frame set, though calibrated: " + ListOfNames(absent) + " (" +
                  std::to_string(absent.size()) + " of " +
                  std::to_string(run.calibration->cameras.size()) + " cameras)");
}

PipelineResult Finish(const Run& run, FrontEnd front, Built built,
                      const IncrementalOptions& incremental) {
  run.context.Report("uncertainty", 0, 1);
  Reconstruction model = WithColors(std::move(built.models.models.front()), front.features);
  const bool lenses_moved = RefinesIntrinsics(RegisteredCount(model), incremental);
  Reference reference = MeasureReference(run, model, front.features, lenses_moved);
  if (reference.alignment) {
    const Sim3& rig_from_model = reference.alignment->rig_from_model;
    model = Transformed(model, rig_from_model);
    reference.covariances = Transformed(*reference.covariances, rig_from_model);
  }
  PoseSet poses = DescribePoses(run.set, built.models, model, front.features);
  poses.method = MethodName(run.options.method);
  poses.options = DescribeOptions(run, incremental.refine_intrinsics);
  if (built.tc_sfm) {
    AddVerdict(*built.tc_sfm, poses);
    AddEvidence(*built.tc_sfm, poses);
    if (run.options.calibration_prior) poses.summary.verdict_of_pictures.clear();
    reference.notes.insert(reference.notes.begin(), built.tc_sfm->notes.begin(),
                           built.tc_sfm->notes.end());
    NoteDoubtfulSides(run.set, *built.tc_sfm, reference.notes);
    NoteUnusedPrior(run.set, *built.tc_sfm, reference.notes);
  }
  if (reference.covariances) AddSigmas(*reference.covariances, model.intrinsics, poses);
  if (reference.alignment) {
    AddCalibrationFigures(*reference.alignment, *run.calibration, poses);
  } else if (!run.options.front_camera.empty()) {
    NameSides(run, model, poses, reference.notes);
  }
  if (built.segments) AddSegments(*built.segments, poses);
  if (built.view_graph_margin) poses.summary.view_graph_margin = built.view_graph_margin;
  reference.notes.insert(reference.notes.end(), built.notes.begin(), built.notes.end());
  NoteAbsentCameras(run, poses, reference.notes);

  PipelineResult result{run.set,          std::move(front.features), std::move(model),
                        std::move(poses), std::move(built.segments), std::move(reference.notes)};
  for (size_t i = 0; i < result.set.frames.size(); ++i) {
    result.set.frames[i].width_px = result.features.images[i].width_px;
    result.set.frames[i].height_px = result.features.images[i].height_px;
  }
  return result;
}

Status CheckFront(const Run& run) {
  if (run.options.front_camera.empty()) return {};
  const std::string& front = run.options.front_camera;
  if (run.calibration) {
    return Error{ErrorCode::kInvalidArgument,
                 "the calibration's rig frame already says where the front is; leave it out",
                 "--front"};
  }
  if (FrameOf(run.set, front) == run.set.frames.size()) {
    return Error{ErrorCode::kInvalidArgument,
                 "\"" + front + "\" is no camera of the frame set; its first is " +
                     run.set.frames.front().camera,
                 "--front"};
  }
  return {};
}

/// A setting of the features changes nothing of features that are there already.
Status CheckFeatureSettings(const PipelineOptions& options) {
  if (!options.database && !options.start_from) return {};
  for (const auto& [name, value] : options.settings) {
    if (!ActsOnFeatures(name)) continue;
    return Error{ErrorCode::kInvalidArgument,
                 std::string("has no effect on features that are taken from ") +
                     (options.database ? "a database" : "the stages") +
                     "; leave it out, or make the features anew",
                 name};
  }
  return {};
}

}  // namespace

Result<Stage> StageFromName(std::string_view name) {
  if (name == "features") return Stage::kFeatures;
  if (name == "matches") return Stage::kMatches;
  if (name == "two-views") return Stage::kTwoViews;
  if (name == "tracks") return Stage::kTracks;
  return Error{ErrorCode::kInvalidArgument,
               "stage '" + std::string(name) +
                   "' is not known; known are features, matches, two-views, tracks",
               ""};
}

Status PipelineOptions::Validate() const {
  if (calibration_prior) ROTUNDA_RETURN_IF_ERROR(CheckPriorOf(method));
  if (start_from && !stages_folder) {
    return Error{ErrorCode::kInvalidArgument,
                 "starting from a stage needs the folder of the stages", ""};
  }
  if (method != Method::kPlain && start_from == Stage::kTracks) {
    return Error{ErrorCode::kInvalidArgument,
                 "tracks to start from are the plain method's: tc-sfm builds its own", ""};
  }
  if (database && start_from && *start_from <= Stage::kMatches) {
    return Error{ErrorCode::kInvalidArgument,
                 "features and matches come either from a database or from the stages", ""};
  }
  ROTUNDA_RETURN_IF_ERROR(CheckFeatureSettings(*this));
  ROTUNDA_RETURN_IF_ERROR(features.Validate());
  ROTUNDA_RETURN_IF_ERROR(matching.Validate());
  ROTUNDA_RETURN_IF_ERROR(two_view.Validate());
  ROTUNDA_RETURN_IF_ERROR(incremental.Validate());
  if (method == Method::kPlain) return {};
  if (method == Method::kLiteral) return literal.Validate();
  ROTUNDA_RETURN_IF_ERROR(tc_sfm.Validate());
  ROTUNDA_RETURN_IF_ERROR(superpixels.Validate());
  ROTUNDA_RETURN_IF_ERROR(track_graph.Validate());
  ROTUNDA_RETURN_IF_ERROR(communities.Validate());
  return segments.Validate();
}

Result<PipelineResult> RunPipeline(const FrameSet& set,
                                   const std::optional<Calibration>& calibration,
                                   const PipelineOptions& options, RunContext& context) {
  const Run run{set, calibration, options, context};
  if (set.frames.size() < kMinPictures) {
    return Error{ErrorCode::kBadInput,
                 "pictures found: " + std::to_string(set.frames.size()) + ", needed: at least " +
                     std::to_string(kMinPictures),
                 set.folder.string()};
  }
  ROTUNDA_RETURN_IF_ERROR(options.Validate());
  if (options.calibration_prior && !calibration) {
    return Error{ErrorCode::kInvalidArgument, "needs a calibration, and there is none",
                 kPriorOption};
  }
  ROTUNDA_RETURN_IF_ERROR(CheckFront(run));
  ROTUNDA_RETURN_IF_ERROR(CheckStages(run));
  ROTUNDA_ASSIGN_OR_RETURN(FrontEnd front, RunFrontEnd(run));

  IncrementalOptions incremental = options.incremental;
  incremental.refine_intrinsics = options.refine_intrinsics.value_or(!front.intrinsics.known);
  ROTUNDA_ASSIGN_OR_RETURN(Built built, BuildModels(run, front, incremental));
  ROTUNDA_RETURN_IF_ERROR(CheckStopped(context));
  return Finish(run, std::move(front), std::move(built), incremental);
}

Status WriteResult(const PipelineResult& result, const CalibrationInForce& in_force,
                   const std::filesystem::path& folder, RunContext& context) {
  context.Report("report", 0, 1);
  const std::filesystem::path sparse = folder / "sparse" / "0";
  std::error_code failure;
  std::filesystem::create_directories(sparse, failure);
  if (failure) return Error{ErrorCode::kIo, failure.message(), sparse.string()};
  ROTUNDA_RETURN_IF_ERROR(WriteFileAtomically(folder / "poses.json", PoseSetToJson(result.poses)));
  ROTUNDA_RETURN_IF_ERROR(WriteColmapModel(result.reconstruction, result.features, result.set,
                                           sparse, ColmapEncoding::kBinary));
  ROTUNDA_RETURN_IF_ERROR(WritePly(result.reconstruction, folder / "points.ply"));
  const ReportInput input{result.set,           result.poses,    result.reconstruction,
                          in_force.calibration, result.features, result.segments,
                          in_force.page};
  ROTUNDA_ASSIGN_OR_RETURN(const std::string html, BuildReport(input, context));
  return WriteFileAtomically(folder / "report.html", html);
}

}  // namespace rotunda::sfm
