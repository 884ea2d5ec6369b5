#include "tests/bench/disambiguation_captures.h"

#include <algorithm>
#include <cctype>
#include <cstdint>
#include <cstdio>

#include "tests/bench/bench_process.h"
#include "tests/bench/disambiguation_changes.h"
#include "tests/support/strecha.h"

namespace rotunda::bench {
namespace {

namespace fs = std::filesystem;

constexpr char kProcedural[] = "procedural";
constexpr char kObjBodies[][24] = {"Asian_F_2_Default", "Black_M_1_Milit"};
constexpr char kHeldOutBody[] = "White_M_2_Casual";
constexpr char kNoSharedData[] = "there is no folder of shared data ($ROTUNDA_SHARED)";

/// What the person wears.
struct Garment {
  const char* name;
  const char* texture;
  const char* relief;
};
constexpr Garment kUnique = {"unique", "unique", "natural"};
constexpr Garment kTwin = {"twin", "twin", "natural"};
constexpr Garment kTwinSymmetric = {"twin-symmetric", "twin", "symmetric"};
constexpr Garment kPlaid = {"plaid", "plaid", "natural"};
constexpr Garment kGarments[] = {kUnique, kTwin, kTwinSymmetric, kPlaid};

std::string ShortName(std::string body) {
  body = body.substr(0, body.find('_'));
  std::transform(body.begin(), body.end(), body.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return body;
}

Capture Simulated(const std::string& body, const Garment& garment, uint64_t seed,
                  const CaptureSize& size) {
  Capture capture;
  capture.name = ShortName(body) + "-" + garment.name + "-s" + std::to_string(seed);
  std::string body_option = body;
  if (body != kProcedural) {
    const auto shared = test::SharedFolder();
    if (!shared) {
      capture.unavailable = kNoSharedData;
      return capture;
    }
    body_option = *shared / "data" / "bodies" / body / (body + ".obj");
    if (!fs::exists(body_option)) capture.unavailable = "there is no " + body_option;
  }
  capture.garment = garment.name;
  capture.scale = size.scale;
  // The studio ties the sides of the rig together, a plain background leaves that to the person.
  const char* background = seed % 2 == 1 ? "studio" : "plain";
  capture.simulate = {"--body",       body_option,
                      "--texture",    garment.texture,
                      "--relief",     garment.relief,
                      "--background", background,
                      "--seed",       std::to_string(seed),
                      "--cameras",    std::to_string(size.cameras),
                      "--scale",      std::to_string(size.scale)};
  return capture;
}

/// colmap takes long: on all that should fold, and elsewhere on what its times are compared on.
bool WithColmap(const std::string& body, const Garment& garment, uint64_t seed) {
  if (garment.name == kTwinSymmetric.name) return true;
  return seed == 1 && (body == kProcedural || garment.name == kUnique.name);
}

/// Without face and shoes, which tell front from back in every other capture.
Capture Covered(Capture capture) {
  capture.name += "-covered";
  capture.simulate.insert(capture.simulate.end(), {"--cover", "head-and-shoes"});
  return capture;
}

Capture MadeFrom(const Capture& base, Change change, const std::string& suffix) {
  Capture capture = base;
  capture.name += "-" + suffix;
  capture.made_from = base.name;
  capture.change = change;
  return capture;
}

/// Boxes and truth are by eye.
Scene Books() {
  return {
      "the photographs go along a desk: 0000-0007 show a pile (orange book on a blue one) left "
      "of a white book, 0012-0020 the same pile right of a green book; 0008-0011, between "
      "them, show neither pile but both books",
      {{"0002", 230, 150, 640, 330}, {"0016", 570, 390, 880, 590}},
      {{"0001", "0002", "0003"}, {"0016", "0018", "0020"}}};
}
Scene Oats() {
  return {
      "the photographs go along a table: 0000-0008 show a can that stands on the table left of a "
      "yellow box, 0012-0022 the same can on a white box right of it; 0009-0011, between "
      "them, show the first one's edge and the box",
      {{"0003", 190, 150, 470, 750}, {"0016", 300, 130, 510, 630}},
      {{"0001", "0003", "0005"}, {"0014", "0016", "0019"}}};
}

/// Simulated anew only when it is not there: every capture is a function of its options.
void Simulate(const Capture& capture, const CaptureFiles& files) {
  if (fs::exists(files.frameset)) return;
  fs::create_directories(files.frameset.parent_path());
  std::vector<std::string> command = {ROTUNDA_COMMAND, "simulate", files.frameset};
  command.insert(command.end(), capture.simulate.begin(), capture.simulate.end());
  RunOrDie(command);
}

}  // namespace

std::vector<Capture> MeanCaptures(const CaptureSize& size) {
  std::vector<Capture> captures;
  for (const std::string body : {kProcedural, kObjBodies[0], kObjBodies[1]}) {
    for (const Garment& garment : kGarments) {
      for (const uint64_t seed : {1, 2}) {
        Capture capture = Simulated(body, garment, seed, size);
        capture.with_colmap = WithColmap(body, garment, seed);
        captures.push_back(capture);
      }
    }
  }
  for (const uint64_t seed : {3, 4, 5, 6, 7, 8}) {
    Capture capture = Simulated(kProcedural, kTwinSymmetric, seed, size);
    capture.with_colmap = true;
    captures.push_back(capture);
  }
  return captures;
}

std::vector<Capture> FullSizeCaptures(const CaptureSize& size) {
  const CaptureSize full{size.cameras, 1.0};
  std::vector<Capture> captures = {
      Simulated(kProcedural, kUnique, 1, full), Simulated(kProcedural, kTwinSymmetric, 1, full),
      Simulated(kObjBodies[0], kTwinSymmetric, 1, full), Simulated(kObjBodies[1], kPlaid, 1, full)};
  for (Capture& capture : captures) capture.name += "-full";
  return captures;
}

std::vector<Capture> HeldOutCaptures(const CaptureSize& size) {
  std::vector<Capture> captures;
  for (const uint64_t seed : {101, 102}) {
    for (const Garment& garment : kGarments) {
      captures.push_back(Simulated(kHeldOutBody, garment, seed, size));
    }
    for (const std::string body : {kProcedural, kObjBodies[0], kObjBodies[1]}) {
      captures.push_back(Simulated(body, kTwinSymmetric, seed, size));
    }
  }
  return captures;
}

std::vector<Capture> StressCaptures(const CaptureSize& size) {
  std::vector<Capture> captures;
  for (const uint64_t seed : {1, 2}) {
    const Capture base = Simulated(kProcedural, kTwinSymmetric, seed, size);
    captures.push_back(MadeFrom(base, Change::kThinnedToHalf, "half"));
    captures.push_back(MadeFrom(base, Change::kThinnedToQuarter, "quarter"));
    captures.push_back(MadeFrom(base, Change::kMissing, "missing"));
    captures.push_back(MadeFrom(base, Change::kMoved, "moved"));
    captures.push_back(MadeFrom(base, Change::kSwapped, "swapped"));
    captures.push_back(Covered(base));
  }
  return captures;
}

std::vector<Capture> AblationCaptures(const CaptureSize& size) {
  return {Simulated(kProcedural, kUnique, 1, size),
          Simulated(kProcedural, kTwinSymmetric, 1, size),
          Simulated(kProcedural, kTwinSymmetric, 2, size),
          Simulated(kProcedural, kTwinSymmetric, 3, size),
          Simulated(kObjBodies[0], kUnique, 1, size),
          Simulated(kObjBodies[0], kTwinSymmetric, 1, size),
          Simulated(kObjBodies[1], kTwinSymmetric, 2, size)};
}

std::vector<Capture> PhotographCaptures() {
  std::vector<Capture> captures;
  const auto shared = test::SharedFolder();
  for (const auto& [name, scene] : {std::pair{"books", Books()}, std::pair{"oats", Oats()}}) {
    Capture& capture = captures.emplace_back();
    capture.name = name;
    capture.scene = scene;
    if (shared) capture.photographs = *shared / "data" / "ambiguous" / name;
    if (!shared) capture.unavailable = kNoSharedData;
    if (shared && !fs::exists(capture.photographs)) {
      capture.unavailable = "there is no " + capture.photographs.string();
    }
  }
  return captures;
}

CaptureFiles FilesOf(const Capture& capture, const fs::path& work) {
  const fs::path folder = work / "captures" / capture.name;
  CaptureFiles files;
  files.frameset = capture.photographs.empty() ? folder : capture.photographs;
  files.stages = work / "stages" / capture.name;
  files.truth = folder / "truth.json";
  files.expected = folder / "expected.json";
  return files;
}

void PrepareCapture(const Capture& capture, const fs::path& work) {
  if (!capture.photographs.empty()) return;
  const CaptureFiles files = FilesOf(capture, work);
  if (capture.change == Change::kNone) {
    Simulate(capture, files);
    return;
  }
  Capture base;
  base.name = capture.made_from;
  base.simulate = capture.simulate;
  PrepareCapture(base, work);
  PrepareStages(FilesOf(base, work), {});
  MakeChanged(capture, FilesOf(base, work), files);
}

std::vector<std::string> ReconstructCommand(const CaptureFiles& files,
                                            const std::vector<std::string>& options,
                                            const fs::path& out) {
  std::vector<std::string> command = {
      ROTUNDA_COMMAND, "reconstruct", files.frameset, "--stages", files.stages,
      "--out",         out,           "--json"};
  command.insert(command.end(), options.begin(), options.end());
  for (const auto& [file, stage] : {std::pair{"two_views.bin", "two-views"},
                                    {"matches.bin", "matches"},
                                    {"features.bin", "features"}}) {
    if (!fs::exists(files.stages / file)) continue;
    command.insert(command.end(), {"--start-from", stage});
    break;
  }
  return command;
}

void PrepareStages(const CaptureFiles& files, const std::vector<std::string>& options) {
  if (fs::exists(files.stages / "two_views.bin")) return;
  // What an interrupted run left was made, but would not be made again, with the options.
  if (!options.empty()) fs::remove_all(files.stages);
  fs::create_directories(files.stages.parent_path());
  std::vector<std::string> plain = {"--method", "plain"};
  plain.insert(plain.end(), options.begin(), options.end());
  std::fprintf(stderr, "making %s ...\n", files.stages.c_str());
  const test::TemporaryFolder unused;
  const test::ProcessOutcome run =
      test::RunProcess(ReconstructCommand(files, plain, unused / "out"));
  // What comes after them may fail.
  if (!fs::exists(files.stages / "two_views.bin")) {
    Die(files.stages.string() + ": no two-view geometries: " + run.errors);
  }
}

}  // namespace rotunda::bench
