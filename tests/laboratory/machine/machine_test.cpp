// Purcell's machine: pictures of both schedules and all oracles equal Quarry's, to the last bit.
#include "tests/laboratory/machine/machine.h"

#include <bit>
#include <cstring>

#include "common/engine/renderer.h"
#include "tests/laboratory/made_scene.h"

namespace quarry::laboratory {
namespace {

/// All triangles in one list: a structure that is surely right.
struct OneList {
  struct Constant {
    float t_end;
  };
  struct State {
    uint32_t next;
  };
  static constexpr bool kGoesUp = false;

  explicit OneList(const LaboratoryScene& scene, AddressSpace& addresses) {
    for (uint32_t t = 0; t < scene.triangles().size(); ++t) numbers.push_back(t);
    texture = addresses.TextureOf(numbers, DataKind::kLists);
  }
  template <class M>
  StepOutcome Setup(M&, const RayStart&, float t, float t_end, Constant& constant, State& state) const {
    constant.t_end = t_end;
    state.next = 0;
    return t < t_end ? StepOutcome::kOn : StepOutcome::kOut;
  }
  /// Lists of seven, so that rays come and go.
  template <class M>
  StepOutcome Step(M&, const Constant&, State& state, TriangleRange& range) const {
    range.next = state.next;
    range.end = state.next = std::min<uint32_t>(state.next + 7, static_cast<uint32_t>(numbers.size()));
    return StepOutcome::kList;
  }
  template <class M>
  StepOutcome Up(M&, const Constant&, State&) const {
    return StepOutcome::kOut;
  }
  template <class M>
  StepOutcome Leave(M&, const Constant&, State& state, float) const {
    return state.next < numbers.size() ? StepOutcome::kOn : StepOutcome::kOut;
  }
  const Texture<uint32_t>& list() const { return texture; }

