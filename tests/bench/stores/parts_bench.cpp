// `quarry bench parts`: time to read, search and select a tree of many parts, in processor seconds of one
// thread. The store is made in a temporary folder: a plant of halls, racks and valves, with one triangle.

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "common/base/log.h"
#include "common/base/resource.h"
#include "common/program/run_program.h"
#include "common/voxel/part_tree.h"
#include "common/voxel/store_reader.h"
#include "common/voxel/store_writer.h"
#include "tests/bench/arguments.h"
#include "tests/bench/median.h"
#include "tests/support/temporary_folder.h"

#ifndef NDEBUG
#error "benchmarks are built with the release preset"
#endif

namespace quarry::bench {
namespace {

constexpr int kRuns = 7;

/// Halls of 10 racks of 100 valves.
PartTable Plant(uint32_t parts) {
  PartTable table;
  uint32_t hall = 0, rack = 0;
  for (uint32_t i = 0; i < parts; ++i) {
    const bool is_hall = i % 1011 == 0, is_rack = !is_hall && i % 1011 % 101 == 1;
    ScenePart part;
    if (is_hall) {
      hall = i;
    } else if (is_rack) {
      part.parent = hall;
      rack = i;
    } else {
      part.parent = rack;
    }
    table.names.push_back(is_hall   ? fmt::format("Hall {}", i)
                          : is_rack ? fmt::format("Pipe rack {}", i)
                                    : fmt::format("Gate valve DN{} number {}", 50 + i % 7 * 25, i));
    table.facts.push_back(part);
  }
  return table;
}

Status Write(const std::string& path, uint32_t parts) {
  QUARRY_ASSIGN(StoreWriter writer, StoreWriter::Create(path));
  HotVoxel hot;
  hot.cell = {glm::vec3(0), glm::vec3(1)};
  hot.nodes = {KdNode::Leaf(0, 1)};
  hot.node_slots = 4;
  hot.wide_nodes = 1;
  hot.references = {0};
  hot.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  hot.corners = {0, 1, 2};
  hot.triangle_ids = hot.parts = {0};
  hot.materials = {0};
  QUARRY_TRY(writer.AddVoxel(EncodeVoxel(hot, nullptr)));
  SceneMeta meta;
  meta.bounds_upper = meta.root_upper = glm::vec3(1);
  meta.input_triangles = 1;
  return writer.Finish(meta, {KdNode::Leaf(0, 1)}, {Material{"paint"}}, Plant(parts)).map([](auto&&) {});
}

/// Prints the median and the spread of the runs of `work`, in milliseconds.
void Measure(const std::string& what, const std::function<void()>& work) {
  std::vector<double> times;
  for (int run = 0; run < kRuns; ++run) {
    const uint64_t start = ThreadTimeUs();
    work();
    times.push_back(static_cast<double>(ThreadTimeUs() - start) * 1e-3);
  }
  Print(fmt::format("{:<44} {:8.2f} ms ({:.2f} to {:.2f})\n", what, Median(times), std::ranges::min(times),
                    std::ranges::max(times)));
}

Status Run(uint32_t parts) {
  const test::TemporaryFolder folder;
  QUARRY_TRY(Write(folder.file("s"), parts));
  QUARRY_ASSIGN(const StoreReader store, StoreReader::Open(folder.file("s")));
  std::shared_ptr<const PartTree> tree;
  Status read;
  Measure("read", [&] {
    tree.reset();
    auto got = PartTree::Read(store);
    if (got) tree = *got;
    read = got.map([](auto&&) {});
  });
  QUARRY_TRY(read);
  Print(fmt::format("{} parts, {:.1f} bytes each, names included\n", tree->size(),
                    static_cast<double>(tree->memory_bytes()) / tree->size()));
  for (const char* text :
       {"v", "valve", "number 99999", "DN125 NUMBER", "nothing like it", "rack 1/gate", "/"})
    Measure(fmt::format("find \"{}\" ({})", text, tree->Find(text, 0, 0).total),
            [&] { (void)tree->Find(text, 0, 100); });
  std::vector<std::string> every_second;
  for (uint32_t part = 0; part < tree->size(); part += 2) every_second.push_back(tree->Path(part));
  const auto select = [&](const std::string& what, const std::vector<std::string>& paths) {
    Measure("select " + what, [&] { (void)tree->Resolve(paths); });
  };
  select("one path", {every_second.back()});
  select("every second path", every_second);
  select("*valve*", {"*valve*"});
  select("Hall 0/*number 5*", {"Hall 0/*number 5*"});
  select("a path that names nothing", {"Hall 1011/Pipe rack 1/Gate valve"});
  return {};
}

int Main(int argc, char** argv) {
  uint32_t parts = 1000000;
  CLI::App app("Time to read, search and select a tree of many parts: the median of 7 runs, one thread.");
  app.footer("Example:\n  quarry bench parts --parts 100000");
  app.add_option("--parts", parts, "Parts")->capture_default_str()->check(CLI::Range(1u, 60000000u));
  if (const auto status = ReadArguments(app, argc, argv)) return *status;
  if (const Status status = Run(parts); !status) {
    Log(status.error().message);
    return status.error().exit_status();
  }
  return 0;
}

}  // namespace
}  // namespace quarry::bench

int main(int argc, char** argv) {
  return quarry::RunProgram({"quarry bench parts", "figures that were printed stand"}, argc, argv,
                            quarry::bench::Main);
}
