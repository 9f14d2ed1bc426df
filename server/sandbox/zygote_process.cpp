#include <dirent.h>
#include <fcntl.h>
#include <sched.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <csignal>
#include <cstdint>
#include <cstdlib>
#include <fstream>
#include <string>

#include "baker/image/image.h"
#include "server/sandbox/child.h"
#include "server/sandbox/confine.h"
#include "server/sandbox/zygote.h"
#include "server/sandbox/zygote_wire.h"

namespace kiln::sandbox {
namespace {

constexpr int kSocket = 0;

/// Forks a child of the service, which waits for it. Returns its id; 0 in the child.
pid_t fork_for_parent() {
  return static_cast<pid_t>(::syscall(SYS_clone, CLONE_PARENT | SIGCHLD, 0, 0, 0, 0));
}

/// Waits until the threads that libraries have started wait for work: then none of them holds a
/// lock that a copy of this process would wait for.
void wait_for_quiet() {
  for (int quiet = 0, tries = 0; quiet < 2 && tries < 1000; ++tries, ::usleep(1000)) {
    DIR* const tasks = ::opendir("/proc/self/task");
    if (tasks == nullptr) return;
    int running = 0;
    while (const dirent* const entry = ::readdir(tasks)) {
      if (entry->d_name[0] == '.') continue;  // "..": the process itself, which runs
      std::ifstream file(std::string("/proc/self/task/") + entry->d_name + "/stat");
      std::string line;
      std::getline(file, line);
      const auto name_end = line.rfind(')');
      running += name_end != std::string::npos && line[name_end + 2] == 'R';
    }
    ::closedir(tasks);
    quiet = running <= 1 ? quiet + 1 : 0;  // this thread runs
  }
}

void die_with(int parent) {
  ::prctl(PR_SET_PDEATHSIG, SIGKILL, 0, 0, 0);
  if (::getppid() != parent) std::_Exit(0);  // it went before that took effect
}

/// Becomes an import process with `files` as its descriptors 0, 1, 2 ..., and no others.
[[noreturn]] void become_import(const std::vector<proto::Fd>& files, int parent) {
  const int count = static_cast<int>(files.size());
  std::vector<int> copies;  // one may lie where another is to go
  for (const proto::Fd& file : files) copies.push_back(::fcntl(file.get(), F_DUPFD, count));
  for (int i = 0; i < count; ++i)
    if (::dup2(copies[static_cast<std::size_t>(i)], i) < 0) std::_Exit(1);
  ::close_range(static_cast<unsigned>(count), ~0u, 0);
  ::setpgid(0, 0);
  run_import_stage(parent);
}

[[noreturn]] void serve_forks(int parent) {
  std::vector<proto::Fd> files;
  while (receive_files(kSocket, files)) {
    const std::int32_t pid = fork_for_parent();
    if (pid == 0) become_import(files, parent);
    files.clear();
    if (::send(kSocket, &pid, sizeof pid, MSG_NOSIGNAL) != sizeof pid) break;
  }
  std::_Exit(0);
}

}  // namespace

void run_import_zygote(int parent) {
  for (const int number : {SIGTERM, SIGINT, SIGHUP, SIGPIPE}) std::signal(number, SIG_IGN);
  die_with(parent);
  const auto opened = image::open_module();
  wait_for_quiet();
  // Threads of libraries stay behind with this process.
  const pid_t copy = fork_for_parent();
  if (copy != 0) std::_Exit(copy < 0 ? 1 : 0);
  die_with(parent);
  confine_zygote();
  if (!send_ready(kSocket, {::getpid(), opened ? "" : opened.error().message})) std::_Exit(1);
  serve_forks(parent);
}

}  // namespace kiln::sandbox
