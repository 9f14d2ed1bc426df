#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/mount.h>
#include <unistd.h>

#include <filesystem>

#include "tests/http/live.h"

/// A service on a disk of its own that fills up.
namespace kiln::test {
namespace {

/// A small file system in memory; none where the test may not mount one.
class SmallDisk {
 public:
  explicit SmallDisk(const char* size) {
    const std::string options = std::string("size=") + size;
    mounted_ = ::mount("tmpfs", folder_.path().c_str(), "tmpfs", 0, options.c_str()) == 0;
  }
  ~SmallDisk() {
    if (mounted_) ::umount2(folder_.path().c_str(), MNT_DETACH);
  }
  SmallDisk(const SmallDisk&) = delete;
  SmallDisk& operator=(const SmallDisk&) = delete;
  bool mounted() const { return mounted_; }
  std::filesystem::path data() const { return folder_.path() / "data"; }

  /// Takes all room that there is.
  void fill() {
    const proto::Fd fd(::open(ballast().c_str(), O_CREAT | O_WRONLY | O_CLOEXEC, 0600));
    for (std::size_t piece = 1 << 20; piece > 0; piece /= 16) {
      const std::string bytes(piece, 'x');
      while (::write(fd.get(), bytes.data(), piece) == static_cast<ssize_t>(piece)) continue;
    }
  }
  void clear() { std::filesystem::remove(ballast()); }

 private:
  std::filesystem::path ballast() const { return folder_.path() / "ballast"; }
  TempFolder folder_;
  bool mounted_ = false;
};

TEST(DiskFull, TheServiceAnswersAndNothingIsLost) {
  SmallDisk disk("32m");
  if (!disk.mounted()) GTEST_SKIP() << "mounting a tmpfs needs root";
  jobs::FakeBake fake;
  base::ServerConfig config;
  config.data = disk.data();
  const Live live(fake.holding(), config);
  const std::string id = post_job(live.port()), path = "/v1/jobs/" + id;
  EXPECT_EQ(wait_for_state(live.port(), id, "running"), "running");

  disk.fill();
  const Answer refused = ask(live.port(), "POST", "/v1/scenes", {}, std::string(300'000, 'x'));
  EXPECT_EQ(refused.status, 507) << refused.body;
  EXPECT_EQ(member(refused.body, "code"), "storage_full");
  EXPECT_EQ(ask(live.port(), "GET", path).status, 200);
  EXPECT_EQ(ask(live.service->admin_port(), "GET", "/healthz").status, 200);
  const Answer ready = ask(live.service->admin_port(), "GET", "/readyz");
  EXPECT_EQ(ready.status, 503) << ready.body;

  fake.go = true;  // the bake can't write its files, and the store not even that
  std::this_thread::sleep_for(std::chrono::milliseconds(700));
  EXPECT_NE(member(ask(live.port(), "GET", path).body, "state"), "succeeded");
  disk.clear();
  EXPECT_EQ(wait_for_state(live.port(), id, "failed"), "failed");
  EXPECT_NE(ask(live.port(), "GET", path).body.find("storage_full"), std::string::npos);

  EXPECT_EQ(ask(live.service->admin_port(), "GET", "/readyz").status, 200);
  EXPECT_EQ(ask(live.port(), "POST", path + "/retry").status, 202);
  EXPECT_EQ(wait_for_state(live.port(), id, "succeeded"), "succeeded");
  EXPECT_EQ(ask(live.port(), "GET", path + "/results/page_00.exr").body.size(), 100'000u);
}

}  // namespace
}  // namespace kiln::test
