#include "server/webhooks/webhooks.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "proto/json.h"
#include "server/base/clock.h"
#include "server/base/ids.h"
#include "server/base/log.h"

namespace kiln::webhooks {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kLease{30'000};  // of a message on its way: longer than any try

std::int64_t unix_ms() {
  return std::chrono::duration_cast<milliseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

}  // namespace

Webhooks::Webhooks(store::JobStore& store, WebhookOptions options, Count count)
    : store_(store), options_(std::move(options)), count_(std::move(count)) {
  store_.release_deliveries();
  store_.on_delivery([this] {
    {
      const std::lock_guard lock(mutex_);
      ++news_;
    }
    changed_.notify_one();
  });
  for (unsigned i = 0; i < kThreads; ++i)
    threads_.emplace_back([this] { loop(stop_.get_token()); });
}

Webhooks::~Webhooks() {
  stop();
}

void Webhooks::stop() {
  stop_.request_stop();
  changed_.notify_all();
  threads_.clear();  // joins
}

proto::Expected<std::vector<std::string>> Webhooks::keys(const std::string& tenant,
                                                         const std::string& name) const {
  if (name.empty()) return std::vector<std::string>{};
  std::vector<std::string> found;
  if (!options_.secrets.empty()) {
    const auto secrets = WebhookSecrets::read(options_.secrets);
    if (!secrets) return proto::Unexpected(secrets.error());
    found = secrets->keys(tenant, name);
  }
  if (!found.empty()) return found;
  return proto::fail("invalid_request", "This service has no webhook secret `" + name + "`.",
                     "request", "/webhook/secret_ref");
}

proto::Expected<void> Webhooks::check(const proto::Webhook& hook, const std::string& tenant) const {
  if (auto ok = check_webhook_url(hook.url, options_.allowed); !ok) return ok;
  auto found = keys(tenant, hook.secret_ref);
  if (found) return {};
  if (found.error().code == "invalid_request") return proto::Unexpected(found.error());
  log_line(base::LogLevel::kError, "webhook.secrets", {{"what", found.error().message}});
  return proto::fail("internal", "The service can't read its webhook secrets.");
}

Webhooks::Tested Webhooks::test(const proto::Webhook& hook, const std::string& tenant) const {
  const nlohmann::json body{{"type", "webhook.test"},
                            {"timestamp", base::now_rfc3339()},
                            {"data", nlohmann::json::object()}};
  const store::Delivery message{base::new_id("msg_"), tenant, hook.url, "", hook.secret_ref,
                                proto::to_text(body), 0};
  return {message.id, send(message, stop_.get_token())};
}

WebhookAnswer Webhooks::send(const store::Delivery& delivery, const std::stop_token& stop) const {
  auto signing = keys(delivery.tenant, delivery.secret_ref);
  if (!signing) return {0, "its secret is not in the service's configuration"};
  return send_webhook(
      {delivery.id, delivery.url, delivery.body, unix_ms() / 1000, std::move(*signing)},
      options_.allowed, options_.limits, stop);
}

std::optional<store::Delivery> Webhooks::claim() {
  std::vector<std::string> busy;
  for (const auto& [origin, count] : origins_)
    if (count >= kPerOrigin) busy.push_back(origin);
  const std::int64_t now = unix_ms();
  // Nothing is due later than this, unless the clock was set back.
  const milliseconds longest =
      std::max(kLease, options_.delays.empty()
                           ? kLease
                           : *std::max_element(options_.delays.begin(), options_.delays.end()));
  return store_.claim_delivery(now, now + 2 * longest.count(), now + kLease.count(), busy);
}

void Webhooks::wait(std::unique_lock<std::mutex>& lock, const std::stop_token& stop) {
  constexpr std::int64_t kShortest = 20, kBusy = 1'000, kLongest = 60'000;
  const auto next = store_.next_delivery();
  std::int64_t ms = kLongest;
  if (next) ms = *next <= unix_ms() ? kBusy : std::clamp(*next - unix_ms(), kShortest, kLongest);
  const std::uint64_t seen = news_;
  changed_.wait_for(lock, stop, milliseconds(ms), [&] { return news_ != seen; });
}

void Webhooks::loop(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  while (!stop.stop_requested()) {
    try {
      const auto delivery = claim();
      if (!delivery) {
        wait(lock, stop);
        continue;
      }
      ++origins_[delivery->origin];
      lock.unlock();
      try {
        const WebhookAnswer answer = send(*delivery, stop);
        if (!stop.stop_requested() || answer.delivered()) settle(*delivery, answer);
      } catch (...) {
        lock.lock();
        leave(delivery->origin);
        throw;
      }
      lock.lock();
      leave(delivery->origin);
    } catch (const std::exception& e) {
      if (!lock.owns_lock()) lock.lock();
      log_line(base::LogLevel::kError, "webhook", {{"what", e.what()}});
      changed_.wait_for(lock, stop, std::chrono::seconds(1), [] { return false; });
    }
  }
}

void Webhooks::leave(const std::string& origin) {
  if (--origins_[origin] == 0) origins_.erase(origin);
  ++news_;
  changed_.notify_all();
}

void Webhooks::settle(const store::Delivery& delivery, const WebhookAnswer& answer) {
  constexpr int kGone = 410;
  const bool last = delivery.tries >= options_.delays.size() || answer.status == kGone;
  const char* outcome = answer.delivered() ? "delivered" : last ? "failed" : "retried";
  log_line(last && !answer.delivered() ? base::LogLevel::kWarn : base::LogLevel::kInfo, "webhook",
           {{"id", delivery.id},
            {"to", delivery.origin},
            {"try", delivery.tries + 1},
            {"outcome", outcome},
            {"error", answer.error}});
  if (answer.delivered() || last)
    store_.forget_delivery(delivery.id);
  else
    store_.postpone_delivery(delivery.id, delivery.tries + 1,
                             unix_ms() + options_.delays[delivery.tries].count());
  count_(outcome);
}

}  // namespace kiln::webhooks
