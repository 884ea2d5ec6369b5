#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <mutex>
#include <system_error>

#include "daemon/api_answers.h"
#include "daemon/model_export.h"
#include "daemon/store_captures.h"
#include "daemon/store_jobs.h"
#include "daemon/store_reconstructions.h"
#include "sfm/core/json_reader.h"

namespace rotunda::daemon {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

// In memory until their clients have taken them, 100 MB each for a full rig.
constexpr int kMaxArchives = 4;
constexpr char kPly[] = "ply";
constexpr char kAnyBytes[] = "application/octet-stream";
// Headers of exports.
constexpr char kFileName[] = "Content-Disposition";
constexpr char kVerdict[] = "Rotunda-Verdict";

HttpResponse List(const ApiParts& parts, const ApiRequest& request) {
  const Result<Page> page = PageOf(request);
  return page ? JsonAnswer(ListCaptures(parts.store, *page)) : Problem(page.error());
}

HttpResponse One(const ApiParts& parts, const std::string& id) {
  const Result<CaptureRecord> capture = FindCapture(parts.store, id);
  if (!capture) return Problem(capture.error());
  const auto frames = ListFrames(parts.store, id);
  if (!frames) return Problem(frames.error());
  const auto reconstructions = ListReconstructions(parts.store, id, Page());
  if (!reconstructions) return Problem(reconstructions.error());
  Json answer = ToJson(*capture);
  answer["frames"] = ItemsJson(*frames);
  answer["reconstructions"] = ItemsJson(reconstructions->items);
  return JsonAnswer(answer);
}

HttpResponse Reconstructions(const ApiParts& parts, const ApiRequest& request) {
  const Result<Page> page = PageOf(request);
  if (!page) return Problem(page.error());
  const std::string& id = request.path.at("capture");
  if (const auto capture = FindCapture(parts.store, id); !capture) return Problem(capture.error());
  return JsonAnswer(ListReconstructions(parts.store, id, *page));
}

HttpResponse Picture(const ApiParts& parts, const ApiRequest& request) {
  const std::string& camera = request.path.at("camera");
  const auto frames = ListFrames(parts.store, request.path.at("capture"));
  if (!frames) return Problem(frames.error());
  const auto found = std::find_if(frames->begin(), frames->end(),
                                  [&](const FrameRecord& f) { return f.camera == camera; });
  if (found == frames->end()) {
    return Problem(404, "the capture has no camera '" + camera + "'");
  }
  if (found->file.empty()) {
    return Problem(404, "camera '" + camera + "' gave no picture: " + found->status);
  }
  return FileAnswer(parts.store.options().state_folder / found->file, "image/png");
}

/// The reconstruction that speaks for the capture.
struct BestReconstruction {
  fs::path folder;
  std::string verdict;  // empty: its method gives none
};
Result<BestReconstruction> FindBest(const ApiParts& parts, const std::string& id) {
  ROTUNDA_ASSIGN_OR_RETURN(const CaptureRecord capture, FindCapture(parts.store, id));
  if (capture.reconstruction) {
    return BestReconstruction{parts.store.ReconstructionFolder(*capture.reconstruction),
                              capture.verdict};
  }
  return Error{ErrorCode::kNotFound,
               "it is not reconstructed yet; see /v1/jobs, or POST to its reconstructions", id};
}

HttpResponse ResultFile(const ApiParts& parts, const ApiRequest& request, const std::string& file,
                        const std::string& content_type) {
  const auto best = FindBest(parts, request.path.at("capture"));
  return best ? FileAnswer(best->folder / file, content_type) : Problem(best.error());
}

/// A folder that goes with the object.
class ScratchFolder {
 public:
  ScratchFolder() {
    std::error_code failure;
    std::string name = (fs::temp_directory_path(failure) / "rotunda-export-XXXXXX").string();
    if (!failure && mkdtemp(name.data()) != nullptr) path_ = name;
  }
  ~ScratchFolder() {
    std::error_code ignored;
    if (!path_.empty()) fs::remove_all(path_, ignored);
  }
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;
  const fs::path& path() const { return path_; }  // empty: it could not be made

 private:
  fs::path path_;
};

/// A few of what costs memory: each is taken as long as there is one and comes back by itself.
class Places {
 public:
  explicit Places(int count) : free_(std::make_shared<std::atomic<int>>(count)) {}
  /// Null: none is left.
  std::shared_ptr<const void> Take() const {
    if (--*free_ < 0) {
      ++*free_;
      return nullptr;
    }
    return {free_.get(), [free = free_](const void*) { ++*free; }};
  }

