#include "sfm/core/frame_set.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <system_error>

#include "sfm/core/camera.h"
#include "sfm/core/file_io.h"
#include "sfm/core/json_reader.h"
#include "sfm/core/json_types.h"

namespace rotunda {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr char kManifestName[] = "frameset.json";
constexpr size_t kMaxNameLength = 255;
constexpr std::array<std::string_view, 8> kPictureEndings = {".png",  ".jpg", ".jpeg", ".tif",
                                                             ".tiff", ".bmp", ".ppm",  ".pgm"};

Error BadInput(const std::string& message, const std::string& context) {
  return {ErrorCode::kBadInput, message, context};
}

bool HasControlCharacter(const std::string& text) {
  return std::any_of(text.begin(), text.end(),
                     [](unsigned char c) { return c < 0x20 || c == 0x7F; });
}

/// What is wrong with a camera's name; empty when nothing is. Cameras name files.
std::string CameraNameProblem(const std::string& name) {
  if (name.empty()) return "is empty";
  if (name.size() > kMaxNameLength) return "is longer than 255 bytes";
  if (HasControlCharacter(name)) return "has control characters";
  if (name.find('/') != std::string::npos) return "has a slash";
  if (name == "." || name == "..") return "is not a name";
  return "";
}

/// What is wrong with a picture's path relative to its set; empty when nothing is.
std::string FileProblem(const std::string& file) {
  if (file.empty()) return "is empty";
  if (HasControlCharacter(file)) return "has control characters";
  const fs::path path(file);
  if (path.is_absolute()) return "is an absolute path";
  if (!path.has_filename()) return "names a folder";
  for (const fs::path& part : path) {
    if (part == "..") return "leads out of the folder";
    if (part == ".") return "has a \".\" in it";
  }
  return "";
}

Json FrameJson(const Frame& frame) {
  Json object;
  object["camera"] = frame.camera;
  object["serial"] = frame.serial;
  object["file"] = frame.file;
  object["width"] = frame.width_px;
  object["height"] = frame.height_px;
  object["pixel_format"] = frame.pixel_format;
  object["exposure_us"] = frame.exposure_us;
  object["gain_db"] = frame.gain_db;
  object["frame_id"] = frame.frame_id;
  object["timestamp_ns"] = frame.timestamp_ns;
  object["status"] = frame.status;
  object["xxh3"] = frame.xxh3;
  return object;
}

bool IsXxh3(const std::string& text) {
  const auto is_digit = [](char c) { return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f'); };
  return text.empty() || (text.size() == 16 && std::all_of(text.begin(), text.end(), is_digit));
}

/// A frame that is not "ok" may lack its file, size and sum: there may be no picture.
Frame ReadFrame(const JsonField& object) {
  Frame frame;
  frame.status = object["status"].String();
  const bool is_ok = frame.status == "ok";
  frame.camera = object["camera"].String();
  if (const std::string problem = CameraNameProblem(frame.camera); !problem.empty()) {
    object["camera"].Refuse("a camera's name, but it " + problem);
  }
  frame.serial = object["serial"].String();
  frame.file = object["file"].String();
  if (const std::string problem = FileProblem(frame.file);
      !problem.empty() && (is_ok || !frame.file.empty())) {
    object["file"].Refuse("a path below the frame set's folder, but it " + problem);
  }
  frame.width_px = static_cast<int>(object["width"].Unsigned(is_ok ? 1 : 0, kMaxPictureSide_px));
  frame.height_px = static_cast<int>(object["height"].Unsigned(is_ok ? 1 : 0, kMaxPictureSide_px));
  frame.pixel_format = object["pixel_format"].String();
  frame.exposure_us = object["exposure_us"].Number();
  frame.gain_db = object["gain_db"].Number();
  frame.frame_id = object["frame_id"].Unsigned();
  frame.timestamp_ns = object["timestamp_ns"].Unsigned();
  frame.xxh3 = object["xxh3"].String();
  if (!IsXxh3(frame.xxh3)) object["xxh3"].Refuse("16 hexadecimal digits");
  return frame;
}

TriggerValue ReadTriggerValue(const JsonField& field) {
  const nlohmann::json& value = *field.value();
  if (value.is_string()) return value.get<std::string>();
  if (value.is_boolean()) return value.get<bool>();
  if (value.is_number_unsigned()) return value.get<uint64_t>();
  if (value.is_number_integer()) return value.get<int64_t>();
  if (value.is_number()) return value.get<double>();
  field.Refuse("a string, a number, true or false");
  return {};
}

std::string SizeText(const Frame& frame) {
  return std::to_string(frame.width_px) + "x" + std::to_string(frame.height_px);
}

/// A camera takes one picture, a picture is one camera's.
void CheckUnique(const JsonField& frames_field, const std::vector<Frame>& frames) {
  std::map<std::string, size_t> by_camera;
  std::map<std::string, size_t> by_file;
  const std::vector<JsonField> items = frames_field.Items();
  for (size_t i = 0; i < frames.size(); ++i) {
    const Frame& frame = frames[i];
    const auto [twin, is_new] = by_camera.emplace(frame.camera, i);
    const Frame& first = frames[twin->second];
    const std::string place = "frames[" + std::to_string(twin->second) + "]";
    if (!is_new && SizeText(first) != SizeText(frame)) {
      items[i]["camera"].Fail("camera \"" + frame.camera + "\" occurs with two sizes, " +
                              SizeText(first) + " in " + place + " and " + SizeText(frame) +
                              " here");
    } else if (!is_new) {
      items[i]["camera"].Fail("camera \"" + frame.camera + "\" is already " + place +
                              "; expected one frame a camera");
    }
    if (frame.file.empty()) continue;
    const auto [owner, is_free] = by_file.emplace(fs::path(frame.file).lexically_normal(), i);
    if (!is_free) {
      items[i]["file"].Fail("\"" + frame.file + "\" is already the picture of camera \"" +
                            frames[owner->second].camera + "\"");
    }
  }
}

void SortByCamera(std::vector<Frame>& frames) {
  std::sort(frames.begin(), frames.end(),
            [](const Frame& a, const Frame& b) { return a.camera < b.camera; });
}

Result<FrameSet> ReadManifest(const fs::path& folder) {
  const fs::path manifest = folder / kManifestName;
  ROTUNDA_ASSIGN_OR_RETURN(const std::string text, ReadFile(manifest));
  ROTUNDA_ASSIGN_OR_RETURN(FrameSet set, FrameSetFromJson(text, manifest.string()));
  for (const Frame& frame : set.frames) {
    std::error_code error;
    if (frame.status == "ok" && !fs::is_regular_file(folder / frame.file, error)) {
      return BadInput("camera \"" + frame.camera + "\" is listed as ok, but its file \"" +
                          frame.file + "\" is not there; " + HowToLeaveOut(set),
                      manifest.string());
    }
  }
  set.folder = folder;
  return set;
}

bool IsPictureName(const fs::path& file) {
  std::string ending = file.extension().string();
  for (char& c : ending) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return file.filename().string().front() != '.' &&
         std::find(kPictureEndings.begin(), kPictureEndings.end(), ending) != kPictureEndings.end();
}

/// Names of the pictures in a folder, sorted.
Result<std::vector<std::string>> ListPictures(const fs::path& folder) {
  std::vector<std::string> names;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    if (!IsPictureName(entry->path())) continue;
    std::error_code status_error;
    const fs::file_status status = entry->status(status_error);
    if (status.type() == fs::file_type::not_found) {
      return BadInput("is a link that leads nowhere", entry->path().string());
    }
    if (fs::is_regular_file(status)) names.push_back(entry->path().filename().string());
  }
  if (error) return Error{ErrorCode::kIo, "cannot list: " + error.message(), folder.string()};
  std::sort(names.begin(), names.end());
  return names;
}

/// The folder with its own pictures, or those of "images" or "frames" below it.
Result<std::vector<std::string>> FindPictures(const fs::path& folder) {
  for (const std::string below : {"", "images", "frames"}) {
    std::error_code error;
    if (!fs::is_directory(folder / below, error)) continue;
    ROTUNDA_ASSIGN_OR_RETURN(std::vector<std::string> names, ListPictures(folder / below));
    for (std::string& name : names) name = fs::path(below) / name;
    if (!names.empty()) return names;
  }
  return BadInput("expected frameset.json or pictures (png, jpg, tif, bmp, ppm, pgm), found none",
                  folder.string());
}

Result<FrameSet> FrameSetOfPictures(const fs::path& folder) {
  ROTUNDA_ASSIGN_OR_RETURN(const std::vector<std::string> files, FindPictures(folder));
  FrameSet set;
  set.folder = folder;
  set.plain_folder = true;
  std::error_code error;
  const fs::path place = fs::absolute(folder, error).lexically_normal();
  if (error) {
    return Error{ErrorCode::kIo, "cannot tell the folder's absolute path: " + error.message(),
                 folder.string()};
  }
  set.id = (place.has_filename() ? place : place.parent_path()).filename().string();
  std::map<std::string, std::string> file_of_camera;
  for (const std::string& file : files) {
    Frame frame;
    frame.camera = fs::path(file).stem().string();
    frame.file = file;
    frame.pixel_format = "RGB8";
    if (HasControlCharacter(file) || !IsUtf8(file)) {
      return BadInput("expected a file name of printable UTF-8", (folder / file).string());
    }
    const auto [twin, is_new] = file_of_camera.emplace(frame.camera, file);
    if (!is_new) {
      return BadInput("camera \"" + frame.camera + "\" has two pictures, \"" + twin->second +
                          "\" and \"" + file + "\"; expected one a camera",
                      folder.string());
    }
    set.frames.push_back(std::move(frame));
  }
  SortByCamera(set.frames);
  return set;
}

}  // namespace

