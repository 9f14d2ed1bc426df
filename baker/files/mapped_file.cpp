#include "baker/files/mapped_file.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <string>
#include <utility>

namespace kiln::files {
namespace {

/// Closes a file descriptor at the end of its scope. A mapping outlives it.
struct Descriptor {
  int fd;
  explicit Descriptor(int opened) : fd(opened) {}
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  ~Descriptor() {
    if (fd >= 0) ::close(fd);
  }
};

}  // namespace

proto::Expected<MappedFile> MappedFile::open(const std::filesystem::path& path,
                                             std::uint64_t max_bytes) {
  // O_NONBLOCK keeps a pipe without a writer from holding the request up.
  const Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  return map(file.fd, path.filename().string(), max_bytes);
}

proto::Expected<MappedFile> MappedFile::map(int fd, const std::string& file_name,
                                            std::uint64_t max_bytes) {
  const std::string name = "\"" + file_name + "\"";
  struct stat status {};
  if (fd < 0 || ::fstat(fd, &status) != 0 || !S_ISREG(status.st_mode)) {
    return proto::fail("missing_file", "The file " + name + " can't be read.");
  }
  const auto size = static_cast<std::uint64_t>(status.st_size);
  if (size > max_bytes) {
    return proto::fail("limit_exceeded", name + " has " + std::to_string(size) +
                                             " bytes, more than the " + std::to_string(max_bytes) +
                                             " allowed");
  }
  if (size == 0) return MappedFile(nullptr, 0, true);
  void* const data = ::mmap(nullptr, size, PROT_READ, MAP_PRIVATE, fd, 0);
  if (data == MAP_FAILED)
    return proto::fail("missing_file", "The file " + name + " can't be mapped into memory.");
  return MappedFile(static_cast<const char*>(data), size, true);
}

MappedFile MappedFile::view(std::string_view bytes) {
  return {bytes.data(), bytes.size(), false};
}

MappedFile::MappedFile(MappedFile&& other) noexcept
    : data_(std::exchange(other.data_, nullptr)),
      size_(std::exchange(other.size_, 0)),
      owned_(other.owned_) {}

MappedFile::~MappedFile() {
  if (data_ && owned_) ::munmap(const_cast<char*>(data_), size_);
}

}  // namespace kiln::files
