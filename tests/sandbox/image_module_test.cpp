// The image module as the built program meets it, and the zygote that has it open.
#include <signal.h>
#include <sys/wait.h>

#include <cstdlib>
#include <future>

#include "baker/generate/generate.h"
#include "baker/image/image.h"
#include "server/sandbox/image_process.h"
#include "server/sandbox/zygote.h"
#include "tests/sandbox/isolated.h"

namespace kiln::test {
namespace {

struct Outcome {
  int code = -1;
  std::string said;
};

/// A copy of the program in a folder of its own, without its module.
class Copy {
 public:
  Copy() {
    fs::create_directories(bin());
    fs::copy_file(LIGHTKILN_BINARY, bin() / "lightkiln");
  }
  fs::path bin() const { return folder_.path() / "prefix" / "bin"; }
  fs::path lib() const { return folder_.path() / "prefix" / "lib" / "lightkiln"; }
  static fs::path module() {
    return fs::path(LIGHTKILN_BINARY).parent_path() / "liblightkiln-image.so";
  }

  Outcome run(const std::string& arguments, const std::string& variables = "") const {
    const fs::path output = folder_.path() / "output";
    const int status = std::system(("cd " + folder_.path().string() + " && env " + variables + " " +
                                    (bin() / "lightkiln").string() + " " + arguments + " >" +
                                    output.string() + " 2>&1 </dev/null")
                                       .c_str());
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, read_bytes(output)};
  }

