#include "config/toml_reader.h"

#include <algorithm>
#include <limits>
#include <sstream>

#include "sfm/core/rigid3.h"

namespace rotunda::config {
namespace {

template <typename Items, typename Name>
std::string ListOf(const Items& items, const Name& name) {
  std::string list;
  for (const auto& item : items) list += (list.empty() ? "" : ", ") + std::string(name(item));
  return list;
}

/// "an array".
std::string Describe(const toml::node& node) {
  std::ostringstream text;
  text << node.type();
  const std::string type = text.str();
  const bool vowel = std::string_view("aeiou").find(type[0]) != std::string_view::npos;
  return (vowel ? "an " : "a ") + type;
}

double FromUnit(double value, Unit unit) {
  if (unit == Unit::kMillimetres) return 1e-3 * value;
  return unit == Unit::kDegrees ? RadFromDeg(value) : value;
}

}  // namespace

Result<TomlFile> TomlFile::Parse(const std::string& text, const std::string& source) {
  try {
    return TomlFile(toml::parse(text, source), source);
  } catch (const toml::parse_error& error) {
    return Error{ErrorCode::kBadInput, std::string(error.description()),
                 source + ":" + std::to_string(error.source().begin.line)};
  }
}

size_t TomlFile::LineOf(const toml::node& node) { return node.source().begin.line; }

Error TomlFile::At(const toml::node& node, const std::string& key,
                   const std::string& message) const {
  return {ErrorCode::kBadInput, message, source_ + ":" + std::to_string(LineOf(node)) + ": " + key};
}

size_t TomlFile::Count(const std::string& name) const {
  const toml::array* list = table_[name].as_array();
  return list && list->is_array_of_tables() ? list->size() : 0;
}

bool TomlFile::Has(const std::string& path) const {
  return static_cast<bool>(table_.at_path(path));
}

Status TomlFile::Read(const std::vector<Section>& sections) const {
  const std::vector<Error> problems = ReadAll(sections);
  return problems.empty() ? Status() : Status(problems.front());
}

std::vector<Error> TomlFile::ReadAll(const std::vector<Section>& sections) const {
  Problems problems;
  for (const auto& [key, node] : table_) {
    const std::string name(key.str());
    const size_t count = Count(name);
    if (count == 0) ReadNode(name, node, sections, problems);
    for (size_t i = 0; i < count; ++i) {
      ReadNode(name + "[" + std::to_string(i) + "]", *node.as_array()->get(i), sections, problems);
    }
  }
  std::vector<Error> in_order;
  for (auto& [line, problem] : problems) in_order.push_back(std::move(problem));
  return in_order;
}

void TomlFile::ReadNode(const std::string& name, const toml::node& node,
                        const std::vector<Section>& sections, Problems& problems) const {
  const auto refuse = [&](const std::string& why) {
    problems.emplace(LineOf(node), At(node, name, why));
  };
  const auto find = [&sections](const std::string& wanted) {
    return std::find_if(sections.begin(), sections.end(),
                        [&wanted](const Section& section) { return section.name == wanted; });
  };
  const auto known = find(name);
  const std::string in_list = name.substr(0, name.find('['));
  if (known == sections.end() && find(in_list) != sections.end()) {
    return refuse("is a list of tables, [[" + in_list + "]], expected one, [" + in_list + "]");
  }
  if (known == sections.end()) {
    return refuse("is not known; allowed are the tables " +
                  ListOf(sections, [](const Section& s) { return s.name; }));
  }
  if (!node.is_table()) return refuse("is " + Describe(node) + ", expected a table");
  known->each ? ReadEach(*node.as_table(), *known, problems)
              : ReadFields(*node.as_table(), *known, problems);
}

void TomlFile::ReadEach(const toml::table& table, const Section& section,
                        Problems& problems) const {
  for (const auto& [key, node] : table) {
    const std::string name = section.name + "." + std::string(key.str());
    if (node.is_table()) {
      ReadFields(*node.as_table(), {name, section.each(std::string(key.str()))}, problems);
    } else {
      problems.emplace(LineOf(node), At(node, name, "is " + Describe(node) + ", expected a table"));
    }
  }
}

void TomlFile::ReadFields(const toml::table& table, const Section& section,
                          Problems& problems) const {
  for (const auto& [key, node] : table) {
    const std::string name = section.name + "." + std::string(key.str());
    const auto field =
        std::find_if(section.fields.begin(), section.fields.end(),
                     [&key = key](const Field& candidate) { return candidate.key == key.str(); });
    if (field == section.fields.end()) {
      problems.emplace(LineOf(node),
                       At(node, name,
                          "is not known; allowed are " +
                              ListOf(section.fields, [](const Field& f) { return f.key; })));
    } else if (Status status = ReadField(node, name, *field); !status) {
      problems.emplace(LineOf(node), status.error());
    }
  }
}

Status TomlFile::ReadField(const toml::node& node, const std::string& name,
                           const Field& field) const {
  const auto expected = [&](const std::string& what) {
    return At(node, name, "is " + Describe(node) + ", expected " + what);
  };
  if (int* const* whole = std::get_if<int*>(&field.target)) {
    const auto value = node.value_exact<int64_t>();
    if (!value) return expected("an integer");
    if (*value > std::numeric_limits<int>::max() || *value < std::numeric_limits<int>::min()) {
      return At(node, name,
                "is " + std::to_string(*value) + ", expected " +
                    std::to_string(std::numeric_limits<int>::min()) + " to " +
                    std::to_string(std::numeric_limits<int>::max()) + " at most");
    }
    **whole = static_cast<int>(*value);
  } else if (double* const* number = std::get_if<double*>(&field.target)) {
    if (!node.is_number()) return expected("a number");
    **number = FromUnit(node.value<double>().value_or(0.0), field.unit);
  } else if (bool* const* flag = std::get_if<bool*>(&field.target)) {
    if (!node.is_boolean()) return expected("true or false");
    **flag = node.value<bool>().value_or(false);
  } else if (std::string* const* text = std::get_if<std::string*>(&field.target)) {
    if (!node.is_string()) return expected("a string");
    **text = node.value<std::string>().value_or("");
  } else {
    const toml::array* list = node.as_array();
    if (!list || list->size() != 3) return expected("three numbers [x, y, z]");
    for (size_t i = 0; i < 3; ++i) {
      if (!list->get(i)->is_number()) return expected("three numbers [x, y, z]");
      (*std::get<Eigen::Vector3d*>(field.target))[static_cast<Eigen::Index>(i)] =
          FromUnit(list->get(i)->value<double>().value_or(0.0), field.unit);
    }
  }
  return {};
}

Error TomlFile::Located(const Error& error) const {
  toml::node_view<const toml::node> node = table_.at_path(error.context);
  if (!node) node = table_.at_path(error.context.substr(0, error.context.rfind('.')));
  if (!node) return {ErrorCode::kBadInput, error.message, source_ + ": " + error.context};
  return At(*node.node(), error.context, error.message);
}

void TomlFile::AddLocated(const std::vector<Error>& found, std::vector<Error>& problems) const {
  const size_t read = problems.size();
  for (const Error& error : found) {
    const std::string key = ": " + error.context;
    const bool is_named = std::any_of(problems.begin(), problems.begin() + static_cast<long>(read),
                                      [&key](const Error& problem) {
                                        return problem.context.ends_with(key) ||
                                               problem.context.find(key + ".") != std::string::npos;
                                      });
    if (is_named) continue;
    Error located = Located(error);
    const auto is_same = [&located](const Error& problem) {
      return problem.context == located.context && problem.message == located.message;
    };
    if (std::none_of(problems.begin(), problems.end(), is_same)) {
      problems.push_back(std::move(located));
    }
  }
}

}  // namespace rotunda::config
