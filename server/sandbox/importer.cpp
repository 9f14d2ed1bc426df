#include "server/sandbox/importer.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <vector>

#include "baker/exec/stop.h"
#include "baker/output/lit_request.h"
#include "baker/scene/scene_file.h"
#include "proto/files.h"
#include "proto/json.h"
#include "proto/sha256.h"

namespace kiln::sandbox {
namespace {

namespace fs = std::filesystem;
using proto::Expected;
using proto::Fd;
using proto::Unexpected;

constexpr const char* kSuffix = ".scene";
constexpr std::size_t kKeptScenes = 4;  ///< of one upload, with different sky maps
/// A scene file is kept when it has at most the first many bytes and the second many for each byte
/// of the upload: JPEGs decode to about ten times their size.
constexpr std::uint64_t kAlwaysKept = 16ull << 20, kKeptPerByte = 16;

/// A file that goes with its last descriptor.
Expected<Fd> file_in_memory(const char* name) {
  Fd file(::memfd_create(name, MFD_CLOEXEC));
  if (!file.valid()) return proto::storage_error("create", name);
  return file;
}

/// A scene file that is open, checked and read.
struct ReadScene {
  Fd file;
  scene::Scene scene;
};

proto::Expected<ReadScene> read_scene(Fd file, const std::string& key,
                                      const std::stop_token& stop) {
  const auto mapped =
      files::MappedFile::map(file.get(), "scene file", files::MappedFile::kAnyLength);
  if (!mapped) return Unexpected(mapped.error());
  auto scene = scene::read_scene_file(mapped->bytes(), key, stop);
  if (!scene) return Unexpected(scene.error());
  return ReadScene{std::move(file), std::move(*scene)};
}

/// Returns the SHA-256 of a file; "" when it can't be read, or a stop was requested.
std::string digest_of(int fd, const std::stop_token& stop) {
  constexpr std::size_t kPiece = std::size_t{8} << 20;
  const auto mapped = files::MappedFile::map(fd, "scene file", files::MappedFile::kAnyLength);
  if (!mapped) return "";
  proto::Sha256 hash;
  for (std::string_view left = mapped->bytes(); !left.empty();) {
    if (stop.stop_requested()) return "";
    hash.update(left.substr(0, kPiece));
    left.remove_prefix(std::min(kPiece, left.size()));
  }
  return hash.hex();
}

std::uint64_t upload_bytes(const files::SceneFiles& files) {
  std::error_code error;
  std::uint64_t all = fs::file_size(files.main, error);
  for (const auto& [name, path] : files.side) all += fs::file_size(path, error);
  return error ? 0 : all;
}

/// Returns the memory of the first try.
std::uint64_t expected_bytes(const base::MemoryBudget& memory, const ImportJob& job,
                             const std::string& owner) {
  constexpr std::uint64_t kPerByte = 8;  ///< documents, vertices, images of JPEG
  // The bake is over: what it had is the process's.
  if (job.work == ImportWork::kLit) return memory.reserved(owner);
  if (job.work == ImportWork::kCheck) return 0;  // decodes no images, and somebody waits for it
  return kPerByte * upload_bytes(job.files);
}

std::optional<std::chrono::milliseconds> left(std::optional<std::chrono::milliseconds> patience,
                                              std::chrono::steady_clock::duration waited) {
  if (!patience) return std::nullopt;
  const auto gone = std::chrono::duration_cast<std::chrono::milliseconds>(waited);
  return *patience - std::min(*patience, gone);
}

using Place = std::optional<base::MemoryBudget::Place>;
using Run = std::function<Expected<Confinement>(const ImportProcessOptions&, Place)>;

/// Runs a process in its turn, with more memory each time that what it was given was not enough.
/// `owner`: see MemoryBudget::enter().
Expected<Confinement> in_turn(const Importer::Options& options, const ImportJob& job,
                              const std::string& owner, const std::stop_token& stop,
                              std::optional<std::chrono::milliseconds> patience, const Run& run) {
  if (!options.memory) return run(options.process, {});
  base::MemoryBudget& memory = *options.memory;
  std::chrono::steady_clock::duration waited{0};
  for (std::uint64_t bytes = expected_bytes(memory, job, owner);; bytes *= 2) {
    const auto began = std::chrono::steady_clock::now();
    auto place = memory.enter(bytes, stop, left(patience, waited), owner);
    waited += std::chrono::steady_clock::now() - began;
    if (!place) return Unexpected(place.error());
    ImportProcessOptions process = options.process;
    bytes = process.memory_bytes = place->bytes();
    process.most_memory_bytes = memory.for_import();
    auto done = run(process, std::move(*place));
    const bool more_helps =
        !done && done.error().code == "import_out_of_memory" && bytes < memory.for_import();
    if (!more_helps) return done;
    if (job.product >= 0 &&
        (::ftruncate(job.product, 0) != 0 || ::lseek(job.product, 0, SEEK_SET) != 0))
      return proto::storage_error("begin again", "scene");
  }
}

Expected<Confinement> run_in_turn(const Importer::Options& options, const ImportJob& job,
                                  const std::string& owner, const std::stop_token& stop) {
  return in_turn(options, job, owner, stop, {},
                 [&](const ImportProcessOptions& process, const Place&) {
                   return run_import_process(process, job, stop);
                 });
}

/// Makes an empty file at the path, or in memory where that is "".
Expected<Fd> new_product(const fs::path& path) {
  if (path.empty()) return file_in_memory("scene");
  Fd file(::open(path.c_str(), O_CREAT | O_EXCL | O_RDWR | O_CLOEXEC, 0600));
  if (!file.valid()) return proto::storage_error("create", path);
  return file;
}

class IsolatedSource final : public baker::UploadReader {
 public:
  IsolatedSource(const Importer::Options& options, std::shared_ptr<CheckedScenes> checked,
                 files::SceneFiles files, const std::string& scene_key, fs::path cache,
                 std::string owner)
      : options_(options),
        checked_(std::move(checked)),
        files_(std::move(files)),
        key_(import::import_key(scene_key, options_.limits, files_.sky_map)),
        cache_(std::move(cache)),
        owner_(std::move(owner)) {}

