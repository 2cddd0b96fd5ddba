#include "common/voxel/part_tree.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <functional>
#include <limits>
#include <numeric>
#include <random>
#include <string>
#include <vector>

#include "common/voxel/parts/part_path.h"
#include "common/voxel/store_reader.h"
#include "common/voxel/store_writer.h"
#include "tests/fuzz/store_mend.h"
#include "tests/support/stores/changed_store.h"
#include "tests/support/stores/small_store.h"
#include "tests/support/temporary_folder.h"

namespace quarry {
namespace {

using test::Changed;
using test::TemporaryFolder;

constexpr uint32_t kNone = PartTree::kNone;

/// Adds a part and returns its number.
uint32_t Add(PartTable& table, const std::string& name, uint32_t parent = kNone, uint64_t triangles = 0,
             uint32_t flags = 0) {
  ScenePart part;
  part.parent = parent;
  part.triangles = triangles;
  part.flags = flags;
  const auto number = static_cast<uint32_t>(table.names.size());
  if (triangles > 0) {
    part.lower = glm::vec3(static_cast<float>(number));
    part.upper = part.lower + glm::vec3(0.5f, 0.25f, 2);
  }
  table.names.push_back(name);
  table.facts.push_back(part);
  return number;
}

/// A plant: 0 plant, 1 hall/1, 2 valve, 3 valve #2, 4 a*b\c, 5 Pump, 6 plant 2.
PartTable Plant() {
  PartTable table;
  const uint32_t plant = Add(table, "plant"), hall = Add(table, "hall/1", plant, 3);
  Add(table, "valve", hall, 4, ScenePart::kClosed);
  Add(table, "valve #2", hall, 5, ScenePart::kClosed | ScenePart::kInsideOut);
  Add(table, "a*b\\c", plant, 6);
  Add(table, "Pump", plant);
  Add(table, "plant 2", kNone, 7);
  return table;
}

/// Writes a store of three voxels, whose triangles have the parts 2 and 3, 3, and 6 and 1.
void WriteParts(const std::string& path, const PartTable& table) {
  auto writer = StoreWriter::Create(path);
  REQUIRE(writer);
  const std::vector<std::vector<uint32_t>> parts{{2, 3}, {3, 3}, {6, 1}};
  for (const std::vector<uint32_t>& of_voxel : parts) {
    HotVoxel hot = test::TwoTriangles();
    hot.parts = of_voxel;
    EncodedVoxel voxel = EncodeVoxel(hot, nullptr);
    voxel.chained = &of_voxel != &parts.back();
    REQUIRE(writer->AddVoxel(voxel));
  }
  SceneMeta meta;
  meta.bounds_upper = meta.root_upper = glm::vec3(1);
  meta.padding = 1e-6f;
  meta.input_triangles = 25;
  meta.voxel_size = 4096;
  REQUIRE(writer->Finish(meta, {KdNode::Leaf(0, 1)}, {Material{"paint"}}, table));
}

std::shared_ptr<const PartTree> Tree(const PartTable& table) {
  const TemporaryFolder folder;
  {
    auto writer = StoreWriter::Create(folder.file("s"));
    REQUIRE(writer);
    REQUIRE(writer->AddVoxel(EncodeVoxel(test::TwoTriangles(), nullptr)));
    SceneMeta meta;
    meta.bounds_upper = meta.root_upper = glm::vec3(1);
    meta.input_triangles = 1000;
    REQUIRE(writer->Finish(meta, {KdNode::Leaf(0, 1)}, {Material{"paint"}}, table));
  }
  const auto store = StoreReader::Open(folder.file("s"));
  REQUIRE(store);
  const auto tree = PartTree::Read(*store);
  REQUIRE(tree);
  return *tree;
}

std::vector<uint32_t> Numbers(const std::vector<uint64_t>& bits, uint32_t parts) {
  std::vector<uint32_t> numbers;
  for (uint32_t part = 0; part < parts; ++part)
    if (bits[part / 64] >> part % 64 & 1) numbers.push_back(part);
  return numbers;
}

std::vector<uint32_t> Selected(const PartTree& tree, const std::vector<std::string>& paths) {
  const auto bits = tree.Resolve(paths);
  REQUIRE(bits);
  CHECK(bits->size() == (tree.size() + 63) / 64);
  return Numbers(*bits, tree.size());
}

std::string Refusal(const PartTree& tree, const std::string& path) {
  const auto bits = tree.Resolve(std::vector<std::string>{path});
  REQUIRE_FALSE(bits);
  CHECK(bits.error().kind == ErrorKind::kUsage);
  return bits.error().message;
}

using Lists = std::vector<std::vector<uint32_t>>;

}  // namespace

TEST_CASE("A store returns the tree of its parts and the parts of its voxels", "[parts]") {
  const TemporaryFolder folder;
  const PartTable table = Plant();
  WriteParts(folder.file("s"), table);
  CHECK(test::FaultOf(folder.file("s")).empty());
  const auto store = StoreReader::Open(folder.file("s"));
  REQUIRE(store);
  const auto read = PartTree::Read(*store);
  REQUIRE(read);
  const PartTree& tree = **read;
  CHECK(tree.has_tree());
  REQUIRE(tree.size() == 7);
  const std::vector<std::string> paths{
      "plant",      "plant/hall\\/1", "plant/hall\\/1/valve", "plant/hall\\/1/valve #2", "plant/a\\*b\\\\c",
      "plant/Pump", "plant 2"};
  for (uint32_t part = 0; part < tree.size(); ++part) {
    CHECK(tree[part] == table.facts[part]);
    CHECK(tree.name(part) == table.names[part]);
    CHECK(tree.Path(part) == paths[part]);
    CHECK(store->part_sections().Path(part) == paths[part]);
    CHECK(NamesOfPath(paths[part]).back() == table.names[part]);
    CHECK(Selected(tree, {paths[part]})[0] == part);
  }
  CHECK(store->part_sections().Path(7) == "");
  CHECK(tree.memory_bytes() < 7 * 98 + 100);

  CHECK(tree.total(0).triangles == 18);
  CHECK((tree.total(0).lower == glm::vec3(1) && tree.total(0).upper == glm::vec3(4.5f, 4.25f, 6)));
  CHECK(tree.total(1).triangles == 12);
  CHECK((tree.total(3).lower == glm::vec3(3) && tree.total(3).upper == glm::vec3(3.5f, 3.25f, 5)));
  CHECK((tree.total(5).triangles == 0 && tree.total(5).lower.x > tree.total(5).upper.x));

  CHECK(tree.child_count(kNone) == 2);
  CHECK(tree.Children(kNone, 0, 10) == std::vector<uint32_t>{0, 6});
  CHECK(tree.child_count(0) == 3);
  CHECK(tree.Children(0, 0, 2) == std::vector<uint32_t>{1, 4});
  CHECK(tree.Children(0, 2, 2) == std::vector<uint32_t>{5});
  CHECK(tree.Children(0, 3, ~0u).empty());
  CHECK(tree.Children(0, ~0u, ~0u).empty());
  CHECK(tree.Children(1, 0, 10) == std::vector<uint32_t>{2, 3});
  CHECK(tree.child_count(6) == 0);

  REQUIRE(store->has_parts_of_voxels());
  Lists lists;
  REQUIRE(store->ForEachVoxelParts([&](uint32_t voxel, std::span<const uint32_t> parts) {
    CHECK(voxel == lists.size());
    lists.emplace_back(parts.begin(), parts.end());
  }));
  CHECK(lists == Lists{{2, 3}, {3}, {1, 6}});
}

TEST_CASE("Parts are found by pieces of names and of paths", "[parts]") {
  const auto tree = Tree(Plant());
  const auto found = [&](std::string_view text, uint32_t from = 0, uint32_t count = 100) {
    const PartTree::Found f = tree->Find(text, from, count);
    CHECK(f.total >= f.parts.size());
    return f.parts;
  };
  using Parts = std::vector<uint32_t>;
  CHECK(found("VALVE") == Parts{2, 3});
  CHECK(found("pump") == Parts{5});
  CHECK(found("#2") == Parts{3});
  CHECK(found("lant") == Parts{0, 6});
  CHECK(found("plantp") == Parts{});  // not across names
  CHECK(found(std::string_view("valve\0", 6)) == Parts{});
  CHECK(found("").size() == 7);
  CHECK(tree->Find("a", 1, 2).parts == Parts{1, 2});
  CHECK(tree->Find("a", 1, 2).total == 6);
  CHECK(tree->Find("a", 9, 2).parts.empty());
  CHECK(found("ant/p") == Parts{5});
  CHECK(found("plant/") == Parts{1, 2, 3, 4, 5});
  CHECK(found("/VALVE") == Parts{2, 3});
  CHECK(found("plant/hall\\/1/val") == Parts{2, 3});
  CHECK(found("ll\\/1/v") == Parts{2, 3});
  CHECK(found("hall\\/1") == Parts{1});
  CHECK(found("plant/hall/1") == Parts{});
  CHECK(found("plant/all") == Parts{});
  CHECK(found("/") == Parts{1, 2, 3, 4, 5});
}

TEST_CASE("Paths select parts and all below them", "[parts]") {
  const auto tree = Tree(Plant());
  using Parts = std::vector<uint32_t>;
  CHECK(Selected(*tree, {}).empty());
  CHECK(Selected(*tree, {"plant"}) == Parts{0, 1, 2, 3, 4, 5});
  CHECK(Selected(*tree, {"plant/hall\\/1", "plant 2"}) == Parts{1, 2, 3, 6});
  CHECK(Selected(*tree, {"plant/hall\\/1/valve"}) == Parts{2});
  CHECK(Selected(*tree, {"*valve"}) == Parts{2});
  CHECK(Selected(*tree, {"*valve*"}) == Parts{2, 3});
  CHECK(Selected(*tree, {"plant/*"}) == Parts{1, 2, 3, 4, 5});
  CHECK(Selected(*tree, {"*"}) == Parts{0, 1, 2, 3, 4, 5, 6});
  CHECK(Selected(*tree, {"*/*/*"}) == Parts{2, 3});
  CHECK(Selected(*tree, {"*\\/*"}) == Parts{1, 2, 3});
  CHECK(Selected(*tree, {"*\\**"}) == Parts{4});
  CHECK(Selected(*tree, {"plant/a\\*b\\\\c"}) == Parts{4});
  CHECK(Selected(*tree, {"p*t*1/v*e"}) == Parts{2});
}

TEST_CASE("A path that names nothing is refused with the nearest path", "[parts]") {
  const auto tree = Tree(Plant());
  CHECK(Refusal(*tree, "plant/hall\\/1/vlave") ==
        "no part is named `plant/hall\\/1/vlave`; the nearest is `plant/hall\\/1/valve`");
  CHECK_THAT(Refusal(*tree, "plnt/pump"), Catch::Contains("the nearest is `plant/Pump`"));
  CHECK_THAT(Refusal(*tree, "*/vlave"), Catch::Contains("no part is named `*/vlave`"));
  CHECK_THAT(Refusal(*tree, ""), Catch::Contains("no part is named ``; the nearest is `plant`"));
  CHECK_THAT(Refusal(*tree, "plant 2/a/b"), Catch::Contains("the nearest is `plant 2`"));
  CHECK(Refusal(*tree, std::string(5000, 'x')).size() < 500);
  CHECK_THAT(Refusal(*Tree({}), "a"), Catch::Contains("the store has no parts"));
  const std::vector<std::string> many(PartTree::kMostPatterns + 1, "*");
  const auto refused = tree->Resolve(many);
  REQUIRE_FALSE(refused);
  CHECK_THAT(refused.error().message, Catch::Contains("more than 64 paths have a *"));
}

TEST_CASE("Parts of equal names, and without a name, keep their places", "[parts]") {
  PartTable table;
  const uint32_t root = Add(table, ""), twin = Add(table, "a"), other = Add(table, "a");
  const uint32_t child = Add(table, "x", root), first = Add(table, "b", twin),
                 second = Add(table, "b", other);
  const auto tree = Tree(table);
  CHECK(tree->Path(root).empty());
  CHECK(tree->Path(child) == "/x");
  CHECK(Selected(*tree, {""}) == std::vector<uint32_t>{root, child});
  CHECK(Selected(*tree, {"/x"}) == std::vector<uint32_t>{child});
  CHECK(Selected(*tree, {"a/b"}) == std::vector<uint32_t>{first, second});
}

namespace {

/// Whether a path given as characters, with the slashes between names as 256, matches a pattern with stars
/// as 257.
bool MatchesSlowly(std::span<const int> path, std::span<const int> pattern) {
  if (pattern.empty()) return path.empty();
  if (pattern[0] == 257)
    return MatchesSlowly(path, pattern.subspan(1)) ||
           (!path.empty() && MatchesSlowly(path.subspan(1), pattern));
  return !path.empty() && path[0] == pattern[0] && MatchesSlowly(path.subspan(1), pattern.subspan(1));
}

std::string Escaped(const std::vector<int>& letters) {
  std::string text;
  for (const int letter : letters) {
    if (letter == 256 || letter == 257) {
      text += letter == 256 ? '/' : '*';
    } else {
      AppendToPath(std::string(1, static_cast<char>(letter)), text, true);
    }
  }
  return text;
}

size_t EditsSlowly(const std::string& a, const std::string& b) {
  std::vector<size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), size_t{0});
  for (size_t i = 0; i < a.size(); ++i) {
    size_t before = row[0]++;
    for (size_t k = 0; k < b.size(); ++k) {
      const size_t here = std::min({before + (a[i] != b[k]), row[k] + 1, row[k + 1] + 1});
      before = std::exchange(row[k + 1], here);
    }
  }
  return row.back();
}

}  // namespace