  std::vector<uint32_t> numbers;
  Texture<uint32_t> texture;
};
static_assert(Accelerator<OneList>);

CameraSpec FirstCamera() { return {.eye = {-1, -7, 3}, .at = {0, 0, 1}, .up = {0, 0, 1}, .fov_degrees = 50}; }

/// The pixels that workers render.
std::vector<float> RenderedBy(const std::string& store, const View& view) {
  auto scene = Scene::Open(store);
  REQUIRE(scene.has_value());
  auto renderer = quarry::Renderer::Create(*scene, {.cache_bytes = 64 << 20, .threads = 2});
  REQUIRE(renderer.has_value());
  std::vector<float> image(size_t{3} * view.width * view.height);
  const std::vector<Tile> tiles = TilesOf(view.crop);
  REQUIRE((*renderer)
              ->Render(view, tiles,
                       [&](size_t i, const RenderedTile& result, quarry::Renderer::Progress) {
                         const PixelRect& r = tiles[i].pixels;
                         for (uint32_t p = 0; p < r.height * r.width; ++p)
                           std::memcpy(
                               &image[size_t{3} * ((r.y + p / r.width) * view.width + r.x + p % r.width)],
                               result.pixels.data() + size_t{4 * kColorWords} * p, 3 * sizeof(float));
                       })
              .has_value());
  return image;
}

size_t Unlike(const std::vector<float>& a, const std::vector<float>& b) {
  REQUIRE(a.size() == b.size());
  size_t unlike = 0;
  for (size_t i = 0; i < a.size(); ++i)
    unlike += std::bit_cast<uint32_t>(a[i]) != std::bit_cast<uint32_t>(b[i]) ? 1 : 0;
  return unlike;
}

struct Run {
  std::vector<float> pixels;
  MachineCounts counts;
};
template <class Body>
Run RunMachine(LaboratoryScene& scene, const Picture& picture, const Body& body) {
  PlainMemory memory;
  AddressSpace addresses = scene.addresses();
  const OneList list(scene, addresses);
  Machine<OneList, PlainMemory> machine(list, picture, memory, addresses);
  body(machine);
  return {MeansOf(machine.sums(), picture.context.view.spp), machine.counts()};
}

TEST_CASE("Multipass and branching give the pixels of a render") {
  test::TemporaryFolder folder;
  MadeScene scene(GlassModel(folder));
  for (const Renderer renderer :
       {Renderer::kRaycast, Renderer::kShadow, Renderer::kWhitted, Renderer::kPath}) {
    INFO(kRendererNames[static_cast<int>(renderer)]);
    const auto view = MakeView(*scene, renderer, FirstCamera(), 48, 36, 2);
    REQUIRE(view.has_value());
    const Picture picture(*scene, renderer, *view);
    REQUIRE(picture.has_see_through);
    const Run branching = RunMachine(*scene, picture, [](auto& machine) { machine.RunBranching(0); });
    CHECK(branching.counts.rays > (renderer == Renderer::kRaycast ? 1000 : 2000));
    if (renderer != Renderer::kPath) CHECK(Unlike(branching.pixels, RenderedBy(scene.store(), *view)) == 0);
    for (uint32_t oracle = 0; oracle < kOracles; ++oracle)
      for (const uint32_t tile : {0u, 16u}) {
        const Unrolling unrolling = tile == 0 ? Unrolling{} : Unrolling{4, 2};
        const Run run = RunMachine(*scene, picture, [&](auto& machine) {
          machine.RunMultipass({static_cast<OracleKind>(oracle), 0.2}, unrolling, tile);
        });
        CHECK(Unlike(run.pixels, branching.pixels) == 0);
        CHECK(run.counts.rays == branching.counts.rays);
        CHECK(run.counts.steps == branching.counts.steps);
        CHECK(run.counts.tests == branching.counts.tests);
        CHECK(run.counts.shaded == branching.counts.shaded);
        if (tile != 0 || renderer != Renderer::kRaycast) continue;
        // Each ray goes through all lists and tests all triangles.
        const auto triangles = static_cast<uint32_t>(scene->triangles().size()), lists = (triangles + 6) / 7;
        CHECK(run.counts.most_steps == lists);
        CHECK(run.counts.most_tests == triangles);
        CHECK(run.counts.least_passes == uint64_t{2} * (lists + triangles));
        CHECK(run.counts.structure_passes() >= run.counts.least_passes);
      }
  }
}

TEST_CASE("Streams that a picture does not need take no memory, and the others keep their addresses") {
  constexpr uint32_t kRays = 12288;  // all streams are whole multiples of the alignment
  AddressSpace first, second;
  const RayStreams<OneList> all(kRays, {}, first);
  const RayStreams<OneList> few(kRays, {false, false, false}, second);
  CHECK((all.bound.data && all.path.data && all.lit.data && all.pending.data && all.list.data));
  CHECK(!(few.bound.data || few.path.data || few.lit.data || few.pending.data || few.list.data));
  CHECK((few.stencil.data && few.ray.data && few.hit.data && few.constant.data && few.state.data &&
         few.range.data));
  CHECK(few.size() == kRays);
  CHECK(all.constant.address == few.constant.address);
  CHECK(all.state.address == few.state.address);
  CHECK(all.range.address == few.range.address);
  CHECK(first.Take(0) - all.stencil.address == kRays * RayStreams<OneList>::BytesPerRay({}));
  const uint64_t before_bounds = (few.bound.address - few.stencil.address) / kRays;
  CHECK(RayStreams<OneList>::BytesPerRay({false, false, false}) ==
        before_bounds + sizeof(OneList::Constant) + sizeof(OneList::State) + sizeof(TriangleRange));
}

TEST_CASE("A picture needs the parts of its renderer") {
  test::TemporaryFolder folder;
  MadeScene glass(GlassModel(folder)), opaque = Generated("city", 1000);
  const auto parts = [](MadeScene& scene, Renderer renderer) {
    const auto view = MakeView(*scene, renderer, FirstCamera(), 8, 8, 1);
    REQUIRE(view.has_value());
    return Picture(*scene, renderer, *view).parts();
  };
  const RayParts cast = parts(glass, Renderer::kRaycast);
  CHECK(!(cast.paths || cast.bounds || cast.lists));
  const RayParts shadow = parts(glass, Renderer::kShadow);
  CHECK((shadow.paths && shadow.bounds && !shadow.lists));
  CHECK(!parts(opaque, Renderer::kShadow).bounds);
  const RayParts whitted = parts(glass, Renderer::kWhitted);
  CHECK((whitted.paths && whitted.bounds && whitted.lists));
  CHECK(!parts(glass, Renderer::kPath).lists);
}

TEST_CASE("Oracles choose by the number of rays") {
  StageCounts counts;
  counts[Stage::kTraverse] = 70;
  counts[Stage::kUp] = 11;
  counts[Stage::kIntersect] = 19;
  const auto choose = [&](OracleKind kind, Stage last = Stage::kTraverse) {
    return ChooseStage({kind, 0.2}, counts, last);
  };
  CHECK(choose(OracleKind::kAny) == Stage::kIntersect);
  CHECK(choose(OracleKind::kShare) == Stage::kTraverse);
  CHECK(choose(OracleKind::kDelany) == Stage::kTraverse);
  CHECK(choose(OracleKind::kFoley, Stage::kIntersect) == Stage::kTraverse);
  counts[Stage::kIntersect] = 21;  // of 102: more than 20 %
  CHECK(choose(OracleKind::kShare) == Stage::kIntersect);
  counts[Stage::kIntersect] = 35;  // half of the traversing rays: not less than half
  CHECK(choose(OracleKind::kFoley, Stage::kIntersect) == Stage::kIntersect);
  CHECK(choose(OracleKind::kFoley, Stage::kUp) == Stage::kTraverse);
  CHECK(choose(OracleKind::kFoley, Stage::kSetup) == Stage::kTraverse);
  counts = {};
  counts[Stage::kUp] = 1;
  for (uint32_t kind = 0; kind < kOracles; ++kind) CHECK(choose(static_cast<OracleKind>(kind)) == Stage::kUp);
  counts = {};
  counts[Stage::kIntersect] = 1;
  for (uint32_t kind = 0; kind < kOracles; ++kind)
    CHECK(choose(static_cast<OracleKind>(kind)) == Stage::kIntersect);
}

}  // namespace
}  // namespace quarry::laboratory
