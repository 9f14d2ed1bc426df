#include "server/storage/files.h"

#include <fcntl.h>
#include <openssl/evp.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <system_error>

namespace kiln::server {
namespace {

constexpr std::size_t kBuffer = 256 * 1024;

proto::Expected<void> write_all(int fd, std::string_view bytes, const std::filesystem::path& path) {
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

proto::Expected<void> sync_path(const std::filesystem::path& path, int flags) {
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

struct Sha256::Context {
  EVP_MD_CTX* md = EVP_MD_CTX_new();
  Context() {
    if (!md || EVP_DigestInit_ex(md, EVP_sha256(), nullptr) != 1)
      throw std::runtime_error("SHA-256 is not available");
  }
  Context(const Context&) = delete;
  Context& operator=(const Context&) = delete;
  ~Context() { EVP_MD_CTX_free(md); }
};

Sha256::Sha256() : context_(std::make_unique<Context>()) {}
Sha256::Sha256(Sha256&&) noexcept = default;
Sha256& Sha256::operator=(Sha256&&) noexcept = default;
Sha256::~Sha256() = default;

void Sha256::update(std::string_view bytes) {
  EVP_DigestUpdate(context_->md, bytes.data(), bytes.size());
}

std::string Sha256::hex() {
  std::array<unsigned char, 32> digest{};
  EVP_DigestFinal_ex(context_->md, digest.data(), nullptr);
  std::string text;
  for (const unsigned char b : digest) {
    text += "0123456789abcdef"[b >> 4];
    text += "0123456789abcdef"[b & 15];
  }
  return text;
}

proto::Unexpected storage_error(std::string_view doing, const std::filesystem::path& path) {
  const int error = errno;
  const bool full = error == ENOSPC || error == EDQUOT;
  return proto::fail(full ? "storage_full" : "io_error",
                     "Could not " + std::string(doing) + " " + path.filename().string() + ": " +
                         std::system_category().message(error) + ".");
}

proto::Expected<HashingFile> HashingFile::create(const std::filesystem::path& path) {
  Fd fd(::open(path.c_str(), O_CREAT | O_EXCL | O_WRONLY | O_CLOEXEC, 0600));
  if (!fd.valid()) return storage_error("create", path);
  return HashingFile(std::move(fd), path);
}

HashingFile::~HashingFile() {
  if (fd_.valid()) ::unlink(path_.c_str());
}

proto::Expected<void> HashingFile::write(std::string_view bytes) {
  bytes_ += bytes.size();
  buffer_ += bytes;
  if (buffer_.size() < kBuffer) return {};
  return flush();
}

proto::Expected<void> HashingFile::flush() {
  hash_.update(buffer_);
  auto written = write_all(fd_.get(), buffer_, path_);
  buffer_.clear();
  return written;
}

proto::Expected<std::string> HashingFile::finish() {
  if (auto flushed = flush(); !flushed) return proto::Unexpected(flushed.error());
  if (::fsync(fd_.get()) != 0) return storage_error("flush", path_);
  fd_.reset();
  return hash_.hex();
}

proto::Expected<void> sync_folder(const std::filesystem::path& path) {
  return sync_path(path, O_RDONLY | O_DIRECTORY);
}

proto::Expected<void> sync_file(const std::filesystem::path& path) {
  return sync_path(path, O_RDONLY);
}

proto::Expected<void> sync_tree(const std::filesystem::path& path) {
  for (const auto& entry : std::filesystem::recursive_directory_iterator(path)) {
    auto done = entry.is_directory() ? sync_folder(entry.path()) : sync_file(entry.path());
    if (!done) return done;
  }
  return sync_folder(path);
}

proto::Expected<void> write_file_atomically(const std::filesystem::path& path,
                                            std::string_view content) {
  auto temporary = path;
  temporary += ".tmp";
  ::unlink(temporary.c_str());
  auto file = HashingFile::create(temporary);
  if (!file) return proto::Unexpected(file.error());
  if (auto ok = file->write(content); !ok) return ok;
  if (auto ok = file->finish(); !ok) return proto::Unexpected(ok.error());
  if (::rename(temporary.c_str(), path.c_str()) != 0) return storage_error("rename", path);
  return sync_folder(path.parent_path());
}

proto::Expected<std::string> read_file(const std::filesystem::path& path, std::uint64_t max_bytes) {
  const Fd fd(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  struct stat info {};
  if (!fd.valid() || ::fstat(fd.get(), &info) != 0) return storage_error("open", path);
  if (static_cast<std::uint64_t>(info.st_size) > max_bytes)
    return proto::fail("limit_exceeded", path.filename().string() + " is too large to read.");
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

proto::Expected<FileDigest> digest_file(const std::filesystem::path& path) {
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

bool is_sha256(std::string_view text) {
  return text.size() == 64 && std::all_of(text.begin(), text.end(), [](char c) {
           return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f');
         });
}

}  // namespace kiln::server