TEST_CASE("Search and selection agree with a slow comparison of whole paths", "[parts]") {
  std::mt19937 random(5);
  const std::string letters = "aAb/*\\";
  const auto word = [&](size_t most) {
    std::string text;
    for (size_t n = random() % (most + 1); n > 0; --n) text += letters[random() % letters.size()];
    return text;
  };
  PartTable table;
  std::vector<std::vector<int>> paths;  // of the parts, in characters and slashes
  for (uint32_t i = 0; i < 300; ++i) {
    const uint32_t parent = i == 0 || random() % 4 == 0 ? kNone : static_cast<uint32_t>(random() % i);
    const std::string name = word(4);
    Add(table, name, parent);
    paths.push_back(parent == kNone ? std::vector<int>{} : paths[parent]);
    if (parent != kNone) paths.back().push_back(256);
    paths.back().insert(paths.back().end(), name.begin(), name.end());
  }
  const auto tree = Tree(table);
  int matched = 0, found_some = 0;
  for (int round = 0; round < 3000; ++round) {
    std::vector<int> pattern;
    for (const char c : word(5)) pattern.push_back(random() % 4 == 0 ? 256 : c);
    if (random() % 8 != 0)
      pattern.insert(pattern.begin() + static_cast<long>(random() % (pattern.size() + 1)), 257);
    if (random() % 2 != 0)
      pattern.insert(pattern.begin() + static_cast<long>(random() % (pattern.size() + 1)), 257);
    std::vector<bool> expected(tree->size());
    for (uint32_t part = 0; part < tree->size(); ++part)
      expected[part] = MatchesSlowly(paths[part], pattern) ||
                       (table.facts[part].parent != kNone && expected[table.facts[part].parent]);
    const auto bits = tree->Resolve(std::vector<std::string>{Escaped(pattern)});
    INFO(Escaped(pattern));
    const bool any = std::ranges::find(expected, true) != expected.end();
    REQUIRE(bits.has_value() == any);
    matched += any;
    for (uint32_t part = 0; any && part < tree->size(); ++part)
      REQUIRE(((*bits)[part / 64] >> part % 64 & 1) == expected[part]);

    // A piece of a path, with a slash: the paths that contain it, whatever the case.
    std::vector<int> piece;
    for (const char c : word(3)) piece.push_back(c);
    piece.insert(piece.begin() + static_cast<long>(random() % (piece.size() + 1)), 256);
    const auto lower = [](int c) { return c == 'A' ? 'a' : c; };
    const PartTree::Found found = tree->Find(Escaped(piece), 0, 1000);
    std::vector<uint32_t> containing;
    for (uint32_t part = 0; part < tree->size(); ++part)
      if (!std::ranges::search(paths[part], piece, {}, lower, lower).empty()) containing.push_back(part);
    INFO(Escaped(piece));
    REQUIRE(found.parts == containing);
    found_some += !containing.empty();

    const std::string a = word(40), b = word(40);
    REQUIRE(NameDistance(a).To(b) == EditsSlowly(a, b));
  }
  CHECK(matched > 1000);
  CHECK(found_some > 1000);
  CHECK(NameDistance(std::string(64, 'a')).To("") == 64);
}

