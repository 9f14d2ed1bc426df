#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>

#include "proto/expected.h"
#include "server/data/data_folder.h"

namespace kiln::data {

/// An upload that comes in pieces.
struct PartialUpload {
  std::string id;  ///< upl_...
  std::string tenant;
  std::string name;          ///< the client's own, by which it finds the upload again; "": none
  std::string content_type;  ///< media type of the whole
  std::string digest;  ///< digest of the whole, as a Content-Digest (RFC 9530); "": not announced
  std::uint64_t length = 0, offset = 0;
  std::string expires_at;  ///< RFC 3339
  std::string scene;       ///< key of the scene that came of it; "" until then

  bool complete() const { return offset == length; }
};

/// Stores uploads that can be resumed, each in a folder of its own under uploads/: `data`, what is
/// known of it in `upload.json`, and in `offset` how many bytes are on the disk for sure. They
/// survive the process. Thread-safe.
class UploadStore {
 public:
  static constexpr std::size_t kMaxPerTenant = 100;

  /// Takes up what an earlier process left; bytes that it had not flushed are forgotten.
  UploadStore(const DataFolder&, std::chrono::seconds ttl);
  ~UploadStore();

  struct Opened {
    PartialUpload upload;
    bool created = false;  ///< false: the one that has this name
  };
  /// Creates an upload; `wanted` has its tenant, name, content_type and length. It is durable on
  /// return.
  /// Errors: `idempotency_mismatch`, `quota_exceeded`, `storage_full`, `io_error`.
  proto::Expected<Opened> open(const PartialUpload& wanted);
  /// Returns the upload as it is. Bytes that still arrive for it on other connections are refused
  /// from now on, so its offset stays as reported. Errors: `not_found`, for those of other tenants
  /// too.
  proto::Expected<PartialUpload> look(const std::string& id, const std::string& tenant, bool admin);

  class Entry;
  /// Adds bytes to one upload. A later writer takes over.
  class Appender {
   public:
    /// Errors: `offset_mismatch` when another one took over; `payload_too_large` beyond the length;
    /// `storage_full`, `io_error`.
    proto::Expected<void> write(std::string_view bytes);
    /// Flushes what was written to the disk: then it counts after a power failure too.
    proto::Expected<PartialUpload> finish();

   private:
    friend class UploadStore;
    Appender(std::shared_ptr<Entry> entry, std::uint64_t turn)
        : entry_(std::move(entry)), turn_(turn) {}
    std::shared_ptr<Entry> entry_;
    std::uint64_t turn_;
  };
  /// Errors: `not_found`, `offset_mismatch`.
  proto::Expected<Appender> append(const std::string& id, std::uint64_t offset);

  std::filesystem::path file(const std::string& id) const;
  /// Ends an upload that became a scene: its bytes go, what is known of it stays until it expires.
  proto::Expected<void> finished(const std::string& id, const std::string& scene);
  void remove(const std::string& id);
  void sweep(const std::string& now);  ///< removes what has expired; RFC 3339
  /// Returns the bytes that the tenant's uploads take, or will take.
  std::uint64_t bytes(const std::string& tenant) const;

 private:
  using EntryPtr = std::shared_ptr<Entry>;
  EntryPtr find(const std::string& id) const;
  EntryPtr load(const std::string& id) const;
  proto::Expected<void> store(const PartialUpload&) const;

  const DataFolder& data_;
  const std::chrono::seconds ttl_;
  mutable std::mutex mutex_;
  std::map<std::string, EntryPtr> entries_;  ///< guarded by mutex_
};

}  // namespace kiln::data
