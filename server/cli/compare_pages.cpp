#include "server/cli/compare_pages.h"

#include <algorithm>
#include <set>

#include "baker/image/page_image.h"

namespace kiln::cli {
namespace {

namespace fs = std::filesystem;
using proto::Expected;
using proto::Unexpected;

bool is_page(const std::string& stem) {
  constexpr std::string_view kBegin = "page_";
  return stem.starts_with(kBegin) && stem.size() > kBegin.size() &&
         stem.find_first_not_of("0123456789", kBegin.size()) == std::string::npos;
}

/// Returns the names of the pages in a folder, without ".exr".
Expected<std::set<std::string>> pages_in(const fs::path& folder) {
  std::set<std::string> names;
  std::error_code error;
  for (fs::directory_iterator at(folder, error), end; !error && at != end; at.increment(error)) {
    const fs::path& file = at->path();
    if (file.extension() == ".exr" && is_page(file.stem())) names.insert(file.stem());
  }
  if (error) return proto::fail("io_error", folder.string() + " can't be read: " + error.message());
  return names;
}

/// Returns an error unless the folder has these pages and no others.
Expected<void> check_pages(const fs::path& folder, const std::set<std::string>& wanted,
                           const fs::path& reference) {
  const auto names = pages_in(folder);
  if (!names) return Unexpected(names.error());
  std::vector<std::string> odd;
  std::set_symmetric_difference(wanted.begin(), wanted.end(), names->begin(), names->end(),
                                std::back_inserter(odd));
  if (odd.empty()) return {};
  const bool missing = wanted.contains(odd.front());
  return proto::fail("usage", (missing ? folder : reference).string() + " has no " + odd.front() +
                                  ".exr, and " + (missing ? reference : folder).string() +
                                  " has one. Bake both with the same atlas settings, or name the "
                                  "two files to compare.");
}

std::string size_of(const image::PageImage& image) {
  return std::to_string(image.width) + "x" + std::to_string(image.height);
}

Expected<image::PageImage> read(const fs::path& file, const std::string& layer) {
  auto image = image::read_exr(file, layer);
  if (!image && image.error().code == "invalid_image")
    return proto::fail("invalid_image",
                       file.string() + " can't be compared: " + image.error().message + ".");
  return image;
}

Expected<image::PageImage> read_like(const image::PageImage& reference,
                                     const fs::path& reference_file, const fs::path& file,
                                     const std::string& layer) {
  auto image = read(file, layer);
  if (!image || (image->width == reference.width && image->height == reference.height))
    return image;
  return proto::fail("invalid_image", "The images differ in size: " + reference_file.string() +
                                          " is " + size_of(reference) + " and " + file.string() +
                                          " is " + size_of(*image) +
                                          ". Bake both with the same atlas settings.");
}

/// The images of one page at a time.
class PageImages {
 public:
  PageImages(const std::vector<ComparedFiles>& pages, const MeasureOptions& options)
      : pages_(pages), options_(options) {}

  Expected<output::PagePair> read(std::size_t page) {
    if (page != page_) {
      page_.reset();
      images_ = {};
      auto images = read_pages(pages_[page], options_.layer, options_.factor);
      if (!images) return Unexpected(images.error());
      images_ = std::move(*images);
      page_ = page;
    }
    return images_.pair();
  }

 private:
  const std::vector<ComparedFiles>& pages_;
  const MeasureOptions& options_;
  std::optional<std::size_t> page_;  ///< the one that images_ holds
  ComparedImages images_;
};

}  // namespace

Expected<Figures> measure_pages(const std::vector<ComparedFiles>& pages,
                                const MeasureOptions& options, const UsePage& use) {
  PageImages images(pages, options);
  output::Comparison all(options.scale);
  for (std::size_t p = 0; p < pages.size(); ++p) {
    const auto pair = images.read(p);
    if (!pair) return Unexpected(pair.error());
    all.look_at(*pair);
  }
  Figures out;
  for (std::size_t p = 0; p < pages.size(); ++p) {
    const auto pair = images.read(p);
    if (!pair) return Unexpected(pair.error());
    all.add(*pair);
    out.pages.push_back(
        output::compare(pair->reference, pair->candidate, all.scale(), pair->second));
    if (!use) continue;
    if (auto ok = use(p, *pair, all.scale()); !ok) return Unexpected(ok.error());
  }
  out.all = all.result();
  if (out.all.texels > 0) return out;
  return proto::fail("invalid_image", "No texel is lit in both " + pages[0].reference.string() +
                                          " and " + pages[0].candidate.string() +
                                          ". Compare lightmaps of one scene, which were baked "
                                          "with the same atlas settings.");
}

Expected<std::vector<ComparedFiles>> find_pages(const fs::path& reference,
                                                const fs::path& candidate, const fs::path& second) {
  std::vector<fs::path> others{candidate};
  if (!second.empty()) others.push_back(second);
  std::error_code error;
  const bool folders = fs::is_directory(reference, error);
  for (const fs::path& other : others)
    if (fs::is_directory(other, error) != folders)
      return proto::fail("usage", (folders ? reference : other).string() + " is a folder, and " +
                                      (folders ? other : reference).string() +
                                      " is a file. Name two folders, or two files.");
  if (!folders) return std::vector<ComparedFiles>{{"", reference, candidate, second}};
  const auto names = pages_in(reference);
  if (!names) return Unexpected(names.error());
  if (names->empty())
    return proto::fail("usage", reference.string() +
                                    " has no page_NN.exr. Name a folder that "
                                    "`lightkiln bake` or `fetch` has written.");
  for (const fs::path& other : others)
    if (auto ok = check_pages(other, *names, reference); !ok) return Unexpected(ok.error());
  std::vector<ComparedFiles> pages;
  for (const std::string& name : *names) {
    const std::string file = name + ".exr";
    pages.push_back(
        {name, reference / file, candidate / file, second.empty() ? fs::path() : second / file});
  }
  return pages;
}

Expected<ComparedImages> read_pages(const ComparedFiles& files, const std::string& layer,
                                    double factor) {
  auto reference = read(files.reference, layer);
  if (!reference) return Unexpected(reference.error());
  auto candidate = read_like(*reference, files.reference, files.candidate, layer);
  if (!candidate) return Unexpected(candidate.error());
  if (factor != 1)
    for (math::Rgb& v : candidate->rgb) v = v * float(factor);
  ComparedImages images{std::move(*reference), std::move(*candidate), {}};
  if (files.second.empty()) return images;
  auto second = read_like(images.reference, files.reference, files.second, layer);
  if (!second) return Unexpected(second.error());
  images.second = std::move(*second);
  return images;
}

}  // namespace kiln::cli