 private:
  TempFolder folder_;
};

constexpr const char* kBake = "bake s.glb -o out --set atlas.page_size=64";

TEST(ImageModule, IsMissedByWhatNeedsItOnly) {
  const Copy copy;
  EXPECT_EQ(copy.run("version").code, 0);
  EXPECT_EQ(copy.run("scene cornell -o s.glb").code, 0) << "has no texture";
  const Outcome bake = copy.run(kBake);
  EXPECT_EQ(bake.code, 1) << bake.said;
  for (const fs::path& path : {copy.bin(), copy.lib()})
    EXPECT_NE(bake.said.find((path / "liblightkiln-image.so").string()), std::string::npos)
        << bake.said;
  const Outcome doctor = copy.run("doctor --data data --port 0 --admin-port 0");
  EXPECT_EQ(doctor.code, 1);
  EXPECT_NE(doctor.said.find("image_module"), std::string::npos) << doctor.said;
}

TEST(ImageModule, LiesBesideTheProgramOrInLib) {
  for (const bool beside : {true, false}) {
    const Copy copy;
    fs::create_directories(copy.lib());
    fs::copy_file(Copy::module(), (beside ? copy.bin() : copy.lib()) / "liblightkiln-image.so");
    EXPECT_EQ(copy.run("scene cornell -o s.glb").code, 0);
    const Outcome bake = copy.run(kBake);
    EXPECT_EQ(bake.code, 0) << bake.said;
  }
}

TEST(ImageModule, IsFoundNowhereElse) {
  const Copy copy;
  const fs::path here = copy.bin().parent_path().parent_path();
  fs::copy_file(Copy::module(), here / "liblightkiln-image.so");  // the working directory
  EXPECT_EQ(copy.run("scene cornell -o s.glb").code, 0);
  const Outcome bake = copy.run(kBake, "LD_LIBRARY_PATH=" + here.string());
  EXPECT_EQ(bake.code, 1) << bake.said;
}

TEST(ImageModule, ABrokenOneIsNamed) {
  for (const char* content : {"", "no library",
                              "\x7f"
                              "ELF"}) {
    const Copy copy;
    EXPECT_EQ(copy.run("scene cornell -o s.glb").code, 0);
    std::ofstream(copy.bin() / "liblightkiln-image.so") << content;
    const Outcome bake = copy.run(kBake);
    EXPECT_EQ(bake.code, 1);
    EXPECT_NE(bake.said.find((copy.bin() / "liblightkiln-image.so").string()), std::string::npos)
        << bake.said;
  }
}

// A bake of hours asks before it begins.
TEST(ImageModule, WhatTheZygoteMissesIsKnownAtOnce) {
  const Copy copy;
  const auto zygote = std::make_shared<sandbox::Zygote>(
      sandbox::Zygote::Options{copy.bin() / "lightkiln", [](const std::string&) {}});
  const sandbox::ImageProcesses processes({.zygote = zygote});
  for (int i = 0; i < 30'000 && zygote->pid() < 0; ++i) std::this_thread::sleep_for(1ms);
  const auto opened = image::open_module();
  ASSERT_FALSE(opened);
  EXPECT_EQ(opened.error().code, "internal");
  EXPECT_NE(opened.error().message.find((copy.bin() / "liblightkiln-image.so").string()),
            std::string::npos)
      << opened.error().message;
  const auto png = image::encode_png(std::vector<std::uint8_t>(12), 2, 2, 3);
  ASSERT_FALSE(png);
  EXPECT_EQ(png.error().message, opened.error().message);
}

TEST(ImageModule, TheEnvironmentBringsNoPlugins) {
  const Copy copy;
  fs::create_directories(copy.lib());
  fs::copy_file(Copy::module(), copy.lib() / "liblightkiln-image.so");
  EXPECT_EQ(copy.run("scene room_textured -o s.glb").code, 0);
  EXPECT_EQ(copy.run(kBake).code, 0);
  const std::string page = read_bytes(copy.bin().parent_path().parent_path() / "out/page_00.exr");
  // A plug-in that ends the process as soon as it is loaded.
  const fs::path plugins = copy.bin() / "plugins";
  fs::create_directories(plugins);
  std::ofstream(plugins / "p.c") << "#include <stdlib.h>\n"
                                    "__attribute__((constructor)) void end(void) { _Exit(77); }\n"
                                    "int png_imageio_version = 27;\n";
  ASSERT_EQ(std::system(("cc -shared -fPIC -o " + (plugins / "png.imageio.so").string() + " " +
                         (plugins / "p.c").string())
                            .c_str()),
            0);
  const Outcome bake = copy.run(
      kBake,
      "OIIO_LIBRARY_PATH=" + plugins.string() + " LD_LIBRARY_PATH=" + plugins.string() +
          " OPENIMAGEIO_OPTIONS=openexr:core=1,threads=7,plugin_searchpath=" + plugins.string());
  EXPECT_EQ(bake.code, 0) << bake.said;
  EXPECT_EQ(read_bytes(copy.bin().parent_path().parent_path() / "out/page_00.exr"), page);
}

std::shared_ptr<sandbox::Zygote> ready_zygote(std::string* failed = nullptr) {
  auto zygote = std::make_shared<sandbox::Zygote>(
      sandbox::Zygote::Options{LIGHTKILN_BINARY, [failed](const std::string& reason) {
                                 if (failed != nullptr) *failed = reason;
                               }});
  for (int i = 0; i < 30'000 && zygote->pid() < 0; ++i) std::this_thread::sleep_for(1ms);
  return zygote;
}

TEST(Zygote, HasOneThreadAndAFilter) {
  const auto zygote = ready_zygote();
  ASSERT_GT(zygote->pid(), 0);
  EXPECT_EQ(status_of(zygote->pid(), "Threads"), "1");
  EXPECT_EQ(status_of(zygote->pid(), "Seccomp"), "2");
  EXPECT_EQ(status_of(zygote->pid(), "PPid"), std::to_string(::getpid()));
}

TEST(Zygote, ItsCopiesAreConfinedAndHaveOneThread) {
  Isolated isolated;
  isolated.options.process.zygote = ready_zygote();
  isolated.options.process.program = "/nonexistent";  // only copies can be started
  const Scene scene(slow_glb());
  auto outcome = std::async(std::launch::async, [&] { return isolated.import(scene.files); });
  const pid_t pid = isolated.confined_pid();
  ASSERT_GT(pid, 0);
  ::kill(pid, SIGSTOP);
  EXPECT_EQ(status_of(pid, "Threads"), "1");
  EXPECT_EQ(status_of(pid, "PPid"), std::to_string(::getpid()));
  std::size_t open = 0;
  for (const auto& entry : fs::directory_iterator("/proc/" + std::to_string(pid) + "/fd"))
    open += entry.exists() || true;
  EXPECT_EQ(open, 3u) << "answer, words, product";
  ::kill(pid, SIGCONT);
  const auto imported = outcome.get();
  ASSERT_TRUE(imported) << imported.error().message;
  EXPECT_EQ(imported->images.size(), 1u);
}

TEST(Zygote, ItsCopiesDieAndAreStoppedAsProgramsAre) {
  Isolated isolated;
  isolated.options.process.zygote = ready_zygote();
  isolated.options.process.program = "/nonexistent";
  const Scene scene(slow_glb());
  auto outcome = std::async(std::launch::async, [&] { return isolated.import(scene.files); });
  const pid_t pid = isolated.confined_pid();
  ASSERT_GT(pid, 0);
  ::kill(pid, SIGSEGV);
  const auto crashed = outcome.get();
  ASSERT_FALSE(crashed);
  EXPECT_EQ(crashed.error().code, "import_crashed");
  std::stop_source stop;
  outcome = std::async(std::launch::async,
                       [&] { return isolated.import(scene.files, stop.get_token()); });
  const pid_t other = isolated.confined_pid();
  ASSERT_GT(other, 0);
  stop.request_stop();
  EXPECT_EQ(outcome.get().error().code, proto::kCanceledCode);
  EXPECT_NE(::kill(other, 0), 0);
}

TEST(Zygote, IsReplacedAndImportsWaitForThat) {
  std::string failed;
  Isolated isolated;
  const auto zygote = isolated.options.process.zygote = ready_zygote(&failed);
  const Scene scene(textured_glb(large_png(64)));
  const pid_t first = zygote->pid();
  ::kill(first, SIGKILL);
  for (int i = 0; i < 5000 && zygote->pid() == first; ++i) std::this_thread::sleep_for(1ms);
  EXPECT_TRUE(sandbox::Importer(isolated.options).check(scene.files, {})) << "does not";
  EXPECT_EQ(isolated.code_of(scene.files), "");
  EXPECT_GT(zygote->pid(), 0);
  EXPECT_NE(zygote->pid(), first);
  EXPECT_EQ(failed, "it ended");
}

TEST(Zygote, ScenesWithoutImagesDoNotWaitForIt) {
  Isolated isolated;
  isolated.options.process.zygote = std::make_shared<sandbox::Zygote>(
      sandbox::Zygote::Options{"/nonexistent", [](const std::string&) {}});
  isolated.options.decodes_images = false;
  const Scene scene(generate::generate_glb("cornell").value());
  const auto began = std::chrono::steady_clock::now();
  EXPECT_EQ(isolated.code_of(scene.files), "");
  EXPECT_LT(std::chrono::steady_clock::now() - began, 5s * kSlowdown);
}

TEST(Zygote, GoesWithItsOwner) {
  pid_t pid = -1;
  {
    const auto zygote = ready_zygote();
    pid = zygote->pid();
    ASSERT_GT(pid, 0);
  }
  EXPECT_NE(::kill(pid, 0), 0);
}

TEST(Zygote, ImagesCostAnImportLittleTime) {
  if (kSlowdown != 1) GTEST_SKIP() << "of a plain build";
  Isolated isolated;
  isolated.options.process.zygote = ready_zygote();
  const Scene plain(generate::generate_glb("cornell").value()),
      textured(textured_glb(large_png(64)));
  const auto best = [&](const Scene& scene) {
    auto least = 1h * 1.0;
    for (int i = 0; i < 7; ++i) {
      const auto began = std::chrono::steady_clock::now();
      EXPECT_TRUE(sandbox::Importer(isolated.options).open(scene.files, "key", {})->import({}));
      least = std::min<decltype(least)>(least, std::chrono::steady_clock::now() - began);
    }
    return std::chrono::duration<double, std::milli>(least).count();
  };
  const double without = best(plain), with = best(textured);
  RecordProperty("without_ms", std::to_string(without));
  RecordProperty("with_ms", std::to_string(with));
  EXPECT_LT(with, without + 50);
}

}  // namespace
}  // namespace kiln::test
