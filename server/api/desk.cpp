#include "server/api/desk.h"

#include <utility>

#include "server/http/problem.h"

namespace kiln::api {

/// One piece of work, in line or under way.
struct Desk::Order {
  explicit Order(Work given) : work(std::move(given)) {}

  const Work work;
  std::stop_source stop;
  std::mutex mutex;
  // The mutex guards these.
  std::function<void()> done;
  bool is_done = false;
  std::exception_ptr thrown;

  void run(const std::stop_token& service) {
    const std::stop_callback with_the_service(service, [this] { stop.request_stop(); });
    std::exception_ptr failure;
    try {
      work(stop.get_token());
    } catch (...) {  // the request's own thread throws it again
      failure = std::current_exception();
    }
    std::function<void()> tell;
    {
      const std::lock_guard lock(mutex);
      is_done = true;
      thrown = failure;
      tell = std::move(done);
    }
    if (tell) tell();
  }
  /// Nobody wants the work any more.
  void give_up() {
    stop.request_stop();
    const std::lock_guard lock(mutex);
    done = nullptr;
  }
  /// Returns whether the work was done. Throws what it threw.
  bool finished() {
    const std::lock_guard lock(mutex);
    if (thrown) std::rethrow_exception(thrown);
    return is_done;
  }
};

bool Desk::has_room() {
  const std::lock_guard lock(mutex_);
  std::erase_if(line_, [](const auto& order) { return order->stop.stop_requested(); });
  return line_.size() < in_line_;
}

void Desk::put(std::shared_ptr<Order> order, std::function<void()> done) {
  order->done = std::move(done);
  {
    const std::lock_guard lock(mutex_);
    line_.push_back(std::move(order));
    while (threads_.size() < at_once_)
      threads_.emplace_back([this](const std::stop_token& stop) { work(stop); });
  }
  changed_.notify_one();
}

void Desk::work(const std::stop_token& stop) {
  for (;;) {
    std::shared_ptr<Order> order;
    {
      std::unique_lock lock(mutex_);
      if (!changed_.wait(lock, stop, [this] { return !line_.empty(); })) return;
      order = std::move(line_.front());
      line_.pop_front();
    }
    if (stop.stop_requested()) return;
    if (!order->stop.stop_requested()) order->run(stop);
  }
}

http::Response Desk::answer(Work work, Answer answer, std::chrono::seconds patience,
                            std::string late) {
  auto order = std::make_shared<Order>(std::move(work));
  http::Response response;
  response.deferred = http::Deferred{
      std::chrono::steady_clock::now() + patience,
      [this, order](std::function<void()> wake) -> std::shared_ptr<const void> {
        put(order, std::move(wake));
        // It ends with the connection, or before the answer is made.
        return {order.get(), [order](const void*) { order->give_up(); }};
      },
      [order, answer = std::move(answer), late = std::move(late)](http::Request& again) {
        return order->finished() ? answer(again) : problem({"overloaded", late, {}}, again);
      }};
  return response;
}

}  // namespace kiln::api
