#include "server/api/upload.h"

#include <algorithm>
#include <array>
#include <functional>
#include <utility>
#include <vector>

#include "proto/base64.h"
#include "proto/sha256.h"
#include "server/http/multipart.h"

namespace kiln::api {
namespace {

using proto::Expected;
using proto::fail;

constexpr std::size_t kPiece = std::size_t{256} * 1024;
constexpr std::size_t kMaxFileName = 1024;

proto::Unexpected too_large(std::uint64_t limit) {
  return proto::fail("payload_too_large", "The request's body is over the limit of " +
                                              std::to_string(limit) + " bytes.");
}

// The base64 text of `sha-256=:...:` in a Content-Digest (RFC 9530); other algorithms are ignored.
std::optional<std::string> announced_digest(const http::RequestHead& head) {
  constexpr std::string_view kBegin = "sha-256=:";
  const std::string* header = head.header("content-digest");
  const auto at = header ? header->find(kBegin) : std::string::npos;
  if (at == std::string::npos) return std::nullopt;
  const auto from = at + kBegin.size();
  return header->substr(from, header->find(':', from) - from);
}

std::string base64(const std::array<unsigned char, 32>& digest) {
  return proto::base64_encode({reinterpret_cast<const char*>(digest.data()), digest.size()});
}

}  // namespace

// Counts bytes as they come: a Content-Length may be absent.
Expected<void> receive_body(http::Request& request, std::uint64_t limit,
                            const std::function<proto::Expected<void>(std::string_view)>& take) {
  if (request.head.content_length.value_or(0) > limit) return too_large(limit);
  std::vector<char> buffer(kPiece);
  std::uint64_t total = 0;
  const auto announced = announced_digest(request.head);
  proto::Sha256 hash;
  for (;;) {
    const ssize_t got = request.body.read(buffer.data(), buffer.size());
    if (got == 0) {
      if (!announced || base64(hash.digest()) == *announced) return {};
      return proto::fail("digest_mismatch", "The body does not have the announced Content-Digest.");
    }
    if (got < 0)
      return proto::fail("bad_request", "The request's body ended early or is malformed.");
    total += static_cast<std::uint64_t>(got);
    if (total > limit) return too_large(limit);
    if (announced) hash.update({buffer.data(), static_cast<std::size_t>(got)});
    if (auto ok = take({buffer.data(), static_cast<std::size_t>(got)}); !ok) return ok;
  }
}

namespace {

bool is_plain_text(const std::string& name) {
  return std::none_of(name.begin(), name.end(),
                      [](unsigned char c) { return c < 0x20 || c == 0x7f; });
}

/// Sorts the parts of one multipart body into scene, side files and texts.
class PartCollector {
 public:
  PartCollector(Upload& upload, const UploadLimits& limits, bool for_job)
      : upload_(upload), limits_(limits), for_job_(for_job) {}

  proto::Expected<void> begin(const http::PartHead& part) {
    const std::string pointer = "/" + part.name;
    const auto refuse = [&](const std::string& what) {
      return proto::fail("invalid_request", what, "request", pointer);
    };
    if (for_job_ && (part.name == "settings" || part.name == "options")) {
      auto& text = part.name == "settings" ? upload_.settings : upload_.options;
      if (text) return refuse("There are two `" + part.name + "` parts.");
      text_ = &text.emplace();
      return {};
    }
    name_.clear();
    if (part.name == "scene") {
      if (upload_.scene.main) return refuse("There are two `scene` parts.");
    } else if (!part.filename) {
      return refuse("The part `" + part.name + "` is neither `scene`, nor " +
                    (for_job_ ? "`settings`, nor `options`, nor " : "") + "a file with a name.");
    } else {
      name_ = *part.filename;
      if (name_.empty() || name_.size() > kMaxFileName || !is_plain_text(name_))
        return refuse("A side file needs a name of 1 to 1,024 bytes without control characters.");
      for (const auto& other : upload_.scene.side)
        if (other.name == name_) return refuse("Two side files are called `" + name_ + "`.");
    }
    is_main_ = part.name == "scene";
    auto file = proto::HashingFile::create(upload_.scene.next_path());
    if (!file) return proto::Unexpected(file.error());
    file_.emplace(std::move(*file));
    return {};
  }

