#include "baker/output/files.h"

#include <fcntl.h>
#include <openssl/evp.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <fstream>
#include <memory>
#include <stdexcept>
#include <system_error>
#include <vector>

namespace kiln::baker {
namespace {

proto::Unexpected io_error(const std::string& what, const std::filesystem::path& path, int error) {
  return proto::fail("io_error", what + " " + path.filename().string() + ": " +
                                     std::system_category().message(error));
}

/// Flushes a file's or a folder's content to the disk.
proto::Expected<void> flush(const std::filesystem::path& path) {
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) return io_error("cannot open", path, errno);
  const bool ok = ::fsync(fd) == 0;
  const int error = errno;
  ::close(fd);
  if (!ok) return io_error("cannot flush", path, error);
  return {};
}

proto::Expected<void> write_plain(const std::filesystem::path& path, std::string_view bytes) {
  errno = 0;
  std::ofstream out(path, std::ios::binary | std::ios::trunc);
  out.write(bytes.data(), std::streamsize(bytes.size()));
  out.close();
  if (!out) return io_error("cannot write", path, errno);
  return {};
}

class Sha256 {
 public:
  Sha256() : context_(EVP_MD_CTX_new(), &EVP_MD_CTX_free) {
    check(context_ && EVP_DigestInit_ex(context_.get(), EVP_sha256(), nullptr));
  }
  void update(std::string_view bytes) {
    check(EVP_DigestUpdate(context_.get(), bytes.data(), bytes.size()));
  }
  std::string hex() {
    std::array<unsigned char, 32> digest{};
    check(EVP_DigestFinal_ex(context_.get(), digest.data(), nullptr));
    std::string out;
    for (const unsigned char byte : digest) {
      out += "0123456789abcdef"[byte >> 4];
      out += "0123456789abcdef"[byte & 15];
    }
    return out;
  }

 private:
  static void check(bool ok) {
    if (!ok) throw std::runtime_error("OpenSSL cannot compute SHA-256");
  }
  std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> context_;
};

}  // namespace

proto::Expected<void> write_whole(
    const std::filesystem::path& target,
    const std::function<proto::Expected<void>(const std::filesystem::path&)>& write) {
  const std::filesystem::path temporary =
      target.parent_path() / std::string(".").append(target.filename().string()).append(".part");
  auto ok = write(temporary);
  if (ok) ok = flush(temporary);
  if (ok && ::rename(temporary.c_str(), target.c_str()) != 0)
    ok = io_error("cannot rename to", target, errno);
  if (!ok) {
    std::error_code ignored;  // the first error is the one to report
    std::filesystem::remove(temporary, ignored);
    return ok;
  }
  return flush(target.parent_path().empty() ? "." : target.parent_path());
}

proto::Expected<void> write_bytes(const std::filesystem::path& target, std::string_view bytes) {
  return write_whole(target, [&](const std::filesystem::path& t) { return write_plain(t, bytes); });
}

proto::Expected<proto::ResultFile> describe_file(const std::filesystem::path& path,
                                                 std::string media_type) {
  proto::ResultFile file{path.filename().string(), std::move(media_type), 0, {}};
  std::ifstream in(path, std::ios::binary);
  if (!in) return io_error("cannot open", path, errno);
  Sha256 hash;
  std::vector<char> piece(1 << 20);
  while (in) {
    in.read(piece.data(), std::streamsize(piece.size()));
    const auto got = static_cast<std::size_t>(in.gcount());
    hash.update({piece.data(), got});
    file.bytes += got;
  }
  if (in.bad()) return io_error("cannot read", path, errno);
  file.sha256 = hash.hex();
  return file;
}

std::string sha256_hex(std::string_view bytes) {
  Sha256 hash;
  hash.update(bytes);
  return hash.hex();
}

}  // namespace kiln::baker