TEST_CASE("A damaged tree of parts is refused", "[parts]") {
  const TemporaryFolder folder;
  WriteParts(folder.file("s"), Plant());
  const auto fault = [&](auto change) {
    Changed store(folder.file("s"));
    change(store, store.Begin(SectionType::kPartTree));
    fuzz::MendStore(std::as_writable_bytes(std::span(store.bytes)));
    const auto opened = store.Open();
    REQUIRE(opened);
    const auto tree = PartTree::Read(*opened);
    if (tree) return std::string();
    CHECK(tree.error().permanent());
    CHECK_FALSE(opened->Verify([](uint64_t, uint64_t) {}));
    return tree.error().message;
  };
  const float inf = std::numeric_limits<float>::infinity(), nan = std::numeric_limits<float>::quiet_NaN();
  CHECK(fault([](Changed&, uint64_t) {}).empty());
  for (const uint32_t parent : {2u, 3u, 6u, 7u, 0xFFFFFFFEu})
    CHECK_THAT(
        fault([&](Changed& s, uint64_t at) { s.Put(at + 2 * 40, parent); }),
        Catch::Contains("section PTRE") && Catch::Contains("the parent of part 2 does not come before"));
  for (const uint32_t flags : {2u, 4u, ~0u})
    CHECK_THAT(fault([&](Changed& s, uint64_t at) { s.Put(at + 2 * 40 + 4, flags); }),
               Catch::Contains("part 2 has unknown flags"));
  CHECK_THAT(fault([](Changed& s, uint64_t at) { s.Put(at + 4, 1u); }),
             Catch::Contains("part 0 has a surface without triangles"));
  CHECK_THAT(fault([](Changed& s, uint64_t at) { s.Put(at + 8, ~uint64_t{0}); }),
             Catch::Contains("more triangles than META states"));
  CHECK_THAT(fault([](Changed& s, uint64_t at) { s.Put(at + 6 * 40 + 8, uint64_t{8}); }),
             Catch::Contains("more triangles than META states"));
  for (const float lower : {inf, -inf, nan, 3.0f})
    CHECK_THAT(fault([&](Changed& s, uint64_t at) { s.Put(at + 2 * 40 + 16, lower); }),
               Catch::Contains("part 2 has an impossible box"));
  CHECK_THAT(fault([](Changed& s, uint64_t at) { s.Put(at + 28, 0.0f); }),
             Catch::Contains("part 0 has an impossible box"));
  CHECK_THAT(fault([](Changed& s, uint64_t) {
               const uint64_t entry = s.Entry(SectionType::kParts);
               const auto size = s.Get<uint64_t>(entry + 16);
               s.Put(entry + 16, size - 4);
               s.Put(entry + kSectionEntryBytes + 8, s.Get<uint64_t>(entry + kSectionEntryBytes + 8) - 4);
               s.Put(entry + kSectionEntryBytes + 16, s.Get<uint64_t>(entry + kSectionEntryBytes + 16) + 4);
             }),
             Catch::Contains("another number of parts than PART has"));
  // The path of one part, read alone.
  Changed store(folder.file("s"));
  store.Put(store.Begin(SectionType::kPartTree) + 2 * 40, uint32_t{2});
  fuzz::MendStore(std::as_writable_bytes(std::span(store.bytes)));
  const auto opened = store.Open();
  REQUIRE(opened);
  CHECK(opened->part_sections().Path(1) == "plant/hall\\/1");
  CHECK_FALSE(opened->part_sections().Path(2));
}

