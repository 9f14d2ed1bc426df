#include "server/http/answer_writer.h"

#include <httplib.h>

#include <algorithm>
#include <string>
#include <vector>

#include "server/http/content.h"

namespace kiln::http {
namespace {

/// The exchange as the library's stream: the checked head in, the answer out.
class ExchangeStream final : public httplib::Stream {
 public:
  // The library decodes, splits and matches header values by rules of its own (percent signs,
  // regular expressions for Range): it gets the method and nothing else.
  explicit ExchangeStream(Exchange& exchange)
      : exchange_(exchange), head_(exchange.head.method + " / HTTP/1.1\r\n\r\n") {}
  bool is_readable() const override { return true; }
  bool is_writable() const override { return !broken_; }
  ssize_t read(char* out, std::size_t n) override {
    const std::size_t take = std::min(n, head_.size() - at_);
    std::copy_n(head_.data() + at_, take, out);
    at_ += take;
    return static_cast<ssize_t>(take);
  }
  ssize_t write(const char* bytes, std::size_t n) override {
    if (broken_ || !exchange_.connection.write({bytes, n})) {
      broken_ = true;
      return -1;
    }
    return static_cast<ssize_t>(n);
  }
  void get_remote_ip_and_port(std::string& ip, int& port) const override {
    ip = exchange_.connection.peer_address();
    port = exchange_.connection.peer_port();
  }
  void get_local_ip_and_port(std::string& ip, int& port) const override {
    ip.clear();
    port = 0;
  }
  socket_t socket() const override { return exchange_.connection.fd(); }
  bool broken() const { return broken_; }

 private:
  Exchange& exchange_;
  const std::string head_;
  std::size_t at_ = 0;
  bool broken_ = false;
};

thread_local Exchange* t_exchange = nullptr;

bool send_piece(const Content& content, std::size_t at, std::size_t left, httplib::DataSink& sink) {
  thread_local std::vector<char> buffer(std::size_t{256} * 1024);
  const std::int64_t got = read_content(content, at, buffer.data(), std::min(left, buffer.size()));
  return got > 0 && sink.write(buffer.data(), static_cast<std::size_t>(got));
}

void fill_answer(Exchange& exchange, httplib::Response& out) {
  Response& response = exchange.response;
  out.status = response.status;
  for (const auto& [name, value] : response.headers) out.set_header(name.c_str(), value);
  if (response.stream) {
    out.set_chunked_content_provider(response.content_type,
                                     [&exchange](std::size_t, httplib::DataSink&) {
                                       exchange.streaming = true;  // the head is out, no body byte
                                       return false;
                                     });
  } else if (!response.content.empty()) {
    out.set_content_provider(
        length_of(response.content), response.content_type,
        [content = response.content](std::size_t at, std::size_t left, httplib::DataSink& sink) {
          return send_piece(content, at, left, sink);
        });
  } else if (!response.content_type.empty()) {
    out.set_content(response.body, response.content_type);
  }
}

}  // namespace

class AnswerWriter::Library final : public httplib::Server {
 public:
  Library();
  // Gives the one protected function of the library that is needed.
  bool process(httplib::Stream& stream) {
    bool ignored = false;
    return process_request(stream, false, ignored, nullptr);
  }
};

AnswerWriter::Library::Library() {
  // One without a socket is taken for one that shuts down, which cuts its answers.
  svr_sock_ = 0;
  set_pre_routing_handler([](const httplib::Request&, httplib::Response& out) {
    fill_answer(*t_exchange, out);
    return HandlerResponse::Handled;
  });
  set_post_routing_handler([](const httplib::Request&, httplib::Response& out) {
    out.headers.erase("Keep-Alive");
    out.headers.erase("Accept-Ranges");
    for (const auto& [name, value] : t_exchange->response.headers)
      if (name == "Accept-Ranges") out.set_header("Accept-Ranges", value);
    if (out.status == 304 || out.status == 204) out.headers.erase("Content-Length");
    out.set_header("X-Request-Id", t_exchange->request.id);
    if (t_exchange->close) out.set_header("Connection", "close");
  });
  set_exception_handler([](const httplib::Request&, httplib::Response& out, std::exception_ptr) {
    out.status = 500;  // filling the answer failed: out of memory
  });
}

AnswerWriter::AnswerWriter() : library_(std::make_unique<Library>()) {}

AnswerWriter::~AnswerWriter() = default;

AnswerWriter::End AnswerWriter::write(Exchange& exchange) {
  const struct Current {
    explicit Current(Exchange* e) { t_exchange = e; }
    ~Current() { t_exchange = nullptr; }
  } current(&exchange);
  ExchangeStream stream(exchange);
  const bool ok = library_->process(stream);
  if (stream.broken()) return End::kClose;
  if (exchange.streaming) return End::kStream;
  return ok && !exchange.close ? End::kKeep : End::kClose;
}

}  // namespace kiln::http
