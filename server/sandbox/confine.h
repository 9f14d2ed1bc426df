#pragma once

#include <cstdint>

#include "server/sandbox/protocol.h"

namespace kiln::sandbox {

/// Takes from this process what decoding does not need, before it sees the first byte from outside.
/// None of it can be taken back: no memory or processor time beyond the limits, no file beyond
/// those that are open, none longer than `file_bytes`, no new privileges, no core file, and with
/// seccomp no system calls but those of memory, of open descriptors and of the clock: no sockets,
/// no processes or threads, no signals to others, no executable memory. A limit of 0 is none;
/// memory counts beyond what the program and its libraries take.
Confinement confine(std::uint64_t memory_bytes, std::uint32_t seconds, std::uint64_t file_bytes);

/// Takes from a zygote (zygote.h) what forking import processes does not need: other programs,
/// sockets, executable memory, new privileges.
void confine_zygote();

}  // namespace kiln::sandbox