TEST_CASE("Parts lie at most 256 levels deep", "[parts]") {
  PartTable table;
  for (uint32_t i = 0; i < kMostPartLevels; ++i) Add(table, "level", i == 0 ? kNone : i - 1);
  CHECK(Tree(table)->Path(kMostPartLevels - 1).size() == kMostPartLevels * 6 - 1);
  Add(table, "deeper", kMostPartLevels - 1);
  const TemporaryFolder folder;
  WriteParts(folder.file("s"), table);
  const auto store = StoreReader::Open(folder.file("s"));
  REQUIRE(store);
  const auto tree = PartTree::Read(*store);
  REQUIRE_FALSE(tree);
  CHECK_THAT(tree.error().message, Catch::Contains("part 256 lies more than 256 levels deep"));
  CHECK_FALSE(store->part_sections().Path(kMostPartLevels));
}

TEST_CASE("Damaged lists of the voxels' parts are refused", "[parts]") {
  const TemporaryFolder folder;
  WriteParts(folder.file("s"), Plant());
  const auto fault = [&](std::vector<uint8_t> lists) {
    Changed store(folder.file("s"));
    const uint64_t at = store.Begin(SectionType::kVoxelParts);
    REQUIRE(store.Get<uint64_t>(store.Entry(SectionType::kVoxelParts) + 16) == 8);
    REQUIRE(lists.size() == 8);
    std::ranges::copy(lists, store.bytes.begin() + static_cast<long>(at));
    fuzz::MendStore(std::as_writable_bytes(std::span(store.bytes)));
    const auto opened = store.Open();
    REQUIRE(opened);
    const Status read = opened->ForEachVoxelParts([](uint32_t, std::span<const uint32_t>) {});
    const Status verified = opened->Verify([](uint64_t, uint64_t) {});
    CHECK((read || !verified));
    if (read) return verified ? std::string() : verified.error().message;
    CHECK(read.error().permanent());
    return read.error().message;
  };
  CHECK(fault({2, 2, 1, 1, 3, 2, 1, 5}).empty());
  CHECK_THAT(fault({0, 2, 1, 1, 3, 2, 1, 5}), Catch::Contains("another number of parts"));
  CHECK_THAT(fault({3, 2, 1, 1, 3, 2, 1, 5}), Catch::Contains("another number of parts"));
  CHECK_THAT(fault({2, 2, 0, 1, 3, 2, 1, 5}), Catch::Contains("parts out of order"));
  CHECK_THAT(fault({2, 2, 5, 1, 3, 2, 1, 5}), Catch::Contains("a part that does not exist"));
  CHECK_THAT(fault({2, 7, 1, 1, 3, 2, 1, 5}), Catch::Contains("a part that does not exist"));
  CHECK_THAT(fault({2, 0xFF, 0xFF, 0xFF, 0xFF, 0x1F, 1, 5}), Catch::Contains("more than 32 bits"));
  CHECK_THAT(fault({2, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 1, 5}), Catch::Contains("more than 32 bits"));
  CHECK_THAT(fault({1, 2, 1, 1, 1, 3, 1, 5}), Catch::Contains("bytes after the last voxel's list"));
  CHECK_THAT(fault({2, 2, 1, 2, 3, 1, 1, 0x85}), Catch::Contains("ends too early"));
  CHECK_THAT(fault({2, 2, 1, 1, 3, 2, 1, 4}), Catch::Contains("other parts than the VPRT section states"));
}

