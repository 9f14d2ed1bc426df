#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

#include "clients/sha256.h"
#include "proto/expected.h"

namespace kiln::clients {

/// A file that is only seen under its name when it is whole and has the expected digest: bytes go
/// to a temporary beside it, which is renamed at the end and removed on any failure.
class VerifiedFile {
 public:
  explicit VerifiedFile(std::filesystem::path target);
  ~VerifiedFile();  ///< removes the temporary unless committed
  VerifiedFile(const VerifiedFile&) = delete;
  VerifiedFile& operator=(const VerifiedFile&) = delete;

  proto::Expected<void> open();  ///< starts (again) with an empty file; errors: `io_error`
  bool write(std::string_view bytes);
  std::uint64_t size() const { return size_; }

  /// Checks digest ("" for none known), flushes to disk, renames. Errors: `digest_mismatch`,
  /// `io_error`.
  proto::Expected<void> commit(const std::string& sha256);

 private:
  std::filesystem::path target_, temporary_;
  int fd_ = -1;
  std::uint64_t size_ = 0;
  std::unique_ptr<Sha256> hash_;
  int write_error_ = 0;  ///< errno of the first write that failed

  void close();
  proto::Unexpected io_error(const std::string& what, int number) const;
};

/// Whether a result's name is a plain file name that can't leave its folder: letters, digits, '.',
/// '_' and '-', not starting with '.', at most 128.
bool is_plain_name(std::string_view);

}  // namespace kiln::clients
