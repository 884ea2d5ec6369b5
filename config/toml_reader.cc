#include "config/toml_reader.h"

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

Status TomlFile::Read(const std::vector<Section>& sections) const {
  for (const auto& [key, node] : table_) {
    const std::string_view name = key.str();
    const Section* known = nullptr;
    for (const Section& section : sections) {
      if (section.name == name) known = &section;
    }
    if (!known) {
      return At(node, std::string(name),
                "is not known; allowed are the tables " +
                    ListOf(sections, [](const Section& s) { return s.name; }));
    }
    if (!node.is_table()) {
      return At(node, std::string(name), "is a " + Describe(node) + ", expected a table");
    }
    const toml::table& table = *node.as_table();
    ROTUNDA_RETURN_IF_ERROR(known->each ? ReadEach(table, *known)
                                        : ReadFields(table, std::string(name), known->fields));
  }
  return {};
}

Status TomlFile::ReadEach(const toml::table& table, const Section& section) const {
  for (const auto& [key, node] : table) {
    const std::string name = std::string(section.name) + "." + std::string(key.str());
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
    const Field* field = nullptr;
    for (const Field& candidate : fields) {
      if (candidate.key == key.str()) field = &candidate;
    }
    if (!field) {
      return At(node, name, "is not known; allowed are " + ListOf(fields, [](const Field& f) {
                              return f.key;
                            }));
    }
    ROTUNDA_RETURN_IF_ERROR(ReadValue(node, name, *field));
  }
  return {};
}

Status TomlFile::ReadValue(const toml::node& node, const std::string& name,
                           const Field& field) const {
  const auto refuse = [&](const std::string& expected) {
    return At(node, name, "is a " + Describe(node) + ", expected " + expected);
  };
  if (int* const* whole = std::get_if<int*>(&field.target)) {
    const auto value = node.value_exact<int64_t>();
    if (!value) return refuse("an integer");
    if (std::abs(*value) > std::numeric_limits<int>::max()) {
      return At(node, name, "is " + std::to_string(*value) + ", which is too large");
    }
    **whole = static_cast<int>(*value);
  } else if (double* const* number = std::get_if<double*>(&field.target)) {
    if (!node.is_number()) return refuse("a number");
    **number = node.value<double>().value_or(0.0);
  } else if (bool* const* flag = std::get_if<bool*>(&field.target)) {
    const auto value = node.value_exact<bool>();
    if (!value) return refuse("true or false");
    **flag = *value;
  } else {
    const auto value = node.value_exact<std::string>();
    if (!value) return refuse("a string");
    *std::get<std::string*>(field.target) = *value;
  }
  return {};
}

Error TomlFile::Located(const Error& error) const {
  const toml::node_view<const toml::node> node = table_.at_path(error.context);
  if (!node) return {ErrorCode::kBadInput, error.message, source_ + ": " + error.context};
  return At(*node.node(), error.context, error.message);
}

}  // namespace rotunda::config
