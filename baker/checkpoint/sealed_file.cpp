#include "baker/checkpoint/sealed_file.h"

#include <cerrno>
#include <cstring>

#include "proto/files.h"
#include "proto/job.h"

namespace kiln::checkpoint {

void copy_where_different(std::span<const std::byte> from, std::byte* to) {
  constexpr std::size_t kMemoryPage = 4096;
  for (std::size_t at = 0; at < from.size(); at += kMemoryPage) {
    const auto page = from.subspan(at, std::min(kMemoryPage, from.size() - at));
    if (std::memcmp(page.data(), to + at, page.size()) != 0)
      std::memcpy(to + at, page.data(), page.size());
  }
}

proto::Expected<void> write_sealed(const std::filesystem::path& file, const Magic& magic,
                                   const std::string& key,
                                   const std::function<void(SealedWriter&)>& fill) {
  errno = 0;
  std::ofstream out(file, std::ios::binary);
  SealedWriter w(out);
  w.bytes(magic.data(), magic.size());
  w.text(key);
  fill(w);
  w.seal();
  out.close();
  if (out) return {};
  return proto::storage_error("write", file);
}

proto::Unexpected stopped() {
  return proto::fail(proto::kCanceledCode, "The job was canceled.");
}

proto::Unexpected unusable(const std::filesystem::path& file, const char* what) {
  return proto::fail("invalid_checkpoint",
                     "The checkpoint " + file.filename().string() + " " + what + ".");
}

}  // namespace kiln::checkpoint
