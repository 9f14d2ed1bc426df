// The memory of the processes that decode uploads: its limit, its place in the machine's budget.
#include "baker/generate/generate.h"
#include "tests/sandbox/isolated.h"

namespace kiln::test {
namespace {

constexpr std::uint64_t kMiB = 1 << 20;

TEST(ImportMemory, MemoryBeyondTheLimitIsItsOwnError) {
  if (!kHasMemoryLimit) GTEST_SKIP() << "a sanitizer's shadow is larger than any limit";
  Isolated isolated;
  const Scene scene(textured_glb(large_png(10'000)));  // 400 MB
  isolated.options.process.memory_bytes = 128ull << 20;
  const auto small = isolated.import(scene.files);
  ASSERT_FALSE(small);
  EXPECT_EQ(small.error().code, "import_out_of_memory");
  EXPECT_NE(small.error().message.find("import_memory_bytes"), std::string::npos);
  isolated.options.process.memory_bytes = 2ull << 30;
  EXPECT_EQ(isolated.code_of(scene.files), "");
}

TEST(ImportMemory, StartsWithLittleAndAgainWithMore) {
  if (!kHasMemoryLimit) GTEST_SKIP() << "a sanitizer's shadow is larger than any limit";
  Isolated isolated;
  const Scene scene(slow_glb());
  isolated.options.memory = std::make_shared<base::MemoryBudget>(
      2048 * kMiB, base::MemoryBudget::Imports{2, 1600 * kMiB, 128 * kMiB});
  EXPECT_EQ(isolated.code_of(scene.files), "");
  EXPECT_GT(isolated.started, 1);
  EXPECT_EQ(isolated.options.memory->free_bytes(), isolated.options.memory->for_bakes());
  isolated.options.memory = std::make_shared<base::MemoryBudget>(
      2048 * kMiB, base::MemoryBudget::Imports{2, 256 * kMiB, 128 * kMiB});
  EXPECT_EQ(isolated.code_of(scene.files), "import_out_of_memory");
}

TEST(ImportMemory, ChecksStartWithWhatIsSetAside) {
  Isolated isolated;
  const Scene scene(generate::generate_glb("cornell").value() + std::string(40 * kMiB, '\0'));
  isolated.options.memory = std::make_shared<base::MemoryBudget>(
      2048 * kMiB, base::MemoryBudget::Imports{2, 1600 * kMiB});
  isolated.options.patience = 0ms;
  ASSERT_TRUE(isolated.options.memory->reserve("a", isolated.options.memory->for_bakes()));
  const auto checked = sandbox::Importer(isolated.options).check(scene.files, {});
  EXPECT_EQ(isolated.started, 1) << "bakes have all the rest, and the upload has 40 MiB";
  EXPECT_TRUE(checked || checked.error().code != "overloaded");
}

TEST(ImportMemory, ACheckWhoseTurnDoesNotComeIsRefused) {
  Isolated isolated;
  const Scene scene(slow_glb());
  isolated.options.memory =
      std::make_shared<base::MemoryBudget>(0, base::MemoryBudget::Imports{1, 0});
  isolated.options.patience = 20ms;
  const auto other = isolated.options.memory->enter(0, {});
  const auto refused = sandbox::Importer(isolated.options).check(scene.files, {});
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, "overloaded");
  EXPECT_EQ(isolated.started, 0);
}

TEST(ImportMemory, LitScenesAreMadeWithinTheJobsMemory) {
  const TempFolder folder;
  const std::string request = (folder.path() / "request-").string();
  Isolated isolated;
  isolated.options.process.zygote = nullptr;
  isolated.options.process.program = script(
      folder, "cat > " + request + "$$\nexec " LIGHTKILN_BINARY " \"$@\" < " + request + "$$");
  isolated.options.memory = std::make_shared<base::MemoryBudget>(
      2048 * kMiB, base::MemoryBudget::Imports{2, 1600 * kMiB, 128 * kMiB});
  ASSERT_TRUE(isolated.options.memory->reserve("a job", 300 * kMiB));
  const Scene scene(generate::generate_glb("cornell").value());
  for (const auto& [job, bytes] : {std::pair("a job", 300 * kMiB), std::pair("", 128 * kMiB)}) {
    const TempFolder out;
    const auto manifest = bake_small(
        scene.files, out, sandbox::Importer(isolated.options).open(scene.files, "key", {}, job));
    ASSERT_TRUE(manifest) << manifest.error().message;
    const std::string text = read_bytes(request + std::to_string(isolated.pid));
    EXPECT_NE(text.find("\"memory_bytes\":" + std::to_string(bytes)), std::string::npos) << text;
  }
}

}  // namespace
}  // namespace kiln::test