  proto::Expected<scene::Scene> import(std::stop_token stop) override {
    if (auto kept = find_kept(stop)) {
      checked_->take(identity_of(files_));  // nobody needs it
      return std::move(*kept);
    }
    return make(stop);
  }

  proto::Expected<void> write_lit(const fs::path& path, const scene::Scene&,
                                  const atlas::Atlas& atlas, const output::LitPages& pages,
                                  std::stop_token stop) override {
    const Fd product(::open(path.c_str(), O_CREAT | O_TRUNC | O_WRONLY | O_CLOEXEC, 0666));
    if (!product.valid()) return proto::storage_error("create", path);
    const auto request = file_in_memory("lit-request");
    if (!request) return Unexpected(request.error());
    if (auto ok = output::write_lit_request(request->get(), atlas, pages); !ok) return ok;
    ImportJob job = job_for(ImportWork::kLit);
    job.product = product.get();
    job.scene = scene_file_.get();
    job.lit = request->get();
    const auto done = run_in_turn(options_, job, owner_, stop);
    if (!done) return Unexpected(done.error());
    return {};
  }

 private:
  ImportJob job_for(ImportWork work) const {
    ImportJob job;
    job.work = work;
    job.key = key_;
    job.limits = options_.limits;
    job.files = files_;
    job.decodes_images = options_.decodes_images;
    return job;
  }

