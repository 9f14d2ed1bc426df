#pragma once

#include <condition_variable>
#include <deque>
#include <exception>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include "baker/exec/thread_pool.h"
#include "baker/view/view.h"
#include "proto/expected.h"
#include "server/data/data_folder.h"
#include "server/http/message.h"
#include "server/jobs/job_lookup.h"

namespace kiln::api {

/// A picture of a finished job's results.
struct ViewInput {
  std::filesystem::path folder;  ///< of the results
  std::string lit_sha256;        ///< of their lit.glb
  view::Request request;
};
/// Draws the picture and returns it as PNG bytes: server::make_view(), or a test's stand-in.
/// Errors: those of view::draw() and of reading a scene, and `overloaded`.
using ViewFunction = std::function<proto::Expected<std::string>(const ViewInput&, exec::ThreadPool&,
                                                                std::stop_token)>;

/// One view, in line or being drawn.
class ViewOrder {
 public:
  explicit ViewOrder(ViewInput input) : input_(std::move(input)) {}
  ViewOrder(const ViewOrder&) = delete;
  ViewOrder& operator=(const ViewOrder&) = delete;

  /// Nobody wants the picture any more.
  void give_up();
  /// Returns the picture, or what went wrong; nothing when it is not done. Throws what drawing it
  /// threw. May be called once.
  std::optional<proto::Expected<std::string>> result();

 private:
  friend class ViewDesk;
  void draw(const ViewFunction&, exec::ThreadPool&, const std::stop_token&);

  const ViewInput input_;
  std::stop_source stop_;
  std::mutex mutex_;
  std::function<void()> done_;
  std::optional<proto::Expected<std::string>> png_;
  std::exception_ptr thrown_;
};

/// Draws views, two at a time, on threads of its own; the others wait in line. Thread-safe.
class ViewDesk {
 public:
  ViewDesk(ViewFunction draw, exec::ThreadPool& pool) : draw_(std::move(draw)), pool_(pool) {}
  ViewDesk(const ViewDesk&) = delete;
  ViewDesk& operator=(const ViewDesk&) = delete;

  /// Returns whether the line has room for one more.
  bool has_room();
  /// Puts an order in line. `done` is called once there is a result, unless it was given up.
  void put(std::shared_ptr<ViewOrder>, std::function<void()> done);

 private:
  void work(const std::stop_token&);

  const ViewFunction draw_;
  exec::ThreadPool& pool_;
  std::mutex mutex_;
  std::condition_variable_any changed_;
  std::deque<std::shared_ptr<ViewOrder>> line_;
  std::vector<std::jthread> threads_;  ///< begun with the first order; the last to be made
};

/// The parts that the route of views works on.
struct Views {
  const jobs::JobLookup& lookup;
  const data::DataFolder& data;
  ViewDesk& desk;
};

http::Response get_view(const Views&, http::Request&);

}  // namespace kiln::api
