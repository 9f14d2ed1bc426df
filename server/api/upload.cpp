#include "server/api/upload.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <utility>

#include "proto/files.h"

namespace kiln::api {
namespace {

using proto::Expected;
using proto::fail;

constexpr std::size_t kMaxFileName = 1024;

/// Makes a file without a name. Its path tells messages where it is.
struct NamelessFile {
  std::filesystem::path path;
  proto::Fd fd;

  static Expected<NamelessFile> create(const data::DataFolder& data) {
    NamelessFile file{data.new_temporary(), {}};
    file.fd = proto::Fd(::open(file.path.c_str(), O_CREAT | O_EXCL | O_RDWR | O_CLOEXEC, 0600));
    if (!file.fd.valid()) return proto::storage_error("create", file.path);
    ::unlink(file.path.c_str());
    return file;
  }
};

/// Collects text that arrives in pieces. Thousands of texts may be arriving: a longer one waits in
/// a file without a name.
class TextSpool {
 public:
  explicit TextSpool(const data::DataFolder& data) : data_(&data) {}

  Expected<void> add(std::string_view bytes) {
    constexpr std::size_t kInMemory = std::size_t{8} * 1024;
    size_ += bytes.size();
    memory_ += bytes;
    if (memory_.size() <= kInMemory) return {};
    if (!file_.fd.valid()) {
      auto file = NamelessFile::create(*data_);
      if (!file) return proto::Unexpected(file.error());
      file_ = std::move(*file);
    }
    auto written = proto::write_all(file_.fd.get(), memory_, file_.path);
    memory_.clear();
    return written;
  }
  std::uint64_t size() const { return size_; }

  Expected<std::string> text() const {
    std::string all(size_ - memory_.size(), '\0');
    for (std::size_t done = 0; done < all.size();) {
      const ssize_t got =
          ::pread(file_.fd.get(), all.data() + done, all.size() - done, static_cast<off_t>(done));
      if (got < 0 && errno == EINTR) continue;
      if (got <= 0) return proto::storage_error("read", file_.path);
      done += static_cast<std::size_t>(got);
    }
    return all + memory_;
  }

 private:
  const data::DataFolder* data_;
  NamelessFile file_;
  std::string memory_;
  std::uint64_t size_ = 0;
};

bool is_plain_text(const std::string& name) {
  return std::none_of(name.begin(), name.end(),
                      [](unsigned char c) { return c < 0x20 || c == 0x7f; });
}

Expected<void> check_encoding(const http::RequestHead& head) {
  const std::string* encoding = head.header("content-encoding");
  if (!encoding || http::equal_ignoring_case(*encoding, "identity")) return {};
  return fail("unsupported_media_type", "Send the body as it is, without Content-Encoding.");
}

}  // namespace

/// Sorts the parts of one multipart body into scene, side files and texts.
class UploadReceiver::Parts {
 public:
  Parts(data::SceneUpload scene, const Intake& intake, bool for_job)
      : scene_(std::move(scene)), intake_(intake), for_job_(for_job) {}

  Expected<void> begin(const http::PartHead& part) {
    const std::string pointer = "/" + part.name;
    const auto refuse = [&](const std::string& what) {
      return fail("invalid_request", what, "request", pointer);
    };
    if (for_job_ && (part.name == "settings" || part.name == "options")) {
      auto& text = part.name == "settings" ? settings_ : options_;
      if (text) return refuse("There are two `" + part.name + "` parts.");
      text_ = &text.emplace(intake_.data);
      return {};
    }
    name_.clear();
    if (part.name == "scene") {
      if (scene_.main) return refuse("There are two `scene` parts.");
    } else if (!part.filename) {
      return refuse("The part `" + part.name + "` is neither `scene`, nor " +
                    (for_job_ ? "`settings`, nor `options`, nor " : "") + "a file with a name.");
    } else {
      name_ = *part.filename;
      if (name_.empty() || name_.size() > kMaxFileName || !is_plain_text(name_))
        return refuse("A side file needs a name of 1 to 1,024 bytes without control characters.");
      for (const auto& other : scene_.side)
        if (other.name == name_) return refuse("Two side files are called `" + name_ + "`.");
    }
    is_main_ = part.name == "scene";
    auto file = proto::HashingFile::create(scene_.next_path());
    if (!file) return proto::Unexpected(file.error());
    file_.emplace(std::move(*file));
    return {};
  }

  Expected<void> data(std::string_view bytes) {
    if (text_ == nullptr) return file_->write(bytes);
    if (text_->size() + bytes.size() > intake_.limits.json_bytes)
      return fail("payload_too_large", "A JSON part is over the limit of " +
                                           std::to_string(intake_.limits.json_bytes) + " bytes.");
    return text_->add(bytes);
  }

  Expected<void> end() {
    if (std::exchange(text_, nullptr) != nullptr) return {};
    auto hash = file_->finish();
    if (!hash) return proto::Unexpected(hash.error());
    data::UploadedFile done{name_, file_->path(), file_->bytes(), *hash};
    if (is_main_) {
      scene_.main = std::move(done);
    } else {
      scene_.side.push_back(std::move(done));
    }
    file_.reset();
    return {};
  }

