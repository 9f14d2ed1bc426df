#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "proto/expected.h"

namespace kiln::clients {

/// A multipart/form-data body, or a bare file, whose files stay on disk. Its length is known
/// beforehand, and only one piece of it is in memory at a time.
class MultipartBody {
 public:
  explicit MultipartBody(std::string boundary);
  /// Makes a body of one file, without parts. Errors: `missing_file` when it can't be read.
  static proto::Expected<MultipartBody> bare(const std::filesystem::path&);

  void add_text(const std::string& name, const std::string& media_type, std::string text);
  /// Adds a file under the name `file_name`, which the service gets. Errors: `missing_file` when it
  /// can't be read.
  proto::Expected<void> add_file(const std::string& name, const std::string& file_name,
                                 const std::filesystem::path&);
  void finish();  ///< ends the body; no parts may follow

  std::uint64_t size() const { return size_; }
  std::string content_type() const;

  /// Hands up to `length` bytes from `offset` on to `sink`, in a few pieces at most. Returns false
  /// when a file is shorter than it was (see error()) or when the sink refuses.
  bool read(std::uint64_t offset, std::uint64_t length,
            const std::function<bool(std::string_view)>& sink);
  const std::string& error() const { return error_; }

 private:
  struct Segment {
    std::uint64_t begin = 0, size = 0;
    std::string text;  ///< used when `file` is empty
    std::filesystem::path file;
  };
  std::string boundary_, error_;
  std::vector<Segment> segments_;
  std::uint64_t size_ = 0;
  std::ifstream open_;
  std::filesystem::path open_path_;
  std::vector<char> buffer_;

  void append(Segment);
  bool read_file(const Segment&, std::uint64_t at, std::uint64_t length,
                 const std::function<bool(std::string_view)>& sink);
};

}  // namespace kiln::clients
