#include "clients/verified_file.h"

#include <unistd.h>

#include <algorithm>
#include <utility>

namespace kiln::clients {

VerifiedFile::VerifiedFile(std::filesystem::path target)
    : target_(std::move(target)),
      temporary_(target_.parent_path() /
                 ("." + target_.filename().string() + ".part-" + std::to_string(::getpid()))) {}

VerifiedFile::~VerifiedFile() {
  ::unlink(temporary_.c_str());
}

proto::Expected<void> VerifiedFile::open() {
  file_.reset();
  written_ = {};
  // An earlier try, or a crashed process with our id, may have left one behind.
  ::unlink(temporary_.c_str());
  auto file = proto::HashingFile::create(temporary_, 0666);
  if (!file) return proto::Unexpected(std::move(file.error()));
  file_.emplace(std::move(*file));
  return {};
}

bool VerifiedFile::write(std::string_view bytes) {
  written_ = file_->write(bytes);
  return written_.has_value();
}

proto::Expected<void> VerifiedFile::commit(const std::string& sha256) {
  if (!written_) return written_;
  const auto found = file_->finish();
  if (!found) return proto::Unexpected(found.error());
  if (!sha256.empty() && *found != sha256)
    return proto::fail("digest_mismatch", target_.filename().string() + " arrived with SHA-256 " +
                                              *found + ", expected " + sha256);
  if (::rename(temporary_.c_str(), target_.c_str()) != 0)
    return proto::storage_error("rename to", target_);
  return proto::sync_folder(target_.parent_path());
}

bool is_plain_name(std::string_view name) {
  return !name.empty() && name.size() <= 128 && name.front() != '.' &&
         std::all_of(name.begin(), name.end(), [](unsigned char c) {
           return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
                  c == '.' || c == '_' || c == '-';
         });
}

}  // namespace kiln::clients
