#pragma once

#include <cstdint>

namespace kiln::exec {

/// Returns the most memory that this process has held at once, bytes.
std::uint64_t peak_memory_bytes();

}  // namespace kiln::exec
