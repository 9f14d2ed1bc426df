#include <cmath>
#include <nlohmann/json.hpp>

#include "baker/output/lit_page.h"
#include "baker/output/output.h"
#include "proto/files.h"
#include "proto/json.h"

namespace kiln::baker {
namespace {

using proto::fail;
using proto::Unexpected;

/// Half floats end at 65,504: beyond this a page is written as float.
constexpr float kHalfLimitLx = 60'000;

bool contains(const std::vector<std::string>& list, std::string_view item) {
  return std::find(list.begin(), list.end(), item) != list.end();
}

std::string page_name(std::uint32_t page, const char* extension) {
  const std::string digits = std::to_string(page);
  return std::string("page_").append(digits.size() < 2 ? "0" : "").append(digits).append(extension);
}

/// The plane of one layer, one value per texel of the group.
proto::Expected<std::vector<Rgb>> layer_values(const OutputInput& in, const std::string& layer) {
  const Lightmap& light = in.light;
  const FilteredLight& shown = in.filtered;
  const auto plane = [&](const auto& value) -> std::vector<Rgb> {
    std::vector<Rgb> values(light.size());
    for (std::uint32_t i = 0; i < light.size(); ++i) values[i] = value(i);
    return values;
  };
  if (layer == "irradiance")
    return plane([&](auto i) { return shown.direct[i] + shown.sky[i] + shown.indirect[i]; });
  if (layer == "direct") return plane([&](auto i) { return shown.direct[i] + shown.sky[i]; });
  if (layer == "indirect") return shown.indirect;
  if (layer == "raw") return plane([&](auto i) { return light.irradiance(i); });
  if (layer == "standard_error")
    return plane([&](auto i) {
      const float direct = shown.direct_variance[i], gathered = shown.gathered_variance[i];
      return Rgb{std::sqrt(direct + gathered), std::sqrt(direct), std::sqrt(gathered)};
    });
  if (layer == "samples")
    return plane([&](auto i) {
      return Rgb{float(light.samples[i]), float(light.direct_samples[i]), 0};
    });
  return fail("internal", "there is no layer '" + layer + "'");
}

struct Layer {
  std::string name;
  std::vector<Rgb> values;
};

/// Writes the files of one bake; fills the manifest on the way.
class Writer {
 public:
  Writer(const std::filesystem::path& dir, const OutputInput& in,
         const proto::BakeSettings& settings, proto::Manifest& manifest, std::stop_token stop)
      : dir_(dir), in_(in), settings_(settings), manifest_(manifest), stop_(std::move(stop)) {}

  proto::Expected<void> run() {
    if (auto ok = load_layers(); !ok) return ok;
    manifest_.pages.clear();
    manifest_.files.clear();
    for (std::uint32_t p = 0; p < in_.texels.pages.size(); ++p)
      if (auto ok = write_page(p); !ok) return ok;
    fill_nodes();
    if (auto ok = write_lit_scene(); !ok) return ok;
    return write_manifest();
  }

 private:
  proto::Expected<void> load_layers() {
    for (const std::string& name : settings_.output.layers) {
      auto values = layer_values(in_, name);
      if (!values) return Unexpected(values.error());
      layers_.push_back({name, std::move(*values)});
    }
    auto irradiance = layer_values(in_, "irradiance");
    if (!irradiance) return Unexpected(irradiance.error());
    irradiance_ = std::move(*irradiance);
    return {};
  }

  proto::Expected<void> canceled() const {
    if (stop_.stop_requested()) return fail(proto::kCanceledCode, "the bake was cancelled");
    return {};
  }

  PageImage compose(std::uint32_t page, const std::vector<Rgb>& values) const {
    return compose_page(in_.texels, page, values, settings_.post.dilate);
  }

  proto::Expected<void> write_page(std::uint32_t p) {
    if (auto ok = canceled(); !ok) return ok;
    const PageImage irradiance = compose(p, irradiance_);
    proto::PageInfo info;
    info.width = irradiance.width;
    info.height = irradiance.height;
    for (std::size_t i = 0; i < irradiance.rgb.size(); ++i) {
      if (!(irradiance.coverage[i] > 0)) continue;
      const Rgb v = irradiance.rgb[i];
      if (!std::isfinite(v.r) || !std::isfinite(v.g) || !std::isfinite(v.b))
        return fail("internal", "the light of texel (" + std::to_string(i % info.width) + ", " +
                                    std::to_string(i / info.width) + ") of page " +
                                    std::to_string(p) + " is not finite");
      ++info.texels;
      info.max_lx = std::max(info.max_lx, max_channel(v));
    }
    if (auto ok = write_page_exr(p, info); !ok) return ok;
    if (auto ok = write_preview(p, irradiance, info); !ok) return ok;
    if (auto ok = canceled(); !ok) return ok;
    if (contains(settings_.output.formats, "glb")) {
      auto lit = encode_lit_page(irradiance);
      if (!lit) return Unexpected(lit.error());
      lit->exr = info.exr;
      lit->exposure =
          settings_.output.exposure ? *settings_.output.exposure : automatic_exposure(irradiance);
      lit_pages_.push_back(std::move(*lit));
    }
    manifest_.pages.push_back(std::move(info));
    return {};
  }

