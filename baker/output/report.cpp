#include "baker/output/report.h"

#include <nlohmann/json.hpp>

#include "baker/exec/stop.h"
#include "baker/output/compare.h"
#include "baker/output/error_map.h"
#include "proto/files.h"
#include "proto/json.h"

namespace kiln::output {
namespace {

using nlohmann::json;
using proto::Expected;
using proto::Unexpected;

std::string numbered(const char* name, std::uint32_t page) {
  const std::string digits = std::to_string(page);
  return std::string(name).append(digits.size() < 2 ? "_0" : "_").append(digits).append(".png");
}

json describe(const Reference& reference, const proto::ReportSettings& settings) {
  json out{{"against", *settings.against}};
  if (!reference.settings) return out;
  out["method"] = proto::to_string(reference.settings->method);
  out["samples"] = settings.samples;
  out["seed"] = reference.settings->seed;
  out["passes"] = json::array();
  for (const auto& pass : reference.passes) out["passes"].push_back(proto::to_json(pass));
  return out;
}

/// A comparison under way. A page's images are made twice, since its error map hangs on the largest
/// value of all pages.
class Report {
 public:
  Report(const std::filesystem::path& dir, const Reference& reference,
         const std::function<image::PageImage(std::uint32_t)>& result,
         const proto::ReportSettings& settings, const std::stop_token& stop)
      : dir_(dir), reference_(reference), result_(result), settings_(settings), stop_(stop) {}

  Expected<std::vector<ReportFile>> write(std::uint32_t pages) {
    for (std::uint32_t p = 0; p < pages; ++p)
      if (auto ok = with_page(p, [&](const PagePair& pair) { return look_at(pair); }); !ok)
        return Unexpected(ok.error());
    json document = describe(reference_, settings_);
    for (std::uint32_t p = 0; p < pages; ++p)
      if (auto ok = with_page(p, [&](const PagePair& pair) { return add(p, pair, document); }); !ok)
        return Unexpected(ok.error());
    const CompareResult all = all_.result();
    document["figures"] = to_json(all);
    document["error_map"] = {
        {"ramp", "ember"}, {"factor", double(settings_.error_scale)}, {"white", white()}};
    if (auto ok = put("histogram.csv", "text/csv", histogram_csv(all)); !ok)
      return Unexpected(ok.error());
    if (auto ok = put("report.json", "application/json", document.dump(1) + "\n"); !ok)
      return Unexpected(ok.error());
    return std::move(files_);
  }

 private:
  template <class Use>
  Expected<void> with_page(std::uint32_t page, const Use& use) const {
    if (stop_.stop_requested()) return exec::canceled();
    const image::PageImage candidate = result_(page);
    const auto reference = reference_.page(page);
    if (!reference) return Unexpected(reference.error());
    return use(PagePair{*reference, candidate});
  }

  Expected<void> look_at(const PagePair& pair) {
    all_.look_at(pair);
    return {};
  }

  Expected<void> add(std::uint32_t page, const PagePair& pair, json& document) {
    all_.add(pair);
    json figures = to_json(compare(pair.reference, pair.candidate, all_.scale()));
    figures["error_map"] = numbered("error", page);
    figures["contours"] = numbered("contours", page);
    document["pages"].push_back(std::move(figures));
    if (auto ok = put_picture(numbered("error", page), error_map(pair, white())); !ok) return ok;
    return put_picture(numbered("contours", page), contours(pair, all_.scale()));
  }

  /// The error that is white in the error maps.
  double white() const { return all_.scale() / double(settings_.error_scale); }

  Expected<void> put_picture(const std::string& name, const Picture& picture) {
    const auto png = image::encode_png(picture.pixels, picture.width, picture.height);
    if (!png) return Unexpected(png.error());
    return put(name, "image/png", *png);
  }
  Expected<void> put(const std::string& name, const char* media_type, std::string_view bytes) {
    files_.push_back({name, media_type});
    return proto::write_bytes(dir_ / name, bytes);
  }

  const std::filesystem::path& dir_;
  const Reference& reference_;
  const std::function<image::PageImage(std::uint32_t)>& result_;
  const proto::ReportSettings& settings_;
  const std::stop_token& stop_;
  Comparison all_;
  std::vector<ReportFile> files_;
};

}  // namespace

Expected<std::vector<ReportFile>> write_report(
    const std::filesystem::path& dir, const Reference& reference, std::uint32_t pages,
    const std::function<image::PageImage(std::uint32_t page)>& result,
    const proto::ReportSettings& settings, const std::stop_token& stop) {
  return Report(dir, reference, result, settings, stop).write(pages);
}

}  // namespace kiln::output