Result<FrameSet> ReadFrameSet(const fs::path& folder) {
  std::error_code error;
  const fs::file_status status = fs::status(folder, error);
  if (status.type() == fs::file_type::not_found) {
    return Error{ErrorCode::kNotFound, "no such folder", folder.string()};
  }
  if (error) return Error{ErrorCode::kIo, "cannot open: " + error.message(), folder.string()};
  if (!fs::is_directory(status)) {
    return BadInput("expected a frame set's folder or a folder of pictures, found a file",
                    folder.string());
  }
  if (fs::exists(fs::symlink_status(folder / kManifestName, error))) return ReadManifest(folder);
  return FrameSetOfPictures(folder);
}

std::string HowToLeaveOut(const FrameSet& set) {
  return set.plain_folder ? "without that file the folder's other pictures are used"
                          : "a frame with \"status\": \"missing\" in frameset.json is left out";
}

std::string FrameSetToJson(const FrameSet& set) {
  Json root;
  root["format"] = kFrameSetFormat;
  root["id"] = set.id;
  root["captured_at"] = set.captured_at;
  if (set.subject) root["subject"] = *set.subject;
  root["trigger"] = Json::object();
  for (const auto& [key, value] : set.trigger) {
    std::visit([&, &name = key](const auto& plain) { root["trigger"][name] = plain; }, value);
  }
  root["frames"] = Json::array();
  for (const Frame& frame : set.frames) root["frames"].push_back(FrameJson(frame));
  return JsonText(root);
}

Result<FrameSet> FrameSetFromJson(const std::string& text, const std::string& source) {
  ROTUNDA_ASSIGN_OR_RETURN(const nlohmann::json json, ParseJson(text, source));
  JsonReader reader(source, json);
  const JsonField root = reader.root();
  root.ExpectFormat(kFrameSetFormat);
  FrameSet set;
  set.id = root["id"].String();
  set.captured_at = root["captured_at"].String();
  if (root["subject"].present()) set.subject = root["subject"].String();
  for (const auto& [key, value] : root["trigger"].Members()) {
    set.trigger[key] = ReadTriggerValue(value);
  }
  for (const JsonField& item : root["frames"].Items()) set.frames.push_back(ReadFrame(item));
  if (set.frames.empty()) root["frames"].Refuse("at least one frame");
  CheckUnique(root["frames"], set.frames);
  ROTUNDA_RETURN_IF_ERROR(reader.status());
  SortByCamera(set.frames);
  return set;
}

}  // namespace rotunda
