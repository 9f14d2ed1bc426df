#include "server/sandbox/spawn.h"

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>

extern char** environ;

namespace kiln::sandbox {
namespace {

std::vector<char*> plain_environment() {
  std::vector<char*> kept;
  for (char** entry = environ; *entry != nullptr; ++entry)
    for (const char* name :
         {"LD_LIBRARY_PATH=", "ASAN_OPTIONS=", "UBSAN_OPTIONS=", "TSAN_OPTIONS="})
      if (std::strncmp(*entry, name, std::strlen(name)) == 0) kept.push_back(*entry);
  kept.push_back(nullptr);
  return kept;
}

}  // namespace

SpawnPlan::SpawnPlan() {
  ::posix_spawn_file_actions_init(&actions_);
  ::posix_spawnattr_init(&attributes_);
  sigset_t blocked;  // until the process ignores them
  sigemptyset(&blocked);
  for (const int number : {SIGTERM, SIGINT, SIGHUP}) sigaddset(&blocked, number);
  ::posix_spawnattr_setsigmask(&attributes_, &blocked);
  ::posix_spawnattr_setpgroup(&attributes_, 0);
  ::posix_spawnattr_setflags(&attributes_, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETPGROUP);
}

SpawnPlan::~SpawnPlan() {
  ::posix_spawn_file_actions_destroy(&actions_);
  ::posix_spawnattr_destroy(&attributes_);
}

int SpawnPlan::give(std::vector<int> sources) {
  const int count = static_cast<int>(sources.size());
  for (int& fd : sources) {
    proto::Fd& copy = copies_.emplace_back(::fcntl(fd, F_DUPFD_CLOEXEC, count));
    if (!copy.valid()) return errno;
    fd = copy.get();
  }
  for (int i = 0; i < count; ++i)
    if (const int error =
            ::posix_spawn_file_actions_adddup2(&actions_, sources[static_cast<std::size_t>(i)], i);
        error != 0)
      return error;
  return ::posix_spawn_file_actions_addclosefrom_np(&actions_, count);
}

int SpawnPlan::run(const std::filesystem::path& program, std::string command, pid_t& pid) {
  std::string name = "lightkiln", parent = std::to_string(::getpid());
  std::array<char*, 4> words{name.data(), command.data(), parent.data(), nullptr};
  return ::posix_spawn(&pid, program.c_str(), &actions_, &attributes_, words.data(),
                       plain_environment().data());
}

Child::~Child() {
  end();
}

int Child::wait() {
  int status = 0;
  while (::waitpid(pid_, &status, 0) < 0 && errno == EINTR) {
  }
  pid_ = -1;
  return status;
}

int Child::end() {
  if (pid_ <= 0) return 0;  // these numbers would reach other processes
  ::kill(-pid_, SIGKILL);   // with whatever it started where system calls are not filtered
  ::kill(pid_, SIGKILL);
  return wait();
}

}  // namespace kiln::sandbox
