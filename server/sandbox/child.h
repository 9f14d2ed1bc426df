#pragma once

#include "server/sandbox/protocol.h"

namespace kiln::sandbox {

/// The whole life of an import process: `lightkiln import-stage PID`, which only a service with
/// this process id starts. Never returns.
[[noreturn]] void run_import_stage(int parent);

/// The rest of such a process's life when its work is kImage: one call of a function of
/// image::Module, told over the standard output, which is a socket. Never returns.
[[noreturn]] void run_image_call(const ImportRequest&);

}  // namespace kiln::sandbox
