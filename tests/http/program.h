#pragma once

#include <sys/types.h>

#include <chrono>
#include <condition_variable>
#include <filesystem>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "tests/http/live.h"

namespace kiln::test {

/// The built program as `lightkiln serve` on free ports, in a process of its own.
class Program {
 public:
  /// Returns when it says that it is ready. Fails the test when it does not.
  explicit Program(const std::filesystem::path& data, const std::vector<std::string>& flags = {});
  ~Program();  ///< kills it when it still runs
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;

  std::uint16_t port() const { return port_; }
  std::uint16_t admin_port() const { return admin_port_; }
  pid_t pid() const { return pid_; }
  std::string url(const std::string& path = "") const {
    return "http://127.0.0.1:" + std::to_string(port_) + path;
  }

  void signal(int number) const;
  /// Waits for its end: the exit code, or minus the signal that killed it.
  int wait_exit();
  /// Whether a log line holds `text` now or within the time.
  bool logged(const std::string& text, std::chrono::milliseconds time = std::chrono::seconds(20));
  std::string log();

  /// Anonymous memory that it holds now: what it took itself, without mapped files.
  std::uint64_t anonymous_bytes() const;

 private:
  void read_log(int fd);

  pid_t pid_ = -1;
  std::uint16_t port_ = 0, admin_port_ = 0;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::string log_;     ///< guarded by mutex_
  bool ended_ = false;  ///< the program closed its log; guarded by mutex_
  std::thread reader_;
};

/// Runs curl with these arguments, its connection kept to this machine. `status` is 0 when curl
/// itself failed, and the body then says why.
Answer curl(const std::string& arguments);

/// Writes one of the generated scenes as NAME.glb.
std::filesystem::path write_scene(const std::filesystem::path& folder, const std::string& name);

/// Writes corner.glb: a floor, a wall and a lamp, few texels of which are covered, so that even the
/// default settings bake it within a second or two.
std::filesystem::path write_small_scene(const std::filesystem::path& folder);

/// Arguments for curl that post a job, which is baked whatever was baked before: the scene, and
/// settings unless empty.
std::string job_form(const std::filesystem::path& scene, const std::string& settings = "");

/// Posts a job by curl; returns its id.
std::string post_job(const Program&, const std::filesystem::path& scene,
                     const std::string& settings = "");

/// Settings of a bake of the Cornell box that takes at least a minute: long enough to be cut.
inline const std::string kLongBake =
    R"({"atlas":{"page_size":1024},"solver":{"samples":1024,"direct_samples":256}})";

}  // namespace kiln::test