 private:
  std::shared_ptr<std::atomic<int>> free_;
};

/// What exports are made with.
struct Exporter {
  std::mutex one;  // an export takes a handler's thread for some seconds
  Places archives{kMaxArchives};
};

/// The reconstruction as `format`, a tar archive.
Result<std::string> Archive(const fs::path& reconstruction, const std::string& format) {
  const ScratchFolder scratch;
  if (scratch.path().empty()) {
    return Error{ErrorCode::kIo, "no folder can be made for temporary files", format};
  }
  const Result<ExportedModel> exported = ExportModel(reconstruction, format, scratch.path());
  return exported ? TarOf(scratch.path()) : exported.error();
}

/// A model that the format cannot hold is 422: the request can be read, and another format would
/// do.
HttpResponse ArchiveAnswer(const fs::path& reconstruction, const std::string& format,
                           Exporter& exporter) {
  HttpResponse response;
  response.held = exporter.archives.Take();
  if (!response.held) return Busy("others are taking as many exports as there may be");
  const std::unique_lock only(exporter.one, std::try_to_lock);
  if (!only) return Busy("another export is being made");
  Result<std::string> tar = Archive(reconstruction, format);
  if (!tar && tar.error().code == ErrorCode::kInvalidArgument) {
    return Problem(422, format + ": " + tar.error().ToString());
  }
  if (!tar) return Problem(tar.error());
  response.content_type = kAnyBytes;
  response.body = *std::move(tar);
  return response;
}

/// To be kept under a name that says what it is. Formats of other programs have no place for a
/// verdict: one that is not sure stands in the name, any in a header.
HttpResponse AsFile(HttpResponse made, const std::string& capture, const std::string& format,
                    const std::string& verdict) {
  const bool is_doubted = !verdict.empty() && verdict != "sure";
  const bool is_ply = format == kPly;
  const std::string name = capture + (is_ply ? "" : "-" + format) +
                           (is_doubted ? "-" + verdict : "") + (is_ply ? ".ply" : ".tar");
  made.headers.emplace_back(kFileName, "attachment; filename=\"" + name + "\"");
  if (!verdict.empty()) made.headers.emplace_back(kVerdict, verdict);
  return made;
}

HttpResponse Export(const ApiParts& parts, const ApiRequest& request,
                    const std::shared_ptr<Exporter>& exporter) {
  const std::string& capture = request.path.at("capture");
  const std::string& format = request.query.at("format");
  const auto best = FindBest(parts, capture);
  if (!best) return Problem(best.error());
  const auto as_file = [capture, format, verdict = best->verdict](HttpResponse made) {
    return made.status == 200 ? AsFile(std::move(made), capture, format, verdict) : made;
  };
  if (format == kPly) return as_file(FileAnswer(best->folder / "points.ply", kAnyBytes));
  return BulkAnswer([folder = best->folder, format, exporter, as_file] {
    return as_file(ArchiveAnswer(folder, format, *exporter));
  });
}

/// kNotFound when it is not there, unless the same was asked for before: that is known as long as
/// its job is, also when its capture is gone.
Status CheckCapture(Store& store, const std::string& id, const ApiRequest& request) {
  const std::string key = request.http.Header("idempotency-key");
  if (!key.empty()) {
    ROTUNDA_ASSIGN_OR_RETURN(const std::optional<JobRecord> known, FindJobByKey(store, key));
    if (known) return {};
  }
  ROTUNDA_RETURN_IF_ERROR(FindCapture(store, id));
  return {};
}

/// The body with the capture of the path in it.
HttpResponse StartReconstruction(const ApiParts& parts, const ApiRequest& request) {
  const std::string& id = request.path.at("capture");
  if (const Status there = CheckCapture(parts.store, id, request); !there.ok()) {
    return Problem(there.error());
  }
  Result<nlohmann::json> body = BodyObject(request.http.body);
  if (body && body->contains("capture")) {
    return Problem(422, "body: 'capture' is not known here; the path says which");
  }
  if (body) (*body)["capture"] = id;
  return SubmitJob(parts, JobKind::kReconstruction, body, request);
}

/// What reads one capture.
std::vector<Route> OneCaptureRoutes(const ApiParts& parts) {
  const auto exporter = std::make_shared<Exporter>();
  return {
      {.method = "GET",
       .path = "/v1/captures/{capture}",
       .operation = "getCapture",
       .summary = "One capture, its frames and newest reconstructions",
       .schema = "CaptureDetail",
       .handle =
           [parts](const ApiRequest& request) { return One(parts, request.path.at("capture")); }},
      {.method = "GET",
       .path = "/v1/captures/{capture}/frames/{camera}.png",
       .operation = "getFrame",
       .summary = "A picture as the sensor gave it (Bayer stays Bayer)",
       .content_type = "image/png",
       .handle = [parts](const ApiRequest& request) { return Picture(parts, request); }},
      {.method = "GET",
       .path = "/v1/captures/{capture}/poses",
       .operation = "getPoses",
       .summary = "Camera poses of the capture's `reconstruction` (rotunda-poses/1)",
       .schema = "Poses",
       .handle =
           [parts](const ApiRequest& request) {
             return ResultFile(parts, request, "poses.json", "application/json");
           }},
      {.method = "GET",
       .path = "/v1/captures/{capture}/report",
       .operation = "getReport",
       .summary = "The page of the capture's `reconstruction`, for a browser",
       .content_type = "text/html; charset=utf-8",
       .handle =
           [parts](const ApiRequest& request) {
             return ResultFile(parts, request, "report.html", "text/html; charset=utf-8");
           }},
      {.method = "GET",
       .path = "/v1/captures/{capture}/export",
       .operation = "getExport",
       .summary =
           "The capture's `reconstruction` for other programs: a tar archive, or the PLY file. A "
           "verdict that is not sure is in the file's name, too",
       .query = {{"format", "What to write", ExportFormats(), true}},
       .content_type = kAnyBytes,
       .headers = {{kFileName, "attachment, with a name for the file"},
                   {kVerdict, "sure, unsure or folded; absent: its method gives none", false}},
       .refusals = {{422,
                     "The format cannot hold the model: `detail` names the camera, its lens "
                     "model, and the lens models that the format holds"}},
       .handle = [parts, exporter](const ApiRequest& request) {
         return Export(parts, request, exporter);
       }}};
}

}  // namespace

