#include "server/sandbox/confine.h"

#include <fcntl.h>
#include <sched.h>
#include <seccomp.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <memory>
#include <system_error>

#include "proto/files.h"

namespace kiln::sandbox {
namespace {

// The shadow memory of a sanitizer is larger than any limit; and it writes to a pipe of its own
// what it wants to look at, to see whether it may be read.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool kSanitized = true;
constexpr std::uint64_t kNewDescriptors = 16;
#else
constexpr bool kSanitized = false;
constexpr std::uint64_t kNewDescriptors = 0;
#endif

/// Room for the program, its libraries and its stack, which count as address space too.
constexpr std::uint64_t kProgramBytes = 512ull << 20;

/// @param most another process may raise the limit to this
bool limit(int resource, std::uint64_t value, std::uint64_t most = 0) {
  const rlimit both{value, std::max(value, most)};
  return ::setrlimit(static_cast<__rlimit_resource>(resource), &both) == 0;
}

/// Bytes of this process's address space that are in use: the libraries and the upload, too.
struct InUse {
  std::uint64_t all = 0, data = 0;  ///< `data`: what may be written and is no file
};
InUse bytes_in_use() {
  const proto::Fd file(::open("/proc/self/statm", O_RDONLY | O_CLOEXEC));
  char text[128] = {};
  if (!file.valid() || ::read(file.get(), text, sizeof text - 1) <= 0) return {};
  unsigned long long all = 0, data = 0;
  if (std::sscanf(text, "%llu %*u %*u %*u %*u %llu", &all, &data) != 2) return {};
  const auto page = std::uint64_t(::sysconf(_SC_PAGESIZE));
  return {all * page, data * page};
}

bool limit_memory(std::uint64_t bytes, std::uint64_t most) {
  if (bytes == 0 || kSanitized) return false;
  const InUse now = bytes_in_use();
  const std::uint64_t all = now.all + kProgramBytes;
  return limit(RLIMIT_DATA, now.data + bytes, now.data + most) &&
         limit(RLIMIT_AS, all + bytes, all + most);
}

/// Asks the kernel to end this process, not the service, when memory runs short.
void go_first() {
  const proto::Fd file(::open("/proc/self/oom_score_adj", O_WRONLY | O_CLOEXEC));
  if (file.valid() && ::write(file.get(), "1000", 4) != 4)
    return;  // then it is as likely as others
}

// The C and C++ libraries call these for memory, descriptors, clocks, and to end.
constexpr int kCalls[] = {
    SCMP_SYS(read),           SCMP_SYS(pread64),      SCMP_SYS(write),
    SCMP_SYS(pwrite64),       SCMP_SYS(writev),       SCMP_SYS(lseek),
    SCMP_SYS(close),          SCMP_SYS(fstat),        SCMP_SYS(munmap),
    SCMP_SYS(mremap),         SCMP_SYS(brk),          SCMP_SYS(madvise),
    SCMP_SYS(futex),          SCMP_SYS(exit),         SCMP_SYS(exit_group),
    SCMP_SYS(rt_sigreturn),   SCMP_SYS(rt_sigaction), SCMP_SYS(rt_sigprocmask),
    SCMP_SYS(sigaltstack),    SCMP_SYS(getpid),       SCMP_SYS(gettid),
    SCMP_SYS(clock_gettime),  SCMP_SYS(gettimeofday), SCMP_SYS(getrandom),
    SCMP_SYS(sysinfo),        SCMP_SYS(sched_yield),  SCMP_SYS(getrusage),
    SCMP_SYS(restart_syscall)};

// A zygote calls these, too, to fork processes, and they do before they are confined.
constexpr int kZygoteCalls[] = {SCMP_SYS(sendto),    SCMP_SYS(recvmsg),   SCMP_SYS(dup2),
                                SCMP_SYS(fcntl),     SCMP_SYS(setpgid),   SCMP_SYS(close_range),
                                SCMP_SYS(getppid),   SCMP_SYS(prctl),     SCMP_SYS(openat),
                                SCMP_SYS(prlimit64), SCMP_SYS(setrlimit), SCMP_SYS(seccomp)};

enum class For { kImport, kZygote };

/// Returns 0, or minus an errno.
int allow(scmp_filter_ctx filter, For whom) {
  if (whom == For::kZygote) {
    for (const int call : kZygoteCalls)
      if (const int error = ::seccomp_rule_add(filter, SCMP_ACT_ALLOW, call, 0); error != 0)
        return error;
    if (const int error = ::seccomp_rule_add(filter, SCMP_ACT_ALLOW, SCMP_SYS(clone), 1,
                                             SCMP_A0(SCMP_CMP_EQ, CLONE_PARENT | SIGCHLD));
        error != 0)
      return error;
  }
  for (const int call : kCalls)
    if (const int error = ::seccomp_rule_add(filter, SCMP_ACT_ALLOW, call, 0); error != 0)
      return error;
  const auto not_executable = SCMP_A2(SCMP_CMP_MASKED_EQ, PROT_EXEC, 0);
  for (const int call : {SCMP_SYS(mmap), SCMP_SYS(mprotect)})
    if (const int error = ::seccomp_rule_add(filter, SCMP_ACT_ALLOW, call, 1, not_executable);
        error != 0)
      return error;
  if (kSanitized)
    for (const int call : {SCMP_SYS(pipe), SCMP_SYS(pipe2)})
      if (const int error = ::seccomp_rule_add(filter, SCMP_ACT_ALLOW, call, 0); error != 0)
        return error;
  // fstat() of glibc; abort(), which signals this process only.
  if (const int error = ::seccomp_rule_add(filter, SCMP_ACT_ALLOW, SCMP_SYS(newfstatat), 1,
                                           SCMP_A3(SCMP_CMP_EQ, AT_EMPTY_PATH));
      error != 0)
    return error;
  if (whom == For::kZygote)  // children abort, too, each held by its own filter
    return ::seccomp_rule_add(filter, SCMP_ACT_ALLOW, SCMP_SYS(tgkill), 0);
  return ::seccomp_rule_add(filter, SCMP_ACT_ALLOW, SCMP_SYS(tgkill), 1,
                            SCMP_A0(SCMP_CMP_EQ, static_cast<scmp_datum_t>(::getpid())));
}

/// Returns why there is no filter; "" when there is one.
std::string filter_calls(For whom) {
  const auto why = [](int error) { return std::system_category().message(-error); };
  const std::unique_ptr<void, decltype(&::seccomp_release)> filter(
      ::seccomp_init(SCMP_ACT_ERRNO(EPERM)), &::seccomp_release);
  if (!filter) return "libseccomp can't be used";
  // A sanitizer's own thread is held as well.
  if (const int error = ::seccomp_attr_set(filter.get(), SCMP_FLTATR_CTL_TSYNC, 1); error != 0)
    return why(error);
  if (const int error = allow(filter.get(), whom); error != 0) return why(error);
  const int error = ::seccomp_load(filter.get());
  return error == 0 ? "" : why(error);
}

}  // namespace

bool raise_bounds(pid_t pid, std::uint64_t more_bytes) {
  for (const auto resource : {RLIMIT_DATA, RLIMIT_AS, RLIMIT_FSIZE, RLIMIT_CPU}) {
    rlimit now{};
    if (::prlimit(pid, resource, nullptr, &now) != 0) return false;
    if (now.rlim_cur == RLIM_INFINITY) continue;
    const rlim_t more = resource == RLIMIT_CPU ? now.rlim_cur : more_bytes;
    now.rlim_cur += std::min(more, now.rlim_max - now.rlim_cur);
    if (::prlimit(pid, resource, &now, nullptr) != 0) return false;
  }
  return true;
}

void confine_zygote() {
  limit(RLIMIT_CORE, 0);
  ::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0);
  // The import processes say so when there are no filters.
  (void)filter_calls(For::kZygote);
}

Confinement confine(const ImportBounds& bounds) {
  Confinement done;
  go_first();
  done.memory = limit_memory(bounds.memory_bytes, bounds.most_bytes);
  limit(RLIMIT_CORE, 0);
  if (bounds.file_bytes > 0) limit(RLIMIT_FSIZE, bounds.file_bytes, bounds.most_bytes);
  limit(RLIMIT_NPROC, 0);
  const std::uint64_t seconds = bounds.seconds;
  if (seconds > 0) limit(RLIMIT_CPU, seconds, bounds.most_bytes > 0 ? 2 * seconds : seconds);
  ::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0);
  limit(RLIMIT_NOFILE, kNewDescriptors);
  done.no_seccomp = filter_calls(For::kImport);
  return done;
}

}  // namespace kiln::sandbox
