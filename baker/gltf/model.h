#pragma once

#include <nlohmann/json_fwd.hpp>

namespace tinygltf {
class Model;
}

namespace kiln::exec {
class StopPoll;
}

namespace kiln::gltf {

// The collections that grow with a scene, from a document that check_gltf has passed. They go past
// the library, whose way by the text of their JSON takes several times as long as all the rest of
// a check: a file of 50 MB would not be answered within a second. Properties that no bake reads
// are left at their defaults. When stopped, what they leave is incomplete.

void read_nodes(tinygltf::Model&, const nlohmann::json& nodes, exec::StopPoll&);
void read_meshes(tinygltf::Model&, const nlohmann::json& meshes, exec::StopPoll&);
void read_accessors(tinygltf::Model&, const nlohmann::json& accessors, exec::StopPoll&);

}  // namespace kiln::gltf
