#include <algorithm>
#include <memory>
#include <mutex>

#include "daemon/api_answers.h"
#include "daemon/store_reconstructions.h"

namespace rotunda::daemon {
namespace {

using Json = nlohmann::ordered_json;

/// Each camera, with its drift where there is one.
Result<std::vector<Json>> Cameras(const ApiParts& parts) {
  ROTUNDA_ASSIGN_OR_RETURN(const std::vector<CameraDrift> drift, DriftNow(parts.store));
  std::vector<Json> cameras;
  for (const rig::CameraState& state : parts.station.States()) {
    Json& camera = cameras.emplace_back(ToJson(state));
    const auto known = std::find_if(drift.begin(), drift.end(), [&](const CameraDrift& each) {
      return each.latest.camera == state.camera;
    });
    if (known != drift.end()) camera["drift"] = ToJson(*known);
  }
  return cameras;
}

HttpResponse ListCameras(const ApiParts& parts) {
  const auto cameras = Cameras(parts);
  return cameras ? JsonAnswer(Json{{"items", *cameras}}) : Problem(cameras.error());
}

HttpResponse OneCamera(const ApiParts& parts, const std::string& name) {
  const auto cameras = Cameras(parts);
  if (!cameras) return Problem(cameras.error());
  const auto found = std::find_if(cameras->begin(), cameras->end(),
                                  [&](const Json& camera) { return camera["camera"] == name; });
  if (found == cameras->end()) return Problem(404, "there is no camera '" + name + "'");
  return JsonAnswer(*found);
}

/// A preview takes a second and a handler's thread: one at a time, so that the others stay free.
HttpResponse Preview(const ApiParts& parts, const std::string& camera, std::mutex& one) {
  const std::vector<rig::CameraState> states = parts.station.States();
  if (std::none_of(states.begin(), states.end(),
                   [&](const rig::CameraState& state) { return state.camera == camera; })) {
    return Problem(404, "there is no camera '" + camera + "'");
  }
  const std::unique_lock only(one, std::try_to_lock);
  if (!only) return Busy("another preview is being taken");
  Result<std::string> picture = parts.station.PreviewJpeg(camera);
  if (!picture) return Problem(503, picture.error().ToString());
  HttpResponse response;
  response.content_type = "image/jpeg";
  response.body = *std::move(picture);
  return response;
}

}  // namespace

std::vector<Route> CameraRoutes(const ApiParts& parts) {
  const auto one_preview = std::make_shared<std::mutex>();
  return {{.method = "GET",
           .path = "/v1/cameras",
           .operation = "listCameras",
           .summary = "Every configured camera, how it is and how far it has drifted",
           .schema = "CameraList",
           .handle = [parts](const ApiRequest&) { return ListCameras(parts); }},
          {.method = "GET",
           .path = "/v1/cameras/{camera}",
           .operation = "getCamera",
           .summary = "One camera",
           .schema = "Camera",
           .handle =
               [parts](const ApiRequest& request) {
                 return OneCamera(parts, request.path.at("camera"));
               }},
          {.method = "GET",
           .path = "/v1/cameras/{camera}/preview.jpg",
           .operation = "getPreview",
           .summary = "A picture that the camera takes now, by itself",
           .content_type = "image/jpeg",
           .handle = [parts, one_preview](const ApiRequest& request) {
             return Preview(parts, request.path.at("camera"), *one_preview);
           }}};
}

}  // namespace rotunda::daemon
