#pragma once

#include <nlohmann/json_fwd.hpp>

namespace kiln::api {

/// Returns the API as an OpenAPI 3.1 document, for client generators and test tools. Schemas of
/// what the service answers are closed: a member that they don't name does not come.
nlohmann::json openapi_document();

/// Puts examples into that document (openapi_examples.cpp). Throws when an operation has none.
void add_openapi_examples(nlohmann::json& document);

/// Returns the `components/schemas` of that document (openapi_schemas.cpp).
nlohmann::json openapi_schemas();

}  // namespace kiln::api