TEST_CASE("A voxel's list has each of its parts once, near together or far apart", "[parts]") {
  std::mt19937 random(3);
  for (int round = 0; round < 300; ++round) {
    const uint32_t first = random() >> random() % 32 >> 1, range = 1 + (random() >> random() % 32 >> 1);
    std::vector<uint32_t> parts(1 + random() % 300);
    for (uint32_t& part : parts)
      part = std::min(first + static_cast<uint32_t>(random()) % range, 0x7FFFFFFFu);
    const Bytes list = EncodePartList(parts);
    ByteReader in(list);
    const auto number = [&] {
      uint64_t value = 0;
      for (int shift = 0;; shift += 7) {
        const auto byte = in.Get<uint8_t>();
        value |= uint64_t{byte & 0x7Fu} << shift;
        if (byte < 0x80) return value;
      }
    };
    std::vector<uint32_t> got(number());
    uint64_t part = 0;
    for (uint32_t& g : got) g = static_cast<uint32_t>(part += number());
    CHECK(in.done());
    std::ranges::sort(parts);
    parts.erase(std::unique(parts.begin(), parts.end()), parts.end());
    REQUIRE(got == parts);
  }
}

TEST_CASE("A store of before, without sections of parts, has only roots", "[parts]") {
  const TemporaryFolder folder;
  WriteParts(folder.file("s"), Plant());
  Changed store(folder.file("s"));
  for (const SectionType type : {SectionType::kPartTree, SectionType::kVoxelParts})
    store.Put(store.Entry(type), uint32_t{0x58580000} + static_cast<uint32_t>(type) % 256);
  store.MendTable();
  const auto opened = store.Open();
  REQUIRE(opened);
  CHECK(opened->Verify([](uint64_t, uint64_t) {}));
  CHECK_FALSE(opened->has_parts_of_voxels());
  CHECK_FALSE(opened->part_sections().has_tree());
  CHECK(opened->part_sections().Path(2) == "valve");
  CHECK(opened->part_sections().Path(1) == "hall\\/1");
  const auto tree = PartTree::Read(*opened);
  REQUIRE(tree);
  CHECK_FALSE((*tree)->has_tree());
  CHECK((*tree)->child_count(kNone) == 7);
  CHECK((**tree)[2] == ScenePart{});
  CHECK(Selected(**tree, {"valve*"}) == std::vector<uint32_t>{2, 3});
}

TEST_CASE("Entries of parts that all name one long string are refused", "[parts]") {
  const TemporaryFolder folder;
  PartTable table;
  Add(table, std::string(4000, 'n'));
  for (int i = 0; i < 100; ++i) Add(table, "x");
  WriteParts(folder.file("s"), table);
  Changed store(folder.file("s"));
  const uint64_t at = store.Begin(SectionType::kParts);
  for (uint64_t i = 1; i < 101; ++i) store.Put(at + 4 * i, store.Get<uint32_t>(at));
  fuzz::MendStore(std::as_writable_bytes(std::span(store.bytes)));
  const auto opened = store.Open();
  REQUIRE(opened);
  const auto tree = PartTree::Read(*opened);
  REQUIRE_FALSE(tree);
  CHECK_THAT(tree.error().message, Catch::Contains("refer to more names than it has"));
}

}  // namespace quarry
