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

/// A whole file, mapped for reading. Its bytes take page cache, which the system may reclaim, and
/// no memory of the process. The file must keep its length while it is mapped: reading beyond the
/// end of a truncated file ends the process. Complete uploads are never written to, and unlinking,
/// which removes them, leaves a mapping whole.
class MappedFile {
 public:
  static constexpr std::uint64_t kAnyLength = ~std::uint64_t{0};
  /// Maps the file at a path. Errors: `limit_exceeded` when the file is longer than `max_bytes`,
  /// `missing_file` when it can't be read or is no regular file.
  static proto::Expected<MappedFile> open(const std::filesystem::path&, std::uint64_t max_bytes);

  /// Maps an open file; `name` appears in messages. The descriptor may be closed afterwards. The
  /// errors are those of open().
  static proto::Expected<MappedFile> map(int fd, const std::string& name, std::uint64_t max_bytes);
  /// Refers to bytes that another object owns and keeps for as long as this one lives.
  static MappedFile view(std::string_view bytes);

  MappedFile(MappedFile&&) noexcept;
  MappedFile& operator=(MappedFile&&) = delete;
  ~MappedFile();

  /// Returns the bytes. They stay valid while this object, or the one it was moved into, lives.
  std::string_view bytes() const { return {data_, size_}; }

 private:
  MappedFile(const char* data, std::size_t size, bool owned)
      : data_(data), size_(size), owned_(owned) {}

  const char* data_ = nullptr;  ///< nullptr for an empty file
  std::size_t size_ = 0;
  bool owned_ = true;
};

/// Holds files that were opened beforehand, by their path, for a process that may not open any
/// itself.
using OpenedFiles = std::map<std::filesystem::path, MappedFile>;

}  // namespace kiln::files
