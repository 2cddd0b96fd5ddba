// Hidden parts and sections, through the renderer: hits are those of brute force over the triangles that are
// shown, within the section, bit for bit; cut solids get caps.
#include <cmath>
#include <cstring>
#include <glm/geometric.hpp>
#include <set>

#include "common/engine/ask_rays.h"
#include "common/engine/sources/ray_list.h"
#include "common/engine/surfaces/section_clip.h"
#include "tests/reference/reference_rays.h"
#include "tests/support/rendering/looking.h"

namespace quarry::test {
namespace {

/// A section by a box and two planes that cut through the scene's middle.
SectionCut CutOf(const SceneMeta& meta) {
  const glm::dvec3 lower(meta.bounds_lower), size(meta.bounds_upper - meta.bounds_lower);
  SectionCut section;
  section.has_box = true;
  section.lower = lower + size * 0.1;
  section.upper = lower + size * 0.93;
  section.planes = {{lower + size * 0.6, {1, 0.4, -0.3}}, {lower + size * 0.5, {-0.2, 0.1, 1}}};
  REQUIRE(NormalizeSection(section).has_value());
  return section;
}

/// The parts for which part % 3 == 1, hidden; each voxel's share as it is.
std::shared_ptr<const PartSelection> HideEveryThird(const LoadedScene& scene, size_t parts) {
  auto selection = std::make_shared<PartSelection>();
  selection->hidden = NoParts(parts);
  for (uint32_t part = 1; part < parts; part += 3) AddPart(selection->hidden, part);
  for (const VoxelGeometry& voxel : scene.voxels()) {
    uint32_t hidden = 0;
    for (uint32_t t = 0; t < voxel.triangle_count; ++t) hidden += HasPart(selection->hidden, voxel.part(t));
    selection->voxels.push_back(hidden == 0                      ? PartSelection::Shown::kAll
                                : hidden == voxel.triangle_count ? PartSelection::Shown::kNone
                                                                 : PartSelection::Shown::kSome);
  }
  selection->id = IdOf(*selection);
  return selection;
}

/// The rays as the renderer makes them of queries.
RayPacket PacketOf(const std::vector<RayQuery>& rays, size_t first, const SceneMeta& meta) {
  RayList list;
  list.Open({std::make_shared<const RayVector>(rays), first, RayPacket::kRays}, meta);
  RayPacket packet;
  SamplePacket samples;
  list.Next(~uint64_t{0}, samples, packet);
  return packet;
}

/// The nearest hit of lane i by definition: within the part of the ray that a section keeps.
Hit ExpectedHit(const LoadedScene& scene, const RayPacket& packet, uint32_t i, const SectionClip& clip) {
  const KeptRange kept = clip.RangesOf(packet);
  if (!(kept.begin[i] < kept.end[i])) return {};
  Ray ray = packet.RayOf(i);
  ray.t_max = NextAbove(std::min(kept.end[i], packet.hit_t[i]));
  const bool begins = (packet.bounded >> i & 1) != 0 && packet.after_t[i] > kept.begin[i];
  ray.after_t = begins ? packet.after_t[i] : kept.begin[i];
  ray.after_id = kNoTriangle;
  return BruteForce(scene, ray);
}

struct Cube {
  explicit Cube(bool inverted) {
    std::ofstream out(folder.file("cube.obj"));
    for (int i = 0; i < 8; ++i) out << "v " << (i & 1) << ' ' << (i >> 1 & 1) << ' ' << (i >> 2) << '\n';
    const int faces[6][4] = {{1, 3, 4, 2}, {5, 6, 8, 7}, {1, 2, 6, 5},
                             {3, 7, 8, 4}, {1, 5, 7, 3}, {2, 4, 8, 6}};
    for (int f = 0; f < 6; ++f) {
      out << 'f';
      for (int c = 0; c < 4; ++c) out << ' ' << faces[f][inverted ? 3 - c : c];
      out << '\n';
    }
    out.close();
    MakeStore({.models = {folder.file("cube.obj")}, .output = folder.file("s")});
  }
  TemporaryFolder folder;
};

}  // namespace

TEST_CASE("Hits of views with hidden parts and a section are those of brute force", "[reference][inside]") {
  const TemporaryFolder folder;
  std::mt19937 random(21);
  std::ofstream out(folder.file("soup.obj"));
  constexpr int kTriangles = 3000, kParts = 20;
  for (int i = 0; i < kTriangles; ++i) {
    const glm::vec3 at = PointInBox(random, {0, 0, 0}, {10, 10, 10});
    out << "g part" << i % kParts << '\n';
    for (int c = 0; c < 3; ++c) {
      const glm::vec3 p = at + PointInBox(random, glm::vec3(-1), glm::vec3(1));
      out << "v " << p.x << ' ' << p.y << ' ' << p.z << '\n';
    }
    out << "f -3 -2 -1\n";
  }
  out.close();
  const std::string model = folder.file("soup.obj"), store = folder.file("s");
  MakeStore({.models = {model}, .output = store, .threads = 2, .voxel_size = 4096});
  const auto scene = Scene::Open(store);
  REQUIRE(scene.has_value());
  const IsHidden is_hidden = [](uint32_t part) { return part % 3 == 1; };
  const LoadedScene all(model, 4096), some(model, 4096, {}, is_hidden);
  const SceneMeta& meta = scene->catalog().meta;

  std::vector<RayQuery> rays;
  for (int i = 0; i < 1024; ++i) {
    const Ray ray = MakeRay(all, random);
    rays.push_back({glm::dvec3(ray.origin), glm::dvec3(ray.direction)});
    if (i % 3 == 0) rays.back().begin = 0.1 * (i % 50);  // before the cut, or behind it
  }
  for (const bool hides : {false, true})
    for (const bool cuts : {false, true}) {
      View view;
      if (hides) view.parts.selection = HideEveryThird(all, scene->store().part_count());
      if (cuts) view.section = CutOf(meta);
      const LoadedScene& shown = hides ? some : all;
      const SectionClip clip(view.section, meta);
      for (const uint64_t cache : {uint64_t{meta.largest_decoded}, uint64_t{64} << 20}) {
        const auto renderer = Renderer::Create(*scene, {cache, 2});
        REQUIRE(renderer.has_value());
        const auto hits = HitsOf(**renderer, rays, RayGoal::kNearest, {}, view);
        const auto any = HitsOf(**renderer, rays, RayGoal::kAny, {}, view);
        // All hits of a view that makes caps come to an end.
        const auto every = AskRays(**renderer, rays, {.goal = RayGoal::kAll, .surfaces = true}, {}, view);
        REQUIRE(every.has_value());
        REQUIRE(hits.has_value());
        REQUIRE(any.has_value());
        int wrong = 0, found = 0;
        for (size_t first = 0; first < rays.size(); first += RayPacket::kRays) {
          const RayPacket packet = PacketOf(rays, first, meta);
          for (uint32_t i = 0; i < RayPacket::kRays; ++i) {
            const Hit expected = ExpectedHit(shown, packet, i, clip);
            const Hit& hit = (*hits)[first + i];
            found += expected.triangle != kNoTriangle;
            wrong += hit.triangle != expected.triangle || hit.b1 != expected.b1 || hit.b2 != expected.b2;
            wrong += ((*any)[first + i].triangle == kNoTriangle) != (expected.triangle == kNoTriangle);
          }
        }
        INFO("hides " << hides << ", cuts " << cuts << ", cache " << cache);
        CHECK(wrong == 0);
        CHECK(found > 200);
      }
    }
}

TEST_CASE("No block is loaded that has none of the parts of a view", "[reference][inside]") {
  const TemporaryFolder folder;
  const std::string store = folder.file("s");
  MakeStore({.models = {GenerateScene(folder, "plant", 20000, ".obj")}, .output = store, .voxel_size = 8192});
  const auto scene = Scene::Open(store);
  REQUIRE(scene.has_value());
  const Catalog& catalog = scene->catalog();
  auto selection = std::make_shared<PartSelection>();
  selection->hidden = NoParts(scene->store().part_count());
  for (uint32_t part = 0; part < scene->store().part_count(); ++part)
    if (part % 50 != 7) AddPart(selection->hidden, part);
  selection->voxels.resize(catalog.voxels.size());
  size_t kept = 0;
  REQUIRE(scene->store()
              .ForEachVoxelParts([&](uint32_t voxel, std::span<const uint32_t> parts) {
                const bool any = std::ranges::any_of(
                    parts, [&](uint32_t part) { return !HasPart(selection->hidden, part); });
                selection->voxels[voxel] = any ? PartSelection::Shown::kSome : PartSelection::Shown::kNone;
                kept += any;
              })
              .has_value());
  selection->id = IdOf(*selection);
  View view = Looking({-190, -150, 120}, {10, 10, 40}, 256, 192);
  view.mode = RenderMode::kAo;
  view.parts.selection = selection;
  const auto renderer = Renderer::Create(*scene, {64 << 20, 2});
  REQUIRE(renderer.has_value());
  std::set<uint32_t> touched;
  REQUIRE((*renderer)
              ->Render(view, TilesOf(view.crop),
                       [&](size_t, const RenderedTile& tile, Renderer::Progress) {
                         for (const BlockKey block : tile.blocks)
                           if (block.kind() == BlockKind::kHot) touched.insert(block.index());
                       })
              .has_value());
  CHECK(touched.size() > 3);
  CHECK(touched.size() <= kept);
  CHECK((*renderer)->counters().cache.loaded <= 2 * kept);
  for (const uint32_t voxel : touched) CHECK(selection->voxels[voxel] != PartSelection::Shown::kNone);
}

TEST_CASE("A section keeps the part of a ray that lies in its planes", "[reference][inside]") {
  SceneMeta meta;
  meta.root_lower = {-10, -10, -10};
  meta.root_upper = {10, 10, 10};
  SectionCut section;
  section.has_box = true;
  section.lower = {-1, -20, -20};  // four sides cut nothing off
  section.upper = {2, 20, 20};
  section.planes = {{{0, 0, 3}, {0, 0, 1}}};
  const SectionClip clip(section, meta);
  RayPacket packet;
  for (uint32_t i = 0; i < RayPacket::kRays; ++i) packet.Set(i, Ray{});
  const auto set = [&](uint32_t i, const glm::vec3& origin, const glm::vec3& direction) {
    Ray ray;
    ray.origin = origin;
    ray.direction = direction;
    packet.Set(i, ray);
  };
  set(0, {-5, 0, 0}, {1, 0, 0});
  set(1, {0, 0, 0}, {0, 0, 1});
  set(2, {0, 0, 5}, {0, 1, 0});  // beyond the plane, along it
  set(3, {0, 0, 0}, {0, 1, 0});  // cut nowhere
  set(4, {5, 0, 0}, {1, 0, 0});  // outside, away
  const KeptRange kept = clip.RangesOf(packet);
  CHECK(kept.begin[0] == 4);
  CHECK(kept.end[0] == 7);
  CHECK(clip.normal(kept.plane[0]) == glm::vec3(-1, 0, 0));
  CHECK(kept.begin[1] == 0);
  CHECK(kept.end[1] == 3);
  CHECK_FALSE(kept.begin[2] < kept.end[2]);
  CHECK((kept.begin[3] == 0 && kept.end[3] == kInfinity));
  CHECK_FALSE(kept.begin[4] < kept.end[4]);
  section.lower = {-10, -10, -10};
  section.upper = {10, 10, 10};
  section.planes.clear();
  CHECK(SectionClip(section, meta).empty());
}

TEST_CASE("A cut part has a cap if it is known to be closed", "[reference][inside]") {
  const bool inverted = GENERATE(false, true), closed = GENERATE(false, true);
  const Cube cube(inverted);
  const auto scene = Scene::Open(cube.folder.file("s"));
  REQUIRE(scene.has_value());
  View view = Looking({5, 0.5, 0.5}, {0, 0.5, 0.5}, 64, 64);
  view.camera.ortho_height = 2;
  view.section.planes = {{{0.25, 0, 0}, {1, 0, 0}}};
  view.aov_mask = 1u << static_cast<int>(Aov::kDepth) | 1u << static_cast<int>(Aov::kNormal);
  auto selection = std::make_shared<PartSelection>();
  selection->closed = selection->inverted = NoParts(scene->store().part_count());
  for (uint32_t part = 0; closed && part < scene->store().part_count(); ++part) {
    AddPart(selection->closed, part);
    if (inverted) AddPart(selection->inverted, part);
  }
  selection->id = IdOf(*selection);
  view.parts.selection = selection;
  REQUIRE(NormalizeView(view).has_value());
  const auto renderer = Renderer::Create(*scene, {1 << 20, 1});
  REQUIRE(renderer.has_value());
  int capped = 0, inside = 0;
  const uint32_t words = WordsPerPixel(view.aov_mask);
  const auto on_tile = [&](size_t, const RenderedTile& tile, Renderer::Progress) {
    for (size_t at = 0; at + 4 * words <= tile.pixels.size(); at += 4 * words) {
      float values[8];
      std::memcpy(values, tile.pixels.data() + at, sizeof values);
      const float depth = values[4], normal_x = values[5];
      capped += std::fabs(depth - 4.75f) < 1e-5f && normal_x == 1;
      inside += std::fabs(depth - 5) < 1e-5f;
    }
  };
  REQUIRE((*renderer)->Render(view, TilesOf(view.crop), on_tile).has_value());
  // The cube covers a quarter of the picture.
  CHECK(capped == (closed ? 32 * 32 : 0));
  CHECK(inside == (closed ? 0 : 32 * 32));
}

TEST_CASE("Lines are drawn at edges, the same for any tiles, crops and lattices", "[reference][inside]") {
  const Cube cube(false);
  const auto scene = Scene::Open(cube.folder.file("s"));
  REQUIRE(scene.has_value());
  const auto renderer = Renderer::Create(*scene, {1 << 20, 2});
  REQUIRE(renderer.has_value());
  View view = Looking({3, 2, 2.5}, {0.5, 0.5, 0.5}, 96, 80);
  view.spp = 2;
  // The picture's words by pixel.
  const auto render = [&](const View& of, const std::vector<Tile>& tiles) {
    std::vector<std::array<uint32_t, kColorWords>> picture(size_t{of.width} * of.height);
    const auto on_tile = [&](size_t t, const RenderedTile& tile, Renderer::Progress) {
      const std::byte* from = tile.pixels.data();
      for (uint32_t y = 0; y < tiles[t].rows(); ++y)
        for (uint32_t x = 0; x < tiles[t].columns(); ++x, from += sizeof picture[0])
          std::memcpy(&picture[tiles[t].Y(y) * of.width + tiles[t].X(x)], from, sizeof picture[0]);
    };
    REQUIRE((*renderer)->Render(of, tiles, on_tile).has_value());
    return picture;
  };
  const auto plain = render(view, TilesOf(view.crop));
  view.edges = true;
  const auto lined = render(view, TilesOf(view.crop));
  int lines = 0;
  for (size_t i = 0; i < plain.size(); ++i) lines += plain[i] != lined[i];
  // Nine edges of a cube are seen, each some 30 pixels long.
  CHECK(lines > 150);
  CHECK(lines < 600);
  std::vector<Tile> small;
  for (uint32_t y = 0; y < view.height; y += 5)
    for (uint32_t x = 0; x < view.width; x += 7)
      small.push_back({{x, y, std::min(7u, view.width - x), std::min(5u, view.height - y)}});
  CHECK(render(view, small) == lined);
  std::vector<Tile> lattice;
  for (uint32_t phase = 0; phase < 4; ++phase)
    for (const PixelRect& pixels : {PixelRect{0, 0, 64, 80}, PixelRect{64, 0, 32, 80}})
      lattice.push_back({pixels, 2, phase % 2, phase / 2});
  CHECK(render(view, lattice) == lined);
  View cropped = view;
  cropped.crop = {40, 30, 21, 17};
  const auto part = render(cropped, TilesOf(cropped.crop));
  for (uint32_t y = 30; y < 47; ++y)
    for (uint32_t x = 40; x < 61; ++x) CHECK(part[y * view.width + x] == lined[y * view.width + x]);
}

}  // namespace quarry::test
