#include "server/sandbox/supervisor.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <optional>
#include <system_error>
#include <thread>
#include <vector>

#include "baker/exec/stop.h"
#include "server/sandbox/confine.h"
#include "server/sandbox/spawn.h"

namespace kiln::sandbox {
namespace {

using proto::Expected;
using proto::Fd;
using proto::Unexpected;
using Clock = std::chrono::steady_clock;
using namespace std::chrono_literals;

/// So much is kept of what a process says on its standard error.
constexpr std::size_t kMaxSaid = 2048;
constexpr int kFirstFile = STDERR_FILENO + 1;

Unexpected cannot(const char* what, int error) {
  return proto::fail("io_error", std::string("The import process can't be started: ") + what +
                                     ": " + std::system_category().message(error) + ".");
}

/// Descriptors in the order in which the process gets them, from kFirstFile on.
class Inheritance {
 public:
  int add(int fd) {
    if (fd < 0) return -1;
    sources_.push_back(fd);
    return kFirstFile + static_cast<int>(sources_.size()) - 1;
  }
  proto::Expected<int> open(const std::filesystem::path& path) {
    opened_.emplace_back(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
    if (!opened_.back().valid())
      return proto::fail("missing_file", "cannot read \"" + path.filename().string() + "\"");
    return add(opened_.back().get());
  }
  const std::vector<int>& sources() const { return sources_; }

 private:
  std::vector<int> sources_;
  std::vector<Fd> opened_;
};

proto::Expected<ImportRequest> make_request(const ImportProcessOptions& options,
                                            const ImportJob& job, int orders, Inheritance& files) {
  ImportRequest request{job.work,
                        job.key,
                        job.settings,
                        job.limits,
                        options.memory_bytes,
                        options.most_memory_bytes,
                        options.seconds,
                        {},
                        job.files.sky_map,
                        files.add(job.product),
                        files.add(orders),
                        files.add(job.scene),
                        files.add(job.lit)};
  if (job.work == ImportWork::kProbe) return request;
  const auto main = files.open(job.files.main);
  if (!main) return Unexpected(main.error());
  request.files.push_back({"", *main});
  for (const auto& [name, path] : job.files.side) {
    const auto side = files.open(path);
    if (!side) return Unexpected(side.error());
    request.files.push_back({name, *side});
  }
  return request;
}

struct Pipe {
  Fd read, write;
  static proto::Expected<Pipe> make() {
    std::array<int, 2> ends{};
    if (::pipe2(ends.data(), O_CLOEXEC) != 0) return cannot("pipe", errno);
    Pipe pipe{Fd(ends[0]), Fd(ends[1])};
    ::fcntl(pipe.read.get(), F_SETFL, O_NONBLOCK);
    return pipe;
  }
};

struct StartedPid {
  pid_t pid = -1;
  bool decodes_images = false;
};

/// Starts the process: as a copy of the zygote, or as a program of its own for work that needs no
/// image module while there is no zygote.
Expected<StartedPid> start(const ImportProcessOptions& options, const ImportJob& job,
                           std::vector<int> files, const std::stop_token& stop) {
  if (options.zygote) {
    const bool needs_it = job.work == ImportWork::kImport && job.decodes_images;
    if (const auto pid = options.zygote->fork(files, needs_it ? kZygotePatience : 0ms, stop))
      return StartedPid{*pid, true};
    if (stop.stop_requested()) return exec::canceled();
    if (needs_it) return cannot("no process that has the image module open answers", ETIMEDOUT);
  }
  pid_t pid = -1;
  SpawnPlan plan;
  if (const int error = plan.give(std::move(files)); error != 0)
    return cannot("descriptors", error);
  if (const int error = plan.run(options.program, "import-stage", pid); error != 0)
    return cannot(options.program.c_str(), error);
  return StartedPid{pid, false};
}

}  // namespace

/// The ways in which a wait for a process ends.
enum class End { kByItself, kAnswered, kStopped, kLate, kTalkedTooMuch };

/// A running process: waited for by this thread, killed at the latest when this goes.
class ImportProcess {
 public:
  ImportProcess(pid_t pid, Fd answer, Fd said)
      : pid_(pid), answer_fd_(std::move(answer)), said_fd_(std::move(said)) {}
  ImportProcess(const ImportProcess&) = delete;
  ImportProcess& operator=(const ImportProcess&) = delete;
  ~ImportProcess() {
    if (pid_ > 0) kill_now();
  }

