// The whole API over a real store, without cameras and without computing.

#include "daemon/api.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <regex>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "config/daemon_config.h"
#include "daemon/api_json.h"
#include "daemon/model_export.h"
#include "daemon/openapi.h"
#include "daemon/reconstruction_request.h"
#include "daemon/retention.h"
#include "daemon/store_calibrations.h"
#include "daemon/store_captures.h"
#include "daemon/store_reconstructions.h"
#include "daemon/store_sql.h"
#include "rig/lens_models.h"
#include "sfm/colmap_io.h"
#include "sfm/core/frame_set.h"
#include "sfm/core/name_list.h"
#include "sfm/core/pose_set.h"
#include "sfm/run_choices.h"
#include "tests/support/daemon_state.h"
#include "tests/support/json_schema.h"
#include "tests/support/process.h"
#include "tests/support/simulated_rig.h"

namespace rotunda::daemon {
namespace {

using Json = nlohmann::json;

constexpr char kCapture[] = "20260101T100000Z";
constexpr char kReconstruction[] = "20260101T100000Z-r1";
constexpr char kCalibration[] = "charuco-1";

Calibration TwoCameras() {
  Calibration calibration;
  calibration.created_at = "2026-01-01T09:00:00Z";
  for (const char* name : {"c0", "c1"}) {
    CalibratedCamera& camera = calibration.cameras.emplace_back();
    camera.camera = name;
    camera.serial = std::string("S") + name;
    camera.intrinsics = {CameraModel::kOpencv, 8, 8, {10, 10, 4, 4, 0, 0, 0, 0}};
    camera.sigma = PoseSigma{0.001, 0.05, 0.1};
  }
  return calibration;
}

/// Camera c1 is 20 mm from where the calibration has it.
PoseSet MovedPoses(const std::string& capture = kCapture) {
  PoseSet poses;
  poses.frameset = capture;
  poses.method = "tc-sfm";
  poses.metric = true;
  poses.aligned_to = kCalibration;
  for (const CalibratedCamera& calibrated : TwoCameras().cameras) {
    CameraPose& pose = poses.cameras.emplace_back();
    pose.camera = calibrated.camera;
    pose.registered = true;
    pose.intrinsics = calibrated.intrinsics;
    pose.sigma = calibrated.sigma;
    pose.vs_calibration = VsCalibration{};
  }
  poses.cameras[1].vs_calibration = VsCalibration{0.01, 20.0, true};
  poses.summary.registered = poses.summary.of = 2;
  poses.summary.folded = false;
  poses.summary.verdict = "sure";
  return poses;
}

JobHandler HandlerThatTakesAll() {
  JobHandler handler;
  handler.check = [](const std::string& body) -> Result<std::string> {
    if (body != "{\"bad\":1}") return body;
    return Error{ErrorCode::kInvalidArgument, "is not known", "body: bad"};
  };
  handler.run = [](const JobRecord&, JobContext&) -> Result<std::string> {
    return std::string("{}");
  };
  return handler;
}

/// Takes new jobs when `room` is fine.
JobHandler HandlerThatNeedsRoom(const Status& room) {
  JobHandler handler = HandlerThatTakesAll();
  handler.admit = [&room] { return room; };
  return handler;
}

class Api : public testing::Test {
 protected:
  Api() : station_(CaptureStation::Options()) {
    jobs_ = std::make_unique<JobQueue>(
        state_.store(),
        JobHandlers{HandlerThatTakesAll(), HandlerThatNeedsRoom(room_), HandlerThatTakesAll()},
        JobQueue::Options());
    ServeCamerasOf(station_);
  }
  void ServeCamerasOf(CaptureStation& station) {
    const ApiParts parts{state_.store(),
                         *jobs_,
                         station,
                         "1.2.3",
                         state_.store().Now(),
                         [] { return uint64_t{0}; },
                         [] { return HttpCounters(); }};
    router_ = std::make_unique<Router>(
        ApiRoutes(parts), std::map<Role, std::string>{{Role::kViewer, "a member of group 'v'"},
                                                      {Role::kOperator, "a member of 'o'"}});
  }

  /// A calibration in force, a capture, and its reconstruction in which c1 has moved.
  void Fill() {
    Store& store = state_.store();
    test::WriteCalibrationFolder(store.CalibrationFolder(kCalibration), TwoCameras());
    std::ofstream(store.CalibrationFolder(kCalibration) / "report.html") << "<html>";
    ASSERT_TRUE(RecordCalibration(store, kCalibration));
    ASSERT_TRUE(ActivateCalibration(store, kCalibration));
    AddCapture("2026-01-01T10:00:00Z", MovedPoses());
  }

  void AddCapture(const std::string& captured_at, const PoseSet& poses) {
    Store& store = state_.store();
    test::WriteTinyFrameSet(store.CaptureFolder(poses.frameset), captured_at);
    ASSERT_TRUE(RecordCapture(store, poses.frameset, std::nullopt));
    const std::string id = poses.frameset + "-r1";
    const auto folder = store.ReconstructionFolder(id);
    std::filesystem::create_directories(folder);
    std::ofstream(folder / "poses.json") << PoseSetToJson(poses);
    std::ofstream(folder / "report.html") << "<html>";
    std::ofstream(folder / "points.ply") << "ply";
    const auto recorded = RecordReconstruction(store, id);
    ASSERT_TRUE(recorded) << recorded.error().ToString();
  }
  /// A capture of this many of two cameras, not reconstructed.
  void AddShot(const std::string& id, const std::string& captured_at, int ok) {
    const auto folder = state_.store().CaptureFolder(id);
    test::WriteTinyFrameSet(folder, captured_at);
    FrameSet set = ReadFrameSet(folder).value();
    std::string reasons;
    for (size_t i = static_cast<size_t>(ok); i < set.frames.size(); ++i) {
      set.frames[i].status = "missing";
      reasons += std::string(reasons.empty() ? "" : ", ") + "{\"camera\": \"" +
                 set.frames[i].camera + "\", \"reason\": \"its cable is out\"}";
    }
    std::ofstream(folder / "frameset.json") << FrameSetToJson(set);
    std::ofstream(folder / "shot.json") << "{\"cameras\": [" << reasons << "]}";
    const auto recorded = RecordCapture(state_.store(), id, std::nullopt);
    ASSERT_TRUE(recorded) << recorded.error().ToString();
  }
  std::string Problems() { return Checked(Get("/v1/status"), "Status")["problems"].dump(); }

  /// As the server does it.
  HttpResponse Call(const std::string& method, const std::string& target,
                    const std::string& body = "", Role role = Role::kOperator,
                    const std::map<std::string, std::string>& headers = {}) {
    HttpResponse response = router_->Handle({method, target, headers, body, {1000, 1, role}});
    return response.bulk ? response.bulk() : response;
  }
  HttpResponse Get(const std::string& target) { return Call("GET", target); }
  Json Document() { return Json::parse(Get("/v1/openapi.json").body); }
  /// The body as JSON; also checks it against the schema called `schema`.
  Json Checked(const HttpResponse& response, const std::string& schema) {
    const Json schemas = Document()["components"]["schemas"];
    EXPECT_TRUE(schemas.contains(schema)) << schema;
    Json body = Json::parse(response.body, nullptr, false);
    EXPECT_EQ(test::SchemaProblem(body, schemas[schema], schemas), "") << response.body;
    return body;
  }

