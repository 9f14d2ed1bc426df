// The process that decodes uploads: what it may do, what its deaths and lies do to a job, and that
// a bake by way of it has the same bits.
#include <fcntl.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#include <future>
#include <set>

#include "baker/generate/generate.h"
#include "tests/sandbox/isolated.h"
#include "tests/support/sky_files.h"

namespace kiln::test {
namespace {

TEST(ImportProcess, BakesTheSameBits) {
  for (const char* name : {"cornell", "courtyard"}) {
    // The settings of lit.glb reach the other process as well.
    proto::OutputSettings output;
    if (std::string(name) == "courtyard") {
      output.glb_lightmap = proto::GlbLightmap::kRgbm;
      output.keep_lights = true;
    }
    const Scene scene(generate::generate_glb(name).value());
    std::vector<std::string> exr, lit;
    Isolated isolated;
    for (const bool in_process : {true, false}) {
      const TempFolder out;
      const auto manifest = bake_small(
          scene.files, out,
          in_process ? nullptr : sandbox::Importer(isolated.options).open(scene.files, "key", {}),
          {}, output);
      ASSERT_TRUE(manifest) << manifest.error().message;
      exr.push_back(read_bytes(out.path() / "page_00.exr"));
      lit.push_back(read_bytes(out.path() / "lit.glb"));
    }
    EXPECT_EQ(isolated.started, 2) << "one for the scene, one for lit.glb";
    EXPECT_GT(exr[0].size(), 1000u);
    EXPECT_TRUE(exr[0] == exr[1]) << name;
    EXPECT_TRUE(lit[0] == lit[1]) << name;
    for (const char* held : {"MX_lightmap", "KHR_lights_punctual"})
      EXPECT_EQ(lit[1].find(held) != std::string::npos, std::string(name) == "courtyard");
  }
}

TEST(ImportProcess, KeepsSceneFilesByTheirDigest) {
  Isolated isolated;
  const Scene scene(generate::generate_glb("cornell").value());
  ASSERT_EQ(isolated.code_of(scene.files), "");
  ASSERT_EQ(isolated.cached().size(), 1u);
  const fs::path file = isolated.cached().front();
  const auto end_of_name = [&] { return "-" + proto::digest_file(file)->sha256 + ".scene"; };
  EXPECT_TRUE(file.filename().string().ends_with(end_of_name()));
  ASSERT_EQ(isolated.code_of(scene.files), "");
  EXPECT_EQ(isolated.started, 1) << "the second bake reads what the first one left";

  std::string bytes = read_bytes(file);
  bytes[bytes.size() / 2] ^= 1;  // a coordinate, say: valid, but another one
  std::ofstream(file, std::ios::binary) << bytes;
  ASSERT_EQ(isolated.code_of(scene.files), "");
  EXPECT_EQ(isolated.started, 2) << "a damaged file is not used";
  EXPECT_TRUE(file.filename().string().ends_with(end_of_name())) << "but replaced";

  isolated.options.limits.triangles = 1000;
  ASSERT_EQ(isolated.code_of(scene.files), "");
  EXPECT_EQ(isolated.started, 3) << "other limits, another import";
  EXPECT_EQ(isolated.cached().size(), 2u);
  isolated.options.limits.triangles = 3;
  EXPECT_EQ(isolated.code_of(scene.files), "limit_exceeded");
}

TEST(ImportProcess, KeepsTheScenesThatWereUsedLast) {
  Isolated isolated;
  const Scene scene(generate::generate_glb("cornell").value());
  const auto started_for = [&](std::uint64_t limit) {
    const int before = isolated.started;
    isolated.options.limits.triangles = limit;
    EXPECT_EQ(isolated.code_of(scene.files), "");
    std::this_thread::sleep_for(20ms);  // files' times come in ticks
    return isolated.started - before;
  };
  for (const std::uint64_t limit : {1001, 1002, 1003, 1004}) EXPECT_EQ(started_for(limit), 1);
  EXPECT_EQ(started_for(1001), 0);
  EXPECT_EQ(started_for(1005), 1);
  EXPECT_EQ(isolated.cached().size(), 4u);
  EXPECT_EQ(started_for(1001), 0);
  EXPECT_EQ(started_for(1003), 0);
  EXPECT_EQ(started_for(1002), 1) << "went for 1005";
}

TEST(ImportProcess, DoesNotKeepWhatIsOutOfProportion) {
  Isolated isolated;
  const Scene scene(textured_glb(large_png(3000)));  // 36 MB of texels from some kilobytes
  ASSERT_EQ(isolated.code_of(scene.files), "");
  EXPECT_TRUE(isolated.cached().empty());
  EXPECT_FALSE(fs::exists(isolated.folder.path() / "t0"));
}

TEST(ImportProcess, ErrorsOfTheSceneComeThrough) {
  Isolated isolated;
  const Scene broken("glTF nonsense"), dark(generate::generate_glb("sphere_on_plane").value());
  const auto direct = import::check_scene(broken.files, {});
  const auto isolated_check = sandbox::Importer(isolated.options).check(broken.files, {});
  ASSERT_FALSE(isolated_check);
  EXPECT_EQ(isolated_check.error().code, direct.error().code);
  EXPECT_EQ(isolated_check.error().message, direct.error().message);
  ASSERT_EQ(isolated_check.error().details.size(), direct.error().details.size());
  EXPECT_EQ(isolated_check.error().details[0].pointer, direct.error().details[0].pointer);
  EXPECT_EQ(sandbox::Importer(isolated.options).check(dark.files, {}).error().code, "no_light");
  proto::BakeSettings settings;
  settings.allow_dark = true;
  EXPECT_TRUE(sandbox::Importer(isolated.options).check(dark.files, settings));
  EXPECT_EQ(isolated.failed, "") << "the process did not fail, the scene did";
}

TEST(ImportProcess, SideFilesAreGivenAlong) {
  Isolated isolated;
  GltfBuilder b = triangle_builder();
  b.material({{"emissiveFactor", {1, 1, 1}}});
  b.json["meshes"][0]["primitives"][0]["material"] = 0;
  const std::string binary = b.binary;
  b.json["buffers"] = {{{"byteLength", binary.size()}, {"uri", "data/a%20b.bin"}}};
  const TempFolder folder;
  files::SceneFiles files;
  files.main = folder.write("scene.gltf", b.document(false).dump());
  EXPECT_EQ(isolated.code_of(files), "missing_file");
  files.side["data/a b.bin"] = folder.write("blob", binary);
  files.side["unused"] = folder.write("empty", "");
  EXPECT_EQ(isolated.code_of(files), "");
}

TEST(ImportProcess, SkyMapsAreDecodedThere) {
  const SkyPicture sky(64, [](math::Vec3 d) -> math::Rgb {
    return d.x > 0.95f ? math::Rgb{900, 800, 700} : math::Rgb{0.2f, 0.4f, d.y > 0 ? 1.f : 0.1f};
  });
  Isolated isolated;
  Scene scene(generate::generate_glb("sphere_on_plane").value());
  const std::string cut = exr_file(sky);
  scene.files.side["sky.exr"] = scene.folder.write("exr", exr_file(sky, {.compression = 4}));
  scene.files.side["sky.hdr"] = scene.folder.write("hdr", hdr_file(sky));
  scene.files.side["bad.exr"] = scene.folder.write("bad", cut.substr(0, cut.size() / 2));
  std::vector<std::string> exr;
  for (const char* name : {"sky.exr", "sky.hdr"})
    for (const bool in_process : {true, false}) {
      const TempFolder out;
      files::SceneFiles with_sky = scene.files;
      with_sky.sky_map = name;
      const auto manifest = bake_small(
          scene.files, out,
          in_process ? nullptr : sandbox::Importer(isolated.options).open(with_sky, "key", {}),
          name);
      ASSERT_TRUE(manifest) << manifest.error().message;
      exr.push_back(read_bytes(out.path() / "page_00.exr"));
    }
  EXPECT_GT(exr[0].size(), 1000u);
  EXPECT_TRUE(exr[0] == exr[1]);
  EXPECT_TRUE(exr[2] == exr[3]);

  // Another map is another import, and errors come through.
  const int before = isolated.started;
  for (const char* name : {"sky.exr", "sky.hdr", "sky.hdr", "sky.exr"}) {
    scene.files.sky_map = name;
    const auto imported = isolated.import(scene.files);
    ASSERT_TRUE(imported) << imported.error().message;
    EXPECT_EQ(imported->sky_map.texels.size(), sky.pixels.size());
  }
  EXPECT_EQ(isolated.started, before + 2);
  proto::BakeSettings settings;
  for (const auto& [name, code] :
       {std::pair("bad.exr", "invalid_image"), std::pair("no.exr", "missing_file")}) {
    scene.files.sky_map = settings.sky.map = name;
    const auto imported = isolated.import(scene.files);
    ASSERT_FALSE(imported);
    EXPECT_EQ(imported.error().code, code);
    EXPECT_EQ(imported.error().details.at(0).pointer, "/sky/map");
  }
  const auto checked = sandbox::Importer(isolated.options).check(scene.files, settings);
  ASSERT_FALSE(checked);
  EXPECT_EQ(checked.error().details.at(0).pointer, "/sky/map");
  EXPECT_EQ(isolated.failed, "");
}

TEST(ImportProcess, IsConfined) {
  Isolated isolated;
  isolated.options.process.memory_bytes = 3ull << 30;
  const Scene scene(slow_glb());
  // Two descriptors that someone forgot to mark, one of them beyond all that it gets.
  const int forgotten = ::memfd_create("forgotten", 0);
  const int far = ::fcntl(forgotten, F_DUPFD, 200);
  auto outcome = std::async(std::launch::async, [&] { return isolated.import(scene.files); });
  const pid_t pid = isolated.confined_pid();
  ASSERT_GT(pid, 0);
  ::kill(pid, SIGSTOP);
  std::set<std::string> open;
  for (const auto& entry : fs::directory_iterator("/proc/" + std::to_string(pid) + "/fd"))
    open.insert(entry.path().filename().string() + " " + fs::read_symlink(entry).string());
  const std::string limits = process_file(pid, "limits"),
                    environment = process_file(pid, "environ");
  const std::string score = process_file(pid, "oom_score_adj");
  ::kill(pid, SIGKILL);
  const auto scene_or_error = outcome.get();
  ::close(forgotten);
  ::close(far);

  EXPECT_EQ(open.size(), 3u) << "answer, words, product";
  for (const std::string& file : open) {
    EXPECT_EQ(file.find("forgotten"), std::string::npos) << file;
    EXPECT_EQ(file.find("scene.glb"), std::string::npos) << file << ": mapped and closed";
  }
  const auto limit = [&](const std::string& name) {
    std::istringstream lines(limits);
    for (std::string line; std::getline(lines, line);)
      if (line.starts_with(name)) return line.substr(26, line.find(' ', 26) - 26);
    return std::string("no such line");
  };
  EXPECT_EQ(limit("Max cpu time"), "60");
  EXPECT_EQ(limit("Max open files"), kHasMemoryLimit ? "0" : "16") << "a sanitizer opens pipes";
  EXPECT_EQ(limit("Max processes"), "0");
  EXPECT_EQ(limit("Max core file size"), "0");
  EXPECT_EQ(limit("Max file size"), std::to_string(3ull << 30));
  if (kHasMemoryLimit) {
    // Beyond what the program has.
    const std::uint64_t data = std::stoull(limit("Max data size"));
    EXPECT_GE(data, 3ull << 30);
    EXPECT_LT(data, (3ull << 30) + (256ull << 20));
    EXPECT_NE(limit("Max address space"), "unlimited");
  }
  EXPECT_EQ(score, "1000\n");
  EXPECT_EQ(environment.find("PATH="), std::string::npos);
  ASSERT_FALSE(scene_or_error);
  EXPECT_EQ(scene_or_error.error().code, "import_crashed");
}

TEST(ImportProcess, ItsDeathIsTheJobsError) {
  for (const int number : {SIGKILL, SIGABRT, SIGSEGV}) {
    Isolated isolated;
    const Scene scene(slow_glb());
    auto outcome = std::async(std::launch::async, [&] { return isolated.import(scene.files); });
    const pid_t pid = isolated.confined_pid();
    ASSERT_GT(pid, 0);
    ::kill(pid, number);
    const auto result = outcome.get();
    ASSERT_FALSE(result);
    EXPECT_EQ(result.error().code, "import_crashed") << number;
    EXPECT_EQ(isolated.failed, result.error().message);
    EXPECT_TRUE(isolated.cached().empty());
    EXPECT_FALSE(fs::exists(isolated.options.new_temporary())) << "nothing is left behind";
    EXPECT_NE(::kill(pid, 0), 0) << "and nobody";
  }
}

TEST(ImportProcess, AHangEndsAtTheDeadline) {
  Isolated isolated;
  isolated.options.process.seconds = 2 * kSlowdown;
  const Scene scene(slow_glb());
  auto outcome = std::async(std::launch::async, [&] { return isolated.import(scene.files); });
  const pid_t pid = isolated.confined_pid();
  ASSERT_GT(pid, 0);
  ::kill(pid, SIGSTOP);
  ASSERT_EQ(outcome.wait_for(10s * kSlowdown), std::future_status::ready);
  EXPECT_EQ(outcome.get().error().code, "import_timeout");
  EXPECT_NE(::kill(pid, 0), 0);
}

TEST(ImportProcess, AStopRequestEndsItAtOnce) {
  Isolated isolated;
  const Scene scene(slow_glb());
  std::stop_source stop;
  auto outcome = std::async(std::launch::async,
                            [&] { return isolated.import(scene.files, stop.get_token()); });
  const pid_t pid = isolated.confined_pid();
  ASSERT_GT(pid, 0);
  ::kill(pid, SIGSTOP);
  const auto asked = std::chrono::steady_clock::now();
  stop.request_stop();
  EXPECT_EQ(outcome.get().error().code, proto::kCanceledCode);
  EXPECT_LT(std::chrono::steady_clock::now() - asked, 1s);
  EXPECT_NE(::kill(pid, 0), 0);
  EXPECT_EQ(isolated.failed, "") << "nothing to complain about";
}

TEST(ImportProcess, LiesAreNotBelieved) {
  const std::string fine = R"(printf '{"memory":true,"no_seccomp":""}')";
  const auto error = [](const std::string& code) {
    return R"(printf '{"memory":true,"no_seccomp":"","error":{"code":")" + code +
           R"(","title":"t","status":401,"detail":"d","errors":[]}}')";
  };
  const std::vector<std::pair<std::string, std::string>> lies{
      {"exit 3", "import_crashed"},
      {"kill -SEGV $$", "import_crashed"},
      {"exit 0", "import_crashed"},  // no answer
      {"printf nonsense", "import_crashed"},
      {"printf '[1,2]'", "import_crashed"},
      {"while :; do printf 0123456789; done", "import_crashed"},  // without an end
      {fine, "import_crashed"},                                   // no product
      {"printf 'not a scene' >&3; " + fine, "import_crashed"},
      {"printf 'LKILNFLT' >&3; " + fine, "import_crashed"},
      {error("unauthorized"), "import_crashed"},  // no import's word
      {error("internal"), "import_crashed"},
      {error("invalid_scene"), "invalid_scene"},
      {"exec >&- 2>&-; sleep 100", "import_timeout"},  // silent, but alive
      {"sleep 100 & exit 0", "import_timeout"},        // leaves another behind that holds the pipes
  };
  for (const auto& [lines, code] : lies) {
    const TempFolder folder;
    Isolated isolated;
    isolated.options.process.seconds = 2;
    isolated.options.process.zygote = nullptr;
    isolated.options.process.program = script(folder, lines);
    const Scene scene(generate::generate_glb("cornell").value());
    EXPECT_EQ(isolated.code_of(scene.files), code) << lines;
    EXPECT_TRUE(isolated.cached().empty()) << lines;
  }
}

