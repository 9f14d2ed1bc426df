#include "server/http/exchange.h"

#include <new>
#include <nlohmann/json.hpp>

#include "server/base/log.h"
#include "server/http/problem.h"
#include "server/store/database.h"

namespace kiln::http {

Exchange::Exchange(Connection& c, RequestHead h, std::string id)
    : connection(c),
      head(std::move(h)),
      body(head, [this](char* out, std::size_t n) { return read_body(out, n); }),
      request{head, body, std::move(id), {}, {}, {}} {}

ssize_t Exchange::read_body(char* out, std::size_t n) {
  const std::string* expect = head.header("expect");
  const bool asked = expect && equal_ignoring_case(*expect, "100-continue");
  if (asked && !continued_ && !connection.has_bytes())
    connection.write("HTTP/1.1 100 Continue\r\n\r\n");
  continued_ = true;
  return connection.read(out, n);
}

void Exchange::ask(const Handler& handler, const Lobby& lobby) {
  const auto report = [&](const char* what) {
    log_line(base::LogLevel::kError, "http.exception", {{"path", head.path}, {"what", what}});
  };
  const auto fail = [&](const char* code, const char* message) {
    response = problem({code, message, {}}, request);
  };
  try {
    response = handler(request);
    if (!response.later) return;
    bell = lobby.bell(connection);
    watch_ = response.later->watch([bell = bell] { Lobby::Bell::ring(bell); });
    return;
  } catch (const store::DatabaseError& e) {
    report(e.what());
    if (e.disk_full) return fail("storage_full", "The disk of the service is full.");
  } catch (const std::bad_alloc&) {
    report("out of memory");
    return fail("out_of_memory", "The service has no memory left for this request.");
  } catch (const std::exception& e) {
    report(e.what());
  } catch (...) {
    report("unknown type");
  }
  fail("internal", "The service failed at this request; its log says more.");
}

void Exchange::ask_again(const Lobby& lobby) {
  watch_.reset();
  const auto headers = std::move(response.headers);
  const Handler answer = std::move(response.later->answer);
  ask(answer, lobby);
  for (const auto& [name, value] : headers) response.header(name, value);
}

Connection::Clock::duration Exchange::own_time() const {
  return time() - connection.waited() - request.asleep;
}

}  // namespace kiln::http
