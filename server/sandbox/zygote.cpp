#include "server/sandbox/zygote.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <system_error>

#include "server/sandbox/spawn.h"
#include "server/sandbox/zygote_wire.h"

namespace kiln::sandbox {
namespace {

using namespace std::chrono_literals;
using proto::Fd;

constexpr auto kLoadTime = 60s;  ///< beyond this it hangs
constexpr auto kFirstPause = 100ms, kLongestPause = 30'000ms;

std::string reason_of(const char* what, int error) {
  return std::string(what) + ": " + std::system_category().message(error);
}

/// Returns true when `fd` has something to say, or nobody is at its other end; false once it is to
/// stop, or when that took too long.
bool wait_on(int fd, int stop, std::chrono::milliseconds time, short events) {
  std::array<pollfd, 2> files{{{fd, events, 0}, {stop, POLLIN, 0}}};
  while (::poll(files.data(), files.size(), static_cast<int>(time.count())) < 0 && errno == EINTR) {
  }
  return files[0].revents != 0 && files[1].revents == 0;
}

}  // namespace

Zygote::Zygote(Options options)
    : options_(std::move(options)),
      stop_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)),
      keeper_([this](const std::stop_token& stop) { keep(stop); }) {}

Zygote::~Zygote() {
  keeper_.request_stop();
  ::eventfd_write(stop_.get(), 1);
}

pid_t Zygote::pid() const {
  const std::lock_guard lock(mutex_);
  return pid_;
}

std::string Zygote::fault() const {
  const std::lock_guard lock(mutex_);
  return fault_;
}

void Zygote::publish(Fd socket, pid_t pid, std::string fault) {
  {
    const std::lock_guard lock(mutex_);
    socket_ = std::move(socket);
    pid_ = pid;
    fault_ = std::move(fault);
  }
  changed_.notify_all();
}

void Zygote::keep(const std::stop_token& stop) {
  std::chrono::milliseconds pause = kFirstPause;
  while (!stop.stop_requested()) {
    const auto began = std::chrono::steady_clock::now();
    const std::string reason = run(stop);
    publish({}, -1);
    if (stop.stop_requested()) break;
    if (options_.failed) options_.failed(reason);
    const bool lived = std::chrono::steady_clock::now() - began > kLongestPause;
    pause = lived ? kFirstPause : std::min<std::chrono::milliseconds>(2 * pause, kLongestPause);
    wait_on(-1, stop_.get(), pause, 0);
  }
}

/// Starts one and waits for its end. Returns why it ended.
std::string Zygote::run(const std::stop_token& stop) {
  std::array<int, 2> ends{};
  if (::socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends.data()) != 0)
    return reason_of("socketpair", errno);
  Fd ours(ends[0]), theirs(ends[1]);
  const Fd silence(::open("/dev/null", O_RDWR | O_CLOEXEC));
  pid_t loader = -1;
  {
    SpawnPlan plan;
    int error = plan.give({theirs.get(), silence.get(), silence.get()});
    if (error == 0) error = plan.run(options_.program, "import-zygote", loader);
    if (error != 0) return reason_of(options_.program.c_str(), error);
  }
  theirs.reset();
  Child loading(loader);
  auto ready = wait_on(ours.get(), stop_.get(), kLoadTime, POLLIN) ? receive_ready(ours.get())
                                                                   : std::nullopt;
  if (!ready) return "it ended while it opened the image module, or took too long";
  const pid_t pid = ready->pid;
  const Child zygote(pid);
  loading.wait();  // it ends by itself
  const Fd watched(::fcntl(ours.get(), F_DUPFD_CLOEXEC, 0));
  publish(std::move(ours), pid, std::move(ready->fault));
  while (!wait_on(watched.get(), stop_.get(), 3600s, 0) && !stop.stop_requested()) {
  }
  publish({}, -1);
  return "it ended";
}

std::optional<pid_t> Zygote::fork(std::span<const int> files, std::chrono::milliseconds patience,
                                  const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  changed_.wait_for(lock, stop, patience, [&] { return socket_.valid(); });
  if (stop.stop_requested() || !socket_.valid() || !send_files(socket_.get(), files))
    return std::nullopt;
  std::int32_t pid = -1;
  if (::recv(socket_.get(), &pid, sizeof pid, 0) != sizeof pid || pid <= 0) return std::nullopt;
  return pid;
}

}  // namespace kiln::sandbox
