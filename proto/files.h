#pragma once

#include <sys/types.h>

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <utility>

#include "proto/expected.h"
#include "proto/sha256.h"

namespace kiln::proto {

/// An owned file descriptor.
class Fd {
 public:
  Fd() = default;
  explicit Fd(int fd) : fd_(fd) {}
  Fd(Fd&& other) noexcept : fd_(other.release()) {}
  Fd& operator=(Fd&& other) noexcept;
  ~Fd() { reset(); }

  int get() const { return fd_; }
  bool valid() const { return fd_ >= 0; }
  int release();
  void reset();

 private:
  int fd_ = -1;
};

/// Writes a stream of bytes to a file and hashes them. It collects short pieces, 16 KiB at most:
/// thousands of files may be open. The destructor deletes the file unless finish() was called.
class HashingFile {
 public:
  /// Creates the file, which must not exist yet. Errors: `storage_full`, `io_error`.
  static Expected<HashingFile> create(const std::filesystem::path&, mode_t mode = 0600);
  HashingFile(HashingFile&&) noexcept = default;
  HashingFile& operator=(HashingFile&&) noexcept = delete;
  ~HashingFile();

  Expected<void> write(std::string_view bytes);
  /// Flushes to the disk (fsync) and returns the SHA-256.
  Expected<std::string> finish();
  std::uint64_t bytes() const { return bytes_; }
  const std::filesystem::path& path() const { return path_; }

 private:
  HashingFile(Fd fd, std::filesystem::path path) : fd_(std::move(fd)), path_(std::move(path)) {}
  Expected<void> flush();
  Expected<void> write_through(std::string_view bytes);

  Fd fd_;
  std::filesystem::path path_;
  Sha256 hash_;
  std::string buffer_;
  std::uint64_t bytes_ = 0;
};

/// Returns the error for the current errno: `storage_full` when the disk or quota is full, else
/// `io_error`.
Unexpected storage_error(std::string_view doing, const std::filesystem::path&);

/// Writes all of the bytes. The path appears in messages. Errors: `storage_full`, `io_error`.
Expected<void> write_all(int fd, std::string_view bytes, const std::filesystem::path&);

/// Makes a folder's entries survive power loss. "" is the current folder.
Expected<void> sync_folder(const std::filesystem::path&);
/// Makes a file's content, or a whole tree's, survive power loss.
Expected<void> sync_file(const std::filesystem::path&);
Expected<void> sync_tree(const std::filesystem::path&);

/// Writes a file so that its name shows the whole content or nothing, even after a crash or power
/// loss. `write` fills a temporary beside it, ".<name>.part", which is flushed to the disk and then
/// renamed. A temporary is removed when writing fails. Errors: those of `write`, `storage_full`,
/// `io_error`.
Expected<void> write_whole(
    const std::filesystem::path& target,
    const std::function<Expected<void>(const std::filesystem::path& temporary)>& write);

/// Writes these bytes by write_whole().
Expected<void> write_bytes(const std::filesystem::path& target, std::string_view bytes);

/// Reads a whole file. Errors: `io_error`, and `limit_exceeded` when it has more than `max_bytes`.
Expected<std::string> read_file(const std::filesystem::path&, std::uint64_t max_bytes);

/// The size and SHA-256 of a file.
struct FileDigest {
  std::uint64_t bytes = 0;
  std::string sha256;
};
/// Reads a file in pieces and digests it. Errors: `io_error`.
Expected<FileDigest> digest_file(const std::filesystem::path&);

}  // namespace kiln::proto
