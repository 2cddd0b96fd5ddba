#include "tests/laboratory/tables/kernel_costs.h"

#include <algorithm>

#include "tests/bench/median.h"
#include "tests/bench/stopwatch.h"

namespace quarry::laboratory {
namespace {

/// A hit as a stream has it: 4 words.
struct HitWords {
  float t;
  uint32_t triangle;
  float b1, b2;
};

/// The input of one call of a kernel of structure A, as loaded from streams.
template <class A>
struct Call {
  typename A::Constant constant;
  typename A::State state;
  float best_t;
};

/// One call of the intersect kernel.
struct Test {
  RayStart ray;
  uint32_t entry;  ///< of the list texture
  HitWords hit;
};

/// The output of a kernel's call.
template <class A>
struct Written {
  typename A::State state;
  TriangleRange range;
  StepOutcome outcome;
};

/// Requires: whole words.
constexpr double Words(size_t bytes) { return static_cast<double>(bytes) / sizeof(uint32_t); }

/// Times `run(memory, i)` over the calls, and counts its fetches. `in`, `out`: words of streams a call.
template <class Run>
KernelCost Measure(std::string name, size_t calls, double in, double out, int repetitions, const Run& run) {
  KernelCost cost{std::move(name), calls};
  if (calls == 0) return cost;
  FetchCounter counting;
  for (size_t i = 0; i < calls; ++i) run(counting, i);
  const auto n = static_cast<double>(calls);
  cost.words_in = in + static_cast<double>(counting.words) / n;
  cost.words_out = out;
  cost.fetches = static_cast<double>(counting.fetches) / n;
  std::vector<double> times;
  PlainMemory memory;
  for (int r = 0; r < repetitions; ++r) {
    const double start = bench::ProcessSeconds();
    for (size_t i = 0; i < calls; ++i) run(memory, i);
    times.push_back(bench::ProcessSeconds() - start);
  }
  const double seconds = bench::Median(times);
  cost.nanoseconds = seconds / n * 1e9;
  cost.gigabytes_per_s = (cost.words_in + cost.words_out) * sizeof(uint32_t) * n / seconds / 1e9;
  return cost;
}

/// The calls of all kernels of A, of some rays of the frame.
template <class A>
struct Recorder {
  const A& structure;
  const LaboratoryScene& scene;
  std::vector<Call<A>> steps{}, ups{}, leaves{};
  std::vector<Test> tests{};

