#include "server/data/upload_store.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <nlohmann/json.hpp>
#include <system_error>

#include "proto/bytes.h"
#include "proto/files.h"
#include "proto/json.h"
#include "proto/json_reader.h"
#include "server/base/clock.h"
#include "server/base/ids.h"
#include "server/base/log.h"

namespace kiln::data {
namespace fs = std::filesystem;
namespace {

using proto::Expected;
using proto::fail;

constexpr std::uint64_t kFlushBytes = 16ull << 20;  // what a kill can cost at most
constexpr std::uint64_t kMaxRecordBytes = 1 << 16;

proto::Fd open_file(const fs::path& path, int flags) {
  return proto::Fd(::open(path.c_str(), flags | O_CLOEXEC, 0600));
}

// A number that is overwritten in place: eight bytes of one sector are there as a whole or not.
bool write_number(int fd, std::uint64_t value) {
  std::array<unsigned char, 8> bytes{};
  for (auto& byte : bytes) {
    byte = static_cast<unsigned char>(value & 0xff);
    value >>= 8;
  }
  return ::pwrite(fd, bytes.data(), bytes.size(), 0) == 8 && ::fdatasync(fd) == 0;
}

std::optional<std::uint64_t> read_number(int fd) {
  std::array<char, 8> bytes{};
  if (::pread(fd, bytes.data(), bytes.size(), 0) != 8) return std::nullopt;
  return proto::little_endian({bytes.data(), bytes.size()});
}

std::optional<PartialUpload> parse_record(const std::string& text) {
  auto document = proto::parse_json(text, "upload");
  if (!document) return std::nullopt;
  proto::ProblemList problems("upload");
  proto::JsonReader in(*document, "", problems);
  PartialUpload upload;
  in.read("id", upload.id);
  in.read("tenant", upload.tenant);
  in.read("name", upload.name);
  in.read("content_type", upload.content_type);
  in.read("digest", upload.digest);
  in.read("length", upload.length);
  in.read("expires_at", upload.expires_at);
  in.read("scene", upload.scene);
  if (!problems.empty()) return std::nullopt;
  return upload;
}

proto::Unexpected no_such_upload(const std::string& id) {
  return proto::fail("not_found", "There is no upload " + id + ".");
}

}  // namespace

class UploadStore::Entry {
 public:
  mutable std::mutex mutex;  ///< guards what follows
  PartialUpload info;
  std::uint64_t turn = 0;  ///< turn of the one writer that may append
  std::uint64_t flushed = 0;
  fs::path folder;
  proto::Fd data, offset;

  proto::Expected<void> open_files() {
    data = open_file(folder / "data", O_RDWR | O_CREAT);
    offset = open_file(folder / "offset", O_RDWR | O_CREAT);
    if (data.valid() && offset.valid()) return {};
    return proto::storage_error("open", folder);
  }