  test::DaemonState state_;
  Status room_ = CheckDiskReserve(state_.store(), uint64_t{1} << 60);  // for calibrations
  CaptureStation station_;
  std::unique_ptr<JobQueue> jobs_;
  std::unique_ptr<Router> router_;
};

/// The path with what Fill() made in place of its parameters.
std::string WithIds(std::string path) {
  const std::map<std::string, std::string> ids = {{"{capture}", kCapture},
                                                  {"{camera}", "c0"},
                                                  {"{calibration}", kCalibration},
                                                  {"{reconstruction}", kReconstruction},
                                                  {"{job}", "1"}};
  for (const auto& [name, id] : ids) {
    if (const size_t at = path.find(name); at != std::string::npos)
      path.replace(at, name.size(), id);
  }
  return path;
}

TEST_F(Api, StatusSaysWhyNoCameraIsOpenAndHowManyThereAre) {
  CaptureStation::Options options;
  options.capture.cameras.resize(3);
  options.capture.trigger.camera_input = "Line9x";
  options.simulated = "/nowhere";
  CaptureStation station(options);
  const auto opened = station.Open();
  ASSERT_FALSE(opened.ok());
  ServeCamerasOf(station);
  const Json status = Checked(Get("/v1/status"), "Status");
  EXPECT_EQ(status["cameras"]["of"], 3);
  EXPECT_EQ(status["cameras"]["ready"], 0);
  EXPECT_NE(status["problems"].dump().find("the cameras are not open: trigger.camera_input"),
            std::string::npos)
      << status["problems"];
}

TEST_F(Api, ALastCaptureWithoutAllFramesIsAProblemAndItsFramesSayWhy) {
  AddShot("a", "2026-01-01T10:00:00Z", 0);
  EXPECT_NE(Problems().find("the last capture, a, has 0 of 2 frames: without c0, c1"),
            std::string::npos)
      << Problems();
  const Json capture = Checked(Get("/v1/captures/a"), "CaptureDetail");
  EXPECT_EQ(capture["frames"][1]["status"], "missing");
  EXPECT_EQ(capture["frames"][1]["reason"], "its cable is out");
  AddShot("b", "2026-01-01T10:00:01Z", 2);
  EXPECT_EQ(Problems().find("the last capture"), std::string::npos) << Problems();
  EXPECT_FALSE(Checked(Get("/v1/captures/b"), "CaptureDetail")["frames"][1].contains("reason"));
}

TEST_F(Api, ACalibrationTellsWhatItWasMadeFrom) {
  Store& store = state_.store();
  test::WriteCalibrationFolder(store.CalibrationFolder("elsewhere"), TwoCameras());
  test::WriteCalibrationFolder(store.CalibrationFolder("here"), TwoCameras());
  const Json made_from = {{"captures", {"a", "b"}}, {"board", "cuboid"}, {"model", "opencv"}};
  std::ofstream(store.CalibrationFolder("here") / kMadeFromName) << made_from.dump();
  ASSERT_TRUE(RecordCalibration(store, "here"));
  ASSERT_TRUE(RecordCalibration(store, "elsewhere"));
  EXPECT_EQ(Checked(Get("/v1/calibrations/here"), "Calibration")["made_from"], made_from);
  EXPECT_FALSE(Checked(Get("/v1/calibrations/elsewhere"), "Calibration").contains("made_from"));
}

TEST_F(Api, TheDocumentHasEveryRouteAndTheRouterEveryOperation) {
  const Json document = Document();
  EXPECT_EQ(document["openapi"], "3.1.0");
  std::set<std::string> in_document, in_table, names;
  for (const auto& [path, operations] : document["paths"].items()) {
    for (const auto& [method, operation] : operations.items()) {
      in_document.insert(method + " " + path);
      EXPECT_TRUE(names.insert(operation["operationId"]).second) << operation["operationId"];
      // Whatever is documented is served: neither unknown nor of another method.
      std::string upper = method;
      for (char& letter : upper) letter = static_cast<char>(std::toupper(letter));
      const int status = Call(upper, WithIds(path), "", Role::kNone).status;
      EXPECT_EQ(status, 403) << method << " " << path;
    }
  }
  for (const Route& route : router_->routes()) {
    std::string method = route.method;
    for (char& letter : method) letter = static_cast<char>(std::tolower(letter));
    in_table.insert(method + " " + route.path);
  }
  EXPECT_EQ(in_document, in_table);
  EXPECT_GE(in_table.size(), 25u);
}

/// Names of the schemas that `value` refers to.
void CollectReferences(const Json& value, std::set<std::string>& names) {
  constexpr std::string_view kPrefix = "#/components/schemas/";
  for (const auto& [key, part] : value.items()) {
    if (key == "$ref") names.insert(part.get<std::string>().substr(kPrefix.size()));
    if (part.is_structured()) CollectReferences(part, names);
  }
}

TEST_F(Api, TheDocumentHasNoSchemaThatNothingRefersTo) {
  const Json document = Document();
  std::set<std::string> used = {"Event"};  // what a stream carries, which is no JSON itself
  CollectReferences(document, used);
  for (const auto& [name, schema] : document["components"]["schemas"].items()) {
    EXPECT_TRUE(used.contains(name)) << name;
  }
}

TEST_F(Api, TheDocumentSaysWhichRequestsTakeABody) {
  const Json paths = Document()["paths"];
  const auto needs_body = [&](const char* path) -> bool {
    return paths[path]["post"]["requestBody"]["required"];
  };
  EXPECT_TRUE(needs_body("/v1/calibrations")) << "which captures?";
  EXPECT_FALSE(needs_body("/v1/captures"));
  EXPECT_FALSE(needs_body("/v1/captures/{capture}/reconstructions"));
}

/// One that the document allows is taken, and one that it does not is refused.
TEST_F(Api, TheDocumentSaysWhichIdempotencyKeysThereAre) {
  const Json parameters = Document()["paths"]["/v1/captures"]["post"]["parameters"];
  const auto header = std::find_if(parameters.begin(), parameters.end(), [](const Json& each) {
    return each["name"] == "Idempotency-Key";
  });
  ASSERT_NE(header, parameters.end());
  const std::regex allowed((*header)["schema"]["pattern"].get<std::string>());
  for (const char* key : {"\x1F", " ", "!", "~", "\x7F", "a b", "a-b"}) {
    const int status =
        Call("POST", "/v1/captures", "{}", Role::kOperator, {{"idempotency-key", key}}).status;
    EXPECT_EQ(status, std::regex_match(key, allowed) ? 202 : 400) << key;
  }
}

TEST_F(Api, TheDocumentNamesEveryLensModel) {
  const Json document = Document();
  const Json& request = document["components"]["schemas"]["CalibrationRequest"];
  std::set<std::string> known;
  for (const auto& [name, model] : rig::LensModelsByName()) known.insert(name);
  EXPECT_EQ(request["properties"]["model"]["enum"].get<std::set<std::string>>(), known);
}

TEST_F(Api, TheDocumentNamesWhatMayBeChosenOfAReconstruction) {
  const Json schemas = Document()["components"]["schemas"];
  const Json& fields = schemas["ReconstructionRequest"]["properties"];
  const auto check = [&](const Json& choice, const auto& by_name) {
    EXPECT_EQ(choice["enum"].get<std::vector<std::string>>(), NamesIn(by_name)) << choice;
  };
  check(fields["method"], sfm::MethodsByName());
  check(fields["pairs"], sfm::PairSelectionsByName());
  check(schemas["Preset"], RequestPresets());
  check(schemas["Prior"], sfm::PriorsByName());
  check(schemas["Reconstruction"]["properties"]["prior"], sfm::PriorsByName());
  for (const char* request : {"ReconstructionRequest", "CaptureRequest"}) {
    const Json& of_request = schemas[request]["properties"];
    EXPECT_EQ(of_request["preset"]["$ref"], "#/components/schemas/Preset") << request;
    EXPECT_EQ(of_request["prior"]["$ref"], "#/components/schemas/Prior") << request;
  }
}

/// A model of one picture, of camera c0, with this lens; as a reconstruction leaves it.
void WriteModel(const std::filesystem::path& reconstruction, const CameraIntrinsics& lens) {
  sfm::Reconstruction model;
  model.intrinsics.lenses = {lens};
  model.intrinsics.lens_of_image = {0};
  model.cam_from_model = {Rigid3()};
  sfm::Features features;
  features.images.resize(1);
  FrameSet set;
  set.frames.emplace_back().file = "frames/c0.png";
  const auto folder = reconstruction / "sparse" / "0";
  std::filesystem::create_directories(folder);
  const Status written =
      sfm::WriteColmapModel(model, features, set, folder, sfm::ColmapEncoding::kBinary);
  ASSERT_TRUE(written.ok()) << written.error().ToString();
}

std::string HeaderOf(const HttpResponse& answer, const std::string& name) {
  for (const auto& [key, value] : answer.headers) {
    if (key == name) return value;
  }
  return "";
}

/// Holds headers of answers against what the document says of them.
class HeaderCheck {
 public:
  explicit HeaderCheck(const Json& document) : paths_(document["paths"]) {
    for (const auto& [path, operations] : paths_.items()) {
      for (const auto& [method, operation] : operations.items()) {
        for (const auto& [status, response] : operation["responses"].items()) {
          const Json headers = HeadersIn(response);
          for (const auto& [name, header] : headers.items()) {
            documented_.insert(Place(operation, status, name));
          }
        }
      }
    }
  }
  void Add(const Route& route, const HttpResponse& answer) {
    std::string method = route.method;
    for (char& letter : method) letter = static_cast<char>(std::tolower(letter));
    const Json& operation = paths_[route.path][method];
    std::string status = std::to_string(answer.status);
    if (!operation["responses"].contains(status)) status = "default";
    const Json headers = HeadersIn(operation["responses"][status]);
    for (const auto& [name, value] : answer.headers) sent_.insert(Place(operation, status, name));
    for (const auto& [name, header] : headers.items()) {
      EXPECT_TRUE(!header["required"].get<bool>() || !HeaderOf(answer, name).empty())
          << route.operation << " " << name;
    }
  }
  void ExpectThatTheSameWereSent() const { EXPECT_EQ(sent_, documented_); }

