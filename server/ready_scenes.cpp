#include "server/ready_scenes.h"

#include <algorithm>
#include <exception>
#include <optional>
#include <utility>

namespace kiln::server {

using proto::Expected;
using proto::Unexpected;

/// A scene that is ready or being made. The mutex guards all that changes; `rays` stays as it is
/// once `done`.
struct ReadyScenes::Entry {
  std::string key;
  std::string reservation;      ///< in the memory budget
  std::uint32_t users = 0;      ///< requests that wait for it or use it
  bool done = false;            ///< made, or failed
  bool listed = true;           ///< among entries_
  std::stop_source not_wanted;  ///< by anyone any more
  std::uint64_t bytes = 0;
  std::optional<trace::RayScene> rays;
  std::optional<proto::Error> error;
  std::exception_ptr thrown;

  bool is_unused() const { return done && users == 0; }
};

std::shared_ptr<ReadyScenes> ReadyScenes::create(std::shared_ptr<base::MemoryBudget> memory,
                                                 std::uint64_t most_kept) {
  std::shared_ptr<ReadyScenes> scenes(new ReadyScenes(std::move(memory), most_kept));
  const std::weak_ptr<ReadyScenes> held = scenes;
  scenes->memory_->on_scarce({[kept = scenes->kept_]() -> std::uint64_t { return *kept; },
                              [held](std::uint64_t bytes) {
                                const auto own = held.lock();
                                return own && own->give_back(bytes);
                              }});
  return scenes;
}

// No request uses any of them: each use keeps this object.
ReadyScenes::~ReadyScenes() {
  release({entries_.begin(), entries_.end()});
}

Expected<ReadyScenes::Use> ReadyScenes::get(const std::string& key, const Make& make,
                                            const std::stop_token& stop) {
  bool is_new = false;
  const EntryPtr entry = enter(key, is_new);
  if (!is_new) return wait_for(entry, stop);
  // The request that makes the scene may leave before it is made, as others may that wait for it.
  std::atomic<bool> has_left{false};
  {
    const std::stop_callback on_stop(stop, [&] {
      if (!has_left.exchange(true)) leave(entry);
    });
    make_entry(entry, make);
  }
  if (has_left) return proto::canceled();
  auto use = wait_for(entry, stop);
  if (use) use->was_ready = false;
  return use;
}

ReadyScenes::EntryPtr ReadyScenes::enter(const std::string& key, bool& is_new) {
  const std::lock_guard lock(mutex_);
  const auto found =
      std::ranges::find_if(entries_, [&](const EntryPtr& entry) { return entry->key == key; });
  is_new = found == entries_.end();
  if (is_new) {
    static std::atomic<std::uint64_t> last{0};
    entries_.push_back(std::make_shared<Entry>());
    entries_.back()->key = key;
    entries_.back()->reservation = "scene " + std::to_string(++last);  // no job has such an id
  } else {
    if ((*found)->is_unused()) *kept_ -= (*found)->bytes;
    entries_.splice(entries_.end(), entries_, found);
  }
  ++entries_.back()->users;
  return entries_.back();
}

Expected<ReadyScenes::Use> ReadyScenes::wait_for(const EntryPtr& entry,
                                                 const std::stop_token& stop) {
  // The use is counted already; it ends with this object.
  std::shared_ptr<Entry> use(entry.get(),
                             [self = shared_from_this(), entry](Entry*) { self->leave(entry); });
  std::unique_lock lock(mutex_);
  if (!made_.wait(lock, stop, [&] { return entry->done; })) {
    lock.unlock();
    return proto::canceled();
  }
  lock.unlock();
  if (entry->thrown) std::rethrow_exception(entry->thrown);
  if (entry->error) return Unexpected(*entry->error);
  return Use{{std::move(use), &*entry->rays}};
}

void ReadyScenes::make_entry(const EntryPtr& entry, const Make& make) {
  const std::string& name = entry->reservation;
  std::optional<Expected<trace::RayScene>> made;
  std::exception_ptr thrown;
  try {
    made = make([&](std::uint64_t bytes) { return memory_->reserve(name, bytes); },
                entry->not_wanted.get_token());
  } catch (...) {
    thrown = std::current_exception();
  }
  const bool is_ready = made && *made;
  bool is_wanted = false;
  std::uint64_t bytes = 0;
  if (is_ready) {
    bytes = (*made)->memory_bytes();
    if (!memory_->reserve(name, bytes)) bytes = memory_->reserved(name);
  }
  {
    const std::lock_guard lock(mutex_);
    entry->bytes = bytes;
    entry->thrown = thrown;
    if (is_ready)
      entry->rays.emplace(std::move(**made));
    else if (made)
      entry->error = made->error();
    if (!is_ready && std::exchange(entry->listed, false)) entries_.remove(entry);
    is_wanted = entry->listed;  // all may have left at the last moment
    entry->done = true;
  }
  made_.notify_all();
  if (!is_wanted) release({entry});
  memory_->announce();
}

void ReadyScenes::leave(const EntryPtr& entry) {
  std::vector<EntryPtr> gone;
  bool is_unmade = false;
  {
    const std::lock_guard lock(mutex_);
    if (--entry->users > 0) return;
    is_unmade = !entry->done;
    if (is_unmade) {
      if (std::exchange(entry->listed, false)) entries_.remove(entry);
    } else if (entry->listed) {
      *kept_ += entry->bytes;
      // One that is too large by itself goes, not all the others in its favor.
      if (entry->bytes > most_kept_)
        entries_.splice(entries_.begin(), entries_, std::ranges::find(entries_, entry));
      gone = take_unused([this] { return *kept_ <= most_kept_; });
    }
  }
  if (is_unmade) return void(entry->not_wanted.request_stop());
  release(gone);
  memory_->announce();
}

bool ReadyScenes::give_back(std::uint64_t bytes) {
  std::vector<EntryPtr> gone;
  {
    const std::lock_guard lock(mutex_);
    const std::uint64_t goal = *kept_ - std::min<std::uint64_t>(*kept_, bytes);
    gone = take_unused([&] { return *kept_ <= goal; });
  }
  release(gone);
  return !gone.empty();
}

std::vector<ReadyScenes::EntryPtr> ReadyScenes::take_unused(const std::function<bool()>& enough) {
  std::vector<EntryPtr> gone;
  for (auto at = entries_.begin(); at != entries_.end() && !enough();) {
    if (!(*at)->is_unused()) {
      ++at;
      continue;
    }
    (*at)->listed = false;
    *kept_ -= (*at)->bytes;
    gone.push_back(std::move(*at));
    at = entries_.erase(at);
  }
  return gone;
}

void ReadyScenes::release(const std::vector<EntryPtr>& gone) const {
  for (const EntryPtr& entry : gone) {
    entry->rays.reset();
    memory_->release(entry->reservation);
  }
}

}  // namespace kiln::server
