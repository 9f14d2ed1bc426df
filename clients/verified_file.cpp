#include "clients/verified_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

namespace kiln::clients {

VerifiedFile::VerifiedFile(std::filesystem::path target)
    : target_(std::move(target)),
      temporary_(target_.parent_path() /
                 ("." + target_.filename().string() + ".part-" + std::to_string(::getpid()))) {}

VerifiedFile::~VerifiedFile() {
  if (fd_ < 0) return;
  close();
  ::unlink(temporary_.c_str());
}

proto::Unexpected VerifiedFile::io_error(const std::string& what, int number) const {
  return proto::fail("io_error",
                     "can't " + what + " " + target_.string() + ": " + std::strerror(number));
}

proto::Expected<void> VerifiedFile::open() {
  close();
  fd_ = ::open(temporary_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (fd_ < 0) return io_error("write", errno);
  size_ = 0;
  write_error_ = 0;
  hash_ = std::make_unique<Sha256>();
  return {};
}

bool VerifiedFile::write(std::string_view bytes) {
  hash_->update(bytes);
  while (!bytes.empty()) {
    const auto n = ::write(fd_, bytes.data(), bytes.size());
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) {
      write_error_ = n < 0 ? errno : ENOSPC;
      return false;
    }
    size_ += static_cast<std::uint64_t>(n);
    bytes.remove_prefix(static_cast<std::size_t>(n));
  }
  return true;
}

proto::Expected<void> VerifiedFile::commit(const std::string& sha256) {
  if (write_error_ != 0) return io_error("write", write_error_);
  const std::string found = hash_->hex();
  if (!sha256.empty() && found != sha256)
    return proto::fail("digest_mismatch", target_.filename().string() + " arrived with SHA-256 " +
                                              found + ", expected " + sha256);
  if (::fsync(fd_) != 0) return io_error("flush", errno);
  if (::rename(temporary_.c_str(), target_.c_str()) != 0) return io_error("rename", errno);
  close();
  return {};
}

void VerifiedFile::close() {
  if (fd_ >= 0) ::close(fd_);
  fd_ = -1;
}

bool is_plain_name(std::string_view name) {
  return !name.empty() && name.size() <= 128 && name.front() != '.' &&
         std::all_of(name.begin(), name.end(), [](unsigned char c) {
           return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
                  c == '.' || c == '_' || c == '-';
         });
}

}  // namespace kiln::clients