  Expected<Upload> finish() {
    if (!scene_.main)
      return fail("invalid_request", "The part `scene` is missing.", "request", "/scene");
    Upload upload{std::move(scene_), std::nullopt, std::nullopt};
    for (auto [from, to] :
         {std::pair(&settings_, &upload.settings), std::pair(&options_, &upload.options)}) {
      if (!*from) continue;
      auto text = (*from)->text();
      if (!text) return proto::Unexpected(text.error());
      *to = std::move(*text);
    }
    return upload;
  }

 private:
  data::SceneUpload scene_;
  std::optional<TextSpool> settings_, options_;
  const Intake intake_;
  const bool for_job_;
  TextSpool* text_ = nullptr;  ///< text of the part that is being read, if it is no file
  bool is_main_ = false;
  std::string name_;
  std::optional<proto::HashingFile> file_;
};

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

UploadReceiver::UploadReceiver(std::unique_ptr<Parts> parts,
                               std::optional<http::MultipartReader> reader)
    : parts_(std::move(parts)), multipart_(std::move(reader)) {}

UploadReceiver::~UploadReceiver() = default;

Expected<std::shared_ptr<UploadReceiver>> UploadReceiver::begin(const http::RequestHead& head,
                                                                const Intake& intake,
                                                                bool for_job) {
  if (auto ok = check_encoding(head); !ok) return proto::Unexpected(ok.error());
  const std::string type = media_type(head);
  if (!is_scene_type(type))
    return fail("unsupported_media_type",
                "Send multipart/form-data, or the file as model/gltf-binary, model/gltf+json or "
                "application/octet-stream; not " +
                    type + ".");
  std::optional<std::string> boundary;
  if (type == "multipart/form-data") {
    boundary = http::multipart_boundary(*head.header("content-type"));
    if (!boundary) return fail("bad_request", "The multipart body has no usable boundary.");
  }
  auto folder = data::SceneUpload::create(intake.data);
  if (!folder) return proto::Unexpected(folder.error());
  auto parts = std::make_unique<Parts>(std::move(*folder), intake, for_job);
  std::optional<http::MultipartReader> reader;
  if (boundary)
    reader.emplace(
        *boundary,
        http::PartSink{[to = parts.get()](const http::PartHead& part) { return to->begin(part); },
                       [to = parts.get()](std::string_view bytes) { return to->data(bytes); },
                       [to = parts.get()] { return to->end(); }});
  else if (auto begun = parts->begin({"scene", std::nullopt, type}); !begun)
    return proto::Unexpected(begun.error());
  return std::shared_ptr<UploadReceiver>(new UploadReceiver(std::move(parts), std::move(reader)));
}

Expected<void> UploadReceiver::take(std::string_view bytes) {
  return multipart_ ? multipart_->feed(bytes) : parts_->data(bytes);
}

Expected<Upload> UploadReceiver::finish() {
  if (auto ended = multipart_ ? multipart_->finish() : parts_->end(); !ended)
    return proto::Unexpected(ended.error());
  return parts_->finish();
}

http::Response receive_upload(http::Request& request, const Intake& intake, bool for_job,
                              UploadAnswer answer) {
  auto begun = UploadReceiver::begin(request.head, intake, for_job);
  if (!begun) return answer(request, proto::Unexpected(begun.error()));
  http::Response response;
  response.receive = http::Receive{
      intake.limits.body_bytes, [to = *begun](std::string_view bytes) { return to->take(bytes); },
      [from = *begun, answer = std::move(answer)](http::Request& again,
                                                  const Expected<void>& received) {
        return answer(again, received ? from->finish() : proto::Unexpected(received.error()));
      }};
  return response;
}

http::Response receive_text(http::Request& request, const Intake& intake, TextAnswer answer) {
  if (auto ok = check_encoding(request.head); !ok)
    return answer(request, proto::Unexpected(ok.error()));
  const auto text = std::make_shared<TextSpool>(intake.data);
  http::Response response;
  response.receive = http::Receive{
      intake.limits.json_bytes, [text](std::string_view bytes) { return text->add(bytes); },
      [text, answer = std::move(answer)](http::Request& again, const Expected<void>& received) {
        return answer(again, received ? text->text() : proto::Unexpected(received.error()));
      }};
  return response;
}

http::Response receive_file(http::Request& request, const Intake& intake, std::uint64_t max_bytes,
                            FileAnswer answer) {
  if (auto ok = check_encoding(request.head); !ok)
    return answer(request, proto::Unexpected(ok.error()));
  auto made = NamelessFile::create(intake.data);
  if (!made) return answer(request, proto::Unexpected(made.error()));
  const auto file = std::make_shared<NamelessFile>(std::move(*made));
  http::Response response;
  response.receive = http::Receive{
      std::min(max_bytes, intake.limits.body_bytes),
      [file](std::string_view bytes) {
        return proto::write_all(file->fd.get(), bytes, file->path);
      },
      [file, answer = std::move(answer)](http::Request& again, const Expected<void>& received) {
        if (!received) return answer(again, proto::Unexpected(received.error()));
        return answer(again, std::move(file->fd));
      }};
  return response;
}

}  // namespace kiln::api