  /// Returns the scene that an earlier bake left; nothing when there is none that can be used.
  std::optional<scene::Scene> find_kept(const std::stop_token& stop) {
    std::error_code error;
    if (cache_.empty()) return std::nullopt;
    for (fs::directory_iterator at(cache_, error), end; !error && at != end; at.increment(error)) {
      const std::string name = at->path().filename().string();
      if (!name.starts_with(prefix()) || !name.ends_with(kSuffix)) continue;
      Fd file(::open(at->path().c_str(), O_RDONLY | O_CLOEXEC));
      if (prefix() + digest_of(file.get(), stop) + kSuffix != name) continue;
      auto read = read_scene(std::move(file), key_, stop);
      if (!read) continue;
      ::futimens(read->file.get(), nullptr);  // the ones used last are kept
      scene_file_ = std::move(read->file);
      return std::move(read->scene);
    }
    return std::nullopt;
  }

  proto::Expected<scene::Scene> make(const std::stop_token& stop) {
    if (const auto checked = checked_->take(identity_of(files_)))
      if (const auto done = import_checked(*checked, stop)) {
        if (!*done) return Unexpected(done->error());
        return take_product(std::move(checked->product), checked->temporary, stop);
      }
    const fs::path temporary = cache_.empty() ? fs::path() : options_.new_temporary();
    auto made = make_anew(temporary, stop);
    if (!made && !temporary.empty()) ::unlink(temporary.c_str());
    return made;
  }

  /// Lets the process that checked the scene import it; nothing when another has to.
  std::optional<Expected<Confinement>> import_checked(CheckedScene& checked,
                                                      const std::stop_token& stop) const {
    ImportProcessOptions process = options_.process;
    process.memory_bytes = checked.memory_bytes;
    Place place;
    if (options_.memory) {
      checked.place.reset();  // it sleeps until it has the place of an import
      auto entered = options_.memory->enter(
          expected_bytes(*options_.memory, job_for(ImportWork::kImport), owner_), stop, {}, owner_);
      if (!entered) return Unexpected(entered.error());
      process.memory_bytes = entered->bytes();
      place.emplace(std::move(*entered));
    }
    auto done = checked.process->import(process, key_, stop);
    checked.process.reset();  // before its place
    return done;
  }

  proto::Expected<scene::Scene> make_anew(const fs::path& temporary, const std::stop_token& stop) {
    auto product = new_product(temporary);
    if (!product) return Unexpected(product.error());
    ImportJob job = job_for(ImportWork::kImport);
    job.product = product->get();
    const auto done = run_in_turn(options_, job, owner_, stop);
    if (!done) return Unexpected(done.error());
    return take_product(std::move(*product), temporary, stop);
  }

  /// Reads the scene file that an import left, and keeps it in the cache.
  proto::Expected<scene::Scene> take_product(Fd product, const fs::path& temporary,
                                             const std::stop_token& stop) {
    auto read = read_scene(std::move(product), key_, stop);
    if (!read && read.error().code == "bad_document") return lied(read.error().message);
    if (!read) return Unexpected(read.error());
    if (!temporary.empty() && !cache_.empty())
      if (auto kept = keep(temporary, read->file.get(), stop); !kept)
        return Unexpected(kept.error());
    scene_file_ = std::move(read->file);
    return std::move(read->scene);
  }

  Unexpected lied(const std::string& how) const {
    if (options_.process.failed) options_.process.failed(how, "");
    return proto::fail("import_crashed",
                       "The process that read the scene left something else than a scene: " + how);
  }

  /// Returns true when a file of that size may stay longer than this bake.
  bool is_worth_keeping(std::uint64_t bytes) const {
    return bytes <= kAlwaysKept + kKeptPerByte * upload_bytes(files_);
  }

  /// Scene files that are read in the same way have this prefix; versions, limits and sky maps make
  /// others.
  std::string prefix() const { return key_.substr(0, 16) + "-"; }

