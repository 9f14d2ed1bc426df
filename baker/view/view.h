#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "baker/exec/thread_pool.h"
#include "baker/scene/scene.h"
#include "proto/expected.h"
#include "proto/manifest.h"

namespace kiln::view {

/// The longest side of a picture, pixels.
inline constexpr std::uint32_t kMaxSide = 4096;

struct Size {
  std::uint32_t width = 1024, height = 768;
};

/// A picture of a baked scene, whose color is a layer of its pages.
struct Request {
  std::string layer = "irradiance";
  std::string camera = "fit";  ///< see choose_camera()
  Size size;
  bool orthographic = false;
  bool nearest = false;  ///< texels are squares; otherwise colors run from one to the next
  /// The picture shows the light that leaves the surface: albedo / pi times the layer, which is
  /// irradiance, and what the surface emits.
  bool shaded = false;
  /// Factor on light before the usual tone curve. Null: automatic, or the bake's output.tone_curve
  /// over the brightest value that is seen.
  std::optional<float> exposure;
};

/// Reads "WIDTHxHEIGHT". Errors: `bad_request`, with the pointer /query/size.
proto::Expected<Size> parse_size(const std::string&);

/// Checks all that can be without the bake. Errors: `bad_request`, with a pointer below /query.
proto::Expected<void> check(const Request&);

/// Reads the manifest of a bake's folder. Errors: `not_found`, `bad_document`, `io_error`.
proto::Expected<proto::Manifest> read_manifest(const std::filesystem::path& folder);

/// Returns the memory that draw() takes beside the scene, and the scene's own. Bytes.
std::uint64_t memory_bytes(const scene::Scene&, const proto::Manifest&, const Request&);

/// The file that a scene was read from: it says what TEXCOORD_1 is.
enum class SceneKind {
  kLit,     ///< a lit.glb: the place on the page
  kSource,  ///< the file that was baked: the manifest says how it lies on the page
};

struct Picture {
  std::uint32_t width = 0, height = 0;
  std::vector<std::array<std::uint8_t, 3>> pixels;  ///< row-major, row 0 = top
  float exposure = 1;                               ///< of light
};

/// Draws a picture of a bake's results. `folder` holds its pages. One-sided surfaces are not seen
/// from behind, so one can look into a closed room; both sides of the others show the light of
/// their front. A pixel is the mean of four points. The picture depends on the arguments only, not
/// on the number of threads.
///
/// Errors: `not_found` (the pages have no such layer, the scene has no such camera), `bad_request`,
/// `invalid_scene` (it is not that of the bake), `invalid_image` and `bad_document` (damaged
/// results), `canceled`.
proto::Expected<Picture> draw(const std::filesystem::path& folder, const proto::Manifest&,
                              const scene::Scene&, SceneKind, const Request&, exec::ThreadPool&,
                              std::stop_token);

}  // namespace kiln::view
