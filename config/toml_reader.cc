#include "config/toml_reader.h"

#include <algorithm>
#include <limits>
#include <sstream>

namespace rotunda::config {
namespace {

template <typename Items, typename Name>
std::string ListOf(const Items& items, const Name& name) {
  std::string list;
  for (const auto& item : items) list += (list.empty() ? "" : ", ") + std::string(name(item));
  return list;
}

std::string Describe(const toml::node& node) {
  std::ostringstream text;
  text << node.type();
  return text.str();
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

Error TomlFile::At(const toml::node& node, const std::string& key,
                   const std::string& message) const {
  return {ErrorCode::kBadInput, message,
          source_ + ":" + std::to_string(node.source().begin.line) + ": " + key};
}

size_t TomlFile::Count(const std::string& name) const {
  const toml::array* list = table_[name].as_array();
  return list && list->is_array_of_tables() ? list->size() : 0;
}

bool TomlFile::Has(const std::string& path) const {
  return static_cast<bool>(table_.at_path(path));
}

Status TomlFile::Read(const std::vector<Section>& sections) const {
  for (const auto& [key, node] : table_) {
    const std::string name(key.str());
    const size_t count = Count(name);
    if (count == 0) ROTUNDA_RETURN_IF_ERROR(ReadNode(name, node, sections));
    for (size_t i = 0; i < count; ++i) {
      ROTUNDA_RETURN_IF_ERROR(
          ReadNode(name + "[" + std::to_string(i) + "]", *node.as_array()->get(i), sections));
    }
  }
  return {};
}

Status TomlFile::ReadNode(const std::string& name, const toml::node& node,
                          const std::vector<Section>& sections) const {
  const auto known = std::find_if(sections.begin(), sections.end(),
                                  [&](const Section& section) { return section.name == name; });
  if (known == sections.end()) {
    return At(node, name,
              "is not known; allowed are the tables " +
                  ListOf(sections, [](const Section& s) { return s.name; }));
  }
  if (!node.is_table()) {
    return At(node, name, "is a " + Describe(node) + ", expected a table");
  }
  return known->each ? ReadEach(*node.as_table(), *known)
                     : ReadFields(*node.as_table(), known->name, known->fields);
}

Status TomlFile::ReadEach(const toml::table& table, const Section& section) const {
  for (const auto& [key, node] : table) {
    const std::string name = section.name + "." + std::string(key.str());
    if (!node.is_table()) {
      return At(node, name, "is a " + Describe(node) + ", expected a table");
    }
    ROTUNDA_RETURN_IF_ERROR(
        ReadFields(*node.as_table(), name, section.each(std::string(key.str()))));
  }
  return {};
}

Status TomlFile::ReadFields(const toml::table& table, const std::string& table_name,
                            const std::vector<Field>& fields) const {
  for (const auto& [key, node] : table) {
    const std::string name = table_name + "." + std::string(key.str());
    const auto field =
        std::find_if(fields.begin(), fields.end(),
                     [&key = key](const Field& candidate) { return candidate.key == key.str(); });
    if (field == fields.end()) {
      return At(node, name, "is not known; allowed are " + ListOf(fields, [](const Field& f) {
                              return f.key;
                            }));
    }
    ROTUNDA_RETURN_IF_ERROR(ReadField(node, name, *field));
  }
  return {};
}

Status TomlFile::ReadField(const toml::node& node, const std::string& name,
                           const Field& field) const {
  const auto expected = [&](const std::string& what) {
    return At(node, name, "is a " + Describe(node) + ", expected " + what);
  };
  if (int* const* whole = std::get_if<int*>(&field.target)) {
    const auto value = node.value_exact<int64_t>();
    if (!value) return expected("an integer");
    if (*value > std::numeric_limits<int>::max() || *value < std::numeric_limits<int>::min()) {
      return At(node, name, "is " + std::to_string(*value) + ", which is too large");
    }
    **whole = static_cast<int>(*value);
  } else if (double* const* number = std::get_if<double*>(&field.target)) {
    if (!node.is_number()) return expected("a number");
    **number = node.value<double>().value_or(0.0);
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
          list->get(i)->value<double>().value_or(0.0);
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

}  // namespace rotunda::config
