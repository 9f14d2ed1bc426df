#pragma once

#include <sys/types.h>

#include <cstdint>

#include "server/sandbox/protocol.h"

namespace kiln::sandbox {

/// Bounds of an import process. confine() takes from this process what decoding and encoding do not
/// need, before it sees the first byte from outside. None of it can be taken back. The process then
/// gets no memory or processor time beyond the limits, no file beyond those that are open, none
/// longer than `file_bytes`, no new privileges and no core file. With seccomp it has no system
/// calls but those of memory, of open descriptors and of the clock: it makes no sockets, processes
/// or threads, sends no signals to others and has no executable memory. A limit of 0 is none;
/// memory counts beyond what the program and its libraries take.
struct ImportBounds {
  std::uint64_t memory_bytes = 0;
  std::uint32_t seconds = 0;  ///< of processor time
  std::uint64_t file_bytes = 0;
  /// The most to which the service may raise both numbers of bytes (raise_bounds()); it may then
  /// double the time, too. 0: it may not.
  std::uint64_t most_bytes = 0;
};
Confinement confine(const ImportBounds&);

/// Gives a confined process of this service `more_bytes` beyond its bounds, for memory and for its
/// product, and its processor time anew. Not beyond the most that it was confined to.
/// Returns false when the process is gone.
bool raise_bounds(pid_t, std::uint64_t more_bytes);

/// Takes from a zygote (zygote.h) what forking import processes does not need: other programs,
/// sockets, executable memory, new privileges.
void confine_zygote();

}  // namespace kiln::sandbox
