#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "server/data/data_folder.h"

namespace kiln::jobs {

/// Writes down what happens to a job, for people: one line with its time per step, over all
/// attempts. Lines that can't be written are left out; a bake does not end for its log.
/// Thread-safe.
class JobLog {
 public:
  static constexpr std::uint64_t kMaxBytes = 1 << 20;  ///< then it ends with a line that says so

  static std::filesystem::path path(const data::DataFolder& data, const std::string& job) {
    return data.job(job) / "log.txt";
  }

  explicit JobLog(std::filesystem::path file) : file_(std::move(file)) {}
  /// Control characters become blanks: a scene's names can't forge lines.
  void line(const std::string& text) const;

 private:
  std::filesystem::path file_;
};

}  // namespace kiln::jobs
