// Shade of facade points toward many suns: quarry.h, from C and through Python, beside Embree on the same
// sorted rays.
#include <embree3/rtcore.h>
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "common/api/quarry.h"
#include "common/base/file.h"
#include "common/base/resource.h"
#include "common/base/size.h"
#include "common/program/cpu_check.h"
#include "common/program/run_program.h"
#include "common/voxel/store_description.h"
#include "deploy/command/rays/npy.h"
#include "tests/bench/arguments.h"
#include "tests/bench/figures.h"
#include "tests/bench/median.h"
#include "tests/bench/rays/embree_scene.h"
#include "tests/bench/stopwatch.h"
#include "tests/support/rendering/resident_scene.h"

namespace quarry::bench {
namespace {

struct Options {
  std::string store, json, python;
  uint32_t points = 500'000, suns = 29, threads = 2, rounds = 3;
  bool embree = true;
};

/// Rays of six floats: 64 points toward the first sun, toward the second, and so on; then the next 64.
using Rays = std::vector<float>;

/// Directions toward the sun over a day, from east by south to west.
std::vector<glm::vec3> Suns(uint32_t count) {
  std::vector<glm::vec3> suns;
  for (uint32_t i = 0; i < count; ++i) {
    const double hour = std::numbers::pi * (i + 0.5) / count, height = 0.1 + 0.9 * std::sin(hour);
    suns.push_back(glm::normalize(glm::vec3(std::cos(hour), -0.6, height)));
  }
  return suns;
}

uint64_t MortonOf(const glm::vec3& unit) {
  uint64_t code = 0;
  for (int bit = 0; bit < 16; ++bit)
    for (int a = 0; a < 3; ++a)
      code |= (static_cast<uint64_t>(unit[a] * 65535.0f) >> bit & 1) << (3 * bit + a);
  return code;
}

/// Points just outside of steep triangles, spread evenly over their ids, and sorted by place.
std::vector<glm::vec3> FacadePoints(const test::ResidentScene& scene, const test::SceneView& view,
                                    uint32_t count) {
  const SceneMeta& meta = scene.catalog().meta;
  const glm::vec3 size = meta.bounds_upper - meta.bounds_lower;
  const float lift = 1e-5f * glm::length(size);
  std::vector<bool> seen(meta.input_triangles);
  std::vector<glm::vec3> all;
  for (const VoxelGeometry& voxel : view.voxels())
    for (uint32_t t = 0; t < voxel.triangle_count; ++t) {
      if (seen[voxel.triangle_ids[t]]) continue;
      seen[voxel.triangle_ids[t]] = true;
      const glm::vec3 a = voxel.vertex(t, 0), b = voxel.vertex(t, 1), c = voxel.vertex(t, 2);
      const glm::vec3 n = glm::normalize(glm::cross(b - a, c - a));
      if (std::fabs(n.z) < 0.3f) all.push_back((a + b + c) / 3.0f + n * lift);
    }
  std::vector<std::pair<uint64_t, glm::vec3>> chosen;
  for (uint32_t i = 0; i < count && !all.empty(); ++i) {
    const glm::vec3& p = all[static_cast<size_t>(i) * all.size() / count];
    chosen.emplace_back(MortonOf(glm::clamp((p - meta.bounds_lower) / size, glm::vec3(0), glm::vec3(1))), p);
  }
  std::ranges::sort(chosen, {}, &std::pair<uint64_t, glm::vec3>::first);
  std::vector<glm::vec3> points;
  for (const auto& [code, point] : chosen) points.push_back(point);
  return points;
}

Rays MakeRays(const std::vector<glm::vec3>& points, const std::vector<glm::vec3>& suns) {
  Rays rays;
  rays.reserve(6 * points.size() * suns.size());
  constexpr size_t kTogether = 64;
  for (size_t first = 0; first < points.size(); first += kTogether)
    for (const glm::vec3& sun : suns)
      for (const glm::vec3& p : std::span(points).subspan(first, std::min(kTogether, points.size() - first)))
        for (const float number : {p.x, p.y, p.z, sun.x, sun.y, sun.z}) rays.push_back(number);
  return rays;
}

/// Runs body(first, end) on each thread's share of `count`; the seconds.
double Shared(unsigned threads, size_t count, const std::function<void(size_t, size_t)>& body) {
  const auto start = Clock::now();
  std::vector<std::thread> running;
  for (unsigned i = 0; i < threads; ++i)
    running.emplace_back([&, i] { body(count * i / threads, count * (i + 1) / threads); });
  for (std::thread& thread : running) thread.join();
  return SecondsSince(start);
}

enum class EmbreeWay { kSingle, kPacket, kStream };

/// Embree's answer to all rays, `hit`, from the caller's array of six floats; the seconds.
double AskEmbree(RTCScene scene, const Rays& rays, EmbreeWay way, unsigned threads,
                 std::vector<uint8_t>& hit) {
  const auto ray_of = [&](size_t i) {
    RTCRay ray{};
    const float* const r = &rays[6 * i];
    ray.org_x = r[0], ray.org_y = r[1], ray.org_z = r[2];
    ray.dir_x = r[3], ray.dir_y = r[4], ray.dir_z = r[5];
    ray.tfar = std::numeric_limits<float>::infinity();
    ray.mask = ~0u;
    return ray;
  };
  return Shared(threads, hit.size(), [&](size_t first, size_t end) {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
    if (way == EmbreeWay::kSingle) {
      for (size_t i = first; i < end; ++i) {
        RTCRay ray = ray_of(i);
        rtcOccluded1(scene, &context, &ray);
        hit[i] = ray.tfar < 0;
      }
    } else if (way == EmbreeWay::kPacket) {
      for (size_t i = first; i < end; i += 16) {
        alignas(64) int valid[16];
        alignas(64) RTCRay16 packet;
        for (size_t k = 0; k < 16; ++k) {
          valid[k] = i + k < end ? -1 : 0;
          const RTCRay ray = ray_of(std::min(i + k, end - 1));
          packet.org_x[k] = ray.org_x, packet.org_y[k] = ray.org_y, packet.org_z[k] = ray.org_z;
          packet.dir_x[k] = ray.dir_x, packet.dir_y[k] = ray.dir_y, packet.dir_z[k] = ray.dir_z;
          packet.tnear[k] = packet.time[k] = 0, packet.tfar[k] = ray.tfar, packet.mask[k] = ~0u,
          packet.flags[k] = 0;
        }
        rtcOccluded16(valid, scene, &context, &packet);
        for (size_t k = 0; k < 16 && i + k < end; ++k) hit[i + k] = packet.tfar[k] < 0;
      }
    } else {
      std::vector<RTCRay> stream(64);
      for (size_t i = first; i < end; i += stream.size()) {
        const size_t count = std::min(stream.size(), end - i);
        for (size_t k = 0; k < count; ++k) stream[k] = ray_of(i + k);
        rtcOccluded1M(scene, &context, stream.data(), static_cast<unsigned>(count), sizeof(RTCRay));
        for (size_t k = 0; k < count; ++k) hit[i + k] = stream[k].tfar < 0;
      }
    }
  });
}

/// A scene of quarry.h.
class Asked {
 public:
  Asked(const std::string& store, uint64_t cache, unsigned threads) {
    quarry_options options = QUARRY_OPTIONS_INIT;
    options.cache_bytes = cache;
    options.threads = threads;
    if (quarry_open(store.c_str(), &options, &scene_) != QUARRY_OK) Log(quarry_error());
  }
  ~Asked() { quarry_close(scene_); }
  Asked(const Asked&) = delete;
  /// The answer to all rays; the seconds, or a negative number after an error.
  double Ask(const Rays& rays, std::vector<uint8_t>& hit) const {
    quarry_rays given = QUARRY_RAYS_INIT;
    given.type = QUARRY_FLOAT32;
    given.count = hit.size();
    given.origins = rays.data();
    given.directions = rays.data() + 3;
    given.stride = 6 * sizeof(float);
    const auto start = Clock::now();
    if (quarry_any(scene_, &given, hit.data()) != QUARRY_OK) {
      Log(quarry_error());
      return -1;
    }
    return SecondsSince(start);
  }
  uint64_t loaded() const {
    quarry_statistics s = QUARRY_STATISTICS_INIT;
    quarry_measure(scene_, &s);
    return s.bytes_decoded;
  }

