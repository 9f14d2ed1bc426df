#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

#include "proto/expected.h"

namespace kiln::server {

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

/// Incremental SHA-256.
class Sha256 {
 public:
  Sha256();
  Sha256(Sha256&&) noexcept;
  Sha256& operator=(Sha256&&) noexcept;
  ~Sha256();

  void update(std::string_view bytes);
  std::string hex();  ///< finishes; 64 lower-case digits

 private:
  struct Context;
  std::unique_ptr<Context> context_;
};

/// A file that takes a stream of bytes and knows their hash. Buffered; memory does not grow with
/// the content. Deletes the file unless finish() was called.
class HashingFile {
 public:
  /// Errors: `storage_full`, `io_error`.
  static proto::Expected<HashingFile> create(const std::filesystem::path&);
  HashingFile(HashingFile&&) noexcept = default;
  HashingFile& operator=(HashingFile&&) noexcept = delete;
  ~HashingFile();

  proto::Expected<void> write(std::string_view bytes);
  /// Flushes to the disk (fsync) and returns the SHA-256.
  proto::Expected<std::string> finish();
  std::uint64_t bytes() const { return bytes_; }
  const std::filesystem::path& path() const { return path_; }

 private:
  HashingFile(Fd fd, std::filesystem::path path) : fd_(std::move(fd)), path_(std::move(path)) {}
  proto::Expected<void> flush();

  Fd fd_;
  std::filesystem::path path_;
  Sha256 hash_;
  std::string buffer_;
  std::uint64_t bytes_ = 0;
};

/// The error for the current errno: `storage_full` when the disk or quota is, else `io_error`.
proto::Unexpected storage_error(std::string_view doing, const std::filesystem::path&);

/// Makes a folder's entries survive power loss.
proto::Expected<void> sync_folder(const std::filesystem::path&);
/// Makes a file's content, or a whole tree's, survive power loss.
proto::Expected<void> sync_file(const std::filesystem::path&);
proto::Expected<void> sync_tree(const std::filesystem::path&);

/// Writes a file as a whole or not at all: temporary, fsync, rename, fsync of the folder.
proto::Expected<void> write_file_atomically(const std::filesystem::path&, std::string_view content);

/// The whole content. Errors: `io_error`, and `limit_exceeded` beyond `max_bytes`.
proto::Expected<std::string> read_file(const std::filesystem::path&, std::uint64_t max_bytes);

/// Size and SHA-256 of a file.
struct FileDigest {
  std::uint64_t bytes = 0;
  std::string sha256;
};
proto::Expected<FileDigest> digest_file(const std::filesystem::path&);

/// Whether `text` is a SHA-256 in lower-case hexadecimal.
bool is_sha256(std::string_view text);

}  // namespace kiln::server