  /// Reads what it says until it closes its pipes, and waits for its end. With `one_answer` it
  /// also returns, as kAnswered, once a line was answered and the process lives.
  End wait(std::optional<Clock::time_point> deadline, const std::stop_token& stop,
           bool one_answer = false) {
    const Fd wake(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK));
    const std::stop_callback on_stop(stop, [&] { ::eventfd_write(wake.get(), 1); });
    End end = End::kByItself;
    while (end == End::kByItself && (answer_fd_.valid() || said_fd_.valid())) {
      std::array<pollfd, 3> files{
          {{answer_fd_.get(), POLLIN, 0}, {said_fd_.get(), POLLIN, 0}, {wake.get(), POLLIN, 0}}};
      ::poll(files.data(), files.size(), milliseconds_to(deadline));
      if (stop.stop_requested())
        end = End::kStopped;
      else if (deadline && Clock::now() >= *deadline)
        end = End::kLate;
      else if (!take(answer_fd_, answer_, kMaxAnswerBytes))
        end = End::kTalkedTooMuch;
      else if (one_answer && answer_.ends_with('\n'))
        return End::kAnswered;
      else
        take(said_fd_, said_, kMaxSaid);
    }
    if (end == End::kByItself) end = reap_within(deadline, stop);
    if (end != End::kByItself) kill_now();
    return end;
  }

  pid_t pid() const { return pid_; }
  const std::string& answer() const { return answer_; }
  void forget_answer() { answer_.clear(); }
  const std::string& said() const { return said_; }
  int status() const { return status_; }

