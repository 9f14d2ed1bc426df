// What a large file costs: page cache, not memory.
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <fstream>
#include <functional>
#include <limits>
#include <thread>

#include "tests/import/import_helpers.h"

namespace kiln::import {
namespace {

constexpr std::uint64_t kMegabyte = 1'000'000;

/// Anonymous memory of this process in bytes.
std::uint64_t anonymous_memory() {
  std::ifstream status("/proc/self/status");
  for (std::string word; status >> word;) {
    std::uint64_t kilobytes = 0;
    if (word == "RssAnon:" && status >> kilobytes) return kilobytes * 1024;
  }
  ADD_FAILURE() << "the system doesn't tell RssAnon";
  return 0;
}

/// By how much anonymous memory rises at most while `work` runs, looked at every millisecond.
std::uint64_t anonymous_rise(const std::function<void()>& work) {
  std::atomic<std::uint64_t> peak = 0;
  const std::uint64_t before = anonymous_memory();
  {
    const std::jthread watcher([&](const std::stop_token& stop) {
      while (!stop.stop_requested()) {
        peak = std::max(peak.load(), anonymous_memory());
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
      }
    });
    work();
  }
  peak = std::max(peak.load(), anonymous_memory());
  return peak > before ? peak - before : 0;
}

/// A .glb with a BIN chunk of 320 MB that starts with triangles without indices, all of them in one
/// point but the last. Its file has holes where the zeros are, so that it costs no disk.
struct LargeScene {
  static constexpr std::uint64_t kBytes = 320 * kMegabyte;
  test::TempFolder folder;
  files::SceneFiles files;
  std::uint64_t position_offset = 0;

  explicit LargeScene(std::uint64_t vertices) {
    GltfBuilder b;
    b.json["buffers"] = {{{"byteLength", kBytes}}};
    b.json["bufferViews"] = {{{"buffer", 0}, {"byteLength", 12 * vertices}}};
    b.json["accessors"] = {
        {{"bufferView", 0}, {"componentType", 5126}, {"count", vertices}, {"type", "VEC3"}}};
    b.node({{"mesh", b.mesh({{"attributes", {{"POSITION", 0}}}})}});
    std::string text = b.document(false).dump();
    text.resize((text.size() + 3) / 4 * 4, ' ');
    const std::uint64_t size = 28 + text.size() + kBytes;
    files.main = folder.write("large.glb", "glTF" + GltfBuilder::u32(2) + GltfBuilder::u32(size) +
                                               GltfBuilder::u32(text.size()) + "JSON" + text +
                                               GltfBuilder::u32(kBytes) + std::string("BIN\0", 4));
    std::filesystem::resize_file(files.main, size);
    position_offset = 28 + text.size();
    put(position_offset + 12 * (vertices - 3), test::triangle_positions());
  }

  void put(std::uint64_t offset, const std::vector<float>& values) const {
    std::fstream file(files.main, std::ios::binary | std::ios::in | std::ios::out);
    file.seekp(static_cast<std::streamoff>(offset));
    file.write(reinterpret_cast<const char*>(values.data()),
               static_cast<std::streamsize>(values.size() * sizeof(float)));
    ASSERT_TRUE(file.good());
  }
};

constexpr std::uint64_t kManyVertices = 24'000'000;

TEST(SceneMemory, CheckingALargeFileTakesHardlyAny) {
#ifdef __SANITIZE_THREAD__
  GTEST_SKIP() << "the sanitizer's shadow of what is read counts as memory of the process";
#endif
  const LargeScene scene(kManyVertices);
  const std::uint64_t size = std::filesystem::file_size(scene.files.main);
  ASSERT_GT(size, 300 * kMegabyte);
#ifdef __SANITIZE_ADDRESS__
  const std::uint64_t shadow = size / 8;  // a byte for every eight that are read
#else
  const std::uint64_t shadow = 0;
#endif
  const auto rise = anonymous_rise([&] {
    const auto checked = check_scene(scene.files, dark());
    EXPECT_TRUE(checked) << checked.error().message;
  });
  EXPECT_LT(rise, 32 * kMegabyte + shadow);
}

TEST(SceneMemory, TheWholeOfALargeFileIsLookedAt) {
  const LargeScene scene(kManyVertices);
  const std::uint64_t last = kManyVertices - 4;
  scene.put(scene.position_offset + 12 * last, {0, std::numeric_limits<float>::quiet_NaN(), 0});
  const auto checked = check_scene(scene.files, dark());
  ASSERT_FALSE(checked);
  EXPECT_EQ(checked.error().message, "element " + std::to_string(last) + " is not finite");
}

TEST(SceneMemory, ImportCopiesNoBytesThatItDoesNotUse) {
  const LargeScene scene(3);
  const auto rise = anonymous_rise([&] {
    const auto imported = import_scene(scene.files, dark());
    ASSERT_TRUE(imported) << imported.error().message;
    EXPECT_EQ(imported->triangles.size(), 1u);
  });
  EXPECT_LT(rise, 8 * kMegabyte);
}

}  // namespace
}  // namespace kiln::import
