#pragma once

#include <sys/types.h>

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <stop_token>
#include <string>

#include "proto/expected.h"
#include "proto/files.h"
#include "server/sandbox/protocol.h"
#include "server/sandbox/zygote.h"

namespace kiln::sandbox {

/// How import processes are started and held.
struct ImportProcessOptions {
  /// The program: this one, whatever has become of its file since it was started.
  std::filesystem::path program = "/proc/self/exe";
  /// What processes are forked from; imports wait for it. Null: the program is started each time,
  /// and can't decode images.
  std::shared_ptr<Zygote> zygote;
  std::uint64_t memory_bytes = 0;  ///< 0: no limit
  std::uint32_t seconds = 0;       ///< of time on the wall, and of the processor; 0: no limit
  /// Told each process's id, on the thread that waits for it.
  std::function<void(pid_t)> started;
  /// Told why a process failed, and what it had said on its standard error.
  std::function<void(const std::string& reason, const std::string& said)> failed;
};

/// Files for a process: the descriptors are opened by the service and given along.
struct ImportJob {
  ImportWork work = ImportWork::kProbe;
  std::string key;
  std::string settings;
  files::ImportLimits limits;
  files::SceneFiles files;  ///< none for kProbe
  int product = -1, scene = -1, lit = -1;
};

/// Runs one import process to its end. When this returns there is no such process any more, so
/// nobody writes to the product. However it ends, by a crash, a kill, a hang or a lie, the outcome
/// is an error of this one job. Thread-safe; the calling thread waits.
/// Errors: those that the work itself has, `import_crashed`, `import_timeout`,
/// `import_out_of_memory`, `io_error` (it could not be started), `canceled`.
proto::Expected<Confinement> run_import_process(const ImportProcessOptions&, const ImportJob&,
                                                std::stop_token);

}  // namespace kiln::sandbox