 private:
  static int milliseconds_to(std::optional<Clock::time_point> deadline) {
    if (!deadline) return -1;
    const auto left =
        std::chrono::ceil<std::chrono::milliseconds>(*deadline - Clock::now()).count();
    return static_cast<int>(std::clamp<std::int64_t>(left, 0, 60'000));
  }

  /// Returns false when there is more than `max`; the rest is read and forgotten.
  static bool take(Fd& fd, std::string& to, std::size_t max) {
    std::array<char, 16384> piece;
    while (fd.valid()) {
      const ssize_t n = ::read(fd.get(), piece.data(), piece.size());
      if (n < 0 && errno == EINTR) continue;
      if (n < 0 && errno == EAGAIN) break;
      if (n <= 0) {
        fd.reset();
        break;
      }
      const std::size_t room = max - to.size(), got = static_cast<std::size_t>(n);
      to.append(piece.data(), std::min(room, got));
      if (got > room) return false;
    }
    return true;
  }

  /// A process that closed its pipes is all but gone.
  End reap_within(std::optional<Clock::time_point> deadline, const std::stop_token& stop) {
    for (auto pause = std::chrono::microseconds(50);;
         pause = std::min(pause * 2, std::chrono::microseconds(10'000))) {
      const pid_t got = ::waitpid(pid_, &status_, WNOHANG);
      if (got == pid_) {
        pid_ = -1;
        return End::kByItself;
      }
      if (stop.stop_requested()) return End::kStopped;
      if (deadline && Clock::now() >= *deadline) return End::kLate;
      std::this_thread::sleep_for(pause);
    }
  }

  void kill_now() {
    ::kill(-pid_, SIGKILL);  // with whatever it started where system calls are not filtered
    ::kill(pid_, SIGKILL);
    while (::waitpid(pid_, &status_, 0) < 0 && errno == EINTR) {
    }
    pid_ = -1;
  }

  pid_t pid_;
  Fd answer_fd_, said_fd_;
  std::string answer_, said_;
  int status_ = 0;
};

namespace {

std::string text_of(std::uint64_t number) {
  return std::to_string(number);
}

Unexpected too_late(const ImportProcessOptions& options) {
  return proto::fail("import_timeout",
                     "Reading the scene took longer than the limit `import_seconds` of this "
                     "service, " +
                         text_of(options.seconds) + ".");
}

Unexpected out_of_memory(const ImportProcessOptions& options) {
  return proto::fail("import_out_of_memory",
                     options.memory_bytes > 0
                         ? "Reading the scene takes more memory than the " +
                               text_of(options.memory_bytes) +
                               " bytes that `import_memory_bytes` and `memory_budget_bytes` of "
                               "this service leave for it."
                         : "Reading the scene takes more memory than there is.");
}

Unexpected crashed(const std::string& how) {
  return proto::fail("import_crashed",
                     "The process that read the scene " + how +
                         ". The scene may be made to do this, or meet a fault of the decoders.");
}

Expected<Confinement> outcome_of(const ImportProcessOptions& options, const std::string& text) {
  auto answer = parse_answer(text);
  if (!answer) return crashed("gave no valid answer: " + answer.error().message);
  if (!answer->error) return answer->confinement;
  if (answer->error->code == "import_out_of_memory") return out_of_memory(options);
  return Unexpected(std::move(*answer->error));
}

/// Returns the job's outcome by the process's end.
Expected<Confinement> outcome_of(const ImportProcessOptions& options, const ImportProcess& process,
                                 End end) {
  if (end == End::kStopped) return exec::canceled();
  if (end == End::kLate) return too_late(options);
  if (end == End::kTalkedTooMuch) return crashed("answered too much");
  const int status = process.status();
  if (WIFSIGNALED(status) && WTERMSIG(status) == SIGXCPU) return too_late(options);
  if (WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL)
    return crashed("was killed by the system, for want of memory perhaps");
  if (WIFSIGNALED(status))
    return crashed("was ended by signal " + std::to_string(WTERMSIG(status)) + " (" +
                   ::sigdescr_np(WTERMSIG(status)) + ")");
  if (WEXITSTATUS(status) != 0)
    return crashed("ended with code " + std::to_string(WEXITSTATUS(status)));
  return outcome_of(options, process.answer());
}

struct Started {
  std::unique_ptr<ImportProcess> process;
  bool decodes_images = false;
};

/// @param orders descriptor that brings the process its orders; -1: none
proto::Expected<Started> launch(const ImportProcessOptions& options, const ImportJob& job,
                                int orders, const std::stop_token& stop) {
  Inheritance files;
  const auto request = make_request(options, job, orders, files);
  if (!request) return Unexpected(request.error());
  const auto input = request_file(*request);
  if (!input) return Unexpected(input.error());
  auto answer = Pipe::make();
  if (!answer) return Unexpected(answer.error());
  auto said = Pipe::make();
  if (!said) return Unexpected(said.error());
  std::vector<int> given{input->get(), answer->write.get(), said->write.get()};
  given.insert(given.end(), files.sources().begin(), files.sources().end());
  const auto started = start(options, job, std::move(given), stop);
  if (!started) return Unexpected(started.error());
  auto process =
      std::make_unique<ImportProcess>(started->pid, std::move(answer->read), std::move(said->read));
  if (options.started) options.started(started->pid);
  return Started{std::move(process), started->decodes_images};
}

std::optional<Clock::time_point> deadline_of(const ImportProcessOptions& options) {
  if (options.seconds == 0) return std::nullopt;
  return Clock::now() + std::chrono::seconds(options.seconds);
}

/// Waits for the process's end. Reports a failure that is not the scene's.
Expected<Confinement> finish(const ImportProcessOptions& options, ImportProcess& process, End end) {
  auto outcome = outcome_of(options, process, end);
  const bool by_itself =
      end == End::kByItself && WIFEXITED(process.status()) && WEXITSTATUS(process.status()) == 0;
  if (!outcome && !(by_itself && outcome.error().code != "import_crashed") &&
      end != End::kStopped && options.failed)
    options.failed(outcome.error().message, process.said());
  return outcome;
}

}  // namespace

proto::Expected<Confinement> run_import_process(const ImportProcessOptions& options,
                                                const ImportJob& job, std::stop_token stop) {
  const auto started = launch(options, job, -1, stop);
  if (!started) return Unexpected(started.error());
  ImportProcess& process = *started->process;
  return finish(options, process, process.wait(deadline_of(options), stop));
}

struct CheckedProcess::Parts {
  std::unique_ptr<ImportProcess> process;
  Fd orders;
  std::uint64_t memory_bytes = 0;
};

CheckedProcess::CheckedProcess(std::unique_ptr<Parts> parts) : parts_(std::move(parts)) {}
CheckedProcess::~CheckedProcess() = default;

proto::Expected<std::unique_ptr<CheckedProcess>> run_check_process(
    const ImportProcessOptions& options, const ImportJob& job, std::stop_token stop) {
  // A socket, since a write to one whose reader is gone can do without a signal.
  std::array<int, 2> ends{};
  if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()) != 0)
    return cannot("socketpair", errno);
  Fd ours(ends[0]), theirs(ends[1]);
  auto started = launch(options, job, theirs.get(), stop);
  theirs.reset();
  if (!started) return Unexpected(started.error());
  ImportProcess& process = *started->process;
  const auto deadline = deadline_of(options);
  End end = process.wait(deadline, stop, true);
  if (end == End::kAnswered && !outcome_of(options, process.answer()))
    end = process.wait(deadline, stop);  // it ends by itself
  if (end != End::kAnswered)
    if (const auto outcome = finish(options, process, end); !outcome)
      return Unexpected(outcome.error());
  if (end != End::kAnswered) return crashed("ended before it was told to");
  // Without the image module it could check the scene only.
  if (options.zygote && !started->decodes_images) return nullptr;
  process.forget_answer();
  auto parts = std::make_unique<CheckedProcess::Parts>();
  parts->process = std::move(started->process);
  parts->orders = std::move(ours);
  parts->memory_bytes = options.memory_bytes;
  return std::make_unique<CheckedProcess>(std::move(parts));
}

std::optional<proto::Expected<Confinement>> CheckedProcess::import(
    const ImportProcessOptions& options, const std::string& key, std::stop_token stop) {
  ImportProcess& process = *parts_->process;
  const std::uint64_t more =
      options.memory_bytes - std::min(options.memory_bytes, parts_->memory_bytes);
  const std::string order = key + "\n";
  if (!raise_bounds(process.pid(), more) ||
      ::send(parts_->orders.get(), order.data(), order.size(), MSG_NOSIGNAL) !=
          static_cast<ssize_t>(order.size()))
    return std::nullopt;
  const End end = process.wait(deadline_of(options), stop);
  if (end == End::kByItself && process.answer().empty() && WIFEXITED(process.status()) &&
      WEXITSTATUS(process.status()) == 0)
    return std::nullopt;  // it was on its way out when the order came
  auto outcome = finish(options, process, end);
  if (!outcome && outcome.error().code == "import_out_of_memory") return std::nullopt;
  return outcome;
}

}  // namespace kiln::sandbox
