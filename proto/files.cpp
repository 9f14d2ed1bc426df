#include "proto/files.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <system_error>

namespace kiln::proto {
namespace {

constexpr std::size_t kBuffer = std::size_t{256} * 1024;
constexpr std::size_t kHeld = std::size_t{16} * 1024;  // bytes that a HashingFile keeps in memory

Expected<void> sync_path(const std::filesystem::path& path, int flags) {
  const Fd fd(::open(path.c_str(), flags | O_CLOEXEC));
  if (!fd.valid()) return storage_error("open", path);
  if (::fsync(fd.get()) != 0) return storage_error("flush", path);
  return {};
}

}  // namespace

Fd& Fd::operator=(Fd&& other) noexcept {
  if (this != &other) {
    reset();
    fd_ = other.release();
  }
  return *this;
}

int Fd::release() {
  const int fd = fd_;
  fd_ = -1;
  return fd;
}

void Fd::reset() {
  if (fd_ >= 0) ::close(fd_);
  fd_ = -1;
}

Unexpected storage_error(std::string_view doing, const std::filesystem::path& path) {
  const int error = errno;
  const bool full = error == ENOSPC || error == EDQUOT;
  return fail(full ? "storage_full" : "io_error", "Could not " + std::string(doing) + " " +
                                                      path.filename().string() + ": " +
                                                      std::system_category().message(error) + ".");
}

Expected<void> write_all(int fd, std::string_view bytes, const std::filesystem::path& path) {
  while (!bytes.empty()) {
    const ssize_t n = ::write(fd, bytes.data(), bytes.size());
    if (n < 0) {
      if (errno == EINTR) continue;
      return storage_error("write", path);
    }
    bytes.remove_prefix(static_cast<std::size_t>(n));
  }
  return {};
}

Expected<HashingFile> HashingFile::create(const std::filesystem::path& path, mode_t mode) {
  Fd fd(::open(path.c_str(), O_CREAT | O_EXCL | O_WRONLY | O_CLOEXEC, mode));
  if (!fd.valid()) return storage_error("create", path);
  return HashingFile(std::move(fd), path);
}

HashingFile::~HashingFile() {
  if (fd_.valid()) ::unlink(path_.c_str());
}

Expected<void> HashingFile::write(std::string_view bytes) {
  bytes_ += bytes.size();
  if (buffer_.size() + bytes.size() < kHeld) {
    buffer_ += bytes;
    return {};
  }
  if (auto flushed = flush(); !flushed) return flushed;
  return write_through(bytes);
}

Expected<void> HashingFile::flush() {
  auto written = write_through(buffer_);
  buffer_.clear();
  return written;
}

Expected<void> HashingFile::write_through(std::string_view bytes) {
  hash_.update(bytes);
  return write_all(fd_.get(), bytes, path_);
}

Expected<std::string> HashingFile::finish() {
  if (auto flushed = flush(); !flushed) return Unexpected(flushed.error());
  if (::fsync(fd_.get()) != 0) return storage_error("flush", path_);
  fd_.reset();
  return hash_.hex();
}

Expected<void> sync_folder(const std::filesystem::path& path) {
  return sync_path(path.empty() ? "." : path, O_RDONLY | O_DIRECTORY);
}

Expected<void> sync_file(const std::filesystem::path& path) {
  return sync_path(path, O_RDONLY);
}

Expected<void> sync_tree(const std::filesystem::path& path) {
  for (const auto& entry : std::filesystem::recursive_directory_iterator(path)) {
    auto done = entry.is_directory() ? sync_folder(entry.path()) : sync_file(entry.path());
    if (!done) return done;
  }
  return sync_folder(path);
}

Expected<void> write_whole(
    const std::filesystem::path& target,
    const std::function<Expected<void>(const std::filesystem::path&)>& write) {
  const auto temporary = target.parent_path() / ("." + target.filename().string() + ".part");
  auto done = write(temporary);
  if (done) done = sync_file(temporary);
  if (done && ::rename(temporary.c_str(), target.c_str()) != 0)
    done = storage_error("rename to", target);
  if (done) return sync_folder(target.parent_path());
  ::unlink(temporary.c_str());
  return done;
}

Expected<void> write_bytes(const std::filesystem::path& target, std::string_view bytes) {
  return write_whole(target, [&](const std::filesystem::path& temporary) -> Expected<void> {
    const Fd fd(::open(temporary.c_str(), O_CREAT | O_TRUNC | O_WRONLY | O_CLOEXEC, 0666));
    if (!fd.valid()) return storage_error("create", target);
    return write_all(fd.get(), bytes, target);
  });
}

Expected<std::string> read_file(const std::filesystem::path& path, std::uint64_t max_bytes) {
  const Fd fd(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  struct stat info {};
  if (!fd.valid() || ::fstat(fd.get(), &info) != 0) return storage_error("open", path);
  if (static_cast<std::uint64_t>(info.st_size) > max_bytes)
    return fail("limit_exceeded", path.filename().string() + " is too large to read.");
  std::string content(static_cast<std::size_t>(info.st_size), '\0');
  std::size_t done = 0;
  while (done < content.size()) {
    const ssize_t n = ::read(fd.get(), content.data() + done, content.size() - done);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return storage_error("read", path);
    if (n == 0) break;
    done += static_cast<std::size_t>(n);
  }
  content.resize(done);
  return content;
}

Expected<FileDigest> digest_file(const std::filesystem::path& path) {
  const Fd fd(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (!fd.valid()) return storage_error("open", path);
  std::string buffer(kBuffer, '\0');
  Sha256 hash;
  FileDigest digest;
  for (;;) {
    const ssize_t n = ::read(fd.get(), buffer.data(), buffer.size());
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return storage_error("read", path);
    if (n == 0) break;
    hash.update(std::string_view(buffer.data(), static_cast<std::size_t>(n)));
    digest.bytes += static_cast<std::uint64_t>(n);
  }
  digest.sha256 = hash.hex();
  return digest;
}

}  // namespace kiln::proto
