#include <cstdlib>
#include <sstream>

#include "baker/generate/generate.h"
#include "tests/output/lit_scene.h"

namespace kiln::output {
namespace {

// Lights scenes as different as we have. CTest runs these once more with LIGHTKILN_LIT_SAMPLES
// naming a folder to keep them in, and then Khronos' validator over that folder.

/// `name`.glb in the folder.
void write_sample(const std::filesystem::path& folder, const std::string& name,
                  const files::SceneFiles& files, proto::Unwrap unwrap, const LitPages& form = {}) {
  SCOPED_TRACE(name);
  const auto scene = import::import_scene(files, dark());
  ASSERT_TRUE(scene) << scene.error().message;
  proto::AtlasSettings settings;
  settings.page_size = 1024;
  settings.unwrap = unwrap;
  const auto atlas = atlas::build_atlas(*scene, settings);
  ASSERT_TRUE(atlas) << atlas.error().message;
  LitPages pages = form;
  pages.pages = lit_pages(atlas->page_count).pages;
  const auto written = lit::write_lit_glb(folder / (name + ".glb"), files, *scene, *atlas, pages);
  EXPECT_TRUE(written) << written.error().message;
}

std::vector<std::string> split(const std::string& line, char separator) {
  std::vector<std::string> out;
  std::stringstream in(line);
  for (std::string part; std::getline(in, part, separator);) out.push_back(part);
  return out;
}

std::filesystem::path sample_folder(const test::TempFolder& temporary) {
  const char* kept = std::getenv("LIGHTKILN_LIT_SAMPLES");
  if (!kept) return temporary.path();
  std::filesystem::create_directories(kept);
  return kept;
}

TEST(LitSamples, Generated) {
  const test::TempFolder folder;
  const auto out = sample_folder(folder);
  for (const auto& generator : generate::generators()) {
    const std::string name(generator.name);
    const files::SceneFiles files{folder.path() / (name + ".glb"), {}};
    std::ofstream(files.main, std::ios::binary) << generate::generate_glb(name).value();
    write_sample(out, name + "_source_uv", files, proto::Unwrap::kAuto);
    write_sample(out, name + "_unwrapped", files, proto::Unwrap::kAlways);
    LitPages form;
    form.lightmap = proto::GlbLightmap::kRgbm;
    form.keep_lights = true;
    write_sample(out, name + "_rgbm", files, proto::Unwrap::kAuto, form);
    form = {};
    form.mode = proto::GlbMode::kUnlit;
    write_sample(out, name + "_unlit", files, proto::Unwrap::kAuto, form);
  }
}

/// The real files that the validator finds no error in, up to a size that keeps this short.
TEST(LitSamples, Corpus) {
  const test::TempFolder folder;
  const auto out = sample_folder(folder);
  const std::filesystem::path corpus = std::filesystem::path(LIGHTKILN_SHARED_DIR) / "corpus";
  std::ifstream index(corpus / "index.tsv");
  if (!index) GTEST_SKIP() << "there is no corpus beside the source";
  std::string line;
  std::getline(index, line);  // the heading
  while (std::getline(index, line)) {
    const auto row = split(line, '\t');
    ASSERT_GE(row.size(), 6u);
    if (row[5] != "bake" || row[4] != "-" || std::stoul(row[1]) > 1'000'000) continue;
    files::SceneFiles files{corpus / row[0], {}};
    if (row[3] != "-")
      for (const auto& name : split(row[3], ' '))
        files.side[name] = files.main.parent_path() / name;
    std::string name = row[0];
    for (char& c : name)
      if (c == '/' || c == ' ') c = '_';
    write_sample(out, name, files, proto::Unwrap::kAuto);
  }
}

}  // namespace
}  // namespace kiln::output
