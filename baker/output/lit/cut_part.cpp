#include <bit>
#include <limits>

#include "baker/output/lit/geometry.h"

namespace kiln::output::lit {
namespace {

using Key = std::array<std::uint32_t, 3>;  // source vertex, bits of u, bits of v

/// One triangle corner: a vertex of the source at a place on the page.
struct Corner {
  std::uint32_t source = 0;
  std::array<float, 2> uv{};

  Key key() const {
    return {source, std::bit_cast<std::uint32_t>(uv[0]), std::bit_cast<std::uint32_t>(uv[1])};
  }
};

std::map<std::uint32_t, std::vector<std::uint32_t>> triangles_by_page(const atlas::Atlas& atlas,
                                                                      const scene::Part& part) {
  std::map<std::uint32_t, std::vector<std::uint32_t>> out;
  for (std::uint32_t t = part.first_triangle; t < part.first_triangle + part.triangle_count; ++t)
    out[atlas.page_of(t)].push_back(t);
  return out;
}

/// Returns the corners in the source's winding.
std::vector<Corner> corners_of(const scene::Scene& scene, const atlas::Atlas& atlas,
                               const std::vector<std::uint32_t>& triangles, bool mirrored) {
  static constexpr std::array<int, 3> kStraight{0, 1, 2}, kSwapped{0, 2, 1};
  std::vector<Corner> out;
  out.reserve(triangles.size() * 3);
  for (const std::uint32_t t : triangles)
    for (const int c : mirrored ? kSwapped : kStraight) {
      const atlas::AtlasVertex& v = atlas.vertices[atlas.triangles[t][std::size_t(c)]];
      out.push_back({scene.source_vertex[v.scene_vertex],
                     {v.uv.x / float(atlas.page_size), v.uv.y / float(atlas.page_size)}});
    }
  return out;
}

/// Says whether each source vertex has one place; then piece.uv has that of every vertex, (0,0)
/// where no triangle needs one.
bool place_source_vertices(LitPiece& piece, const std::vector<Corner>& corners,
                           std::uint64_t source_vertices) {
  constexpr float kUnset = std::numeric_limits<float>::infinity();
  std::vector<std::array<float, 2>> uv(source_vertices, {kUnset, kUnset});
  for (const Corner& corner : corners) {
    auto& place = uv.at(corner.source);
    if (place[0] == kUnset) place = corner.uv;
    if (place != corner.uv) return false;
  }
  for (auto& place : uv)
    if (place[0] == kUnset) place = {0, 0};
  piece.uv = std::move(uv);
  return true;
}

void split_vertices(LitPiece& piece, const std::vector<Corner>& corners) {
  std::map<Key, std::uint32_t> ids;
  for (const Corner& corner : corners) {
    const auto [found, is_new] =
        ids.emplace(corner.key(), static_cast<std::uint32_t>(piece.source.size()));
    if (is_new) {
      piece.source.push_back(corner.source);
      piece.uv.push_back(corner.uv);
    }
    piece.indices.push_back(found->second);
  }
}

}  // namespace

std::vector<LitPiece> cut_part(const scene::Scene& scene, const atlas::Atlas& atlas,
                               std::uint32_t part_index, std::uint64_t source_vertices) {
  const scene::Part& part = scene.parts[part_index];
  const auto pages = triangles_by_page(atlas, part);
  std::vector<LitPiece> out;
  for (const auto& [page, triangles] : pages) {
    LitPiece piece;
    piece.page = page;
    const auto corners =
        corners_of(scene, atlas, triangles, scene.instances[part.instance].mirrored);
    piece.keeps_vertices =
        pages.size() == 1 && place_source_vertices(piece, corners, source_vertices);
    if (!piece.keeps_vertices) split_vertices(piece, corners);
    out.push_back(std::move(piece));
  }
  return out;
}

}  // namespace kiln::output::lit
