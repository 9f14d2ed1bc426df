#pragma once

#include <sys/types.h>

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>

#include "proto/expected.h"
#include "proto/files.h"
#include "server/sandbox/protocol.h"
#include "server/sandbox/zygote.h"

namespace kiln::sandbox {

/// These options say how import processes are started and held.
struct ImportProcessOptions {
  /// The program: this one, whatever has become of its file since it was started.
  std::filesystem::path program = "/proc/self/exe";
  /// Processes are forked from it; imports that decode images wait for it. Null: the program is
  /// started each time, and can't decode images.
  std::shared_ptr<Zygote> zygote;
  std::uint64_t memory_bytes = 0;       ///< 0: no limit
  std::uint64_t most_memory_bytes = 0;  ///< to which CheckedProcess::import() may raise it
  std::uint32_t seconds = 0;            ///< of time on the wall, and of the processor; 0: no limit
  /// Gets each process's id, on the thread that waits for it.
  std::function<void(pid_t)> started;
  /// Gets the reason why a process failed, and what it had said on its standard error.
  std::function<void(const std::string& reason, const std::string& said)> failed;
};

/// Files for a process: the descriptors are opened by the service and given along.
struct ImportJob {
  ImportWork work = ImportWork::kProbe;
  std::string key;
  std::string settings;
  files::ImportLimits limits;
  files::SceneFiles files;  ///< none for kProbe
  /// False when an import is known to have neither images nor a sky map: it then waits for no
  /// zygote.
  bool decodes_images = true;
  int product = -1, scene = -1, lit = -1;
};

/// Runs one import process to its end. When this returns there is no such process any more, so
/// nobody writes to the product. However it ends, by a crash, a kill, a hang or a lie, the outcome
/// is an error of this one job. Thread-safe; the calling thread waits.
/// Errors: those that the work itself has, `import_crashed`, `import_timeout`,
/// `import_out_of_memory`, `io_error` (it could not be started), `canceled`.
proto::Expected<Confinement> run_import_process(const ImportProcessOptions&, const ImportJob&,
                                                std::stop_token);

/// A process that has checked a scene and waits, asleep, for the order to import it: it still has
/// what it read. It ends with this object. One thread at a time may use it.
class CheckedProcess {
 public:
  struct Parts;
  explicit CheckedProcess(std::unique_ptr<Parts>);
  CheckedProcess(const CheckedProcess&) = delete;
  CheckedProcess& operator=(const CheckedProcess&) = delete;
  ~CheckedProcess();

  /// Gives the process the memory of `options` in place of what it had, and lets it write the scene
  /// file of that key to its product. Returns what run_import_process() does; nothing when the
  /// process is gone, or had too little memory, and another has to read the scene anew. May be
  /// called once.
  std::optional<proto::Expected<Confinement>> import(const ImportProcessOptions& options,
                                                     const std::string& key, std::stop_token);

 private:
  std::unique_ptr<Parts> parts_;
};

/// Runs a check as run_import_process() does. Returns the process of a scene that passes, which
/// can go on to import it into job.product; null where it can't decode images. Same errors.
proto::Expected<std::unique_ptr<CheckedProcess>> run_check_process(const ImportProcessOptions&,
                                                                   const ImportJob&,
                                                                   std::stop_token);

}  // namespace kiln::sandbox
