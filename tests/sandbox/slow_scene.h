#pragma once

#include <gtest/gtest.h>
#include <sys/types.h>
#include <zlib.h>

#include <cstdint>
#include <fstream>
#include <sstream>
#include <string>

#include "tests/support/gltf_builder.h"
#include "tests/support/png_builder.h"

/// Scenes that take long to import, and what /proc tells of the process that does.
namespace kiln::test {

inline std::string process_file(pid_t pid, const char* name) {
  std::ifstream in("/proc/" + std::to_string(pid) + "/" + name);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

/// The value of a line "Name:\tvalue" of /proc/PID/status.
inline std::string status_of(pid_t pid, const std::string& name) {
  std::istringstream lines(process_file(pid, "status"));
  for (std::string line; std::getline(lines, line);)
    if (line.starts_with(name + ":"))
      return line.substr(line.find_first_not_of(" \t", name.size() + 1));
  return "";
}

/// Whether an import process has given up what decoding does not need; a zygote keeps the right to
/// have children.
inline bool is_confined(pid_t pid) {
  std::istringstream lines(process_file(pid, "limits"));
  for (std::string line; std::getline(lines, line);)
    if (line.starts_with("Max open files"))
      return line.substr(26, line.find(' ', 26) - 26).size() <= 2 &&
             status_of(pid, "Seccomp") == "2";
  return false;
}

/// A PNG of a few kilobytes that takes 4 * side^2 bytes and a while to decode.
inline std::string large_png(std::uint32_t side) {
  const std::string rows((std::size_t{side} / 8 + 1) * side, '\0');
  uLongf size = compressBound(rows.size());
  std::string stream(size, '\0');
  EXPECT_EQ(compress2(reinterpret_cast<Bytef*>(stream.data()), &size,
                      reinterpret_cast<const Bytef*>(rows.data()), rows.size(), 1),
            Z_OK);
  stream.resize(size);
  return PngBuilder::from_stream(side, side, 1, 0, stream);
}

/// A triangle with a texture, under a lamp.
inline std::string textured_glb(const std::string& png) {
  GltfBuilder b = triangle_builder();
  b.add("textures", {{"source", b.image(png, "image/png")}});
  b.material({{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}},
              {"emissiveFactor", {1, 1, 1}}});
  b.json["meshes"][0]["primitives"][0]["material"] = 0;
  return b.glb();
}

/// Takes between half a second and some seconds to import.
inline const std::string& slow_glb() {
  static const std::string glb = textured_glb(large_png(12'000));
  return glb;
}

}  // namespace kiln::test
