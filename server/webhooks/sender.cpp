#include "server/webhooks/sender.h"

#include <curl/curl.h>
#include <sys/socket.h>

#include <memory>
#include <stdexcept>

#include "server/webhooks/signature.h"

namespace kiln::webhooks {
namespace {

using Handle = std::unique_ptr<CURL, decltype(&curl_easy_cleanup)>;
using Url = std::unique_ptr<CURLU, decltype(&curl_url_cleanup)>;
using Lines = std::unique_ptr<curl_slist, decltype(&curl_slist_free_all)>;

/// State that the callbacks of one transfer share.
struct Transfer {
  const Networks& allowed;
  const WebhookLimits& limits;
  const std::stop_token& stop;
  std::size_t received = 0;
  bool refused = false;  ///< an address that may not be reached
};

curl_socket_t open_socket(void* data, curlsocktype purpose, curl_sockaddr* address) {
  auto& transfer = *static_cast<Transfer*>(data);
  if (purpose != CURLSOCKTYPE_IPCXN || !may_reach(address->addr, transfer.allowed)) {
    transfer.refused = true;
    return CURL_SOCKET_BAD;
  }
  return ::socket(address->family, address->socktype | SOCK_CLOEXEC, address->protocol);
}

std::size_t take_body(char*, std::size_t size, std::size_t count, void* data) {
  auto& transfer = *static_cast<Transfer*>(data);
  transfer.received += size * count;
  return transfer.received <= transfer.limits.answer_bytes ? size * count : 0;
}

int keep_going(void* data, curl_off_t, curl_off_t, curl_off_t, curl_off_t) {
  return static_cast<Transfer*>(data)->stop.stop_requested() ? 1 : 0;
}

Lines header_lines(const WebhookMessage& message) {
  std::string signatures;
  for (const auto& key : message.keys)
    signatures += (signatures.empty() ? "" : " ") +
                  webhook_signature(key, message.id, message.timestamp, message.body);
  std::vector<std::string> lines{
      "Content-Type: application/json", "Expect:", "User-Agent: lightkiln/" LIGHTKILN_VERSION,
      "Webhook-Id: " + message.id, "Webhook-Timestamp: " + std::to_string(message.timestamp)};
  if (!signatures.empty()) lines.push_back("Webhook-Signature: " + signatures);
  Lines out(nullptr, &curl_slist_free_all);
  for (const auto& line : lines) {
    curl_slist* longer = curl_slist_append(out.get(), line.c_str());
    if (longer == nullptr) throw std::bad_alloc();
    static_cast<void>(out.release());
    out.reset(longer);
  }
  return out;
}

void start_library() {
  static const CURLcode done = curl_global_init(CURL_GLOBAL_DEFAULT);
  if (done != CURLE_OK) throw std::runtime_error("libcurl does not start");
}

void set_options(CURL* curl, const WebhookMessage& message, Transfer& transfer) {
  const auto set = [&](CURLoption option, auto value) {
    if (curl_easy_setopt(curl, option, value) != CURLE_OK)
      throw std::runtime_error("libcurl lacks an option");
  };
  set(CURLOPT_URL, message.url.c_str());
  set(CURLOPT_PROTOCOLS_STR, "http,https");
  set(CURLOPT_DISALLOW_USERNAME_IN_URL, 1L);
  set(CURLOPT_FOLLOWLOCATION, 0L);
  set(CURLOPT_PROXY, "");  // or the environment would choose one
  set(CURLOPT_POST, 1L);
  set(CURLOPT_POSTFIELDSIZE_LARGE, static_cast<curl_off_t>(message.body.size()));
  set(CURLOPT_POSTFIELDS, message.body.c_str());
  set(CURLOPT_NOSIGNAL, 1L);
  set(CURLOPT_QUICK_EXIT, 1L);  // a look-up that hangs is left alone
  set(CURLOPT_CONNECTTIMEOUT_MS, static_cast<long>(transfer.limits.connect.count()));
  set(CURLOPT_TIMEOUT_MS, static_cast<long>(transfer.limits.total.count()));
  set(CURLOPT_OPENSOCKETFUNCTION, &open_socket);
  set(CURLOPT_OPENSOCKETDATA, &transfer);
  set(CURLOPT_WRITEFUNCTION, &take_body);
  set(CURLOPT_WRITEDATA, &transfer);
  set(CURLOPT_NOPROGRESS, 0L);
  set(CURLOPT_XFERINFOFUNCTION, &keep_going);
  set(CURLOPT_XFERINFODATA, &transfer);
}

std::string part_of(CURLU* url, CURLUPart part) {
  char* text = nullptr;
  if (curl_url_get(url, part, &text, 0) != CURLUE_OK) return {};
  std::string out = text;
  curl_free(text);
  return out;
}

proto::Unexpected refuse(const std::string& what) {
  return proto::fail("invalid_request", what, "request", "/webhook/url");
}

}  // namespace

proto::Expected<void> check_webhook_url(const std::string& text, const Networks& allowed) {
  const Url url(curl_url(), &curl_url_cleanup);
  if (!url) throw std::bad_alloc();
  if (curl_url_set(url.get(), CURLUPART_URL, text.c_str(), CURLU_DISALLOW_USER) != CURLUE_OK)
    return refuse("The webhook's URL can't be read; it may not hold a user's name.");
  const std::string scheme = part_of(url.get(), CURLUPART_SCHEME);
  std::string host = part_of(url.get(), CURLUPART_HOST);
  if ((scheme != "http" && scheme != "https") || host.empty())
    return refuse("The webhook's URL has to begin with http:// or https://.");
  // Names are looked up when a message is sent. An address written out is refused at once.
  if (host.front() == '[') host = host.substr(1, host.find_first_of("]%") - 1);
  if (const auto address = Networks::address(host);
      address && !is_public(*address) && !allowed.contains(*address))
    return refuse("The webhook's address is not a public one, and this service does not allow it.");
  return {};
}

WebhookAnswer send_webhook(const WebhookMessage& message, const Networks& allowed,
                           const WebhookLimits& limits, const std::stop_token& stop) {
  start_library();
  const Handle curl(curl_easy_init(), &curl_easy_cleanup);
  if (!curl) throw std::bad_alloc();
  Transfer transfer{allowed, limits, stop};
  const Lines lines = header_lines(message);
  set_options(curl.get(), message, transfer);
  curl_easy_setopt(curl.get(), CURLOPT_HTTPHEADER, lines.get());
  const CURLcode code = curl_easy_perform(curl.get());
  long status = 0;
  curl_easy_getinfo(curl.get(), CURLINFO_RESPONSE_CODE, &status);
  WebhookAnswer answer;
  answer.status = static_cast<int>(status);
  if (answer.delivered()) return answer;
  if (status != 0)
    answer.error = "answered with " + std::to_string(status);
  else if (transfer.refused)
    answer.error = "its address is not a public one, and this service does not allow it";
  else
    answer.error = curl_easy_strerror(code);
  return answer;
}

}  // namespace kiln::webhooks