  /// Gives the file its name; those go that have its key, or were not used for longest. Or unlinks
  /// it: it then lives as long as its descriptor.
  proto::Expected<void> keep(const fs::path& temporary, int fd, const std::stop_token& stop) const {
    if (!is_worth_keeping(std::uint64_t(::lseek(fd, 0, SEEK_END)))) {
      ::unlink(temporary.c_str());
      return {};
    }
    if (auto synced = proto::sync_file(temporary); !synced) return synced;
    const std::string digest = digest_of(fd, stop);
    if (digest.empty()) return exec::canceled();
    const fs::path name = cache_ / (prefix() + digest + kSuffix);
    if (::rename(temporary.c_str(), name.c_str()) != 0)
      return proto::storage_error("rename", temporary);
    make_room_for(name);
    return proto::sync_folder(cache_);
  }

  void make_room_for(const fs::path& name) const {
    std::vector<std::pair<fs::file_time_type, fs::path>> others;
    std::error_code error;
    for (fs::directory_iterator at(cache_, error), end; !error && at != end; at.increment(error)) {
      const fs::path& path = at->path();
      if (path.extension() != kSuffix || path == name) continue;
      std::error_code gone;
      const auto used = fs::last_write_time(path, gone);
      if (path.filename().string().starts_with(prefix()))
        ::unlink(path.c_str());
      else if (!gone)
        others.emplace_back(used, path);
    }
    std::ranges::sort(others, std::greater{});
    for (std::size_t i = kKeptScenes - 1; i < others.size(); ++i)
      ::unlink(others[i].second.c_str());
  }

  const Importer::Options options_;
  const std::shared_ptr<CheckedScenes> checked_;
  files::SceneFiles files_;
  std::string key_;
  fs::path cache_;
  std::string owner_;
  Fd scene_file_;  ///< what import() read; write_lit() gives it along
};

}  // namespace

Importer::Importer(Options options)
    : options_(std::move(options)), checked_(std::make_shared<CheckedScenes>()) {
  if (!options_.memory) return;
  options_.memory->on_crowded([held = std::weak_ptr(checked_)] {
    const auto checked = held.lock();
    return checked && checked->drop_oldest();
  });
}

proto::Expected<Confinement> Importer::probe() const {
  return run_import_process(options_.process, {}, {});
}

proto::Expected<void> Importer::check(const files::SceneFiles& files,
                                      const proto::BakeSettings& settings,
                                      std::stop_token stop) const {
  ImportJob job;
  job.work = ImportWork::kCheck;
  job.settings = proto::to_text(proto::to_json(settings));
  job.limits = options_.limits;
  job.files = files;
  job.files.sky_map = settings.sky.map;
  auto scene = std::make_unique<CheckedScene>();
  if (options_.new_temporary) scene->temporary = options_.new_temporary();
  auto product = new_product(scene->temporary);
  if (!product) return Unexpected(product.error());
  scene->product = std::move(*product);
  job.product = scene->product.get();
  // This is asked before the check: a file that changes meanwhile is not taken for the checked one.
  scene->files = identity_of(job.files);
  bool took_more = false;
  const auto done =
      in_turn(options_, job, {}, stop, options_.patience,
              [&](const ImportProcessOptions& process, Place place) -> Expected<Confinement> {
                auto checked = run_check_process(process, job, stop);
                if (!checked) {
                  took_more = true;
                  return Unexpected(checked.error());
                }
                // Memory beyond what is set aside for it is not held while it sleeps: bakes may
                // want it.
                if (took_more) return Confinement{};
                scene->process = std::move(*checked);
                scene->memory_bytes = process.memory_bytes;
                if (place) scene->place.emplace(std::move(*place));
                return Confinement{};
              });
  if (!done) return Unexpected(done.error());
  if (scene->process) checked_->put(std::move(scene));
  return {};
}

std::shared_ptr<baker::UploadReader> Importer::open(files::SceneFiles files,
                                                    const std::string& scene_key, fs::path cache,
                                                    const std::string& job) const {
  return std::make_shared<IsolatedSource>(options_, checked_, std::move(files), scene_key,
                                          std::move(cache), job);
}

}  // namespace kiln::sandbox
