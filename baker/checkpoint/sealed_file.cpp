#include "baker/checkpoint/sealed_file.h"

#include <cerrno>

#include "proto/files.h"
#include "proto/job.h"

namespace kiln::checkpoint {

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

proto::Unexpected unusable(const std::filesystem::path& file, const char* what) {
  return proto::fail("invalid_checkpoint",
                     "The checkpoint " + file.filename().string() + " " + what + ".");
}

}  // namespace kiln::checkpoint
