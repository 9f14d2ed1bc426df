#pragma once

#include <chrono>
#include <condition_variable>
#include <filesystem>
#include <functional>
#include <map>
#include <mutex>
#include <stop_token>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "proto/expected.h"
#include "proto/webhook.h"
#include "server/store/job_store.h"
#include "server/webhooks/networks.h"
#include "server/webhooks/secrets.h"
#include "server/webhooks/sender.h"

namespace kiln::webhooks {

/// From a failed try to the next; after the last one a message is given up.
using WebhookDelays = std::vector<std::chrono::milliseconds>;
inline const WebhookDelays kWebhookDelays{std::chrono::seconds(5),  std::chrono::seconds(30),
                                          std::chrono::minutes(2),  std::chrono::minutes(10),
                                          std::chrono::minutes(45), std::chrono::hours(2),
                                          std::chrono::hours(6)};

struct WebhookOptions {
  Networks allowed;               ///< besides public addresses
  std::filesystem::path secrets;  ///< read at each use, so that it can change; "": there are none
  WebhookLimits limits;
  WebhookDelays delays = kWebhookDelays;
};

/// Sends what the job store holds for webhooks, on threads of its own: at least once each, several
/// times when the receiver does not take it. What is not sent yet survives the process. A receiver
/// that hangs holds two threads at most. Thread-safe.
class Webhooks {
 public:
  /// Is called with how each try ended: "delivered", "retried" or "failed".
  using Count = std::function<void(std::string_view outcome)>;

  Webhooks(store::JobStore&, WebhookOptions, Count);
  ~Webhooks();  ///< stop()
  Webhooks(const Webhooks&) = delete;
  Webhooks& operator=(const Webhooks&) = delete;

  /// Whether messages can go there, as far as it can be told now.
  /// Errors: `invalid_request`: the URL, or a secret that this tenant has not.
  proto::Expected<void> check(const proto::Webhook&, const std::string& tenant) const;

  struct Tested {
    std::string id;
    WebhookAnswer answer;
  };
  /// Sends one message of the type webhook.test, once. Blocks.
  Tested test(const proto::Webhook&, const std::string& tenant) const;

  void stop();  ///< what is on its way is sent again by the next process

 private:
  static constexpr unsigned kThreads = 4, kPerOrigin = 2;

  void loop(const std::stop_token&);
  std::optional<store::Delivery> claim();  ///< needs mutex_
  void wait(std::unique_lock<std::mutex>&, const std::stop_token&);
  WebhookAnswer send(const store::Delivery&, const std::stop_token&) const;
  void settle(const store::Delivery&, const WebhookAnswer&);
  void leave(const std::string& origin);  ///< with the mutex held
  proto::Expected<std::vector<std::string>> keys(const std::string& tenant,
                                                 const std::string& name) const;

  store::JobStore& store_;
  const WebhookOptions options_;
  const Count count_;
  std::stop_source stop_;
  std::mutex mutex_;
  std::condition_variable_any changed_;
  std::map<std::string, unsigned> origins_;  ///< messages on their way; guarded by mutex_
  std::uint64_t news_ = 0;                   ///< guarded by mutex_
  std::vector<std::jthread> threads_;
};

}  // namespace kiln::webhooks
