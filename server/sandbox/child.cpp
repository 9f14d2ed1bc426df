#include "server/sandbox/child.h"

#include <sys/prctl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <new>

#include "baker/files/mapped_file.h"
#include "baker/gltf/container.h"
#include "baker/output/lit/lit_glb.h"
#include "baker/output/lit_request.h"
#include "baker/scene/scene_file.h"
#include "proto/files.h"
#include "proto/json.h"
#include "server/sandbox/confine.h"
#include "server/sandbox/protocol.h"

namespace kiln::sandbox {
namespace {

using proto::Expected;
using proto::Unexpected;

constexpr std::size_t kMaxRequest = std::size_t{64} << 20;
constexpr std::size_t kMaxOrder = 100;  ///< a key has 64 letters

[[noreturn]] void end(int code) {
  std::_Exit(code);  // nothing here is worth the time of a destructor
}

/// Lets this process go when the service goes. Signals that end a service are not meant for it.
void tie_to(int parent) {
  for (const int number : {SIGTERM, SIGINT, SIGHUP, SIGPIPE, SIGXFSZ}) std::signal(number, SIG_IGN);
  ::prctl(PR_SET_PDEATHSIG, SIGKILL, 0, 0, 0);
  if (::getppid() != parent) end(1);  // it went before that took effect
}

ImportRequest read_request() {
  std::string text;
  char piece[65536];
  for (;;) {
    const ssize_t n = ::read(STDIN_FILENO, piece, sizeof piece);
    if (n < 0 || text.size() > kMaxRequest) end(1);
    if (n == 0) break;
    text.append(piece, static_cast<std::size_t>(n));
  }
  auto request = parse_request(text);
  if (request) return std::move(*request);
  std::fprintf(stderr, "lightkiln import-stage: %s\n", request.error().message.c_str());
  end(1);
}

/// Closes all descriptors but those that the request names.
void close_others(const ImportRequest& request) {
  int last = std::max({STDERR_FILENO, request.product, request.scene, request.lit, request.orders});
  for (const ImportFile& file : request.files) last = std::max(last, file.fd);
  ::close_range(static_cast<unsigned>(last) + 1, ~0u, 0);
  ::close(STDIN_FILENO);
}

std::string path_of(const ImportFile& file, std::size_t index) {
  return file.name.empty() ? "scene" : "side/" + std::to_string(index);
}

/// Maps the whole upload and closes its descriptors.
Expected<files::SceneFiles> map_files(const ImportRequest& request) {
  files::SceneFiles files;
  auto opened = std::make_shared<files::OpenedFiles>();
  for (std::size_t i = 0; i < request.files.size(); ++i) {
    const ImportFile& file = request.files[i];
    const std::string path = path_of(file, i);
    auto mapped = files::MappedFile::map(file.fd, file.name.empty() ? "scene" : file.name,
                                         files::MappedFile::kAnyLength);
    if (!mapped) return Unexpected(mapped.error());
    ::close(file.fd);
    opened->emplace(path, std::move(*mapped));
    if (i == 0)
      files.main = path;
    else
      files.side[file.name] = path;
  }
  files.sky_map = request.sky_map;
  files.opened = std::move(opened);
  return files;
}

/// The mapped files of kLit.
struct LitInput {
  files::MappedFile scene, request;
};

proto::Expected<LitInput> map_lit(const ImportRequest& request) {
  auto scene = files::MappedFile::map(request.scene, "scene file", files::MappedFile::kAnyLength);
  if (!scene) return Unexpected(scene.error());
  auto lit = files::MappedFile::map(request.lit, "lit request", files::MappedFile::kAnyLength);
  if (!lit) return Unexpected(lit.error());
  return LitInput{std::move(*scene), std::move(*lit)};
}

void send(const ImportAnswer& answer) {
  if (!proto::write_all(STDOUT_FILENO, answer_text(answer), "answer")) end(1);
}

/// Waits for the order to import and returns the key that it brings. Ends this process when nobody
/// can give the order any more.
std::string wait_for_order(int orders) {
  std::string order;
  while (!order.ends_with('\n')) {
    char c = 0;
    const ssize_t n = ::read(orders, &c, 1);
    if (n < 0 && errno == EINTR) continue;
    if (n != 1 || order.size() > kMaxOrder) end(0);
    order += c;
  }
  order.pop_back();
  return order;
}

/// Checks the scene and, when there may be an order to import it, answers, waits for that and does
/// it with what was read for the check.
proto::Expected<void> check(const ImportRequest& request, const files::SceneFiles& files,
                            const ImportAnswer& so_far) {
  const auto settings = proto::parse_settings(request.settings);
  if (!settings) return Unexpected(settings.error());
  auto opened = import::OpenedScene::open(files, request.limits, {});
  if (!opened) return Unexpected(opened.error());
  if (auto checked = opened->check(*settings, {}); !checked) return checked;
  if (request.orders < 0) return {};
  send(so_far);
  const std::string key = wait_for_order(request.orders);
  const auto scene = opened->import(files.sky_map, {});
  if (!scene) return Unexpected(scene.error());
  return scene::write_scene_file(request.product, key, *scene);
}

proto::Expected<void> import(const ImportRequest& request, const files::SceneFiles& files) {
  const auto scene = import::import_files(files, request.limits);
  if (!scene) return Unexpected(scene.error());
  return scene::write_scene_file(request.product, request.key, *scene);
}

proto::Expected<void> write_lit(const ImportRequest& request, const files::SceneFiles& files,
                                const LitInput& input) {
  const auto scene = scene::read_scene_file(input.scene.bytes(), request.key);
  if (!scene) return Unexpected(scene.error());
  const auto lit = output::read_lit_request(input.request.bytes(), *scene);
  if (!lit) return Unexpected(lit.error());
  return output::lit::write_lit_glb(request.product, files, *scene, lit->atlas, lit->light,
                                    request.limits);
}

proto::Expected<void> work(const ImportRequest& request, ImportAnswer& answer) {
  auto files = map_files(request);
  if (!files) return Unexpected(files.error());
  std::optional<LitInput> lit;
  if (request.work == ImportWork::kLit) {
    auto mapped = map_lit(request);
    if (!mapped) return Unexpected(mapped.error());
    lit.emplace(std::move(*mapped));
  }
  // The products: a scene file holds what was in memory, and a .glb ends at 4 GiB.
  const std::uint64_t product =
      request.work == ImportWork::kLit ? gltf::kMaxGlbBytes : request.memory_bytes;
  answer.confinement =
      confine({request.memory_bytes, request.seconds, product, request.most_memory_bytes});
  switch (request.work) {
    case ImportWork::kProbe:
      return {};
    case ImportWork::kCheck:
      return check(request, *files, answer);
    case ImportWork::kImport:
      return import(request, *files);
    case ImportWork::kLit:
      return write_lit(request, *files, *lit);
    case ImportWork::kImage:
      break;  // run_image_call() does that
  }
  return {};
}

/// This process says this when it has no memory left to make an answer.
const std::string& last_words() {
  static const std::string words = [] {
    ImportAnswer answer;
    answer.error = proto::Error{"import_out_of_memory", "", {}};
    return answer_text(answer);
  }();
  return words;
}

/// Called when `new` gets no memory. Not every library lets an error of that fly.
void end_for_want_of_memory() {
  const std::string& words = last_words();
  const bool done = ::write(STDOUT_FILENO, words.data(), words.size()) == ssize_t(words.size());
  end(done ? 0 : 1);
}

Expected<void> guarded_work(const ImportRequest& request, ImportAnswer& answer) {
  try {
    return work(request, answer);
  } catch (const std::bad_alloc&) {
    return proto::fail("import_out_of_memory", "");  // the service finds the words
  } catch (const std::exception& e) {
    return proto::fail(
        "import_crashed",
        std::string("Reading the scene failed by a fault of the service: ") + e.what());
  }
}

}  // namespace

void run_import_stage(int parent) {
  tie_to(parent);
  const ImportRequest request = read_request();
  close_others(request);
  if (request.work == ImportWork::kImage) run_image_call(request);
  (void)last_words();
  std::set_new_handler(end_for_want_of_memory);
  ImportAnswer answer;
  auto done = guarded_work(request, answer);
  if (!done) answer.error = std::move(done.error());
  send(answer);
  end(0);
}

}  // namespace kiln::sandbox
