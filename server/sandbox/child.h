#pragma once

namespace kiln::sandbox {

/// The whole life of an import process: `lightkiln import-stage PID`, which only a service with
/// this process id starts. Never returns.
[[noreturn]] void run_import_stage(int parent);

}  // namespace kiln::sandbox