  proto::Expected<void> write_page_exr(std::uint32_t p, proto::PageInfo& info) {
    if (!contains(settings_.output.formats, "exr")) return {};
    std::vector<PageImage> images;
    float max = 0;
    for (const Layer& layer : layers_) {
      images.push_back(compose(p, layer.values));
      for (const Rgb v : images.back().rgb) max = std::max(max, max_channel(v));
    }
    std::vector<ExrLayer> named;
    for (std::size_t i = 0; i < images.size(); ++i) named.push_back({layers_[i].name, &images[i]});

    info.exr = page_name(p, ".exr");
    proto::Precision precision = settings_.output.precision;
    if (precision == proto::Precision::kHalf && max > kHalfLimitLx) {
      precision = proto::Precision::kFloat;
      manifest_.warnings.push_back({"half_overflow", "",
                                    info.exr + " is written as float: it holds " +
                                        std::to_string(std::lround(max)) +
                                        " lx, and half precision ends at 65,504"});
    }
    const auto metadata = exr_metadata(p);
    if (auto ok = proto::write_whole(dir_ / info.exr,
                                     [&](const std::filesystem::path& temporary) {
                                       return write_exr(temporary, named, precision, metadata);
                                     });
        !ok)
      return ok;
    return add_file(info.exr, "image/x-exr");
  }

  std::vector<std::pair<std::string, std::string>> exr_metadata(std::uint32_t page) const {
    const auto& solver = settings_.solver;
    std::string layers;
    for (const Layer& layer : layers_) layers += (layers.empty() ? "" : ",") + layer.name;
    return {
        {"lightkiln:version", manifest_.version},
        {"lightkiln:units", "lux"},
        {"lightkiln:quantity", "irradiance E without albedo; outgoing radiance = albedo / pi * E"},
        {"lightkiln:layers", layers},
        {"lightkiln:alpha", "1 on lit texels, 0 in padding"},
        {"lightkiln:page", std::to_string(page)},
        {"lightkiln:method", solver.method == proto::Method::kPath ? "path" : "gather"},
        {"lightkiln:bounces", std::to_string(solver.bounces)},
        {"lightkiln:samples", solver.samples ? std::to_string(*solver.samples) : "adaptive"},
        {"lightkiln:seed", std::to_string(solver.seed)},
        {"lightkiln:sceneSha256", manifest_.scene_sha256},
        {"lightkiln:settingsSha256", proto::sha256_hex(proto::to_json(settings_).dump())},
        {"lightkiln:instructionSet", manifest_.instruction_set},
    };
  }

  proto::Expected<void> write_preview(std::uint32_t p, const PageImage& image,
                                      proto::PageInfo& info) {
    if (!contains(settings_.output.formats, "png")) return {};
    info.preview = page_name(p, ".png");
    info.preview_exposure =
        settings_.output.exposure ? *settings_.output.exposure : automatic_exposure(image);
    const auto png = encode_png(tone_map(image, info.preview_exposure), image.width, image.height);
    if (!png) return Unexpected(png.error());
    if (auto ok = proto::write_bytes(dir_ / info.preview, *png); !ok) return ok;
    return add_file(info.preview, "image/png");
  }

  void fill_nodes() {
    manifest_.nodes.clear();
    for (std::size_t i = 0; i < in_.scene.instances.size(); ++i) {
      const Instance& instance = in_.scene.instances[i];
      const InstancePlacement& placed = in_.atlas.placements[i];
      proto::NodePlacement node;
      node.node = instance.node;
      node.mesh = instance.mesh;
      node.name = instance.name;
      node.page = placed.page;
      if (placed.uses_source_uv) {
        node.scale = {placed.scale.x, placed.scale.y};
        node.offset = {placed.offset.x, placed.offset.y};
      }
      node.uv_source = placed.uses_source_uv ? "texcoord_1" : "unwrapped";
      node.reason = placed.reason;
      manifest_.nodes.push_back(std::move(node));
    }
  }

  proto::Expected<void> write_lit_scene() {
    if (!contains(settings_.output.formats, "glb")) return {};
    if (auto ok = canceled(); !ok) return ok;
    if (auto ok = proto::write_whole(dir_ / "lit.glb",
                                     [&](const std::filesystem::path& temporary) {
                                       return write_lit_glb(temporary, in_.files, in_.scene,
                                                            in_.atlas, lit_pages_);
                                     });
        !ok)
      return ok;
    return add_file("lit.glb", "model/gltf-binary");
  }

  /// The document cannot hold its own hash: it lists the other files, the caller's manifest lists
  /// it.
  proto::Expected<void> write_manifest() {
    if (auto ok = canceled(); !ok) return ok;
    const std::string text = proto::to_json(manifest_).dump(1) + "\n";
    if (auto ok = proto::write_bytes(dir_ / "manifest.json", text); !ok) return ok;
    return add_file("manifest.json", "application/json");
  }

  proto::Expected<void> add_file(const std::string& name, const char* media_type) {
    auto digest = proto::digest_file(dir_ / name);
    if (!digest) return Unexpected(digest.error());
    manifest_.files.push_back({name, media_type, digest->bytes, std::move(digest->sha256)});
    return {};
  }

  const std::filesystem::path& dir_;
  const OutputInput& in_;
  const proto::BakeSettings& settings_;
  proto::Manifest& manifest_;
  std::stop_token stop_;
  std::vector<Layer> layers_;
  std::vector<Rgb> irradiance_;
  std::vector<LitPage> lit_pages_;
};

}  // namespace

proto::Expected<void> write_outputs(const std::filesystem::path& dir, const OutputInput& in,
                                    const proto::BakeSettings& settings, proto::Manifest& manifest,
                                    std::stop_token stop) {
  return Writer(dir, in, settings, manifest, std::move(stop)).run();
}

}  // namespace kiln::baker
