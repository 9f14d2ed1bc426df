#include "baker/output/lit_request.h"

#include <cmath>

#include "baker/files/flat_file.h"

namespace kiln::output {
namespace {

using proto::Expected;

struct SizeRecord {
  std::uint32_t page_size, page_count;
  std::uint32_t lightmap, mode, keep_lights;
};
struct PlacementRecord {
  std::uint32_t page, uses_source_uv;
  math::Vec2 scale, offset;
};
struct PageRecord {
  float scale, exposure;
  std::uint32_t clipped, clipped_lamps;
  std::uint32_t exr_bytes, png_bytes;
};
using Triangle = std::array<std::uint32_t, 3>;

enum Section : std::size_t {
  kSize,
  kVertices,
  kTriangles,
  kTrianglePage,
  kPlacements,
  kPages,
  kText,  ///< for each page the name of its EXR, then its PNG
};
constexpr std::array<std::uint32_t, kText + 1> kRecordBytes{sizeof(SizeRecord),
                                                            sizeof(atlas::AtlasVertex),
                                                            sizeof(Triangle),
                                                            sizeof(std::uint32_t),
                                                            sizeof(PlacementRecord),
                                                            sizeof(PageRecord),
                                                            1};

/// Returns the header. It needs no key and no history of versions, since one build writes and reads
/// the file and nothing keeps it.
files::FlatHeader header() {
  return {files::FlatKind::kLitRequest, 1, std::string(64, '-')};
}

bool read_pages(LitRequest& out, const files::FlatFile& file) {
  std::string_view text = file.bytes(kText);
  for (const PageRecord& r : file.records<PageRecord>(kPages)) {
    if (r.exr_bytes > text.size() || r.png_bytes > text.size() - r.exr_bytes) return false;
    LitPage page;
    page.exr = text.substr(0, r.exr_bytes);
    page.png = text.substr(r.exr_bytes, r.png_bytes);
    page.scale = r.scale;
    page.exposure = r.exposure;
    page.clipped = r.clipped;
    page.clipped_lamps = r.clipped_lamps;
    if (!std::isfinite(page.scale) || !std::isfinite(page.exposure)) return false;
    text.remove_prefix(std::size_t{r.exr_bytes} + r.png_bytes);
    out.light.pages.push_back(std::move(page));
  }
  return text.empty() && out.light.pages.size() == out.atlas.page_count;
}

bool read_form(LitPages& out, const SizeRecord& r) {
  if (r.lightmap > std::uint32_t(proto::GlbLightmap::kNone) ||
      r.mode > std::uint32_t(proto::GlbMode::kUnlit) || r.keep_lights > 1)
    return false;
  out.lightmap = proto::GlbLightmap(r.lightmap);
  out.mode = proto::GlbMode(r.mode);
  out.keep_lights = r.keep_lights != 0;
  return true;
}

bool read_placements(atlas::Atlas& atlas, const files::FlatFile& file) {
  for (const PlacementRecord& r : file.records<PlacementRecord>(kPlacements)) {
    if (r.page >= atlas.page_count || r.uses_source_uv > 1) return false;
    atlas::InstancePlacement placed;
    placed.page = r.page;
    placed.uses_source_uv = r.uses_source_uv != 0;
    placed.scale = r.scale;
    placed.offset = r.offset;
    atlas.placements.push_back(std::move(placed));
  }
  return true;
}

/// Returns whether every index is in range and all arrays are as long as those of the scene.
bool fits(const atlas::Atlas& atlas, const scene::Scene& scene) {
  if (atlas.triangles.size() != scene.triangles.size() ||
      atlas.triangle_chart.size() != scene.triangles.size() ||
      atlas.placements.size() != scene.instances.size())
    return false;
  for (const atlas::AtlasVertex& v : atlas.vertices)
    if (v.scene_vertex >= scene.positions.size()) return false;
  for (const Triangle& t : atlas.triangles)
    for (const std::uint32_t v : t)
      if (v >= atlas.vertices.size()) return false;
  for (const std::uint32_t page : atlas.triangle_chart)
    if (page >= atlas.page_count) return false;
  return true;
}

}  // namespace

proto::Expected<void> write_lit_request(int fd, const atlas::Atlas& atlas, const LitPages& light) {
  const std::vector<SizeRecord> size{{atlas.page_size, atlas.page_count,
                                      std::uint32_t(light.lightmap), std::uint32_t(light.mode),
                                      light.keep_lights}};
  std::vector<std::uint32_t> triangle_page(atlas.triangles.size());
  for (std::uint32_t t = 0; t < triangle_page.size(); ++t) triangle_page[t] = atlas.page_of(t);
  std::vector<PlacementRecord> placements;
  for (const atlas::InstancePlacement& p : atlas.placements)
    placements.push_back({p.page, p.uses_source_uv, p.scale, p.offset});
  std::vector<PageRecord> records;
  std::string text;
  for (const LitPage& p : light.pages) {
    records.push_back({p.scale, p.exposure, p.clipped, p.clipped_lamps, std::uint32_t(p.exr.size()),
                       std::uint32_t(p.png.size())});
    text += p.exr;
    text += p.png;
  }
  const std::array<files::FlatSection, kText + 1> sections{files::flat_section(size),
                                                           files::flat_section(atlas.vertices),
                                                           files::flat_section(atlas.triangles),
                                                           files::flat_section(triangle_page),
                                                           files::flat_section(placements),
                                                           files::flat_section(records),
                                                           files::FlatSection{1, text}};
  return write_flat(fd, header(), sections);
}

proto::Expected<LitRequest> read_lit_request(std::string_view bytes, const scene::Scene& scene) {
  const auto file = files::FlatFile::open(bytes, header(), kRecordBytes);
  if (!file) return proto::Unexpected(file.error());
  const auto size = file->records<SizeRecord>(kSize);
  constexpr std::uint32_t kMaxPages = 1 << 16;
  if (size.size() != 1 || size[0].page_size == 0 || size[0].page_count > kMaxPages)
    return files::bad_flat_file("its page sizes are out of range");
  LitRequest out;
  if (!read_form(out.light, size[0])) return files::bad_flat_file("its settings are out of range");
  atlas::Atlas& atlas = out.atlas;
  atlas.page_size = size[0].page_size;
  atlas.page_count = size[0].page_count;
  atlas.vertices = file->records<atlas::AtlasVertex>(kVertices);
  atlas.triangles = file->records<Triangle>(kTriangles);
  atlas.triangle_chart = file->records<std::uint32_t>(kTrianglePage);
  atlas.charts.resize(atlas.page_count);
  for (std::uint32_t p = 0; p < atlas.page_count; ++p) atlas.charts[p].page = p;
  if (!read_placements(atlas, *file) || !fits(atlas, scene) || !read_pages(out, *file))
    return files::bad_flat_file("the atlas does not fit the scene");
  return out;
}

}  // namespace kiln::output