std::vector<Route> CaptureRoutes(const ApiParts& parts) {
  std::vector<Route> routes = {
      {.method = "POST",
       .path = "/v1/captures",
       .role = Role::kOperator,
       .operation = "startCapture",
       .summary = "Queue a shot of all cameras; it is reconstructed afterwards unless told not to",
       .request_schema = "CaptureRequest",
       .status = 202,
       .schema = "Job",
       .headers = {JobLocation()},
       .handle =
           [parts](const ApiRequest& request) {
             return SubmitJob(parts, JobKind::kCapture, BodyObject(request.http.body), request);
           }},
      {.method = "GET",
       .path = "/v1/captures",
       .operation = "listCaptures",
       .summary = "Captures, newest first",
       .query = PageQuery(),
       .schema = "CapturePage",
       .handle = [parts](const ApiRequest& request) { return List(parts, request); }},
      {.method = "GET",
       .path = "/v1/captures/{capture}/reconstructions",
       .operation = "listReconstructions",
       .summary = "Reconstructions of the capture, newest first",
       .query = PageQuery(),
       .schema = "ReconstructionPage",
       .handle = [parts](const ApiRequest& request) { return Reconstructions(parts, request); }},
      {.method = "POST",
       .path = "/v1/captures/{capture}/reconstructions",
       .role = Role::kOperator,
       .operation = "startReconstruction",
       .summary = "Queue a reconstruction of the capture",
       .request_schema = "ReconstructionRequest",
       .status = 202,
       .schema = "Job",
       .headers = {JobLocation()},
       .handle =
           [parts](const ApiRequest& request) { return StartReconstruction(parts, request); }},
      {.method = "GET",
       .path = "/v1/reconstructions/{reconstruction}",
       .operation = "getReconstruction",
       .summary = "One reconstruction",
       .schema = "Reconstruction",
       .handle = [parts](const ApiRequest& request) {
         return JsonAnswer(FindReconstruction(parts.store, request.path.at("reconstruction")));
       }}};
  for (Route& route : OneCaptureRoutes(parts)) routes.push_back(std::move(route));
  return routes;
}

}  // namespace rotunda::daemon
