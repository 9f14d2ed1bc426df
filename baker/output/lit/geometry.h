#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "baker/atlas/atlas.h"
#include "baker/output/lit/document.h"
#include "baker/scene/scene.h"

namespace kiln::output::lit {

/// The triangles of one part on one page, as lit.glb needs them.
struct LitPiece {
  std::uint32_t page = 0;
  /// True where each source vertex has one place on the page: then the source's accessors stay, and
  /// `uv` has one entry for each of its vertices.
  bool keeps_vertices = false;
  std::vector<std::array<float, 2>> uv;  ///< 0..1 over the page, one per vertex of the result
  std::vector<std::uint32_t> source;     ///< source of each vertex, if vertices were split
  std::vector<std::uint32_t> indices;    ///< likewise; the source's winding
};

/// `source_vertices`: the count of the primitive's POSITION accessor. One piece per page that the
/// part lies on, by rising page. Vertices are told apart by source vertex and place on the page.
std::vector<LitPiece> cut_part(const scene::Scene&, const atlas::Atlas&, std::uint32_t part,
                               std::uint64_t source_vertices);

/// Writes accessors, each content once.
class AccessorWriter {
 public:
  explicit AccessorWriter(LitDocument& document) : document_(document) {}

  std::uint32_t uv(const std::vector<std::array<float, 2>>&);
  std::uint32_t indices(const std::vector<std::uint32_t>&, std::size_t vertices);
  /// Accessor `index` with the elements of `source` in that order: same type, names and extras, new
  /// count, min and max. Errors: `invalid_scene`.
  proto::Expected<std::uint32_t> gather(std::uint64_t index,
                                        const std::vector<std::uint32_t>& source);

 private:
  std::uint32_t id_of(const std::vector<std::uint32_t>& source);
  std::uint32_t add(Json accessor, std::string bytes, int target, std::uint32_t stride);

  LitDocument& document_;
  std::map<std::vector<std::uint32_t>, std::uint32_t> source_ids_;
  std::map<std::pair<std::uint64_t, std::uint32_t>, std::uint32_t> gathered_;
  std::map<std::pair<std::vector<std::uint32_t>, bool>, std::uint32_t> index_lists_;
};

}  // namespace kiln::output::lit
