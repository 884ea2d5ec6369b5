#include "daemon/model_export.h"

#include <algorithm>
#include <cstdio>
#include <cstring>

#include "sfm/colmap_io.h"
#include "sfm/core/file_io.h"
#include "sfm/model_exchange.h"

namespace rotunda::daemon {
namespace {

namespace fs = std::filesystem;

constexpr size_t kTarBlock = 512;
constexpr size_t kTarNameLength = 100;
constexpr size_t kTarChecksumPlace = 148;
constexpr size_t kTarChecksumLength = 8;

/// IEEE Std 1003.1, pax: "ustar Interchange Format".
std::string TarHeader(const std::string& name, size_t bytes) {
  std::string header(kTarBlock, '\0');
  const auto put = [&header](size_t place, const std::string& text) {
    header.replace(place, text.size(), text);
  };
  char size[12];
  std::snprintf(size, sizeof(size), "%011zo", bytes);
  put(0, name);
  put(100, "0000644");
  put(108, "0000000");
  put(116, "0000000");
  put(124, size);
  put(136, "00000000000");
  put(156, "0");
  put(257, std::string("ustar\00000", 8));
  header.replace(kTarChecksumPlace, kTarChecksumLength, kTarChecksumLength, ' ');
  unsigned sum = 0;
  for (const char byte : header) sum += static_cast<unsigned char>(byte);
  char checksum[kTarChecksumLength];
  std::snprintf(checksum, sizeof(checksum), "%06o", sum);
  header.replace(kTarChecksumPlace, 7, checksum, 7);
  return header;
}

Status WriteModel(const sfm::ColmapModel& model, const std::string& format, const fs::path& out) {
  const sfm::Reconstruction& reconstruction = model.reconstruction;
  if (format == "ply") return sfm::WritePly(reconstruction, out / "points.ply");
  if (format == "nerfstudio") {
    return sfm::WriteNerfstudioModel(reconstruction, model.image_names, out);
  }
  if (format == "metashape") {
    return sfm::WriteMetashapeModel(reconstruction, model.image_names, out);
  }
  if (format == "realitycapture") {
    return sfm::WriteRealityCaptureModel(reconstruction, model.image_names, out);
  }
  FrameSet names;
  for (const std::string& name : model.image_names) names.frames.emplace_back().file = name;
  const auto encoding =
      format == "colmap" ? sfm::ColmapEncoding::kBinary : sfm::ColmapEncoding::kText;
  return sfm::WriteColmapModel(reconstruction, model.features, names, out, encoding);
}

}  // namespace

const std::vector<std::string>& ExportFormats() {
  static const std::vector<std::string> formats = {"colmap",    "colmap-text",    "nerfstudio",
                                                   "metashape", "realitycapture", "ply"};
  return formats;
}

Result<ExportedModel> ExportModel(const fs::path& reconstruction, const std::string& format,
                                  const fs::path& out) {
  ROTUNDA_ASSIGN_OR_RETURN(const sfm::ColmapModel model,
                           sfm::ReadColmapModel(reconstruction / "sparse" / "0"));
  ROTUNDA_RETURN_IF_ERROR(WriteModel(model, format, out));
  return ExportedModel{sfm::RegisteredCount(model.reconstruction),
                       model.reconstruction.points.size()};
}

Result<std::string> TarOf(const fs::path& folder) {
  std::vector<fs::path> files;
  std::error_code failure;
  for (const auto& entry : fs::directory_iterator(folder, failure)) {
    if (entry.is_regular_file(failure)) files.push_back(entry.path());
  }
  if (failure) return Error{ErrorCode::kIo, failure.message(), folder.string()};
  std::sort(files.begin(), files.end());
  std::string tar;
  for (const fs::path& file : files) {
    const std::string name = file.filename().string();
    if (name.size() >= kTarNameLength) {
      return Error{ErrorCode::kFailed, "the name is too long for a tar archive", file.string()};
    }
    ROTUNDA_ASSIGN_OR_RETURN(const std::string bytes, ReadFile(file));
    tar += TarHeader(name, bytes.size());
    tar += bytes;
    tar.resize((tar.size() + kTarBlock - 1) / kTarBlock * kTarBlock);
  }
  tar.resize(tar.size() + 2 * kTarBlock);  // the end
  return tar;
}

}  // namespace rotunda::daemon
