#pragma once

#include "baker/gltf/document.h"
#include "proto/expected.h"

namespace kiln::gltf {

/// Refuses a document that requires what this importer can't read or may not leave out.
/// Errors: `unsupported_extension`, pointer /extensionsRequired/i.
proto::Expected<void> check_required_extensions(const Json& document);

/// One warning for each extension in use that a bake leaves out.
void warn_of_extensions(Document&);

}  // namespace kiln::gltf
