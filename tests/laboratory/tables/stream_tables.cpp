#include "tests/laboratory/tables/stream_tables.h"

#include <fmt/format.h>

#include <cmath>

#include "common/base/log.h"
#include "tests/laboratory/page/plots.h"

namespace quarry::laboratory {

namespace {

double Part(double a, double b) { return b == 0 ? 0 : a / b; }
double Of(uint64_t a, uint64_t b) { return Part(static_cast<double>(a), static_cast<double>(b)); }
constexpr double kMillion = 1e6;

const Instructions* InstructionsOf(const Study& study) {
  return study.renderers.at(0).instructions ? &*study.renderers[0].instructions : nullptr;
}

/// Instructions of each kernel's runs of a schedule.
std::array<double, kKernels> ByKernel(const Instructions& instructions, const MachineCounts& counts,
                                      bool branching) {
  std::array<double, kKernels> out{};
  for (uint32_t k = 0; k < kKernels; ++k) {
    MachineCounts alone;
    alone.runs[k] = counts.runs[k];
    if (static_cast<KernelId>(k) == KernelId::kTraverse) alone.steps = counts.steps;
    if (static_cast<KernelId>(k) == KernelId::kIntersect) alone.tests = counts.tests;
    out[k] = PredictedInstructions(instructions, alone, branching);
  }
  return out;
}

/// Instructions of an average run of a kernel.
std::string InstructionsCell(const Instructions* instructions, const MachineCounts& counts, uint32_t k,
                             bool branching) {
  if (!instructions) return "not counted";
  return fmt::format(
      "{:.0f}", Part(ByKernel(*instructions, counts, branching)[k], static_cast<double>(counts.runs[k])));
}

/// A row of table 1. `instructions`: null if they are not counted.
void PrintKernel(const std::string& name, uint32_t k, const Instructions* instructions,
                 const CountedRun& multipass, const CountedRun& branching) {
  const auto cells = [&](const CountedRun& run, bool branches) {
    const uint64_t runs = run.counts.runs[k];
    const MemoryWords& words = run.words[k];
    return fmt::format(" {} | {:.1f} | {:.1f} | {:.1f} |",
                       InstructionsCell(instructions, run.counts, k, branches), Of(words.read, runs),
                       Of(words.written, runs), Of(words.fetched, runs));
  };
  Print(fmt::format("| {} |{}{}\n", name, cells(multipass, false), cells(branching, true)));
}

void PrintKernels(const Study& study, bool bunny) {
  Print(
      "## Table 1: kernels of the ray caster, and the shade kernels of the other renderers\n\n"
      "Averages of one run (an empty leaf is a run of intersect): instructions, from a smaller picture; "
      "32-bit words read from and written to streams (R, W) and fetched from textures (M). Stencil: each "
      "pass reads a byte of every ray, each run writes one.\n\n"
      "| kernel | multipass: instructions | R | W | M | branching: instructions | R | W | M |\n"
      "|---|---|---|---|---|---|---|---|---|\n");
  const Instructions* instructions = InstructionsOf(study);
  for (uint32_t k = 0; k < kKernels; ++k)
    if (study.multipass.counts.runs[k] != 0)
      PrintKernel(kKernelNames[k], k, instructions, study.multipass, study.branching);
  for (size_t r = 1; r < study.renderers.size(); ++r) {
    const RendererRow& row = study.renderers[r];
    for (const KernelId kernel : {KernelId::kColor, KernelId::kShadow}) {
      const auto k = static_cast<uint32_t>(kernel);
      if (row.multipass.counts.runs[k] == 0) continue;
      PrintKernel(fmt::format("{}, {}", kKernelNames[k], kRendererNames[static_cast<uint32_t>(row.renderer)]),
                  k, row.instructions ? &*row.instructions : nullptr, row.multipass, row.branching);
    }
  }
  if (bunny)
    Print(
        "\nThe paper's shade kernels, in these columns: color 36, 10, 3, 21 and 25, 0, 3, 21; shadow 16, 11, "
        "8, 0 and 10, 0, 0, 0; reflected 26, 11, 9, 9 and 12, 0, 0, 0; path 17, 14, 9, 9 and 11, 3, 0, 0. "
        "Here color and shadow also begin the reflected and scattered rays.\n");
}

void PrintPasses(const Study& study, bool bunny) {
  Print(
      "\n## Table 2: passes of the multipass machine\n\n"
      "Bound: no order of passes has fewer in the structure, since each kernel runs as often as its busiest "
      "ray needs "
      "it.\n\n| oracle | total | traversal | up | intersection | other | times the bound | most traversals "
      "of a "
      "ray | most intersections | SIMD efficiency |\n|---|---|---|---|---|---|---|---|---|---|\n");
  for (const OracleRow& row : study.oracles) {
    const MachineCounts& c = row.counts;
    const auto passes = [&](KernelId kernel) { return c.passes[static_cast<uint32_t>(kernel)]; };
    Print(fmt::format("| {} | {} | {} | {} | {} | {} | {:.2f} | {} | {} | {:.3f} |\n", row.name,
                      c.all_passes(), passes(KernelId::kTraverse), passes(KernelId::kUp),
                      passes(KernelId::kIntersect), c.all_passes() - c.structure_passes(),
                      Of(c.structure_passes(), c.least_passes), c.most_steps, c.most_tests,
                      c.simd_efficiency()));
  }
  if (!study.oracles.empty())
    Print(fmt::format("| bound | | | | | | 1.00 | | | |\n\nThe bound is {} passes.\n",
                      study.oracles[0].counts.least_passes));
  if (bunny)
    Print(
        "The paper, bunny, 1024x1024, share of 20 %: 1085 passes (610 traversal, 471 intersection, 4 other), "
        "maxima 221 and 328, SIMD efficiency 0.105; within a factor of 2 to 3 of the optimum, as soon as any "
        "at "
        "least 5 times.\n");
}

void PrintScene(const Study& study, bool bunny) {
  const MachineCounts& c = study.branching.counts;
  Print(fmt::format(
      "\n## Figure 6: the scene\n\n| v: cells or nodes a ray | t: triangles a ray | s: shadings a ray "
      "|\n|---|---|---|\n"
      "| {:.2f} | {:.2f} | {:.2f} |\n",
      Of(c.steps + c.ups, c.rays), Of(c.tests, c.rays), Of(c.shaded, c.rays)));
  if (bunny) Print("| the paper's bunny: 93.93 | 13.88 | 0.82 |\n");
}

void PrintUse(const Study& study) {
  Print(
      "\n## Figure 7: computation and bandwidth by kernel\n\n| kernel | multipass: million instructions | MB "
      "| "
      "branching: million instructions | MB |\n|---|---|---|---|---|\n");
  const Instructions* instructions = InstructionsOf(study);
  for (uint32_t k = 0; k < kKernels; ++k) {
    if (study.multipass.counts.runs[k] == 0) continue;
    const auto cells = [&](const CountedRun& run, bool branching) {
      const MemoryWords& w = run.words[k];
      const std::string million =
          instructions ? fmt::format("{:.1f}", ByKernel(*instructions, run.counts, branching)[k] / kMillion)
                       : "not counted";
      return fmt::format(" {} | {:.1f} |", million,
                         4 * static_cast<double>(w.read + w.written + w.fetched) / kMillion);
    };
    Print(fmt::format("| {} |{}{}\n", kKernelNames[k], cells(study.multipass, false),
                      cells(study.branching, true)));
  }
  Print(fmt::format(
      "| stencil | | {:.1f} | | |\n",
      static_cast<double>(study.multipass.bytes[static_cast<uint32_t>(DataKind::kStencil)]) / kMillion));
}

void PrintBandwidth(const Study& study, const StudyOptions& options) {
  Print(fmt::format(
      "\n## Figures 8 and 9: bandwidth by type of data, without and with a texture cache\n\n"
      "MB of the picture. Cache: {} bytes, lines of {}, {} way{}.\n\n| schedule |",
      options.cache.bytes, options.cache.line, options.cache.ways, options.cache.ways == 1 ? "" : "s"));
  for (const char* kind : kDataKindNames) Print(fmt::format(" {} |", kind));
  Print(" all | with cache | ratio | hits of vertices |\n|---|");
  for (uint32_t k = 0; k < kDataKinds + 4; ++k) Print("---|");
  Print("\n");
  const auto row = [](const std::string& name, const CountedRun& run) {
    Print(fmt::format("| {} |", name));
    for (const uint64_t bytes : run.bytes)
      Print(fmt::format(" {:.1f} |", static_cast<double>(bytes) / kMillion));
    Print(fmt::format(
        " {:.1f} | {:.1f} | {:.2f} | {:.1f} % |\n", static_cast<double>(run.all_bytes()) / kMillion,
        static_cast<double>(run.all_cached_bytes()) / kMillion, Of(run.all_cached_bytes(), run.all_bytes()),
        100 * Of(run.triangle_hits, run.triangle_accesses)));
  };
  row("multipass", study.multipass);
  row(fmt::format("unrolled {} and {}", options.unrolling.traverse, options.unrolling.intersect),
      study.unrolled);
  row(fmt::format("tiles of {}", options.tile), study.tiled);
  row("branching", study.branching);
  for (size_t r = 1; r < study.renderers.size(); ++r)
    row(fmt::format("branching, {}", kRendererNames[static_cast<uint32_t>(study.renderers[r].renderer)]),
        study.renderers[r].branching);
  const Instructions* instructions = InstructionsOf(study);
  const double whole = static_cast<double>(study.multipass.all_bytes());
  Print(fmt::format("\nUnrolling {} and {}: {:.0f} % less bandwidth", options.unrolling.traverse,
                    options.unrolling.intersect,
                    100 - 100 * Part(static_cast<double>(study.unrolled.all_bytes()), whole)));
  if (instructions)
    Print(fmt::format(", {:+.0f} % instructions",
                      100 * Part(PredictedInstructions(*instructions, study.unrolled.counts, false),
                                 PredictedInstructions(*instructions, study.multipass.counts, false)) -
                          100));
  Print(
      " (the paper: 60 % less where memory is left alone after a ray's end, under 10 % more "
      "instructions).\n");
}

void PrintRenderers(const Study& study, bool bunny) {
  Print(
      "\n## Table 3: the other renderers against the ray caster, branching\n\nA sample's cost: shadow, "
      "whitted and path against raycast of "
      "as many samples.\n\n| renderer | rays a sample | instructions | bandwidth | with cache | multipass "
      "gives the same bits | "
      "as `quarry render` |\n|---|---|---|---|---|---|---|\n");
  const RendererRow& base = study.renderers.at(0);
  const auto samples = [](const RendererRow& row) {
    return static_cast<double>(row.branching.counts.runs[static_cast<uint32_t>(KernelId::kGenerate)]);
  };
  for (const RendererRow& row : study.renderers) {
    const double scale = Part(samples(base), samples(row));
    const std::string instructions =
        row.instructions && base.instructions
            ? fmt::format(
                  "{:.2f}",
                  scale * Part(PredictedInstructions(*row.instructions, row.branching.counts, true),
                               PredictedInstructions(*base.instructions, base.branching.counts, true)))
            : "not counted";
    Print(fmt::format("| {} | {:.2f} | {} | {:.2f} | {:.2f} | {} | {} |\n",
                      kRendererNames[static_cast<uint32_t>(row.renderer)],
                      Part(static_cast<double>(row.branching.counts.rays), samples(row)), instructions,
                      scale * Of(row.branching.all_bytes(), base.branching.all_bytes()),
                      scale * Of(row.branching.all_cached_bytes(), base.branching.all_cached_bytes()),
                      row.same_schedules ? "yes" : "NO",
                      !row.same_as_render   ? "no such mode"
                      : *row.same_as_render ? "yes"
                                            : "NO"));
  }
  if (bunny)
    Print(
        "\nThe paper's bunny, instructions and bandwidth: shadow 0.85 and 1.15, whitted 2.62 and 3.00, path "
        "3.24 and 4.06.\n");
}

nlohmann::ordered_json ToJson(const CountedRun& run) {
  nlohmann::ordered_json json;
  json["rays"] = run.counts.rays;
  json["steps"] = run.counts.steps;
  json["ups"] = run.counts.ups;
  json["tests"] = run.counts.tests;
  json["shaded"] = run.counts.shaded;
  json["passes"] = run.counts.all_passes();
  for (uint32_t k = 0; k < kKernels; ++k)
    json["kernels"][kKernelNames[k]] = {{"runs", run.counts.runs[k]},
                                        {"words_read", run.words[k].read},
                                        {"words_written", run.words[k].written},
                                        {"words_fetched", run.words[k].fetched}};
  for (uint32_t k = 0; k < kDataKinds; ++k) {
    json["bytes"][kDataKindNames[k]] = run.bytes[k];
    json["cached_bytes"][kDataKindNames[k]] = run.cached_bytes[k];
  }
  json["triangle_accesses"] = run.triangle_accesses;
  json["triangle_hits"] = run.triangle_hits;
  return json;
}

}  // namespace

void PrintStudy(const Study& study, const StudyOptions& options, bool bunny) {
  PrintKernels(study, bunny);
  PrintPasses(study, bunny);
  PrintScene(study, bunny);
  PrintUse(study);
  PrintBandwidth(study, options);
  PrintRenderers(study, bunny);
}

nlohmann::ordered_json StudyToJson(const Study& study) {
  nlohmann::ordered_json json;
  json["accelerator"] = study.accelerator;
  for (const OracleRow& row : study.oracles)
    json["oracles"].push_back({{"name", row.name},
                               {"passes", row.counts.all_passes()},
                               {"structure_passes", row.counts.structure_passes()},
                               {"least_structure_passes", row.counts.least_passes},
                               {"most_steps", row.counts.most_steps},
                               {"most_tests", row.counts.most_tests},
                               {"simd_efficiency", row.counts.simd_efficiency()}});
  json["multipass"] = ToJson(study.multipass);
  json["unrolled"] = ToJson(study.unrolled);
  json["tiled"] = ToJson(study.tiled);
  for (const RendererRow& row : study.renderers) {
    nlohmann::ordered_json one = ToJson(row.branching);
    one["multipass"] = ToJson(row.multipass);
    one["renderer"] = kRendererNames[static_cast<uint32_t>(row.renderer)];
    one["same_schedules"] = row.same_schedules;
    if (row.same_as_render) one["same_as_render"] = *row.same_as_render;
    if (row.instructions)
      for (uint32_t k = 0; k < kKernels; ++k) {
        const KernelInstructions& i = (*row.instructions)[k];
        one["instructions"][kKernelNames[k]] = {{"form", i.form}, {"body", i.body}, {"leave", i.leave}};
      }
    json["renderers"].push_back(one);
  }
  return json;
}

Status DrawStudy(const Study& study, const std::string& folder, const std::string& name) {
  const auto path = [&](int figure) { return fmt::format("{}/{}-figure-{}.png", folder, name, figure); };
  const MachineCounts& c = study.branching.counts;
  const auto size = static_cast<uint32_t>(std::lround(std::sqrt(study.branching.pixels.size() / 3)));
  QUARRY_TRY(DrawPicture(study.branching.pixels, size,
                         fmt::format("Figure 6, {}: v = {:.2f}, t = {:.2f}, s = {:.2f}", name,
                                     Of(c.steps + c.ups, c.rays), Of(c.tests, c.rays), Of(c.shaded, c.rays)),
                         path(6)));
  if (const Instructions* instructions = InstructionsOf(study)) {
    StackedPlot plot{
        "Figure 7, " + name + ": computation and bandwidth by kernel", "million instructions or MB", {}, {}};
    plot.parts.assign(kKernelNames.begin(), kKernelNames.end());
    plot.parts.emplace_back("stencil");
    const auto columns = [&](const std::string& schedule, const CountedRun& run, bool branching) {
      Column compute{schedule + ", instructions", {}}, bandwidth{schedule + ", bandwidth", {}};
      const auto million = ByKernel(*instructions, run.counts, branching);
      for (uint32_t k = 0; k < kKernels; ++k) {
        const MemoryWords& w = run.words[k];
        compute.values.push_back(million[k] / kMillion);
        bandwidth.values.push_back(4 * static_cast<double>(w.read + w.written + w.fetched) / kMillion);
      }
      compute.values.push_back(0);
      bandwidth.values.push_back(static_cast<double>(run.bytes[0]) / kMillion);
      plot.columns.push_back(compute);
      plot.columns.push_back(bandwidth);
    };
    columns("multipass", study.multipass, false);
    columns("branching", study.branching, true);
    QUARRY_TRY(DrawStacked(plot, path(7)));
  }
  StackedPlot bandwidth{"Figure 8, " + name + ": bandwidth by type of data", "MB", {}, {}};
  StackedPlot cached{
      "Figure 9, " + name + ": bandwidth with a texture cache over that without", "ratio", {}, {}};
  bandwidth.parts.assign(std::begin(kDataKindNames), std::end(kDataKindNames));
  cached.parts = bandwidth.parts;
  const auto columns = [&](const std::string& schedule, const CountedRun& run) {
    Column without{schedule, {}}, with{schedule, {}};
    for (uint32_t k = 0; k < kDataKinds; ++k) {
      without.values.push_back(static_cast<double>(run.bytes[k]) / kMillion);
      with.values.push_back(Of(run.cached_bytes[k], run.all_bytes()));
    }
    bandwidth.columns.push_back(without);
    cached.columns.push_back(with);
  };
  columns("multipass", study.multipass);
  columns("unrolled", study.unrolled);
  columns("tiled", study.tiled);
  columns("branching", study.branching);
  for (size_t r = 1; r < study.renderers.size(); ++r)
    columns(fmt::format("branching, {}", kRendererNames[static_cast<uint32_t>(study.renderers[r].renderer)]),
            study.renderers[r].branching);
  QUARRY_TRY(DrawStacked(bandwidth, path(8)));
  return DrawStacked(cached, path(9));
}

}  // namespace quarry::laboratory
