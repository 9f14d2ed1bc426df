#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

namespace kiln::jobs {

/// Watchers of jobs, each of which is called once. The cost of a job's change grows with the
/// watchers of this job, not with all. Thread-safe.
class JobWatches {
 public:
  /// Ends the watch when its last copy goes; it may outlive what it was made by. A call that has
  /// begun by then is not waited for.
  using Watch = std::shared_ptr<const void>;

  /// `moved` will be called once, from any thread: when the job is over, or with `since` when it is
  /// of a later version.
  Watch add(const std::string& job, std::optional<std::uint64_t> since,
            std::function<void()> moved);
  /// Calls the watchers that wait for this version of the job, with no lock held.
  void tell(const std::string& job, std::uint64_t version, bool over);

 private:
  struct Book;
  std::shared_ptr<Book> book_ = make_book();
  static std::shared_ptr<Book> make_book();
};

}  // namespace kiln::jobs
