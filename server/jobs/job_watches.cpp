#include "server/jobs/job_watches.h"

#include <atomic>
#include <map>
#include <mutex>

namespace kiln::jobs {

struct JobWatches::Book {
  struct Watcher {
    std::optional<std::uint64_t> since;
    std::function<void()> moved;
  };
  using Watchers = std::map<std::uint64_t, Watcher>;

  std::atomic<std::uint64_t> last{0};
  std::mutex mutex;
  std::map<std::string, Watchers> jobs;  ///< guarded by mutex
};

std::shared_ptr<JobWatches::Book> JobWatches::make_book() {
  return std::make_shared<Book>();
}

JobWatches::Watch JobWatches::add(const std::string& job, std::optional<std::uint64_t> since,
                                  std::function<void()> moved) {
  const std::uint64_t number = ++book_->last;
  const auto leave = [book = book_, job, number](const void*) {
    Book::Watchers::node_type gone;  // goes without the lock
    const std::lock_guard again(book->mutex);
    const auto found = book->jobs.find(job);
    if (found == book->jobs.end()) return;
    gone = found->second.extract(number);
    if (found->second.empty()) book->jobs.erase(found);
  };
  Book::Watchers entry;
  entry.emplace(number, Book::Watcher{since, std::move(moved)});
  // This stands before the lock: where memory ends, the watch ends too, and takes the lock for
  // that.
  Watch watch(book_.get(), leave);
  const std::lock_guard lock(book_->mutex);
  book_->jobs[job].merge(entry);
  return watch;
}

void JobWatches::tell(const std::string& job, std::uint64_t version, bool over) {
  Book::Watchers called;
  {
    const std::lock_guard lock(book_->mutex);
    const auto found = book_->jobs.find(job);
    if (found == book_->jobs.end()) return;
    Book::Watchers& all = found->second;
    for (auto at = all.begin(); at != all.end();) {
      const auto here = at++;
      const auto& since = here->second.since;
      if (over || (since && version > *since)) called.insert(all.extract(here));
    }
    if (all.empty()) book_->jobs.erase(found);
  }
  for (const auto& [number, watcher] : called) watcher.moved();
}

}  // namespace kiln::jobs
