#pragma once

#include <sys/mman.h>
#include <unistd.h>

#include <string>

#include "baker/scene/scene_file.h"
#include "tests/fuzz/require.h"

namespace kiln::fuzz {

/// Of the scene files that targets read and seeds hold.
inline std::string scene_key() {
  return import::import_key("fuzz", {});
}

/// The scene as its file.
inline std::string scene_bytes(const scene::Scene& scene) {
  const int fd = ::memfd_create("scene", MFD_CLOEXEC);
  FUZZ_REQUIRE(scene::write_scene_file(fd, scene_key(), scene));
  std::string bytes(static_cast<std::size_t>(::lseek(fd, 0, SEEK_END)), '\0');
  FUZZ_REQUIRE(::pread(fd, bytes.data(), bytes.size(), 0) == static_cast<ssize_t>(bytes.size()));
  ::close(fd);
  return bytes;
}

}  // namespace kiln::fuzz
