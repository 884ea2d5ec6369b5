#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

// Who may include whom. A folder's own files are always allowed; the row with the longest prefix
// counts. Own headers stand in quotes; of the libraries in <>, some may not stand in the headers of
// the engine and the rig, whose users need not have them.

namespace {

namespace fs = std::filesystem;

struct Rule {
  std::string folder;
  std::vector<std::string> may_include;
  std::vector<std::string> but_not;
};

const std::vector<Rule>& Rules() {
  static const std::vector<Rule> rules = {
      {"sfm/core/", {"sfm/core/"}, {}},
      {"sfm/", {"sfm/", "sfm/core/"}, {}},
      {"rig/", {"rig/", "sfm/core/"}, {"rig/sim/"}},
      {"rig/sim/", {"rig/", "sfm/core/"}, {}},
      {"config/", {"config/", "rig/", "sfm/", "sfm/core/"}, {}},
      {"daemon/", {"daemon/", "config/", "rig/", "sfm/", "sfm/core/"}, {}},
      {"tests/", {""}, {}},
  };
  return rules;
}

bool StartsWith(const std::string& text, const std::string& prefix) {
  return text.compare(0, prefix.size(), prefix) == 0;
}

const Rule* RuleOf(const std::string& file) {
  const Rule* best = nullptr;
  for (const Rule& rule : Rules()) {
    if (StartsWith(file, rule.folder) &&
        (best == nullptr || rule.folder.size() > best->folder.size())) {
      best = &rule;
    }
  }
  return best;
}

bool Allowed(const Rule& rule, const std::string& included) {
  const auto matches = [&](const std::string& prefix) { return StartsWith(included, prefix); };
  return std::any_of(rule.may_include.begin(), rule.may_include.end(), matches) &&
         std::none_of(rule.but_not.begin(), rule.but_not.end(), matches);
}

const std::vector<std::string>& PrivateLibraries() {
  static const std::vector<std::string> prefixes = {"ceres/", "sqlite3", "boost/"};
  return prefixes;
}

struct Include {
  std::string name;
  bool quoted = true;
};

/// What `#include "name"` or `#include <name>` includes; nullopt for any other line.
std::optional<Include> IncludeIn(const std::string& line) {
  const size_t hash = line.find_first_not_of(" \t");
  if (hash == std::string::npos || line[hash] != '#') return std::nullopt;
  const size_t word = line.find_first_not_of(" \t", hash + 1);
  if (word == std::string::npos || line.compare(word, 7, "include") != 0) return std::nullopt;
  const size_t open = line.find_first_of("\"<", word);
  if (open == std::string::npos) return std::nullopt;
  const bool quoted = line[open] == '"';
  const size_t close = line.find(quoted ? '"' : '>', open + 1);
  if (close == std::string::npos) return std::nullopt;
  return Include{line.substr(open + 1, close - open - 1), quoted};
}

bool IsPublicHeader(const std::string& file) {
  return file.ends_with(".h") && (StartsWith(file, "sfm/") || StartsWith(file, "rig/"));
}

/// What is wrong with one include of a file; empty when nothing is.
std::string Problem(const std::string& file, const Rule& rule, const Include& include) {
  const std::string& name = include.name;
  if (include.quoted) {
    if (RuleOf(name) == nullptr) return "\"" + name + "\" is not named from the root";
    return Allowed(rule, name) ? "" : "must not include \"" + name + "\"";
  }
  if (RuleOf(name) != nullptr) return "<" + name + "> is an own header: it belongs in quotes";
  const auto matches = [&](const std::string& prefix) { return StartsWith(name, prefix); };
  const bool is_private =
      std::any_of(PrivateLibraries().begin(), PrivateLibraries().end(), matches);
  return is_private && IsPublicHeader(file) ? "a header must not include <" + name + ">" : "";
}

/// What is wrong with the includes of one file, one line a finding.
std::vector<std::string> Violations(const std::string& file, const std::string& text) {
  std::vector<std::string> violations;
  const Rule* rule = RuleOf(file);
  if (rule == nullptr) return {file + " lies in a folder that has no rule"};
  std::istringstream lines(text);
  size_t number = 0;
  for (std::string line; std::getline(lines, line);) {
    ++number;
    const auto include = IncludeIn(line);
    const std::string problem = include ? Problem(file, *rule, *include) : "";
    if (!problem.empty())
      violations.push_back(file + ":" + std::to_string(number) + ": " + problem);
  }
  return violations;
}

bool IsSource(const fs::path& file) {
  return file.extension() == ".h" || file.extension() == ".cc";
}

std::vector<fs::path> Sources() {
  std::vector<fs::path> sources;
  for (const char* top : {"sfm", "rig", "config", "daemon", "tests"}) {
    for (const auto& entry : fs::recursive_directory_iterator(fs::path(ROTUNDA_SOURCE_DIR) / top)) {
      if (entry.is_regular_file() && IsSource(entry.path())) sources.push_back(entry.path());
    }
  }
  return sources;
}

TEST(IncludeRules, TheTreeKeepsThem) {
  const std::vector<fs::path> sources = Sources();
  EXPECT_GT(sources.size(), 50u) << "the sources were not found";
  for (const fs::path& source : sources) {
    std::ifstream stream(source);
    std::stringstream text;
    text << stream.rdbuf();
    const std::string name = fs::relative(source, ROTUNDA_SOURCE_DIR).generic_string();
    for (const std::string& violation : Violations(name, text.str())) {
      ADD_FAILURE() << violation;
    }
  }
}

struct Example {
  const char* file;
  const char* line;
  bool allowed;
};

TEST(IncludeRules, TheCheckerTellsGoodFromBad) {
  const std::vector<Example> examples = {
      {"sfm/core/camera.cc", "#include \"sfm/core/camera.h\"", true},
      {"sfm/core/camera.cc", "#include \"sfm/features.h\"", false},
      {"sfm/core/camera.cc", "#include \"rig/camera.h\"", false},
      {"sfm/features.cc", "#include \"sfm/core/ids.h\"", true},
      {"sfm/features.cc", "  #  include \"rig/board.h\"", false},
      {"sfm/features.cc", "#include \"config/sfm_options.h\"", false},
      {"rig/capture.cc", "#include \"sfm/core/frame_set.h\"", true},
      {"rig/capture.cc", "#include \"sfm/features.h\"", false},
      {"rig/capture.cc", "#include \"rig/sim/world.h\"", false},
      {"rig/sim/world.cc", "#include \"rig/camera.h\"", true},
      {"rig/sim/world.cc", "#include \"sfm/incremental.h\"", false},
      {"config/load.cc", "#include \"rig/sim/rig_options.h\"", true},
      {"config/load.cc", "#include \"daemon/store.h\"", false},
      {"daemon/cli/main.cc", "#include \"config/load.h\"", true},
      {"daemon/cli/main.cc", "#include \"tests/support/process.h\"", false},
      {"tests/sfm/x_test.cc", "#include \"daemon/store.h\"", true},
      {"sfm/features.cc", "#include \"features.h\"", false},
      {"sfm/features.cc", "#include <sfm_of_others.h>", true},
      {"sfm/features.cc", "#include <sfm/core/ids.h>", false},
      {"daemon/cli/main.cc", "#include  <config/load.h>", false},
      {"sfm/features.cc", "#include <ceres/ceres.h>", true},
      {"sfm/features.h", "#include <ceres/ceres.h>", false},
      {"sfm/core/camera.h", "#include <ceres/jet.h>", false},
      {"sfm/colmap_io.h", "#include <sqlite3.h>", false},
      {"rig/sim/world.h", "#include <boost/graph/adjacency_list.hpp>", false},
      {"sfm/features.h", "#include <vector>", true},
      {"tests/support/world.h", "#include <ceres/ceres.h>", true},
      {"sfm/features.cc", "// #include \"rig/board.h\" in a comment", true},
      {"tools/x.cc", "", false},
  };
  for (const Example& example : examples) {
    EXPECT_EQ(Violations(example.file, std::string("#pragma once\n") + example.line).empty(),
              example.allowed)
        << example.file << ": " << example.line;
  }
  EXPECT_EQ(Violations("sfm/core/a.h", "\n#include \"sfm/tracks.h\"\n"),
            std::vector<std::string>{"sfm/core/a.h:2: must not include \"sfm/tracks.h\""});
}

}  // namespace
