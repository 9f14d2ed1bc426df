#include "baker/files/upload.h"

namespace kiln::files {

proto::Expected<MappedFile> map_file(const SceneFiles& files, const std::filesystem::path& path,
                                     std::uint64_t max_bytes) {
  if (!files.opened) return MappedFile::open(path, max_bytes);
  const auto found = files.opened->find(path);
  if (found == files.opened->end())
    return proto::fail("missing_file",
                       "The file \"" + path.filename().string() + "\" can't be read.");
  const std::string_view bytes = found->second.bytes();
  if (bytes.size() <= max_bytes) return MappedFile::view(bytes);
  return proto::fail("limit_exceeded", "\"" + path.filename().string() + "\" has " +
                                           std::to_string(bytes.size()) + " bytes, more than the " +
                                           std::to_string(max_bytes) + " allowed");
}

}  // namespace kiln::files