 private:
  quarry_scene* scene_ = nullptr;
};

/// Seconds of test_occlusions() by Python, the median of its rounds after one that warms the cache up.
std::optional<double> AskPython(const Options& options, const Rays& rays, uint64_t cache) {
  const std::filesystem::path file =
      std::filesystem::temp_directory_path() / fmt::format("quarry-rays-{}.npy", ::getpid());
  {
    auto npy = OutputFile::Create(file.string());
    const std::string header = NpyHeader("'<f4'", rays.size());
    if (!npy || !npy->Write(header.data(), header.size()) ||
        !npy->Write(rays.data(), rays.size() * sizeof(float)) || !npy->Commit())
      return std::nullopt;
  }
  const std::string script = fmt::format(
      "import numpy, quarry, time\nrays = numpy.load('{}').reshape(-1, 6)\nscene = quarry.Scene('{}', "
      "cache={}, threads={})\ntimes = []\n"
      "for i in range({}):\n  begun = time.perf_counter(); scene.test_occlusions(rays); "
      "times.append(time.perf_counter() - begun)\n"
      "print(sorted(times[1:])[len(times[1:]) // 2])\n",
      file.string(), options.store, cache, options.threads, options.rounds + 1);
  std::FILE* const python = ::popen((options.python + " -c \"" + script + "\"").c_str(), "r");
  double seconds = 0;
  const bool told = python && std::fscanf(python, "%lf", &seconds) == 1;
  const bool ended = python && ::pclose(python) == 0;
  std::filesystem::remove(file);
  return told && ended ? std::optional(seconds) : std::nullopt;
}

int Main(int argc, char** argv) {
  RequireCpu();
  Options o;
  CLI::App app{
      "Shade of facade points toward many suns: quarry.h beside Embree's robust mode, on the same sorted "
      "rays.",
      "quarry bench rays"};
  app.add_option("store", o.store, "The store, with z up")->required();
  app.add_option("--points", o.points, "Points of facades")->capture_default_str();
  app.add_option("--suns", o.suns, "Directions of the sun")->capture_default_str();
  app.add_option("--threads", o.threads, "Threads of each")->capture_default_str();
  app.add_option("--rounds", o.rounds, "Times that all are asked, by turns")->capture_default_str();
  app.add_flag("!--no-embree", o.embree, "Quarry alone: its peak memory is then that of one process");
  app.add_option("--python", o.python,
                 "Ask through the Python package too, by this interpreter, such as /usr/bin/python3");
  app.add_option("--json", o.json, "Write the figures here")->check(CheckFigures);
  app.footer("Example:\n  quarry bench rays plant.quarry --threads 2");
  if (const auto ended = ReadArguments(app, argc, argv)) return *ended;
  uint64_t hot = 0;
  Rays rays;
  std::optional<EmbreeScene> embree;
  {
    auto scene = test::ResidentScene::Load(o.store);
    if (!scene) return Log(scene.error().message), 1;
    const test::SceneView& view = (*scene)->view();
    for (const VoxelEntry& voxel : (*scene)->catalog().voxels) hot += voxel.blocks[0].decoded;
    rays = MakeRays(FacadePoints(**scene, view, o.points), Suns(o.suns));
    if (o.embree) embree.emplace(view.voxels(), (*scene)->catalog().meta.input_triangles, true);
  }
  const size_t count = rays.size() / 6;
  if (count == 0) return Log("the store has no steep triangles"), 1;
  Print(fmt::format("{} rays, {} of decoded voxels, {} threads\n", count, FormatSize(hot), o.threads));
  nlohmann::ordered_json figures = {{"rays", count}, {"threads", o.threads}};
  std::vector<uint8_t> ours(count), theirs(count);
  const Asked all(o.store, hot + (hot >> 2) + (64u << 20), o.threads);
  if (all.Ask(rays, ours) < 0) return 1;  // warms the cache up
  std::vector<double> quarry_s, embree_s[3];
  for (uint32_t round = 0; round < o.rounds; ++round) {
    quarry_s.push_back(all.Ask(rays, ours));
    for (int way = 0; embree && way < 3; ++way)
      embree_s[way].push_back(
          AskEmbree(embree->scene(), rays, static_cast<EmbreeWay>(way), o.threads, theirs));
  }
  const auto rate = [&](double seconds) { return static_cast<double>(count) / seconds * 1e-6; };
  const auto tell = [&](const std::string& name, double seconds, double best) {
    Print(fmt::format("  {:<34} {:7.2f} M rays/s{}\n", name, rate(seconds),
                      best > 0 ? fmt::format("   {:.2f} of Embree's best", best / seconds) : ""));
    figures[name] = rate(seconds);
  };
  double best = 0;
  if (embree) {
    const char* const names[] = {"Embree robust, single rays", "Embree robust, packets of 16",
                                 "Embree robust, streams"};
    for (int way = 0; way < 3; ++way) {
      tell(names[way], Median(embree_s[way]), 0);
      if (best == 0 || Median(embree_s[way]) < best) best = Median(embree_s[way]);
    }
    size_t differ = 0, shaded = 0;
    for (size_t i = 0; i < count; ++i) differ += ours[i] != theirs[i], shaded += ours[i];
    Print(fmt::format("  {:.1f} % in the shade; {} rays differ\n",
                      100.0 * static_cast<double>(shaded) / static_cast<double>(count), differ));
  }
  tell("quarry_any(), all in the cache", Median(quarry_s), best);
  if (!o.python.empty()) {
    if (const auto seconds = AskPython(o, rays, hot + (hot >> 2) + (64u << 20)))
      tell("test_occlusions() of Python", *seconds, best);
    else
      Log("Python did not answer: PYTHONPATH and QUARRY_LIBRARY name the package");
  }
  const Asked quarter(o.store, hot / 4, o.threads);
  const double first = quarter.Ask(rays, theirs);
  if (first < 0) return 1;
  tell("quarry_any(), a quarter in the cache", first, best);
  Print(fmt::format("  {} decoded meanwhile; the answers are {}\n", FormatSize(quarter.loaded()),
                    ours == theirs ? "the same" : "DIFFERENT"));
  Print(fmt::format("  peak memory {}\n", FormatSize(PeakResidentBytes())));
  return WriteFigures(o.json, figures.dump(2)) && ours == theirs ? 0 : 1;
}

}  // namespace
}  // namespace quarry::bench

int main(int argc, char** argv) {
  return quarry::RunProgram({"quarry bench rays", "figures that were printed stand"}, argc, argv,
                            quarry::bench::Main);
}
