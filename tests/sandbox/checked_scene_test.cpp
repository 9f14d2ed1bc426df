// A scene is read by one process from its check to its import, unless that process is needed
// elsewhere or gone.
#include <signal.h>
#include <sys/wait.h>

#include "baker/generate/generate.h"
#include "tests/sandbox/isolated.h"

namespace kiln::test {
namespace {

constexpr std::uint64_t kMiB = 1 << 20;

/// Has one importer for a check and what follows.
struct Kept : Isolated {
  Kept() {
    for (int i = 0; i < 60'000 && options.process.zygote->pid() < 0; ++i)
      std::this_thread::sleep_for(1ms);  // what starts before it can't decode images
  }
  sandbox::Importer& importer() {
    if (!importer_) importer_.emplace(options);
    return *importer_;
  }
  bool check(const files::SceneFiles& files, const proto::BakeSettings& settings = {}) {
    const auto checked = importer().check(files, settings);
    EXPECT_TRUE(checked) << checked.error().message;
    return checked.has_value();
  }
  proto::Expected<scene::Scene> import_checked(const files::SceneFiles& files) {
    return importer().open(files, "key", cache())->import({});
  }

 private:
  std::optional<sandbox::Importer> importer_;
};

TEST(CheckedScene, IsImportedByTheProcessThatCheckedIt) {
  Kept kept;
  const Scene scene(generate::generate_glb("room_textured").value());
  ASSERT_TRUE(kept.check(scene.files));
  EXPECT_EQ(kept.started, 1);
  const auto imported = kept.import_checked(scene.files);
  ASSERT_TRUE(imported) << imported.error().message;
  EXPECT_EQ(kept.started, 1) << "nothing is parsed again";
  const auto alone = import::import_files(scene.files);
  ASSERT_TRUE(alone);
  EXPECT_EQ(imported->positions.size(), alone->positions.size());
  EXPECT_EQ(imported->image_texels, alone->image_texels);
  EXPECT_EQ(imported->warnings.size(), alone->warnings.size());
  ASSERT_EQ(kept.cached().size(), 1u) << "kept as if it had been imported alone";
  ASSERT_TRUE(kept.check(scene.files));
  EXPECT_TRUE(kept.import_checked(scene.files));
  EXPECT_EQ(kept.started, 2) << "one for the check; the scene file is there";
}

TEST(CheckedScene, AJobHasTwoProcesses) {
  Kept kept;
  const Scene scene(generate::generate_glb("cornell").value());
  ASSERT_TRUE(kept.check(scene.files));
  const TempFolder out, direct;
  ASSERT_TRUE(bake_small(scene.files, out, kept.importer().open(scene.files, "key", {})));
  EXPECT_EQ(kept.started, 2) << "one for check and import, one for lit.glb";
  ASSERT_TRUE(bake_small(scene.files, direct));
  for (const char* file : {"page_00.exr", "lit.glb"})
    EXPECT_TRUE(read_bytes(out.path() / file) == read_bytes(direct.path() / file)) << file;
}

// A scene gives its warnings once, though it is looked at twice.
TEST(CheckedScene, HasTheWarningsOfAnImport) {
  Kept kept;
  GltfBuilder b = triangle_builder();
  b.json["meshes"][0]["primitives"].push_back(b.json["meshes"][0]["primitives"][0]);
  b.json["meshes"][0]["primitives"][1]["mode"] = 0;  // points
  b.json["extensionsUsed"] = {"VENDOR_any"};
  const Scene scene(b.glb());
  proto::BakeSettings settings;
  settings.allow_dark = true;
  ASSERT_TRUE(kept.check(scene.files, settings));
  const auto imported = kept.import_checked(scene.files);
  ASSERT_TRUE(imported) << imported.error().message;
  EXPECT_EQ(kept.started, 1);
  const auto alone = import::import_files(scene.files);
  ASSERT_EQ(imported->warnings.size(), alone->warnings.size());
  ASSERT_GE(alone->warnings.size(), 2u);
  for (std::size_t i = 0; i < alone->warnings.size(); ++i)
    EXPECT_EQ(imported->warnings[i].message, alone->warnings[i].message);
}

TEST(CheckedScene, OtherFilesAndOtherSkyMapsAreOthers) {
  Kept kept;
  const std::string glb = generate::generate_glb("cornell").value();
  const Scene scene(glb), twin(glb);
  ASSERT_TRUE(kept.check(scene.files));
  ASSERT_TRUE(kept.import_checked(twin.files)) << "the same bytes, but nobody knows that";
  EXPECT_EQ(kept.started, 2);
}

TEST(CheckedScene, IsReadAnewWhenItsProcessIsGone) {
  Kept kept;
  const Scene scene(generate::generate_glb("cornell").value());
  ASSERT_TRUE(kept.check(scene.files));
  ASSERT_EQ(::kill(kept.pid, SIGKILL), 0);
  siginfo_t gone{};
  ASSERT_EQ(::waitid(P_PID, id_t(kept.pid.load()), &gone, WEXITED | WNOWAIT), 0);
  const auto imported = kept.import_checked(scene.files);
  ASSERT_TRUE(imported) << imported.error().message;
  EXPECT_EQ(kept.started, 2);
}

TEST(CheckedScene, GivesUpItsPlaceToWhoeverNeedsOne) {
  Kept kept;
  kept.options.memory = std::make_shared<base::MemoryBudget>(
      1024 * kMiB, base::MemoryBudget::Imports{1, 512 * kMiB, 128 * kMiB});
  kept.options.patience = 0ms;
  const std::string glb = generate::generate_glb("cornell").value();
  const Scene first(glb), second(glb);
  ASSERT_TRUE(kept.check(first.files));
  ASSERT_TRUE(kept.check(second.files)) << "the only place was held by the first";
  ASSERT_TRUE(kept.import_checked(second.files));
  EXPECT_EQ(kept.started, 2);
  ASSERT_TRUE(sandbox::Importer(kept.importer()).open(first.files, "other", {})->import({}));
  EXPECT_EQ(kept.started, 3) << "the first had to go";
  EXPECT_EQ(kept.options.memory->free_bytes(), kept.options.memory->for_bakes());
}

TEST(CheckedScene, HasTheMemoryOfAnImportOnceItIsOne) {
  if (!kHasMemoryLimit) GTEST_SKIP() << "a sanitizer's shadow is larger than any limit";
  Kept kept;
  kept.options.memory = std::make_shared<base::MemoryBudget>(
      2048 * kMiB, base::MemoryBudget::Imports{2, 1600 * kMiB, 64 * kMiB});
  // 32 MiB beside it let an import expect 256; the texture takes 100 MB, the check had 64 MiB.
  const Scene scene(textured_glb(large_png(5000)));
  files::SceneFiles files = scene.files;
  files.side["padding"] = scene.folder.write("padding", std::string(32 * kMiB, '\0'));
  ASSERT_TRUE(kept.check(files));
  const auto imported = kept.import_checked(files);
  ASSERT_TRUE(imported) << imported.error().message;
  EXPECT_EQ(imported->image_texels.size(), 25'000'000u);
  EXPECT_EQ(kept.started, 1);
}

TEST(CheckedScene, LeavesNothingBehind) {
  Kept kept;
  const Scene scene(generate::generate_glb("cornell").value());
  pid_t pid = -1;
  {
    sandbox::Importer importer(kept.options);
    ASSERT_TRUE(importer.check(scene.files, {}));
    pid = kept.pid;
    EXPECT_EQ(::kill(pid, 0), 0);
  }
  EXPECT_NE(::kill(pid, 0), 0) << "it went with the importer";
  EXPECT_FALSE(fs::exists(kept.folder.path() / "t0"));
}

}  // namespace
}  // namespace kiln::test