  proto::Expected<void> flush() {
    if (flushed == info.offset) return {};
    if (::fdatasync(data.get()) != 0 || !write_number(offset.get(), info.offset))
      return proto::storage_error("write", folder / "data");
    flushed = info.offset;
    return {};
  }
};

UploadStore::UploadStore(const DataFolder& data, std::chrono::seconds ttl)
    : data_(data), ttl_(ttl) {
  std::error_code error;
  for (fs::directory_iterator at(data_.uploads(), error), end; !error && at != end;
       at.increment(error)) {
    const std::string id = at->path().filename().string();
    if (auto entry = load(id)) {
      entries_[id] = std::move(entry);
      continue;
    }
    log_line(base::LogLevel::kInfo, "leftover", {{"upload", id}});
    std::error_code ignored;
    fs::remove_all(at->path(), ignored);
  }
}

UploadStore::~UploadStore() = default;

UploadStore::EntryPtr UploadStore::load(const std::string& id) const {
  auto entry = std::make_shared<Entry>();
  entry->folder = data_.uploads() / id;
  auto text = proto::read_file(entry->folder / "upload.json", kMaxRecordBytes);
  auto info = text ? parse_record(*text) : std::nullopt;
  if (!info || info->id != id) return nullptr;
  entry->info = std::move(*info);
  if (!entry->info.scene.empty()) {
    entry->info.offset = entry->info.length;
    return entry;
  }
  if (!entry->open_files()) return nullptr;
  const std::uint64_t offset = read_number(entry->offset.get()).value_or(0);
  if (offset > entry->info.length ||
      ::ftruncate(entry->data.get(), static_cast<off_t>(offset)) != 0)
    return nullptr;
  entry->info.offset = entry->flushed = offset;
  return entry;
}

proto::Expected<void> UploadStore::store(const PartialUpload& upload) const {
  const nlohmann::json record{{"id", upload.id},
                              {"tenant", upload.tenant},
                              {"name", upload.name},
                              {"content_type", upload.content_type},
                              {"digest", upload.digest},
                              {"length", upload.length},
                              {"expires_at", upload.expires_at},
                              {"scene", upload.scene}};
  return proto::write_bytes(data_.uploads() / upload.id / "upload.json", proto::to_text(record));
}

proto::Expected<UploadStore::Opened> UploadStore::open(const PartialUpload& wanted) {
  const std::lock_guard lock(mutex_);
  std::size_t of_tenant = 0;
  for (const auto& [id, entry] : entries_) {
    const std::lock_guard entry_lock(entry->mutex);
    const PartialUpload& known = entry->info;
    if (known.tenant != wanted.tenant) continue;
    if (known.scene.empty()) ++of_tenant;
    if (wanted.name.empty() || known.name != wanted.name) continue;
    if (known.length != wanted.length || known.content_type != wanted.content_type)
      return proto::fail("idempotency_mismatch", "This Idempotency-Key belongs to upload " + id +
                                                     ", which has another length or type.");
    ++entry->turn;
    return Opened{known, false};
  }
  if (of_tenant >= kMaxPerTenant)
    return proto::fail("quota_exceeded", "This tenant has " + std::to_string(kMaxPerTenant) +
                                             " uploads open: finish or delete some.");
  auto entry = std::make_shared<Entry>();
  entry->info = wanted;
  entry->info.id = base::new_id("upl_");
  entry->info.offset = 0;
  entry->info.expires_at = base::now_rfc3339(ttl_);
  entry->folder = data_.uploads() / entry->info.id;
  std::error_code error;
  fs::create_directory(entry->folder, error);
  if (error) {
    errno = error.value();
    return proto::storage_error("create the folder", entry->folder);
  }
  proto::Expected<void> made = entry->open_files();
  if (made) made = store(entry->info);
  if (made) made = proto::sync_folder(data_.uploads());
  if (!made) {
    fs::remove_all(entry->folder, error);
    return proto::Unexpected(made.error());
  }
  entries_[entry->info.id] = entry;
  return Opened{entry->info, true};
}

UploadStore::EntryPtr UploadStore::find(const std::string& id) const {
  const std::lock_guard lock(mutex_);
  const auto found = entries_.find(id);
  return found == entries_.end() ? nullptr : found->second;
}

proto::Expected<PartialUpload> UploadStore::look(const std::string& id, const std::string& tenant,
                                                 bool admin) {
  const EntryPtr entry = find(id);
  if (!entry) return no_such_upload(id);
  const std::lock_guard lock(entry->mutex);
  if (!admin && entry->info.tenant != tenant) return no_such_upload(id);
  ++entry->turn;
  return entry->info;
}

proto::Expected<UploadStore::Appender> UploadStore::append(const std::string& id,
                                                           std::uint64_t offset) {
  const EntryPtr entry = find(id);
  if (!entry) return no_such_upload(id);
  const std::lock_guard lock(entry->mutex);
  if (offset != entry->info.offset)
    return proto::fail("offset_mismatch", "The upload has " + std::to_string(entry->info.offset) +
                                              " bytes: go on there.");
  return Appender(entry, ++entry->turn);
}

proto::Expected<void> UploadStore::Appender::write(std::string_view bytes) {
  const std::lock_guard lock(entry_->mutex);
  PartialUpload& info = entry_->info;
  if (turn_ != entry_->turn)
    return proto::fail("offset_mismatch", "Another request goes on with this upload.");
  if (bytes.size() > info.length - info.offset)
    return proto::fail("payload_too_large",
                       "The upload has more than its " + std::to_string(info.length) + " bytes.");
  while (!bytes.empty()) {
    const ssize_t written =
        ::pwrite(entry_->data.get(), bytes.data(), bytes.size(), static_cast<off_t>(info.offset));
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) return proto::storage_error("write", entry_->folder / "data");
    info.offset += static_cast<std::uint64_t>(written);
    bytes.remove_prefix(static_cast<std::size_t>(written));
  }
  if (info.offset - entry_->flushed >= kFlushBytes) return entry_->flush();
  return {};
}

proto::Expected<PartialUpload> UploadStore::Appender::finish() {
  const std::lock_guard lock(entry_->mutex);
  if (auto flushed = entry_->flush(); !flushed) return proto::Unexpected(flushed.error());
  return entry_->info;
}

fs::path UploadStore::file(const std::string& id) const {
  return data_.uploads() / id / "data";
}

proto::Expected<void> UploadStore::finished(const std::string& id, const std::string& scene) {
  const EntryPtr entry = find(id);
  if (!entry) return no_such_upload(id);
  const std::lock_guard lock(entry->mutex);
  entry->info.scene = scene;
  ++entry->turn;
  if (auto stored = store(entry->info); !stored) return stored;
  entry->data.reset();
  entry->offset.reset();
  std::error_code error;
  fs::remove(entry->folder / "data", error);
  return {};
}

void UploadStore::remove(const std::string& id) {
  EntryPtr entry;
  {
    const std::lock_guard lock(mutex_);
    const auto found = entries_.find(id);
    if (found == entries_.end()) return;
    entry = found->second;
    entries_.erase(found);
  }
  const std::lock_guard lock(entry->mutex);
  ++entry->turn;  // a writer from before writes into a file without a name, once at most
  std::error_code error;
  fs::remove_all(entry->folder, error);
}

void UploadStore::sweep(const std::string& now) {
  std::vector<std::string> old;
  {
    const std::lock_guard lock(mutex_);
    for (const auto& [id, entry] : entries_) {
      const std::lock_guard entry_lock(entry->mutex);
      if (entry->info.expires_at <= now) old.push_back(id);
    }
  }
  for (const auto& id : old) {
    remove(id);
    log_line(base::LogLevel::kInfo, "retention", {{"upload", id}, {"reason", "expired"}});
  }
}

std::uint64_t UploadStore::bytes(const std::string& tenant) const {
  const std::lock_guard lock(mutex_);
  std::uint64_t total = 0;
  for (const auto& [id, entry] : entries_) {
    const std::lock_guard entry_lock(entry->mutex);
    if (entry->info.tenant == tenant && entry->info.scene.empty()) total += entry->info.length;
  }
  return total;
}

}  // namespace kiln::data