  proto::Expected<void> data(std::string_view bytes) {
    if (text_ == nullptr) return file_->write(bytes);
    if (text_->size() + bytes.size() > limits_.json_bytes)
      return proto::fail("payload_too_large", "A JSON part is over the limit of " +
                                                  std::to_string(limits_.json_bytes) + " bytes.");
    *text_ += bytes;
    return {};
  }

  proto::Expected<void> end() {
    if (std::exchange(text_, nullptr) != nullptr) return {};
    auto hash = file_->finish();
    if (!hash) return proto::Unexpected(hash.error());
    data::UploadedFile done{name_, file_->path(), file_->bytes(), *hash};
    if (is_main_) {
      upload_.scene.main = std::move(done);
    } else {
      upload_.scene.side.push_back(std::move(done));
    }
    file_.reset();
    return {};
  }

 private:
  Upload& upload_;
  const UploadLimits& limits_;
  bool for_job_;
  std::string* text_ = nullptr;  ///< of the part that is being read, if it is no file
  bool is_main_ = false;
  std::string name_;
  std::optional<proto::HashingFile> file_;
};

proto::Expected<void> receive_parts(http::Request& request, const std::string& boundary,
                                    const UploadLimits& limits, PartCollector& parts) {
  http::MultipartReader reader(
      boundary,
      {[&](const http::PartHead& head) { return parts.begin(head); },
       [&](std::string_view bytes) { return parts.data(bytes); }, [&] { return parts.end(); }});
  auto done = receive_body(request, limits.body_bytes,
                           [&](std::string_view bytes) { return reader.feed(bytes); });
  if (!done) return done;
  return reader.finish();
}

proto::Expected<void> check_encoding(const http::RequestHead& head) {
  const std::string* encoding = head.header("content-encoding");
  if (!encoding || http::equal_ignoring_case(*encoding, "identity")) return {};
  return proto::fail("unsupported_media_type", "Send the body as it is, without Content-Encoding.");
}

}  // namespace

std::string media_type(const http::RequestHead& head) {
  const std::string* header = head.header("content-type");
  if (!header) return {};
  std::string type(http::trim_blanks(std::string_view(*header).substr(0, header->find(';'))));
  std::transform(type.begin(), type.end(), type.begin(),
                 [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c + 32) : c; });
  return type;
}

bool is_scene_type(const std::string& type) {
  return type == "multipart/form-data" || type == "model/gltf-binary" ||
         type == "model/gltf+json" || type == "application/octet-stream" || type.empty();
}

proto::Expected<Upload> receive_upload(http::Request& request, const data::DataFolder& data,
                                       const UploadLimits& limits, bool for_job) {
  if (auto ok = check_encoding(request.head); !ok) return proto::Unexpected(ok.error());
  const std::string type = media_type(request.head);
  const bool multipart = type == "multipart/form-data";
  if (!is_scene_type(type))
    return proto::fail(
        "unsupported_media_type",
        "Send multipart/form-data, or the file as model/gltf-binary, model/gltf+json or "
        "application/octet-stream; not " +
            type + ".");
  auto folder = data::SceneUpload::create(data);
  if (!folder) return proto::Unexpected(folder.error());
  Upload upload{std::move(*folder), std::nullopt, std::nullopt};
  PartCollector parts(upload, limits, for_job);
  proto::Expected<void> done;
  if (multipart) {
    const auto boundary = http::multipart_boundary(*request.head.header("content-type"));
    if (!boundary) return proto::fail("bad_request", "The multipart body has no usable boundary.");
    done = receive_parts(request, *boundary, limits, parts);
  } else {
    done = parts.begin({"scene", std::nullopt, type});
    if (done)
      done = receive_body(request, limits.body_bytes,
                          [&](std::string_view bytes) { return parts.data(bytes); });
    if (done) done = parts.end();
  }
  if (!done) return proto::Unexpected(done.error());
  if (!upload.scene.main)
    return proto::fail("invalid_request", "The part `scene` is missing.", "request", "/scene");
  return upload;
}

proto::Expected<std::string> receive_text(http::Request& request, std::uint64_t max_bytes) {
  if (auto ok = check_encoding(request.head); !ok) return proto::Unexpected(ok.error());
  std::string text;
  auto done = receive_body(request, max_bytes, [&](std::string_view bytes) {
    text += bytes;
    return proto::Expected<void>();
  });
  if (!done) return proto::Unexpected(done.error());
  return text;
}

}  // namespace kiln::api