TEST(ImportProcess, WhatItSaidIsLogged) {
  const TempFolder folder;
  Isolated isolated;
  isolated.options.process.zygote = nullptr;
  isolated.options.process.program = script(folder, "printf 'oh no' >&2; exit 9");
  const Scene scene(generate::generate_glb("cornell").value());
  EXPECT_EQ(isolated.code_of(scene.files), "import_crashed");
  EXPECT_NE(isolated.failed.find("code 9"), std::string::npos) << isolated.failed;
  EXPECT_EQ(isolated.said, "oh no");
  isolated.options.process.program = folder.path() / "missing";
  EXPECT_EQ(isolated.code_of(scene.files), "io_error");
}

TEST(ImportProcess, CostsLittleTime) {
  Isolated isolated;
  const Scene scene(generate::generate_glb("cornell").value());
  // Of the processor, this process's share and the other's: the wall's clock tells what else runs.
  const auto processor_ms = [] {
    double ms = 0;
    for (const int whose : {RUSAGE_SELF, RUSAGE_CHILDREN}) {
      rusage usage{};
      ::getrusage(static_cast<__rusage_who>(whose), &usage);
      for (const timeval& t : {usage.ru_utime, usage.ru_stime})
        ms += double(t.tv_sec) * 1e3 + double(t.tv_usec) * 1e-3;
    }
    return ms;
  };
  const auto cost = [&](auto&& work) {
    constexpr int kTimes = 10;
    const double before = processor_ms();
    for (int i = 0; i < kTimes; ++i) work();
    return (processor_ms() - before) / kTimes;
  };
  const sandbox::Importer importer(isolated.options);
  const double check = cost([&] { EXPECT_TRUE(importer.check(scene.files, {})); });
  const double import =
      cost([&] { EXPECT_TRUE(importer.open(scene.files, "key", {})->import({})); });
  RecordProperty("check_ms", std::to_string(check));
  RecordProperty("import_ms", std::to_string(import));
  EXPECT_LT(check, 50 * kSlowdown);
  EXPECT_LT(import, 50 * kSlowdown);
}

}  // namespace
}  // namespace kiln::test
