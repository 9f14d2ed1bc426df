#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string_view>

#include "proto/expected.h"

namespace kiln::baker {

/// A whole file, mapped for reading: its bytes cost page cache, which the system may take back, and
/// no memory of the process. The file must keep its length while it is mapped (reading beyond the
/// end of one that was cut ends the process): uploads are never written to once they are complete,
/// and are removed by unlinking, which leaves a mapping whole.
class MappedFile {
 public:
  /// Errors: `limit_exceeded` when the file is longer than `max_bytes`, `missing_file` when it
  /// can't be read or is no regular file.
  static proto::Expected<MappedFile> open(const std::filesystem::path&, std::uint64_t max_bytes);

  MappedFile(MappedFile&&) noexcept;
  MappedFile& operator=(MappedFile&&) = delete;
  ~MappedFile();

  /// Valid as long as this object, also after it was moved elsewhere.
  std::string_view bytes() const { return {data_, size_}; }

 private:
  MappedFile(const char* data, std::size_t size) : data_(data), size_(size) {}

  const char* data_ = nullptr;  ///< nullptr: an empty file
  std::size_t size_ = 0;
};

}  // namespace kiln::baker
