#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "baker/files/upload.h"
#include "proto/expected.h"

namespace kiln::gltf {

/// Says whether a glTF URI carries its bytes itself. The scheme's letter case doesn't matter.
bool is_data_uri(std::string_view uri);

/// A decoded `data:` URI.
struct DataUri {
  std::string mime_type;  ///< lower case, "" when not given
  std::string bytes;
};
/// Decodes base64 or percent escapes. `pointer` names the URI's place in the glTF. Errors:
/// `invalid_scene`.
proto::Expected<DataUri> decode_data_uri(std::string_view uri, const std::string& pointer);

/// Returns the file name that a relative URI means: percent-decoded, "./" removed. Refuses absolute
/// paths, "..", any scheme, drive letters, backslashes and control characters (`invalid_scene`),
/// since a scene may name nothing but files of its own upload.
proto::Expected<std::string> relative_file_name(std::string_view uri, const std::string& pointer);

/// Finds the upload's file that `uri` names, matched as SceneFiles says.
/// Errors: `invalid_scene` as above, `missing_file`.
proto::Expected<std::filesystem::path> find_side_file(const files::SceneFiles&,
                                                      std::string_view uri,
                                                      const std::string& pointer);

/// Finds the upload's file of that name, or of that last path component, for which `where` and
/// `pointer` ask. Errors: `missing_file`.
proto::Expected<std::filesystem::path> find_named_file(const files::SceneFiles&,
                                                       std::string_view name, const char* where,
                                                       const std::string& pointer);

}  // namespace kiln::gltf
