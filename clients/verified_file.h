#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include "proto/files.h"

namespace kiln::clients {

/// Writes a file that appears under its name only when it is whole and has the expected digest.
/// Bytes go to a temporary beside it, which is renamed at the end and removed on any failure.
class VerifiedFile {
 public:
  explicit VerifiedFile(std::filesystem::path target);
  ~VerifiedFile();  ///< removes the temporary unless committed
  VerifiedFile(const VerifiedFile&) = delete;
  VerifiedFile& operator=(const VerifiedFile&) = delete;

  /// Starts, or starts again, with an empty file. Errors: `storage_full`, `io_error`.
  proto::Expected<void> open();
  bool write(std::string_view bytes);  ///< on false, commit() returns the reason

  /// Checks the digest ("" when none is known), flushes the file to disk and renames it. Errors:
  /// `digest_mismatch`, `storage_full`, `io_error`.
  proto::Expected<void> commit(const std::string& sha256);

 private:
  std::filesystem::path target_, temporary_;
  std::optional<proto::HashingFile> file_;
  proto::Expected<void> written_;  ///< the first write that failed
};

/// Returns whether a result's name is a plain file name that can't leave its folder: at most 128
/// letters, digits, '.', '_' and '-', not starting with '.'.
bool is_plain_name(std::string_view);

}  // namespace kiln::clients