 private:
  static Json HeadersIn(const Json& response) { return response.value("headers", Json::object()); }
  /// What any operation may answer is the same for all.
  static std::string Place(const Json& operation, const std::string& status,
                           const std::string& name) {
    const std::string of = operation["operationId"];
    return (status == "default" ? "any" : of) + " " + status + " " + name;
  }

  const Json paths_;
  std::set<std::string> documented_, sent_;
};

TEST_F(Api, TheDocumentSaysWhichHeadersAnswersHave) {
  Fill();
  WriteModel(state_.store().ReconstructionFolder(kReconstruction),
             {CameraModel::kOpencv, 8, 8, {10, 10, 4, 4, 0, 0, 0, 0}});
  room_ = Status();
  HeaderCheck check(Document());
  const auto call_all = [&](const std::map<std::string, std::string>& headers) {
    for (const Route& route : router_->routes()) {
      const std::string target =
          WithIds(route.path) + (route.operation == "getExport" ? "?format=colmap" : "");
      const std::string body = route.request_schema.empty() ? "" : "{}";
      check.Add(route, Call(route.method, target, body, Role::kOperator, headers));
      check.Add(route, Call("PATCH", target));
    }
  };
  call_all({});
  call_all({{"content-type", "text/xml"}});
  call_all({{"content-encoding", "gzip"}});
  jobs_ = std::make_unique<JobQueue>(
      state_.store(),
      JobHandlers{HandlerThatTakesAll(), HandlerThatTakesAll(), HandlerThatTakesAll()},
      JobQueue::Options{.max_queued = 0});
  ServeCamerasOf(station_);
  call_all({});
  check.ExpectThatTheSameWereSent();
}

TEST_F(Api, TheDocumentSaysWhatEveryAnswerIs) {
  const Json document = Document();
  for (const auto& [path, operations] : document["paths"].items()) {
    for (const auto& [method, operation] : operations.items()) {
      for (const auto& [status, response] : operation["responses"].items()) {
        ASSERT_EQ(response["content"].size(), 1u) << path;
        const auto content = response["content"].items().begin();
        const Json& schema = content.value()["schema"];
        const bool is_json = content.key().ends_with("json");
        const bool is_file = schema.contains("contentMediaType") && !is_json;
        EXPECT_TRUE(schema.contains("$ref") || is_file ||
                    schema["type"] == (is_json ? "object" : "string"))
            << method << " " << path << " " << status << schema;
      }
    }
  }
  const Json& get = document["paths"]["/v1/captures/{capture}/frames/{camera}.png"]["get"];
  EXPECT_EQ(get["responses"]["200"]["content"]["image/png"]["schema"]["contentMediaType"],
            "image/png");
}

/// A result with everything that may be left out of one.
PoseSet FullPoses() {
  PoseSet poses = MovedPoses();
  poses.options = {{"preset", "rig"}};
  CameraPose& pose = poses.cameras[0];
  pose.sigma->focal_px = 0.1;
  pose.side = "front";
  pose.segments = {3};
  pose.vs_calibration->swapped_with = "c1";
  pose.vs_calibration->wrong_side = pose.vs_calibration->far_off = true;
  pose.evidence = PoseEvidence{1.5, OtherPose{170, 1, 2}, true, true};
  CameraPose& unregistered = poses.cameras.emplace_back();
  unregistered.camera = "c2";
  unregistered.reason = "3 inliers";
  poses.segments = {{3, 4, true, "front", 5, 6, {3}}};
  poses.summary.mean_rotation_deg = poses.summary.mean_position_mm = 0.5;
  poses.summary.verdict_of_pictures = "sure";
  poses.summary.margin = 12;
  poses.summary.view_graph_margin = 0.75;
  return poses;
}

Calibration FullCalibration() {
  Calibration calibration = TwoCameras();
  calibration.id = kCalibration;
  CalibratedCamera& camera = calibration.cameras[0];
  camera.covariance = Eigen::MatrixXd::Identity(14, 14);
  camera.fit = CameraFit{10, 9, 0.1, 0.2, 0.3};
  CalibratedFace& face = calibration.board.emplace_back();
  face.face = "front";
  face.sigma = FaceSigma{0.1, 0.2, 0.3};
  face.print = FacePrint{5, 7, 40, 30, "DICT", 0, false};
  calibration.residuals = CalibrationResiduals{10, 9, 0.1, 1, 0.2, 0.3, 1, 1};
  return calibration;
}

TEST_F(Api, TheDocumentKnowsAllThatFilesMayHold) {
  const Json schemas = Document()["components"]["schemas"];
  const auto problem = [&](const std::string& text, const char* schema) {
    return test::SchemaProblem(Json::parse(text), schemas[schema], schemas);
  };
  EXPECT_EQ(problem(PoseSetToJson(FullPoses()), "Poses"), "");
  EXPECT_EQ(problem(CalibrationToJson(FullCalibration()), "CalibrationFile"), "");
}

/// A simulated camera that Fill() knows.
test::SimulatedRig::Options OneCamera() {
  test::SimulatedRig::Options options;
  options.block = "127.62.4";
  options.cameras = 1;
  options.like.width_px = 64;
  options.like.height_px = 48;
  return options;
}

TEST_F(Api, EveryReadAnswersAsTheDocumentSays) {
  Fill();
  test::SimulatedRig cameras(OneCamera());
  cameras.capture().cameras[0].camera = "c0";
  CaptureStation station({cameras.capture(), cameras.server().socket()});
  ASSERT_TRUE(station.Open().ok());
  ServeCamerasOf(station);
  while (station.States()[0].condition != rig::CameraCondition::kReady) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  ASSERT_EQ(Call("POST", "/v1/captures").status, 202);
  const Json document = Document();
  const Json& schemas = document["components"]["schemas"];
  for (const Route& route : router_->routes()) {
    if (route.method != "GET") continue;
    std::string target = WithIds(route.path);
    if (route.operation == "getExport") target += "?format=ply";
    const HttpResponse answer = Get(target);
    EXPECT_EQ(answer.status, 200) << target << answer.body;
    EXPECT_EQ(answer.content_type, route.content_type) << target;
    EXPECT_TRUE(!answer.file || std::filesystem::exists(*answer.file)) << target;
    if (route.schema.empty()) continue;
    const std::string body = answer.file ? test::TextOf(*answer.file) : answer.body;
    EXPECT_EQ(test::SchemaProblem(Json::parse(body), schemas[route.schema], schemas), "")
        << target << body;
  }
}

TEST_F(Api, StatusTellsWhatToSeeTo) {
  Fill();
  const Json status = Checked(Get("/v1/status"), "Status");
  EXPECT_EQ(status["version"], "1.2.3");
  EXPECT_EQ(status["calibration"], kCalibration);
  EXPECT_EQ(status["last_capture"]["id"], kCapture);
  EXPECT_EQ(status["moved"].size(), 0u) << "one capture alone does not name a camera";
  EXPECT_NE(status["problems"].dump().find("cameras are not open"), std::string::npos);
  const Json drift = Checked(Get("/v1/drift"), "Drift");
  EXPECT_EQ(drift["calibration"], kCalibration);
  EXPECT_EQ(drift["cameras"][1]["position_mm"], 20.0);
  EXPECT_EQ(drift["cameras"][1]["beyond_limit"], true);
  const Json history = Checked(Get("/v1/drift?camera=c1"), "DriftPage");
  EXPECT_EQ(history["items"][0]["capture"], kCapture);
}

TEST_F(Api, StatusTellsOfCapturesThatAreNotSureAndOfCamerasWithoutAPose) {
  Fill();
  for (int number = 1; number <= 2; ++number) {
    EXPECT_EQ(Problems().find("not sure"), std::string::npos) << number;
    EXPECT_EQ(Problems().find("has no pose"), std::string::npos) << number;
    PoseSet poses = MovedPoses("unsure-" + std::to_string(number));
    poses.summary.verdict = "unsure";
    poses.summary.verdict_of_pictures = "sure";
    poses.summary.verdict_reason = "1 camera far off";
    poses.cameras[1] = CameraPose();
    poses.cameras[1].camera = "c1";
    poses.cameras[1].reason = "3 inliers, expected 30";
    AddCapture("2026-01-01T11:0" + std::to_string(number) + ":00Z", poses);
  }
  EXPECT_NE(Problems().find("the newest 2 are not sure; unsure-2 is unsure: 1 camera far off"),
            std::string::npos)
      << Problems();
  EXPECT_NE(
      Problems().find("camera c1 has no pose in the last 2 captures (3 inliers, expected 30)"),
      std::string::npos)
      << Problems();
  AddCapture("2026-01-01T12:00:00Z", MovedPoses("sure-again"));
  EXPECT_EQ(Problems().find("not sure"), std::string::npos) << Problems();
  EXPECT_EQ(Problems().find("has no pose"), std::string::npos) << Problems();
}

TEST_F(Api, OnlyResultsThatSpeakOfTheRigSayWhetherTheNewestAreSure) {
  Fill();
  const auto add = [&](const std::string& id, const char* verdict, const char* prior,
                       const char* preset = "rig") {
    PoseSet poses = MovedPoses(id);
    poses.options = {{"preset", preset}, {"prior", prior}};
    poses.summary.verdict = verdict;
    poses.summary.verdict_reason = "a reason";
    AddCapture("2026-01-01T11:0" + id.substr(1) + ":00Z", poses);
  };
  add("p1", "unsure", "none");
  add("p2", "unsure", "calibration");
  EXPECT_EQ(Problems().find("not sure"), std::string::npos) << Problems();
  add("p3", "unsure", "none", "internet");
  EXPECT_EQ(Problems().find("not sure"), std::string::npos) << Problems();
  add("p4", "sure", "calibration");
  add("p5", "sure", "none", "internet");
  add("p6", "unsure", "none");
  EXPECT_NE(Problems().find("the newest 2 are not sure; p6 is unsure"), std::string::npos)
      << Problems();
  EXPECT_EQ(Checked(Get("/v1/reconstructions/p5-r1"), "Reconstruction")["preset"], "internet");
  const Json made = Checked(Get("/v1/reconstructions/p4-r1"), "Reconstruction");
  EXPECT_EQ(made["preset"], "rig");
  EXPECT_EQ(made["prior"], "calibration");
  EXPECT_EQ(made["used_for_drift"], false);
  EXPECT_EQ(Checked(Get("/v1/captures/p4"), "CaptureDetail")["reconstruction"], "p4-r1");
}

TEST_F(Api, StatusTellsOfJobsThatCannotBeBegun) {
  const Status done = state_.store().Write([](Database& database, auto&) {
    return database.Execute(
        "CREATE TRIGGER full BEFORE UPDATE ON jobs BEGIN SELECT RAISE(ABORT, 'no room'); END");
  });
  ASSERT_TRUE(done.ok()) << done.error().ToString();
  ASSERT_EQ(Call("POST", "/v1/captures").status, 202);
  while (!jobs_->Trouble()) std::this_thread::sleep_for(std::chrono::milliseconds(2));
  EXPECT_NE(Problems().find("jobs are not begun (capture): "), std::string::npos) << Problems();
}

TEST_F(Api, StatusTellsWhatARunningJobIsNotCancelledFor) {
  std::atomic<bool> over = false;
  JobHandler waits = HandlerThatTakesAll();
  waits.run = [&over](const JobRecord&, JobContext& context) -> Result<std::string> {
    context.refuse_cancel("shot x: is taken and waits for the disk (no room): make room there");
    while (!over) std::this_thread::sleep_for(std::chrono::milliseconds(2));
    return std::string("{}");
  };
  jobs_ = std::make_unique<JobQueue>(
      state_.store(), JobHandlers{waits, HandlerThatTakesAll(), HandlerThatTakesAll()},
      JobQueue::Options());
  ServeCamerasOf(station_);
  const char* said = "shot x: is taken and waits for the disk (no room)";
  EXPECT_EQ(Problems().find(said), std::string::npos) << Problems();
  const Json job = Json::parse(Call("POST", "/v1/captures").body);
  while (jobs_->CancelRefusals().empty()) std::this_thread::sleep_for(std::chrono::milliseconds(2));
  EXPECT_NE(Problems().find(said), std::string::npos) << Problems();
  over = true;
  while (Json::parse(Get("/v1/jobs/" + job["id"].dump()).body)["state"] != "done") {
  }
  while (!jobs_->CancelRefusals().empty())
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  EXPECT_EQ(Problems().find(said), std::string::npos) << Problems();
}

TEST_F(Api, StatusNamesACalibrationInForceThatCannotBeRead) {
  Fill();
  const auto problems = [&] {
    return Checked(Get("/v1/status"), "Status")["problems"].dump().find(
               "without the calibration in force") != std::string::npos;
  };
  EXPECT_FALSE(problems());
  const auto folder = state_.store().CalibrationFolder(kCalibration);
  std::filesystem::rename(folder, state_.folder() / "away");
  EXPECT_TRUE(problems());
  std::filesystem::rename(state_.folder() / "away", folder);
  EXPECT_FALSE(problems());
  std::ofstream(folder / "calibration.json") << "{";
  EXPECT_TRUE(problems());
}

TEST_F(Api, StatusIsAnsweredWhileTheCalibrationInForceHangs) {
  Fill();
  const auto file = state_.store().CalibrationFolder(kCalibration) / "calibration.json";
  std::filesystem::remove(file);
  ASSERT_EQ(mkfifo(file.c_str(), 0600), 0);  // whoever reads it waits for somebody who writes
  HttpResponse held_up;
  std::jthread first([&] { held_up = Get("/v1/status"); });
  int writer = -1;  // can be opened from when somebody reads
  while ((writer = open(file.c_str(), O_WRONLY | O_NONBLOCK | O_CLOEXEC)) < 0) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  for (int i = 0; i < 3; ++i) EXPECT_EQ(Get("/v1/status").status, 200);
  close(writer);
  first.join();
  EXPECT_NE(held_up.body.find("calibration.json"), std::string::npos) << "it was empty";
}

TEST_F(Api, ListsComeInPages) {
  Store& store = state_.store();
  for (int i = 0; i < 5; ++i) {
    const std::string id = "2026010" + std::to_string(i + 1) + "T100000Z";
    test::WriteTinyFrameSet(store.CaptureFolder(id),
                            "2026-01-0" + std::to_string(i + 1) + "T10:00:00Z");
    ASSERT_TRUE(RecordCapture(store, id, std::nullopt));
  }
  std::vector<std::string> seen;
  std::string after;
  do {
    const Json page = Checked(
        Get("/v1/captures?limit=2" + (after.empty() ? "" : "&after=" + after)), "CapturePage");
    EXPECT_LE(page["items"].size(), 2u);
    for (const Json& item : page["items"]) seen.push_back(item["id"]);
    after = page.value("next", "");
  } while (!after.empty());
  EXPECT_EQ(seen,
            (std::vector<std::string>{"20260105T100000Z", "20260104T100000Z", "20260103T100000Z",
                                      "20260102T100000Z", "20260101T100000Z"}));
  for (const char* query : {"limit=0", "limit=501", "limit=-1", "limit=99999999999999999999",
                            "limit=2x", "limit=", "after=..", "after=a%20b", "offset=1"}) {
    EXPECT_EQ(Get(std::string("/v1/captures?") + query).status, 400) << query;
  }
}

/// Lists of five: captures, reconstructions of the first, calibrations, jobs, drift of c1.
class ApiLists : public Api {
 protected:
  ApiLists() {
    Fill();
    for (int i = 2; i <= 5; ++i) {
      const std::string number = std::to_string(i), capture = "x" + number;
      AddReconstruction(std::string(kCapture) + "-r" + number, kCapture);
      test::WriteCalibrationFolder(state_.store().CalibrationFolder("charuco-" + number),
                                   TwoCameras());
      EXPECT_TRUE(RecordCalibration(state_.store(), "charuco-" + number));
      test::WriteTinyFrameSet(state_.store().CaptureFolder(capture),
                              "2026-01-0" + number + "T10:00:00Z");
      EXPECT_TRUE(RecordCapture(state_.store(), capture, std::nullopt));
      AddReconstruction(capture + "-r1", capture);
    }
    for (int i = 0; i < 5; ++i) EXPECT_EQ(Call("POST", "/v1/captures").status, 202);
  }
  void AddReconstruction(const std::string& id, const std::string& capture) {
    PoseSet poses = MovedPoses();
    poses.frameset = capture;
    const auto folder = state_.store().ReconstructionFolder(id);
    std::filesystem::create_directories(folder);
    std::ofstream(folder / "poses.json") << PoseSetToJson(poses);
    EXPECT_TRUE(RecordReconstruction(state_.store(), id));
  }
  /// How many items each page has when at most two may be; every item comes once.
  std::vector<size_t> Pages(const std::string& target, const std::string& schema,
                            const std::string& key) {
    std::vector<size_t> sizes;
    std::set<std::string> seen;
    std::string after;
    do {
      const Json page =
          Checked(Get(target + "limit=2" + (after.empty() ? "" : "&after=" + after)), schema);
      for (const Json& item : page["items"]) {
        EXPECT_TRUE(seen.insert(item[key].dump()).second) << target << item;
      }
      sizes.push_back(page["items"].size());
      after = page.value("next", "");
    } while (!after.empty() && sizes.size() < 10);
    return sizes;
  }
};

TEST_F(ApiLists, AllThatCanGrowComeInPages) {
  const std::string capture = "/v1/captures/" + std::string(kCapture);
  struct List {
    std::string target, schema, key;
  };
  for (const List& list :
       {List{"/v1/captures?", "CapturePage", "id"},
        List{capture + "/reconstructions?", "ReconstructionPage", "id"},
        List{"/v1/calibrations?", "CalibrationPage", "id"}, List{"/v1/jobs?", "JobPage", "id"},
        List{"/v1/drift?camera=c1&", "DriftPage", "capture"}}) {
    EXPECT_EQ(Pages(list.target, list.schema, list.key), (std::vector<size_t>{2, 2, 1}))
        << list.target;
    for (const char* query : {"limit=0", "limit=501", "limit=x", "after=..", "offset=1"}) {
      EXPECT_EQ(Get(list.target + query).status, 400) << list.target << query;
    }
    EXPECT_EQ(Get(list.target + "after=none").status, 404) << list.target;
  }
  EXPECT_EQ(Get("/v1/captures/none/reconstructions").status, 404);
  EXPECT_EQ(Checked(Get(capture), "CaptureDetail")["reconstructions"].size(), 5u);
}

TEST_F(ApiLists, PagesGoOnWhenWhatTheyEndedWithIsGone) {
  const std::string capture = "/v1/captures/" + std::string(kCapture);
  const std::vector<std::pair<std::string, std::string>> lists = {
      {"/v1/captures?limit=2", "DELETE FROM captures WHERE id = 'x4'"},
      {capture + "/reconstructions?limit=2",
       "DELETE FROM reconstructions WHERE id = '20260101T100000Z-r4'"},
      {"/v1/drift?camera=c1&limit=2", "UPDATE drift SET reconstruction = 'x4-r2'"}};
  for (const auto& [target, removal] : lists) {
    const Json first = Json::parse(Get(target).body);
    const Json second =
        Json::parse(Get(target + "&after=" + first["next"].get<std::string>()).body);
    ASSERT_EQ(second["items"].size(), 2u) << second;
    ASSERT_TRUE(state_.store()
                    .Write([&removal = removal](Database& database, auto&) {
                      return database.Execute(removal);
                    })
                    .ok());
    const HttpResponse later = Get(target + "&after=" + first["next"].get<std::string>());
    ASSERT_EQ(later.status, 200) << target << later.body;
    const Json items = Json::parse(later.body)["items"];
    ASSERT_EQ(items.size(), 2u) << items;
    const char* key = target.starts_with("/v1/drift") ? "capture" : "id";
    for (size_t i = 0; i < 2; ++i) EXPECT_EQ(items[i][key], second["items"][i][key]) << target;
  }
  EXPECT_EQ(Get("/v1/drift?camera=c1&after=a,b").status, 400) << "a place in another list";
  EXPECT_EQ(Get("/v1/captures?after=x5").status, 200) << "an id that is there";
}

TEST_F(Api, EveryRouteOfTheDesignIsServed) {
  std::set<std::string> served;
  for (const Route& route : router_->routes()) served.insert(route.method + " " + route.path);
  for (const char* route : {"GET /v1/status",
                            "GET /v1/cameras",
                            "GET /v1/cameras/{camera}",
                            "GET /v1/cameras/{camera}/preview.jpg",
                            "POST /v1/captures",
                            "GET /v1/captures",
                            "GET /v1/captures/{capture}",
                            "GET /v1/captures/{capture}/frames/{camera}.png",
                            "GET /v1/captures/{capture}/poses",
                            "GET /v1/captures/{capture}/report",
                            "GET /v1/captures/{capture}/export",
                            "POST /v1/calibrations",
                            "GET /v1/calibrations",
                            "GET /v1/calibrations/{calibration}",
                            "POST /v1/calibrations/{calibration}/activate",
                            "POST /v1/captures/{capture}/reconstructions",
                            "GET /v1/reconstructions/{reconstruction}",
                            "GET /v1/drift",
                            "GET /v1/jobs",
                            "GET /v1/jobs/{job}",
                            "DELETE /v1/jobs/{job}",
                            "GET /v1/events",
                            "GET /metrics"}) {
    EXPECT_TRUE(served.contains(route)) << route;
  }
}

TEST_F(Api, JobsAreQueuedOnceForAKey) {
  const auto post = [&](const std::string& body, const std::string& key) {
    return Call("POST", "/v1/captures", body, Role::kOperator, {{"idempotency-key", key}});
  };
  const HttpResponse first = post("{\"subject\":\"x\"}", "k1");
  ASSERT_EQ(first.status, 202) << first.body;
  const Json job = Checked(first, "Job");
  ASSERT_FALSE(first.headers.empty());
  EXPECT_EQ(first.headers[0].second, "/v1/jobs/" + std::to_string(job["id"].get<int>()));
  EXPECT_EQ(Json::parse(post("{\"subject\":\"x\"}", "k1").body)["id"], job["id"]);
  EXPECT_EQ(post("{\"subject\":\"y\"}", "k1").status, 409);
  EXPECT_NE(Json::parse(post("{\"subject\":\"x\"}", "k2").body)["id"], job["id"]);
  EXPECT_EQ(post("{}", std::string(200, 'k')).status, 202);
  for (const std::string& wrong : {std::string(201, 'k'), std::string("a b"), std::string()}) {
    const HttpResponse refused = post("{}", wrong);
    EXPECT_EQ(refused.status, 400) << wrong;
    EXPECT_NE(refused.body.find("Idempotency-Key: is '" + wrong + "', expected 1 to 200 "),
              std::string::npos)
        << refused.body;
  }
}

TEST_F(Api, WhatCannotBecomeAJobSaysWhy) {
  Fill();
  EXPECT_EQ(Call("POST", "/v1/captures", "{\"bad\":1}").status, 422);
  const std::string reconstruct = "/v1/captures/" + std::string(kCapture) + "/reconstructions";
  const HttpResponse good = Call("POST", reconstruct, "{\"method\":\"plain\"}");
  ASSERT_EQ(good.status, 202) << good.body;
  EXPECT_EQ(Json::parse(good.body)["request"]["capture"], kCapture) << "the path says which";
  EXPECT_EQ(Call("POST", reconstruct, "{\"capture\":\"other\"}").status, 422);
  for (const char* body : {"{", "[]", "\"x\"", "1", "{\"a\":1,\"a\":2}", "\xff", "null"}) {
    EXPECT_EQ(Call("POST", reconstruct, body).status, 400) << body;
  }
  EXPECT_EQ(Call("POST", reconstruct, std::string(100000, '[')).status, 400);
  EXPECT_EQ(Call("POST", "/v1/captures/nothing/reconstructions").status, 404);
  EXPECT_EQ(
      Call("POST", "/v1/captures", "x", Role::kOperator, {{"content-type", "text/xml"}}).status,
      415);
  EXPECT_EQ(Call("GET", "/v1/status", "{}").status, 400) << "takes no body";
}

TEST_F(Api, MediaTypesAreComparedAsHttpSays) {
  const auto post = [&](const std::string& type) {
    return Call("POST", "/v1/captures", "{}", Role::kOperator, {{"content-type", type}}).status;
  };
  for (const char* fine : {"application/json", "application/JSON", "Application/Json",
                           "application/json;charset=utf-8", "application/json ; charset=utf-8",
                           "\tapplication/json\t", "", " ", "Application/X-WWW-Form-Urlencoded"}) {
    EXPECT_EQ(post(fine), 202) << fine;
  }
  for (const char* other : {"text/json", "application/json2", "application json", "/", "xml"}) {
    EXPECT_EQ(post(other), 415) << other;
  }
}

TEST_F(Api, NoBodyIsUnpacked) {
  const auto post = [&](const std::string& encoding) {
    return Call("POST", "/v1/captures", "{}", Role::kOperator, {{"content-encoding", encoding}});
  };
  EXPECT_EQ(post("Identity").status, 202);
  const HttpResponse packed = post("gzip");
  EXPECT_EQ(packed.status, 415);
  EXPECT_EQ(packed.headers.at(0),
            std::pair(std::string("Accept-Encoding"), std::string("identity")));
}

TEST_F(Api, ABodyThatIsNoObjectIsNotRead) {
  for (const char* path : {"/v1/captures", "/v1/calibrations"}) {
    EXPECT_EQ(Call("POST", path, "[]").status, 400) << path;
    EXPECT_EQ(Call("POST", path, "3").status, 400) << path;
  }
}

TEST_F(Api, OnlyALackOfRoomIs507) {
  const HttpResponse full = Call("POST", "/v1/calibrations");
  EXPECT_EQ(full.status, 507);
  EXPECT_NE(full.body.find("make room"), std::string::npos) << full.body;
  room_ = Error{ErrorCode::kIo, "Input/output error", "disk"};
  EXPECT_EQ(Call("POST", "/v1/calibrations").status, 503) << "it cannot be asked";
  const auto drop = [](Database& database, auto&) { return database.Execute("DROP TABLE jobs"); };
  ASSERT_TRUE(state_.store().Write(drop).ok());
  const HttpResponse broken = Call("POST", "/v1/captures");
  EXPECT_EQ(broken.status, 503);
  EXPECT_NE(broken.body.find("no such table"), std::string::npos) << broken.body;
}

TEST_F(Api, AReconstructionAskedForTwiceIsTheSameJobAlsoWhenItsCaptureIsGone) {
  Fill();
  const std::string target = "/v1/captures/" + std::string(kCapture) + "/reconstructions";
  const auto post = [&](const std::string& key) {
    return Call("POST", target, "", Role::kOperator, {{"idempotency-key", key}});
  };
  const HttpResponse first = post("k1");
  ASSERT_EQ(first.status, 202) << first.body;
  ASSERT_TRUE(
      state_.store()
          .Write([](Database& database, auto&) { return database.Execute("DELETE FROM captures"); })
          .ok());
  const HttpResponse again = post("k1");
  ASSERT_EQ(again.status, 202) << again.body;
  EXPECT_EQ(Json::parse(again.body)["id"], Json::parse(first.body)["id"]);
  EXPECT_EQ(post("k2").status, 404);
}

TEST_F(Api, ABrokenFileOfOursIsNotTheCallersFault) {
  Fill();
  std::ofstream(state_.store().CalibrationFolder(kCalibration) / "calibration.json") << "{";
  const HttpResponse activate =
      Call("POST", "/v1/calibrations/" + std::string(kCalibration) + "/activate");
  EXPECT_EQ(activate.status, 500);
  EXPECT_NE(activate.body.find("calibration.json"), std::string::npos) << activate.body;
  for (const char* body : {"{", "\xff", "{\"a\":1,\"a\":2}"}) {
    EXPECT_EQ(Call("POST", "/v1/captures", body).status, 400) << body;
  }
}

TEST_F(Api, RolesGuardWhatActs) {
  Fill();
  for (const Route& route : router_->routes()) {
    const std::string target = WithIds(route.path);
    const HttpResponse nobody = Call(route.method, target, "", Role::kNone);
    EXPECT_EQ(nobody.status, 403) << target;
    if (route.method == "GET") {
      EXPECT_EQ(route.role, Role::kViewer) << target;
      continue;
    }
    EXPECT_EQ(route.role, Role::kOperator) << target;
    const HttpResponse viewer = Call(route.method, target, "", Role::kViewer);
    EXPECT_EQ(viewer.status, 403) << target;
    EXPECT_NE(viewer.body.find("takes a member of 'o'"), std::string::npos) << viewer.body;
  }
}

TEST_F(Api, NoPathLeadsOutOfTheStateFolder) {
  Fill();
  std::ofstream(state_.folder() / "secret.json") << "secret";
  const std::vector<std::string> names = {"..",
                                          "%2e%2e",
                                          "..%2fsecret",
                                          "%2e%2e%2f",
                                          "....",
                                          "a%00",
                                          "secret.json%00.png",
                                          std::string(101, 'a'),
                                          std::string(1900, '9'),
                                          "%ff",
                                          ".hidden",
                                          "99999999999999999999999",
                                          "-1",
                                          "~",
                                          "*"};
  for (const Route& route : router_->routes()) {
    const size_t open = route.path.find('{'), close = route.path.find('}');
    if (open == std::string::npos) continue;
    for (const std::string& name : names) {
      std::string target = route.path;
      target.replace(open, close - open + 1, name);
      target = WithIds(target) + (route.operation == "getExport" ? "?format=ply" : "");
      const HttpResponse answer = Call(route.method, target);
      EXPECT_TRUE(answer.status == 400 || answer.status == 404) << target << " " << answer.status;
      EXPECT_EQ(answer.content_type, "application/problem+json") << target;
      EXPECT_FALSE(answer.file) << target;
      Checked(answer, "Problem");
    }
  }
  EXPECT_EQ(Get("/v1/../../etc/passwd").status, 400);
  EXPECT_EQ(Get("/v1/nothing").status, 404);
  const HttpResponse method = Call("PATCH", "/v1/captures");
  EXPECT_EQ(method.status, 405);
  EXPECT_EQ(method.headers.at(0).second, "POST, GET, HEAD");
  EXPECT_EQ(Call("HEAD", "/v1/captures").status, 200) << "as GET; the server leaves the body out";
  EXPECT_EQ(Call("HEAD", "/v1/calibrations/x/activate").status, 405);
}

TEST_F(Api, WhatIsNotThereIs404WithTheReason) {
  Fill();
  for (const char* target :
       {"/v1/captures/x", "/v1/captures/x/poses", "/v1/captures/x/export?format=ply",
        "/v1/captures/x/frames/c0.png", "/v1/captures/20260101T100000Z/frames/c9.png",
        "/v1/calibrations/x", "/v1/calibrations/x/calibration.json", "/v1/reconstructions/x",
        "/v1/jobs/999", "/v1/cameras/c0", "/v1/cameras/c0/preview.jpg", "/v1/drift?camera=c9"}) {
    const HttpResponse answer = Get(target);
    EXPECT_EQ(answer.status, 404) << target;
    Checked(answer, "Problem");
  }
  EXPECT_EQ(Call("POST", "/v1/calibrations/x/activate").status, 404);
  EXPECT_EQ(Call("DELETE", "/v1/jobs/999").status, 404);
  EXPECT_EQ(Get("/v1/captures/20260101T100000Z/export").status, 400) << "which format?";
  EXPECT_EQ(Get("/v1/captures/20260101T100000Z/export?format=vrml").status, 400);
  test::WriteTinyFrameSet(state_.store().CaptureFolder("new"), "2026-01-02T10:00:00Z");
  ASSERT_TRUE(RecordCapture(state_.store(), "new", std::nullopt));
  const HttpResponse poses = Get("/v1/captures/new/poses");
  EXPECT_EQ(poses.status, 404);
  EXPECT_NE(poses.body.find("not reconstructed yet"), std::string::npos) << poses.body;
}

TEST_F(Api, WhatCanBeNoNameIs404InAPathAnd400InAQuery) {
  ASSERT_EQ(Call("POST", "/v1/captures").status, 202);
  for (const char* target : {"/v1/jobs/abc", "/v1/jobs/01", "/v1/jobs/-1", "/v1/jobs/1x",
                             "/v1/captures/a%20b", "/v1/calibrations/.hidden/report"}) {
    EXPECT_EQ(Get(target).status, 404) << target;
  }
  EXPECT_EQ(Call("DELETE", "/v1/jobs/abc").status, 404);
  EXPECT_EQ(Call("POST", "/v1/jobs/01/rerun").status, 404) << "not job 1";
  for (const char* target :
       {"/v1/jobs?after=a%20b", "/v1/events?after=zzz", "/v1/jobs?limit=x", "/v1/captures/%zz"}) {
    EXPECT_EQ(Get(target).status, 400) << target;
  }
}

TEST_F(Api, AModelThatAFormatCannotHoldIs422) {
  Fill();
  const auto folder = state_.store().ReconstructionFolder(kReconstruction);
  const std::string target = "/v1/captures/" + std::string(kCapture) + "/export?format=";
  std::vector<double> params = {10, 10, 4, 4, 0, 0, 0, 0, 0, 0, 0, 0};
  for (const bool rational : {false, true}) {
    params[9] = rational ? 0.01 : 0;
    WriteModel(folder, {CameraModel::kFullOpencv, 8, 8, params});
    for (const char* format : {"nerfstudio", "metashape", "realitycapture", "colmap"}) {
      const HttpResponse answer = Get(target + format);
      if (!rational || std::string(format) == "colmap") {
        EXPECT_EQ(answer.status, 200) << format << answer.body;
        continue;
      }
      EXPECT_EQ(answer.status, 422) << format;
      const Json problem = Checked(answer, "Problem");
      for (const char* part : {format, "camera c0", "FULL_OPENCV", "SIMPLE_RADIAL"}) {
        EXPECT_NE(problem["detail"].get<std::string>().find(part), std::string::npos) << problem;
      }
    }
  }
  const Json operation = Document()["paths"]["/v1/captures/{capture}/export"]["get"];
  EXPECT_TRUE(operation["responses"].contains("422"));
  EXPECT_TRUE(operation["responses"]["422"]["content"].contains("application/problem+json"));
}

TEST_F(Api, AnExportThatIsNotSureSaysSo) {
  Fill();
  const std::string begin = "attachment; filename=\"" + std::string(kCapture);
  const std::string target = "/v1/captures/" + std::string(kCapture) + "/export?format=";
  for (const std::string verdict : {"sure", "unsure", "folded", ""}) {
    PoseSet poses = MovedPoses();
    poses.summary.verdict = verdict;
    // The newest of those that are not sure speaks for the capture, once the sure one is gone.
    const std::string id = std::string(kReconstruction) + (verdict == "sure" ? "" : verdict + "x");
    const auto folder = state_.store().ReconstructionFolder(id);
    std::filesystem::create_directories(folder);
    std::ofstream(folder / "poses.json") << PoseSetToJson(poses);
    WriteModel(folder, {CameraModel::kOpencv, 8, 8, {10, 10, 4, 4, 0, 0, 0, 0}});
    ASSERT_TRUE(RecordReconstruction(state_.store(), id));
    const std::string mark = verdict == "unsure" || verdict == "folded" ? "-" + verdict : "";
    for (const std::string format : {"colmap", "ply"}) {
      const HttpResponse answer = Get(target + format);
      ASSERT_EQ(answer.status, 200) << answer.body;
      EXPECT_EQ(HeaderOf(answer, "Rotunda-Verdict"), verdict);
      EXPECT_EQ(HeaderOf(answer, "Content-Disposition"),
                begin + (format == "ply" ? mark + ".ply\"" : "-colmap" + mark + ".tar\""));
    }
    ASSERT_TRUE(state_.store()
                    .Write([&id](Database& database, auto&) {
                      return database.Execute("DELETE FROM reconstructions WHERE id = '" + id +
                                              "'");
                    })
                    .ok());
  }
}

/// Numbers of the events in a piece of a stream.
std::vector<int> NumbersIn(const std::string& stream) {
  std::vector<int> numbers;
  for (size_t at = 0; (at = stream.find("\nevent: ", at)) != std::string::npos; ++at) {
    numbers.push_back(std::stoi(stream.substr(stream.rfind("id: ", at) + 4)));
  }
  return numbers;
}

TEST_F(Api, EventStreamsBeginWhereTheClientSays) {
  Fill();
  const HttpResponse from_now = Get("/v1/events");
  ASSERT_TRUE(from_now.stream);
  const std::string begin = from_now.stream();
  EXPECT_EQ(NumbersIn(begin), std::vector<int>());
  const HttpResponse all = Get("/v1/events?after=0");
  const std::string text = all.stream();
  const std::vector<int> numbers = NumbersIn(text);
  ASSERT_GE(numbers.size(), 3u);
  EXPECT_NE(begin.find("\nid: " + std::to_string(numbers.back()) + "\n"), std::string::npos)
      << "where to go on, also for a client that is cut off before its first event: " << begin;
  EXPECT_NE(text.find("event: calibration_activated\n"), std::string::npos) << text;
  const Json schemas = Document()["components"]["schemas"];
  const size_t data = text.find("data: ") + 6;
  const Json event = Json::parse(text.substr(data, text.find('\n', data) - data));
  EXPECT_EQ(test::SchemaProblem(event, schemas["Event"], schemas), "");
  EXPECT_EQ(NumbersIn(all.stream()), std::vector<int>()) << "once each";
  const std::map<std::string, std::string> seen = {{"last-event-id", std::to_string(numbers[1])}};
  const HttpResponse resumed = Call("GET", "/v1/events", "", Role::kViewer, seen);
  EXPECT_EQ(NumbersIn(resumed.stream()), std::vector<int>(numbers.begin() + 2, numbers.end()));
  const HttpResponse ahead = Get("/v1/events?after=999999");
  EXPECT_EQ(NumbersIn(ahead.stream()), std::vector<int>());
  // What happens later reaches the one that began now, and the one that was ahead.
  test::WriteTinyFrameSet(state_.store().CaptureFolder("late"), "2026-01-02T10:00:00Z");
  ASSERT_TRUE(RecordCapture(state_.store(), "late", std::nullopt));
  EXPECT_EQ(NumbersIn(from_now.stream()).size(), 1u);
  EXPECT_EQ(NumbersIn(ahead.stream()).size(), 1u);
  for (const char* wrong : {"-1", "x", "1e3", "99999999999999999999"}) {
    EXPECT_EQ(Get(std::string("/v1/events?after=") + wrong).status, 400) << wrong;
  }
}

TEST_F(Api, OnlyAJobThatRunsHasProgress) {
  JobRecord job;
  job.body = "{}";
  job.stage = "matches";
  job.done = 3;
  job.total = 10;
  for (const JobState state : {JobState::kQueued, JobState::kRunning, JobState::kDone,
                               JobState::kFailed, JobState::kCancelled, JobState::kInterrupted}) {
    job.state = state;
    EXPECT_EQ(ToJson(job).contains("progress"), state == JobState::kRunning) << JobStateName(state);
  }
  const std::string said =
      Document()["components"]["schemas"]["Progress"]["description"].get<std::string>();
  EXPECT_EQ(said, "Of a job that runs");
}

TEST_F(Api, JobsThatHaveEndedCannotBeCancelled) {
  const Json job = Json::parse(Call("POST", "/v1/captures").body);
  const std::string target = "/v1/jobs/" + std::to_string(job["id"].get<int>());
  while (Json::parse(Get(target).body)["state"] != "done") {
  }
  EXPECT_EQ(Call("DELETE", target).status, 409);
  EXPECT_EQ(Call("POST", target + "/rerun").status, 409);
  EXPECT_EQ(Json::parse(Get("/v1/jobs?state=done").body)["items"].size(), 1u);
  EXPECT_EQ(Json::parse(Get("/v1/jobs?state=failed").body)["items"].size(), 0u);
  EXPECT_EQ(Get("/v1/jobs?state=bored").status, 400);
}

TEST_F(Api, MetricsAreWhatPrometheusReads) {
  Fill();
  const std::string text = Get("/metrics").body;
  EXPECT_NE(text.find("\nrotunda_cameras_ready 0\n"), std::string::npos) << text;
  EXPECT_NE(text.find("# TYPE rotunda_http_requests_total counter\n"), std::string::npos) << text;
}

TEST(DaemonDefaults, AreTheSameInTheConfigurationAndInTheParts) {
  const config::DaemonConfig config;
  EXPECT_EQ(config.drift.position_mm, DriftLimits().position_mm);
  EXPECT_EQ(config.drift.rotation_deg, DriftLimits().rotation_deg);
  EXPECT_EQ(static_cast<size_t>(config.drift.captures), DriftLimits().captures);
  EXPECT_EQ(config.jobs.capture_silence_s, JobQueue::Options().capture_silence.count());
  EXPECT_EQ(config.jobs.computing_silence_s, JobQueue::Options().computing_silence.count());
  EXPECT_EQ(config.http.header_bytes, HttpLimits().header_bytes);
  EXPECT_EQ(config.http.body_bytes, HttpLimits().body_bytes);
  EXPECT_EQ(config.http.connections, HttpLimits().connections);
  EXPECT_EQ(config.http.streams, HttpLimits().streams);
  EXPECT_EQ(config.http.request_ms, HttpLimits().request_ms);
  EXPECT_EQ(config.http.write_ms, HttpLimits().write_ms);
  EXPECT_EQ(config.http.heartbeat_ms, HttpLimits().heartbeat_ms);
  EXPECT_EQ(config.http.threads, HttpLimits().handler_threads);
}

TEST(TarArchive, IsReadByTar) {
  const test::TemporaryFolder folder;
  const std::filesystem::path in = folder / "in", out = folder / "out";
  std::filesystem::create_directories(in);
  std::filesystem::create_directories(out);
  const std::string bytes(1025, 'b');
  std::ofstream(in / "b.bin") << bytes;
  std::ofstream(in / "a.txt") << "";
  const auto tar = TarOf(in);
  ASSERT_TRUE(tar) << tar.error().ToString();
  EXPECT_EQ(*tar, *TarOf(in)) << "the same bytes every time";
  std::ofstream(folder / "x.tar", std::ios::binary) << *tar;
  const auto list =
      test::RunProcess({"tar", "-x", "-v", "-f", folder / "x.tar", "-C", out.string()});
  EXPECT_EQ(list.exit_code, 0) << list.errors;
  EXPECT_EQ(list.output, "a.txt\nb.bin\n");
  std::ifstream read(out / "b.bin", std::ios::binary);
  EXPECT_EQ(std::string(std::istreambuf_iterator<char>(read), {}), bytes);
}

}  // namespace
}  // namespace rotunda::daemon
