#include "server/jobs/job_log.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>

#include "proto/files.h"
#include "server/base/clock.h"

namespace kiln::jobs {

void JobLog::line(const std::string& text) const {
  const proto::Fd file(
      ::open(file_.c_str(), O_WRONLY | O_APPEND | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600));
  struct stat info {};
  if (!file.valid() || ::fstat(file.get(), &info) != 0) return;
  const auto size = static_cast<std::uint64_t>(info.st_size);
  if (size >= kMaxBytes) return;
  std::string out = base::now_rfc3339() + " " + text;
  if (size + out.size() + 1 >= kMaxBytes) {
    out = "... and more, which is left out";
    out.resize(std::max<std::size_t>(out.size(), kMaxBytes - size - 1), '.');
  }
  std::replace_if(
      out.begin(), out.end(), [](unsigned char c) { return c < 0x20 || c == 0x7f; }, ' ');
  out += '\n';
  [[maybe_unused]] const ssize_t full_disk_is_fine = ::write(file.get(), out.data(), out.size());
}

}  // namespace kiln::jobs
