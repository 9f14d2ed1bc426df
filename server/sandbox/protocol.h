#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "baker/import/import.h"
#include "proto/expected.h"
#include "proto/files.h"

namespace kiln::sandbox {

/// The service and its import process exchange one JSON document each way. The request lies in a
/// file that is the process's standard input, the answer comes through a pipe that is its standard
/// output. Each answer is a line. All files that it may read or write are open when it starts; the
/// request names them by descriptor.
enum class ImportWork {
  kProbe,   ///< nothing: it shows that it starts, and what holds it
  kCheck,   ///< check_scene; with `orders` the process then waits for the order to import
  kImport,  ///< import_files, its product as a scene file
  kLit,     ///< write_lit_glb
  kImage,   ///< one call of a function of image::Module (image_wire.h)
};

struct ImportFile {
  std::string name;  ///< "" for the main file
  int fd = -1;
};

struct ImportRequest {
  ImportWork work = ImportWork::kProbe;
  std::string key;       ///< import_key() of the scene file, which is written or read
  std::string settings;  ///< of a check: JSON
  files::ImportLimits limits;
  std::uint64_t memory_bytes = 0;       ///< 0: no limit
  std::uint64_t most_memory_bytes = 0;  ///< to which the service may raise that; 0: it may not
  std::uint32_t seconds = 0;            ///< of processor time; 0: no limit
  std::vector<ImportFile> files;        ///< the upload, main file first
  std::optional<std::string> sky_map;   ///< of an import: name of the file that is the sky map
  int product = -1;                     ///< to write: scene file, lit.glb
  /// A check may have a pipe that brings the order to import, import_key() and a line feed. A
  /// process that has it answers twice, and ends when the pipe does.
  int orders = -1;
  int scene = -1;          ///< of kLit: the scene file
  int lit = -1;            ///< of kLit: the lit request (baker/output/lit_request.h)
  std::string image = {};  ///< of kImage: the head of the call. Its socket is the standard output
};

/// The bounds that hold an import process.
struct Confinement {
  bool memory = false;     ///< its address space is limited
  std::string no_seccomp;  ///< why system calls are not filtered; "" where they are
};

struct ImportAnswer {
  Confinement confinement;
  std::optional<proto::Error> error;
};

std::string request_text(const ImportRequest&);
/// Errors: `bad_document`.
proto::Expected<ImportRequest> parse_request(const std::string& text);
/// Returns the request as a file to read from its beginning: unlike a pipe it takes all of it at
/// once. Errors: `io_error`.
proto::Expected<proto::Fd> request_file(const ImportRequest&);

std::string answer_text(const ImportAnswer&);
/// The process may have been taken over, so an error with a code that no import has is refused.
/// Errors: `bad_document`.
proto::Expected<ImportAnswer> parse_answer(const std::string& text);

/// Longer answers are refused.
inline constexpr std::size_t kMaxAnswerBytes = std::size_t{256} * 1024;

}  // namespace kiln::sandbox
