#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "proto/expected.h"
#include "proto/files.h"
#include "proto/manifest.h"

namespace kiln::data {

/// The service's folder. One server at a time owns it, by a lock that the kernel drops with the
/// process.
///   lock  jobs.db  tokens.db  scenes/<sha256>/  jobs/<id>/{checkpoints,results}/
///   uploads/<id>/  tmp/
class DataFolder {
 public:
  /// Creates what is missing, takes the lock and empties tmp/.
  /// Errors: `data_folder_in_use`, `storage_full`, `io_error`.
  static proto::Expected<DataFolder> open(const std::filesystem::path&);

  const std::filesystem::path& root() const { return root_; }
  std::filesystem::path database() const { return root_ / "jobs.db"; }
  std::filesystem::path tokens() const { return tokens_of(root_); }
  /// Returns the path of the token database of a folder that another process may own.
  static std::filesystem::path tokens_of(const std::filesystem::path& root) {
    return root / "tokens.db";
  }
  std::filesystem::path scenes() const { return root_ / "scenes"; }
  std::filesystem::path uploads() const { return root_ / "uploads"; }
  std::filesystem::path temporary() const { return root_ / "tmp"; }
  std::filesystem::path job(const std::string& id) const { return root_ / "jobs" / id; }
  std::filesystem::path results(const std::string& id) const { return job(id) / "results"; }
  std::filesystem::path checkpoints(const std::string& id) const { return job(id) / "checkpoints"; }

  /// Creates a job's folders and empties the results that an earlier attempt left; its checkpoints
  /// stay.
  proto::Expected<void> make_job_folders(const std::string& id) const;
  void remove_job(const std::string& id) const;
  void remove_checkpoints(const std::string& id) const;
  /// Gives the result files of one job to another, which has none, as hard links. This is durable.
  proto::Expected<void> link_results(const std::string& from, const std::string& to,
                                     const std::vector<proto::ResultFile>&) const;
  std::vector<std::string> job_folders() const;  ///< names under jobs/

  /// Returns a new name in tmp/, unique within this process.
  std::filesystem::path new_temporary() const;

  /// Returns whether a small file can be written now.
  bool writable() const;
  double free_share() const;  ///< free share of the disk, 0..1
  std::uint64_t bytes()
      const;  ///< size of scenes, jobs and uploads; a file with several names counts once

 private:
  DataFolder(std::filesystem::path root, proto::Fd lock)
      : root_(std::move(root)), lock_(std::move(lock)) {}
  std::filesystem::path root_;
  proto::Fd lock_;
};

}  // namespace kiln::data
