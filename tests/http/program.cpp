#include "tests/http/program.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <stdexcept>

#include "baker/generate/generate.h"
#include "baker/gltf/glb_writer.h"

extern char** environ;

namespace kiln::test {
namespace {

pid_t spawn(const std::vector<std::string>& words, int log) {
  std::vector<char*> argv;
  for (const auto& word : words) argv.push_back(const_cast<char*>(word.c_str()));
  argv.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, log, STDERR_FILENO);
  pid_t pid = -1;
  if (posix_spawn(&pid, argv[0], &actions, nullptr, argv.data(), environ) != 0) pid = -1;
  posix_spawn_file_actions_destroy(&actions);
  return pid;
}

// The port in the line that says `ready`: "api":"http://<address>:<port>".
std::uint16_t port_after(const std::string& log, const std::string& key) {
  const std::string beginning = "\"" + key + "\":\"http://";
  const auto at = log.find(beginning);
  if (at == std::string::npos) return 0;
  const auto colon = log.find(':', at + beginning.size());
  return static_cast<std::uint16_t>(std::stoul(log.substr(colon + 1, 5)));
}

std::string file_text(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

}  // namespace

Program::Program(const std::filesystem::path& data, const std::vector<std::string>& flags) {
  std::array<int, 2> ends{};
  if (::pipe2(ends.data(), O_CLOEXEC) != 0) throw std::runtime_error("pipe");
  std::vector<std::string> words{LIGHTKILN_BINARY, "serve", "--port", "0",
                                 "--admin-port",   "0",     "--data", data.string(),
                                 "--log-format",   "json"};
  words.insert(words.end(), flags.begin(), flags.end());
  pid_ = spawn(words, ends[1]);
  ::close(ends[1]);
  reader_ = std::thread([this, fd = ends[0]] { read_log(fd); });
  EXPECT_TRUE(logged("\"event\":\"ready\"")) << log();
  const std::string text = log();
  port_ = port_after(text, "api");
  admin_port_ = port_after(text, "admin");
}

Program::~Program() {
  if (pid_ > 0) {
    signal(SIGKILL);
    wait_exit();
  }
  reader_.join();
}

void Program::read_log(int fd) {
  std::array<char, 4096> piece;
  for (;;) {
    const ssize_t got = ::read(fd, piece.data(), piece.size());
    if (got < 0 && errno == EINTR) continue;
    const std::lock_guard lock(mutex_);
    if (got > 0) log_.append(piece.data(), static_cast<std::size_t>(got));
    ended_ = got <= 0;
    changed_.notify_all();
    if (ended_) break;
  }
  ::close(fd);
}

bool Program::logged(const std::string& text, std::chrono::milliseconds time) {
  std::unique_lock lock(mutex_);
  const auto has = [&] {  // in a line that is whole
    const auto at = log_.find(text);
    return at != std::string::npos && log_.find('\n', at) != std::string::npos;
  };
  changed_.wait_for(lock, time, [&] { return has() || ended_; });
  return has();
}

std::string Program::log() {
  const std::lock_guard lock(mutex_);
  return log_;
}

void Program::signal(int number) const {
  if (pid_ > 0) ::kill(pid_, number);
}

int Program::wait_exit() {
  int status = 0;
  if (pid_ <= 0 || ::waitpid(pid_, &status, 0) != pid_) return -1000;
  pid_ = -1;
  return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
}

std::uint64_t Program::anonymous_bytes() const {
  const std::string text = file_text("/proc/" + std::to_string(pid_) + "/status");
  const auto at = text.find("RssAnon:");
  return at == std::string::npos ? 0 : std::stoull(text.substr(at + 8)) * 1024;
}

Answer curl(const std::string& arguments) {
  const TempFolder folder;
  const std::string at = folder.path().string();
  const std::string command = "curl --silent --show-error --max-time 120 -o " + at + "/body -D " +
                              at + "/head " + arguments + " 2>" + at + "/error </dev/null";
  Answer answer;
  if (const int status = std::system(command.c_str()); status != 0) {
    answer.body = file_text(folder.path() / "error");
    return answer;
  }
  std::string head = file_text(folder.path() / "head");
  if (const auto last = head.rfind("HTTP/1.1 "); last != std::string::npos) head.erase(0, last);
  read_head(head, answer);  // the last one: a 100 Continue may come before it
  answer.body = file_text(folder.path() / "body");
  return answer;
}

std::filesystem::path write_scene(const std::filesystem::path& folder, const std::string& name) {
  auto path = folder / (name + ".glb");
  std::ofstream(path, std::ios::binary) << generate::generate_glb(name).value();
  return path;
}

std::filesystem::path write_small_scene(const std::filesystem::path& folder) {
  using math::Vec2, math::Vec3;
  // A parallelogram; (u, v) is its place on the page.
  const auto square = [](Vec3 corner, Vec3 du, Vec3 dv, Vec3 normal, Vec2 uv) {
    constexpr float kPart = 0.0625f;  // 64 of 1024 texels
    const std::vector<Vec2> uvs{
        uv, {uv.x + kPart, uv.y}, {uv.x, uv.y + kPart}, {uv.x + kPart, uv.y + kPart}};
    return gltf::GlbPrimitive{0,
                              {corner, corner + du, corner + dv, corner + du + dv},
                              std::vector<Vec3>(4, normal),
                              uvs,
                              uvs,
                              {{0, 1, 2}, {2, 1, 3}}};
  };
  gltf::GlbDocument document;
  document.name = "corner";
  document.materials.emplace_back().base_color = {0.5f, 0.5f, 0.5f};
  document.meshes = {
      {"floor", {square({0, 0, 2}, {2, 0, 0}, {0, 0, -2}, {0, 1, 0}, {0.0625f, 0.0625f})}},
      {"wall", {square({0, 0, 0}, {2, 0, 0}, {0, 2, 0}, {0, 0, 1}, {0.25f, 0.0625f})}},
  };
  document.lights.emplace_back().intensity = 100;
  document.nodes.resize(3);
  document.nodes[0].mesh = 0;
  document.nodes[1].mesh = 1;
  document.nodes[2].light = 0;
  document.nodes[2].translation = {1, 1.5f, 1};
  auto path = folder / "corner.glb";
  std::ofstream(path, std::ios::binary) << gltf::write_glb(document);
  return path;
}

std::string job_form(const std::filesystem::path& scene, const std::string& settings) {
  return "-F scene=@" + scene.string() + R"( --form-string 'options={"dedupe":false}')" +
         (settings.empty() ? " " : " --form-string 'settings=" + settings + "' ");
}

std::string post_job(const Program& program, const std::filesystem::path& scene,
                     const std::string& settings) {
  const Answer answer = curl(job_form(scene, settings) + program.url("/v1/jobs"));
  EXPECT_EQ(answer.status, 202) << answer.body;
  return member(answer.body, "id");
}

}  // namespace kiln::test
