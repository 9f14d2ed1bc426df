#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>

#include "proto/expected.h"
#include "server/data/data_folder.h"
#include "server/data/scene_store.h"
#include "server/http/message.h"

namespace kiln::api {

struct UploadLimits {
  std::uint64_t body_bytes = 1ull << 30;
  std::uint64_t json_bytes = 4ull << 20;
};

/// What a client sent: files in tmp/, and the text of its `settings` and `options` parts.
struct Upload {
  data::SceneUpload scene;
  std::optional<std::string> settings, options;
};

/// Receives a scene to disk with bounded memory: multipart/form-data (part `scene`; parts
/// `settings` and `options` for a job; any other part with a file name is a side file of that
/// name), or the bare file as model/gltf-binary, model/gltf+json or application/octet-stream.
/// Errors: `payload_too_large`, `unsupported_media_type`, `bad_request`, `invalid_request`,
/// `storage_full`, `io_error`.
proto::Expected<Upload> receive_upload(http::Request&, const data::DataFolder&, const UploadLimits&,
                                       bool for_job);

/// A JSON body as text. Errors: `payload_too_large`, `bad_request`.
proto::Expected<std::string> receive_text(http::Request&, std::uint64_t max_bytes);

/// Hands the body on piece by piece. Errors: those of `take`, `payload_too_large`, `bad_request`
/// when it ends early, `digest_mismatch` when it has not its Content-Digest.
proto::Expected<void> receive_body(
    http::Request&, std::uint64_t max_bytes,
    const std::function<proto::Expected<void>(std::string_view)>& take);

/// Whether a scene can be sent as this media type.
bool is_scene_type(const std::string& media_type);

/// The media type of a Content-Type, lower case, without parameters; "" when absent.
std::string media_type(const http::RequestHead&);

}  // namespace kiln::api
