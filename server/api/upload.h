#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "proto/expected.h"
#include "proto/files.h"
#include "server/data/data_folder.h"
#include "server/data/scene_store.h"
#include "server/http/message.h"
#include "server/http/multipart.h"

namespace kiln::api {

struct UploadLimits {
  std::uint64_t body_bytes = 1ull << 30;
  std::uint64_t json_bytes = 4ull << 20;
};

/// Holds what receive_upload() needs.
struct Intake {
  const data::DataFolder& data;
  UploadLimits limits;
};

/// A scene as a client sent it: files in tmp/, and the text of its `settings` and `options` parts.
struct Upload {
  data::SceneUpload scene;
  std::optional<std::string> settings, options;
};

/// Receives a scene to disk with bounded memory: multipart/form-data (part `scene`; parts
/// `settings` and `options` for a job; any other part with a file name is a side file of that
/// name), or the bare file as model/gltf-binary, model/gltf+json or application/octet-stream.
class UploadReceiver {
 public:
  /// Judges the head. Errors: `unsupported_media_type`, `bad_request`, `storage_full`, `io_error`.
  static proto::Expected<std::shared_ptr<UploadReceiver>> begin(const http::RequestHead&,
                                                                const Intake&, bool for_job);
  ~UploadReceiver();
  /// Takes the next piece of the body. Errors: `payload_too_large`, `bad_request`,
  /// `invalid_request`, `storage_full`, `io_error`.
  proto::Expected<void> take(std::string_view bytes);
  /// Ends the body, once, after the last piece. Same errors.
  proto::Expected<Upload> finish();

 private:
  class Parts;
  UploadReceiver(std::unique_ptr<Parts>, std::optional<http::MultipartReader>);
  std::unique_ptr<Parts> parts_;
  std::optional<http::MultipartReader> multipart_;  ///< none: the body is the scene
};

/// Returns the response that receives a scene, then answers with what came of it. Errors: those of
/// an UploadReceiver and of Receive.
using UploadAnswer = std::function<http::Response(http::Request&, proto::Expected<Upload>)>;
http::Response receive_upload(http::Request&, const Intake&, bool for_job, UploadAnswer);

/// Returns the response that receives a body of text, within limits.json_bytes. Long text lies on
/// the disk until it is whole. Errors: `unsupported_media_type`, `storage_full`, `io_error`, and
/// those of Receive.
using TextAnswer = std::function<http::Response(http::Request&, proto::Expected<std::string>)>;
http::Response receive_text(http::Request&, const Intake&, TextAnswer);

/// Returns the response that receives a body of bytes, at most `max_bytes`, into a file without a
/// name, which goes with its last descriptor. Errors: those of receive_text().
using FileAnswer = std::function<http::Response(http::Request&, proto::Expected<proto::Fd>)>;
http::Response receive_file(http::Request&, const Intake&, std::uint64_t max_bytes, FileAnswer);

/// Returns whether a scene can be sent as this media type.
bool is_scene_type(const std::string& media_type);

/// Returns the media type of a Content-Type, lower case, without parameters; "" when absent.
std::string media_type(const http::RequestHead&);

}  // namespace kiln::api
