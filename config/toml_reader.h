#pragma once

#include <toml++/toml.h>

#include <Eigen/Core>
#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "sfm/core/result.h"

namespace rotunda::config {

/// What a number in the file is given in; its target is in metres or radians then.
enum class Unit { kNone, kMillimetres, kDegrees };

/// One key of a table and where its value goes.
struct Field {
  std::string_view key;
  std::variant<int*, double*, bool*, std::string*, Eigen::Vector3d*> target;
  Unit unit = Unit::kNone;
};

/// A table; "face[1]" is the second of the list of tables [[face]].
struct Section {
  std::string name;
  std::vector<Field> fields = {};
  /// For a table of tables ([cameras.c00r0], [cameras.c00r1], ...): the fields of the one with this
  /// name. `fields` is empty then.
  std::function<std::vector<Field>(const std::string& name)> each = nullptr;
};

/// A parsed TOML file; its errors name `source` and the line.
class TomlFile {
 public:
  static Result<TomlFile> Parse(const std::string& text, const std::string& source);

  /// How many tables the list [[name]] has; 0 when it is not there.
  size_t Count(const std::string& name) const;
  /// Whether the file gives "table.key" or "table".
  bool Has(const std::string& path) const;

  /// Fills in what the file gives. Any other table or key is refused. The first problem.
  Status Read(const std::vector<Section>& sections) const;
  /// The same; every problem, in the order of the file's lines.
  std::vector<Error> ReadAll(const std::vector<Section>& sections) const;

  /// The error of a Validate() whose context is "table.key", with the line the key is on, or else
  /// that of its table.
  Error Located(const Error& error) const;
  /// Adds what a Problems() found, located, but for keys of which (or of a key below which)
  /// ReadAll() has said something: their values are not those of the file. The same is said once.
  void AddLocated(const std::vector<Error>& found, std::vector<Error>& problems) const;

 private:
  TomlFile(toml::table table, std::string source)
      : table_(std::move(table)), source_(std::move(source)) {}
  /// What is wrong, by line.
  using Problems = std::multimap<size_t, Error>;
  static size_t LineOf(const toml::node& node);
  Error At(const toml::node& node, const std::string& key, const std::string& message) const;
  void ReadNode(const std::string& name, const toml::node& node,
                const std::vector<Section>& sections, Problems& problems) const;
  void ReadEach(const toml::table& table, const Section& section, Problems& problems) const;
  /// `section.name` is that of the table.
  void ReadFields(const toml::table& table, const Section& section, Problems& problems) const;
  Status ReadField(const toml::node& node, const std::string& name, const Field& field) const;

  toml::table table_;
  std::string source_;
};

}  // namespace rotunda::config
