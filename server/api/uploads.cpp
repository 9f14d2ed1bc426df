#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <nlohmann/json.hpp>

#include "server/api/api.h"
#include "server/base/ids.h"
#include "server/http/body.h"
#include "server/http/problem.h"

/// Uploads that can be resumed, in the style of the IETF's resumable uploads for HTTP and of tus.
namespace kiln::api {
namespace {

using proto::Expected;
using proto::fail;

std::string upload_path(const data::PartialUpload& upload) {
  return "/v1/uploads/" + upload.id;
}

http::Response with_progress(http::Response response, const data::PartialUpload& upload) {
  response.header("Upload-Offset", std::to_string(upload.offset))
      .header("Upload-Length", std::to_string(upload.length))
      .header("Upload-Complete", upload.complete() ? "?1" : "?0");
  return response;
}

http::Response upload_response(int status, const data::PartialUpload& upload) {
  nlohmann::json document{{"id", upload.id},
                          {"offset", upload.offset},
                          {"length", upload.length},
                          {"complete", upload.complete()},
                          {"expires_at", upload.expires_at},
                          {"scene", nullptr},
                          {"links", {{"self", upload_path(upload)}}}};
  if (!upload.scene.empty()) document["scene"] = "sha256:" + upload.scene;
  return with_progress(http::json_response(status, document), upload);
}

Expected<std::optional<std::uint64_t>> number_header(const http::Request& request,
                                                     const char* name) {
  const std::string* text = request.head.header(name);
  if (!text) return std::nullopt;
  std::uint64_t value = 0;
  const auto parsed = std::from_chars(text->data(), text->data() + text->size(), value);
  if (!text->empty() && parsed.ec == std::errc() && parsed.ptr == text->data() + text->size())
    return value;
  return fail("bad_request", std::string("The header ") + name + " has to be a whole number.",
              "request", std::string("/headers/") + name);
}

proto::Unexpected missing_header(const char* name, const char* what) {
  return fail("bad_request", std::string("The header ") + name + " is missing: " + what + ".",
              "request", std::string("/headers/") + name);
}

}  // namespace

Expected<data::PartialUpload> Api::find_upload(const http::Request& request) const {
  const std::string& id = request.parameters.at(0);
  if (!base::is_id(id, "upl_")) return fail("not_found", "There is no upload " + id + ".");
  return parts_.uploads.look(id, request.principal.tenant, request.principal.admin);
}

Expected<data::PartialUpload> Api::wanted_upload(const http::Request& request) const {
  data::PartialUpload wanted;
  wanted.tenant = request.principal.tenant;
  auto name = idempotency_key(request);
  if (!name) return proto::Unexpected(name.error());
  wanted.name = std::move(*name);
  auto length = number_header(request, "upload-length");
  if (!length) return proto::Unexpected(length.error());
  if (!*length) return missing_header("upload-length", "the bytes of the whole");
  wanted.length = **length;
  if (wanted.length == 0)
    return fail("invalid_request", "An upload needs a byte.", "request", "/headers/upload-length");
  if (wanted.length > parts_.config.max_upload_bytes)
    return fail("payload_too_large", "The upload is over the limit of " +
                                         std::to_string(parts_.config.max_upload_bytes) +
                                         " bytes.");
  const std::string* type = request.head.header("content-type");
  wanted.content_type = type ? *type : "application/octet-stream";
  if (const std::string* digest = request.head.header("repr-digest")) wanted.digest = *digest;
  if (!is_scene_type(media_type(request.head)))
    return fail("unsupported_media_type",
                "The Content-Type is that of the whole: model/gltf-binary, model/gltf+json, "
                "multipart/form-data or application/octet-stream.");
  return wanted;
}

http::Response Api::post_upload(http::Request& request) {
  auto wanted = wanted_upload(request);
  if (!wanted) return problem(wanted.error(), request);
  const std::string& tenant = wanted->tenant;
  if (parts_.config.max_bytes_per_tenant > 0 &&
      parts_.store.result_bytes(tenant) + parts_.uploads.bytes(tenant) + wanted->length >
          parts_.config.max_bytes_per_tenant)
    return problem({"quota_exceeded",
                    "With this upload the tenant's results and uploads would be over " +
                        std::to_string(parts_.config.max_bytes_per_tenant) + " bytes.",
                    {}},
                   request);
  auto opened = parts_.uploads.open(*wanted);
  if (!opened) return problem(opened.error(), request);
  const int status = opened->created ? 201 : 200;
  if (!request.head.has_body() || !opened->created)
    return upload_response(status, opened->upload).header("Location", upload_path(opened->upload));
  return append_to_upload(
      request, opened->upload,
      [path = upload_path(opened->upload)](http::Request&, http::Response response) {
        if (response.status == 204) response.status = 201;
        if (response.status == 201 && response.body.empty()) response.header("Location", path);
        return response;
      });
}

http::Response Api::get_upload(http::Request& request) {
  auto upload = find_upload(request);
  if (!upload) return problem(upload.error(), request);
  return upload_response(200, *upload);
}

http::Response Api::delete_upload(http::Request& request) {
  auto upload = find_upload(request);
  if (!upload) return problem(upload.error(), request);
  parts_.uploads.remove(upload->id);
  http::Response response;
  response.status = 204;
  return response;
}

http::Response Api::patch_upload(http::Request& request) {
  auto upload = find_upload(request);
  if (!upload) return problem(upload.error(), request);
  auto offset = number_header(request, "upload-offset");
  if (!offset) return problem(offset.error(), request);
  if (!*offset)
    return problem(missing_header("upload-offset", "the bytes before this part").value(), request);
  if (**offset != upload->offset)
    return with_progress(
        problem({"offset_mismatch",
                 "The upload has " + std::to_string(upload->offset) + " bytes: go on there.",
                 {}},
                request),
        *upload);
  return append_to_upload(request, *upload,
                          [](http::Request&, http::Response response) { return response; });
}

// Receives the body into the upload. What has arrived is kept, however the request ends.
http::Response Api::append_to_upload(http::Request& request, const data::PartialUpload& before,
                                     PieceAnswer answer) {
  if (!before.scene.empty()) return answer(request, finished_upload(request, before));
  auto appended = parts_.uploads.append(before.id, before.offset);
  if (!appended) return answer(request, problem(appended.error(), request));
  const auto appender = std::make_shared<data::UploadStore::Appender>(std::move(*appended));
  if (request.head.content_length.value_or(0) > before.length - before.offset)
    return answer(request, answer_piece(request, *appender,
                                        fail("payload_too_large",
                                             "The upload has " + std::to_string(before.length) +
                                                 " bytes, not more.")));
  http::Response response;
  response.receive = http::Receive{
      before.length, [appender](std::string_view bytes) { return appender->write(bytes); },
      [this, appender, answer = std::move(answer)](http::Request& again,
                                                   const Expected<void>& taken) {
        return answer(again, answer_piece(again, *appender, taken));
      }};
  return response;
}

http::Response Api::answer_piece(http::Request& request, data::UploadStore::Appender& appender,
                                 const Expected<void>& taken) {
  auto upload = appender.finish();
  if (!upload) return problem(upload.error(), request);
  if (!taken) return with_progress(problem(taken.error(), request), *upload);
  if (upload->complete()) return finish_upload(request, *upload);
  http::Response response;
  response.status = 204;
  return with_progress(std::move(response), *upload);
}

// The file of a whole upload, as what POST /v1/scenes would have made of it as a body.
Expected<Upload> Api::read_upload(const data::PartialUpload& upload) const {
  constexpr std::size_t kPiece = std::size_t{256} * 1024;
  const auto path = parts_.uploads.file(upload.id);
  const proto::Fd file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (!file.valid()) return proto::storage_error("open", path);
  http::RequestHead head;
  head.headers = {{"Content-Type", upload.content_type}};
  if (!upload.digest.empty()) head.headers.emplace_back("Content-Digest", upload.digest);
  auto receiver = UploadReceiver::begin(
      head, parts_.data, {parts_.config.max_upload_bytes, parts_.config.max_request_json_bytes},
      /*for_job=*/false);
  if (!receiver) return proto::Unexpected(receiver.error());
  http::DigestCheck digest(head);
  std::string buffer(kPiece, '\0');
  for (;;) {
    const ssize_t got = ::read(file.get(), buffer.data(), buffer.size());
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return proto::storage_error("read", path);
    if (got == 0) break;
    const std::string_view bytes(buffer.data(), static_cast<std::size_t>(got));
    digest.update(bytes);
    if (auto taken = (*receiver)->take(bytes); !taken) return proto::Unexpected(taken.error());
  }
  if (auto same = digest.finish(); !same) return proto::Unexpected(same.error());
  return (*receiver)->finish();
}

// The whole is there: what POST /v1/scenes does with a body, with the file as the body.
http::Response Api::finish_upload(http::Request& request, const data::PartialUpload& upload) {
  const auto answer = [this, upload](http::Request& again,
                                     const proto::Expected<data::SceneStore::Put>& put) {
    if (!put) {
      // What the sender has to change can't be mended by sending more of it.
      const auto& code = put.error().code;
      if (code != "storage_full" && code != "io_error" && code != "overloaded")
        parts_.uploads.remove(upload.id);
      return problem(put.error(), again);
    }
    if (auto ok = parts_.uploads.finished(upload.id, put->scene.key); !ok)
      return problem(ok.error(), again);
    return with_progress(scene_response(put->created ? 201 : 200, put->scene)
                             .header("Location", scene_path(put->scene)),
                         upload);
  };
  auto read = read_upload(upload);
  if (read)
    return store_when_checked(request, std::make_shared<data::SceneUpload>(std::move(read->scene)),
                              answer);
  // Another request for the same upload may have been faster.
  const base::Principal& client = request.principal;
  if (auto now = parts_.uploads.look(upload.id, client.tenant, client.admin);
      now && !now->scene.empty())
    return finished_upload(request, *now);
  return answer(request, proto::Unexpected(read.error()));
}

// The answer to the last piece was lost: it is given again.
http::Response Api::finished_upload(http::Request& request, const data::PartialUpload& upload) {
  auto scene = parts_.scenes.use(upload.scene);
  if (!scene) return problem(scene.error(), request);
  return with_progress(scene_response(200, *scene).header("Location", scene_path(*scene)), upload);
}

}  // namespace kiln::api