  void Ray(const RayStart& ray) {
    PlainMemory memory;
    const RayFrame<ScalarLane> frame = FrameOf(ray);
    Hit hit;
    hit.t = std::numeric_limits<float>::max();
    typename A::Constant constant;
    typename A::State state;
    TriangleRange range;
    StepOutcome outcome = structure.Setup(memory, ray, 0, hit.t, constant, state);
    while (outcome != StepOutcome::kOut) {
      if (outcome == StepOutcome::kOn) {
        steps.push_back({constant, state, hit.t});
        outcome = structure.Step(memory, constant, state, range);
      } else if (outcome == StepOutcome::kUp) {
        ups.push_back({constant, state, hit.t});
        outcome = structure.Up(memory, constant, state);
      } else {
        for (uint32_t i = range.next; i < range.end; ++i) {
          tests.push_back({ray, i, {hit.t, hit.triangle, hit.b1, hit.b2}});
          TestPlace(scene.corners(), memory, frame, structure.list().data[i], hit);
        }
        leaves.push_back({constant, state, hit.t});
        outcome = structure.Leave(memory, constant, state, hit.t);
      }
    }
  }
};

/// Every so many rays of the frame are recorded, so that they come from all of it and no kernel has many more
/// than `most` calls. Estimated from every 16th ray.
template <class A>
size_t StrideFor(const A& structure, const PapersScene& papers, size_t most) {
  constexpr size_t kEvery = 16;
  TraceCounts counts;
  PlainMemory memory;
  for (size_t i = 0; i < papers.rays(); i += kEvery)
    TraceOne(structure, papers.scene().corners(), memory, papers.ray_list()[i],
             std::numeric_limits<float>::max(), counts);
  const uint64_t busiest = std::max({counts.steps, counts.ups, counts.leaves(), counts.tests});
  return std::max<size_t>(1, (kEvery * busiest + most - 1) / most);
}

/// At most `most` rays from all of the frame.
struct SomeRays {
  const PapersScene& papers;
  size_t stride, count;
  SomeRays(const PapersScene& of, size_t most)
      : papers(of), stride(std::max<size_t>(1, (of.rays() + most - 1) / most)) {
    count = (of.rays() + stride - 1) / stride;
  }
  const RayStart& operator[](size_t i) const { return papers.ray_list()[i * stride]; }
};

template <class A>
std::vector<KernelCost> KernelsOf(const std::string& prefix, const A& structure, const PapersScene& papers,
                                  int repetitions, size_t most) {
  const LaboratoryScene& scene = papers.scene();
  Recorder<A> recorded{structure, scene};
  const size_t stride = StrideFor(structure, papers, most);
  for (size_t i = 0; i < papers.rays(); i += stride) recorded.Ray(papers.ray_list()[i]);
  std::vector<KernelCost> costs;
  constexpr double kRayWords = Words(sizeof(typename A::Constant)),
                   kStateWords = Words(sizeof(typename A::State));
  const SomeRays some(papers, most);
  std::vector<Call<A>> set_up(some.count);
  costs.push_back(Measure(prefix + " Setup", some.count, Words(sizeof(RayStart)), kRayWords + kStateWords,
                          repetitions, [&](auto& memory, size_t i) {
                            structure.Setup(memory, some[i], 0, std::numeric_limits<float>::max(),
                                            set_up[i].constant, set_up[i].state);
                          }));
  std::vector<Written<A>> out(std::max({recorded.steps.size(), recorded.ups.size(), recorded.leaves.size()}));
  costs.push_back(Measure(prefix + (A::kGoesUp ? " Down" : " Traverse"), recorded.steps.size(),
                          kRayWords + kStateWords, kStateWords + 2, repetitions, [&](auto& memory, size_t i) {
                            const Call<A>& call = recorded.steps[i];
                            out[i].state = call.state;
                            out[i].outcome =
                                structure.Step(memory, call.constant, out[i].state, out[i].range);
                          }));
  if (A::kGoesUp)
    costs.push_back(Measure(prefix + " Up", recorded.ups.size(), kRayWords + kStateWords, kStateWords,
                            repetitions, [&](auto& memory, size_t i) {
                              const Call<A>& call = recorded.ups[i];
                              out[i].state = call.state;
                              out[i].outcome = structure.Up(memory, call.constant, out[i].state);
                            }));
  costs.push_back(Measure(prefix + " Continue", recorded.leaves.size(), kRayWords + kStateWords + 1,
                          kStateWords, repetitions, [&](auto& memory, size_t i) {
                            const Call<A>& call = recorded.leaves[i];
                            out[i].state = call.state;
                            out[i].outcome =
                                structure.Leave(memory, call.constant, out[i].state, call.best_t);
                          }));
  std::vector<HitWords> hits(recorded.tests.size());
  costs.push_back(Measure(prefix + " Intersect", recorded.tests.size(), Words(sizeof(Test)),
                          Words(sizeof(HitWords)), repetitions, [&](auto& memory, size_t i) {
                            const Test& test = recorded.tests[i];
                            Hit hit{test.hit.t, test.hit.triangle, test.hit.b1, test.hit.b2};
                            TestPlace(scene.corners(), memory, FrameOf(test.ray),
                                      memory.Fetch(structure.list(), test.entry), hit);
                            hits[i] = {hit.t, hit.triangle, hit.b1, hit.b2};
                          }));
  return costs;
}

/// Every ray against one triangle, which is a constant of the kernel: no fetch depends on data.
KernelCost BruteIntersect(const PapersScene& papers, int repetitions, size_t most) {
  const std::vector<KdTriangle>& triangles = papers.scene().triangles();
  const SomeRays some(papers, most);
  std::vector<HitWords> hits(some.count, {std::numeric_limits<float>::max(), kNoTriangle, 0, 0});
  uint32_t triangle = 0;
  return Measure("Brute Intersect", some.count, Words(sizeof(RayStart) + sizeof(HitWords)),
                 Words(sizeof(HitWords)), repetitions, [&](auto&, size_t i) {
                   if (i == 0) triangle = (triangle + 1) % static_cast<uint32_t>(triangles.size());
                   const glm::vec3* p = triangles[triangle].vertices;
                   Hit hit{hits[i].t, hits[i].triangle, hits[i].b1, hits[i].b2};
                   TestTriangle(FrameOf(some[i]), p[0], p[1], p[2], triangle, hit);
                   hits[i] = {hit.t, hit.triangle, hit.b1, hit.b2};
                 });
}

}  // namespace

std::vector<KernelCost> MeasureKernels(const PapersScene& scene, int repetitions, size_t most_calls) {
  std::vector<KernelCost> costs{BruteIntersect(scene, repetitions, most_calls)};
  for (KernelCost& cost : KernelsOf("Grid", scene.grid(), scene, repetitions, most_calls))
    costs.push_back(std::move(cost));
  for (KernelCost& cost : KernelsOf("KD", KdBacktrack(scene.tree(0)), scene, repetitions, most_calls))
    costs.push_back(std::move(cost));
  return costs;
}

}  // namespace quarry::laboratory
