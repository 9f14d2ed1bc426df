#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <string_view>

#include "proto/expected.h"

namespace kiln::files {

/// A whole file, mapped for reading: its bytes cost page cache, which the system may take back, and
/// no memory of the process. The file must keep its length while it is mapped (reading beyond the
/// end of one that was cut ends the process): uploads are never written to once they are complete,
/// and are removed by unlinking, which leaves a mapping whole.
class MappedFile {
 public:
  static constexpr std::uint64_t kAnyLength = ~std::uint64_t{0};
  /// Errors: `limit_exceeded` when the file is longer than `max_bytes`, `missing_file` when it
  /// can't be read or is no regular file.
  static proto::Expected<MappedFile> open(const std::filesystem::path&, std::uint64_t max_bytes);

  /// An open file; `name` is for messages. The descriptor may be closed afterwards. Same errors.
  static proto::Expected<MappedFile> map(int fd, const std::string& name, std::uint64_t max_bytes);
  /// Bytes that someone else owns, and keeps for as long as this.
  static MappedFile view(std::string_view bytes);

  MappedFile(MappedFile&&) noexcept;
  MappedFile& operator=(MappedFile&&) = delete;
  ~MappedFile();

  /// Valid as long as this object, also after it was moved elsewhere.
  std::string_view bytes() const { return {data_, size_}; }

 private:
  MappedFile(const char* data, std::size_t size, bool owned)
      : data_(data), size_(size), owned_(owned) {}

  const char* data_ = nullptr;  ///< nullptr: an empty file
  std::size_t size_ = 0;
  bool owned_ = true;
};

/// Files that were opened beforehand, by the path that names them: for a process that may not open
/// any itself.
using OpenedFiles = std::map<std::filesystem::path, MappedFile>;

}  // namespace kiln::files
