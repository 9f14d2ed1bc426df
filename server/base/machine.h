#pragma once

#include <cstdint>
#include <filesystem>

namespace kiln::base {

/// Memory that this process could take now: what the machine has free, caches included, or what is
/// left below the limit of a control group around it (a container, a systemd unit). `root` is for
/// tests: the folder that holds proc and sys. 0 when nothing tells.
std::uint64_t free_memory_bytes(const std::filesystem::path& root = "/");

/// Returns what bakes and imports may take where nothing is configured: four fifths of it.
inline std::uint64_t usual_memory_budget() {
  return free_memory_bytes() / 5 * 4;
}

}  // namespace kiln::base
