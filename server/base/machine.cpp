#include "server/base/machine.h"

#include <algorithm>
#include <fstream>
#include <optional>
#include <string>

namespace kiln::base {
namespace {

namespace fs = std::filesystem;

// A number alone in a file; nothing for "max" and for files that are not there.
std::optional<std::uint64_t> number_in(const fs::path& path) {
  std::ifstream in(path);
  std::uint64_t value = 0;
  if (in >> value) return value;
  return std::nullopt;
}

std::uint64_t available(const fs::path& meminfo) {
  std::ifstream in(meminfo);
  for (std::string line; std::getline(in, line);)
    if (line.rfind("MemAvailable:", 0) == 0) return std::stoull(line.substr(13)) * 1024;
  return 0;
}

// The process's group in the unified hierarchy, "/a/b"; "/" within a container.
std::string group_of(const fs::path& cgroup) {
  std::ifstream in(cgroup);
  for (std::string line; std::getline(in, line);)
    if (line.rfind("0::/", 0) == 0) return line.substr(3);
  return "/";
}

// Returns what a group's limit leaves; groups that are full leave nothing.
std::uint64_t left(std::uint64_t limit, std::uint64_t used) {
  return limit - std::min(limit, used);
}

}  // namespace

std::uint64_t free_memory_bytes(const fs::path& root) {
  std::uint64_t least = available(root / "proc/meminfo");
  const auto limit_by = [&](const fs::path& max, const fs::path& current) {
    if (const auto limit = number_in(max))
      least = std::min(least, left(*limit, number_in(current).value_or(0)));
  };
  const fs::path groups = root / "sys/fs/cgroup";
  fs::path group = group_of(root / "proc/self/cgroup");
  for (;; group = group.parent_path()) {  // every group above limits as well
    const fs::path at = groups / group.relative_path();
    limit_by(at / "memory.max", at / "memory.current");
    if (!group.has_relative_path()) break;
  }
  limit_by(groups / "memory/memory.limit_in_bytes", groups / "memory/memory.usage_in_bytes");
  return least;
}

}  // namespace kiln::base
