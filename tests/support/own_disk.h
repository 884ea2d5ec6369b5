#pragma once

#include <filesystem>
#include <functional>
#include <optional>

namespace rotunda::test {

/// Runs `work` in a child whose `folder` is a file system of its own: a tmpfs mounted with `flags`
/// (MS_RDONLY, ...) and `options` ("size=64k"). `work` gives the child's exit code. nullopt: this
/// machine does not let us mount.
std::optional<int> OnOwnDisk(const std::filesystem::path& folder, unsigned long flags,
                             const char* options, const std::function<int()>& work);

}  // namespace rotunda::test
