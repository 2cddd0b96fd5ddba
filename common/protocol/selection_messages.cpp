#include "common/protocol/selection_messages.h"

#include <algorithm>
#include <utility>

#include "common/protocol/messages.h"
#include "common/protocol/wire_reading.h"

namespace quarry {
namespace {

void Append(const glm::dvec3& v, std::vector<double>& out) { out.insert(out.end(), {v.x, v.y, v.z}); }

glm::dvec3 VectorAt(const flatbuffers::Vector<double>& numbers, uint32_t at) {
  return {numbers.Get(at), numbers.Get(at + 1), numbers.Get(at + 2)};
}

tl::unexpected<Error> WrongSelection() {
  return Fail("received a selection of parts that is not well formed");
}

}  // namespace

std::unique_ptr<wire::SectionT> SectionToWire(const SectionCut& section) {
  if (section.empty()) return nullptr;
  auto w = std::make_unique<wire::SectionT>();
  if (section.has_box) {
    Append(section.lower, w->box);
    Append(section.upper, w->box);
  }
  for (const SectionPlane& plane : section.planes) {
    Append(plane.point, w->planes);
    Append(plane.normal, w->planes);
  }
  w->caps = section.caps;
  return w;
}

Status ReadSection(const wire::Section* w, SectionCut& section) {
  section = {};
  if (!w) return {};
  const size_t box = SizeOf(w->box()), planes = SizeOf(w->planes());
  if ((box != 0 && box != 6) || planes % 6 != 0 || planes > 6 * size_t{kMaxSectionPlanes})
    return Fail("received a section that is not well formed");
  section.has_box = box != 0;
  if (section.has_box) {
    section.lower = VectorAt(*w->box(), 0);
    section.upper = VectorAt(*w->box(), 3);
  }
  for (uint32_t i = 0; i < planes; i += 6)
    section.planes.push_back({VectorAt(*w->planes(), i), VectorAt(*w->planes(), i + 3)});
  section.caps = w->caps();
  return NormalizeSection(section);
}

std::unique_ptr<wire::PartListsT> PartListsToWire(const PartLists* lists) {
  if (!lists) return nullptr;
  auto w = std::make_unique<wire::PartListsT>();
  w->hide = lists->hide;
  w->has_only = lists->only.has_value();
  if (lists->only) w->only = *lists->only;
  for (const PartLists::Coloring& coloring : lists->colors) {
    auto c = std::make_unique<wire::PartColoringT>();
    c->parts = coloring.parts;
    if (coloring.color) c->color = {coloring.color->x, coloring.color->y, coloring.color->z};
    w->colors.push_back(std::move(c));
  }
  return w;
}

Result<std::shared_ptr<const PartLists>> ReadPartLists(const wire::PartLists& w, size_t message_bytes) {
  auto lists = std::make_shared<PartLists>();
  // A coloring takes more bytes than a text: texts that are shared by many of them are refused too.
  const size_t colorings = SizeOf(w.colors());
  size_t bytes = colorings * kLeastStringBytes;
  const auto read = [&](const auto* texts, std::vector<std::string>& out) {
    for (uint32_t i = 0; i < SizeOf(texts); ++i) bytes += kLeastStringBytes + texts->Get(i)->size();
    return bytes <= message_bytes && Read(texts, message_bytes, out);
  };
  if (colorings > kMostPartColors || !read(w.hide(), lists->hide)) return WrongSelection();
  if (w.has_only() && !read(w.only(), lists->only.emplace())) return WrongSelection();
  for (uint32_t i = 0; i < colorings; ++i) {
    const wire::PartColoring& c = *w.colors()->Get(i);
    PartLists::Coloring& coloring = lists->colors.emplace_back();
    glm::vec3 color;
    if (!read(c.parts(), coloring.parts)) return WrongSelection();
    if (SizeOf(c.color()) == 0) continue;
    if (!Read(c.color(), color)) return WrongSelection();
    coloring.color = color;
  }
  if (lists->empty() || (lists->only && lists->only->empty())) return WrongSelection();
  return lists;
}

Bytes Encode(const SelectionSetup& m) {
  wire::SelectionT w;
  w.id = m.id;
  w.hidden = m.hidden;
  for (const PartSelection::Shown shown : m.voxels) w.voxels.push_back(static_cast<uint8_t>(shown));
  w.closed = m.closed;
  w.inverted = m.inverted;
  for (const glm::vec3& color : m.colors) w.colors.insert(w.colors.end(), {color.x, color.y, color.z});
  w.color_of = m.color_of;
  return PackTable<wire::Selection>(w);
}

Result<SelectionSetup> DecodeSelection(std::span<const std::byte> table) {
  const auto* w = Root<wire::Selection>(table);
  const size_t colors = w ? SizeOf(w->colors()) : 0;
  if (!w || colors % 3 != 0 || colors / 3 > kMostPartColors) return WrongSelection();
  // The lists must not share bytes.
  const size_t words = SizeOf(w->hidden()) + SizeOf(w->closed()) + SizeOf(w->inverted());
  if (words * 8 + SizeOf(w->voxels()) + SizeOf(w->color_of()) * 2 > table.size()) return WrongSelection();
  SelectionSetup m;
  m.id = w->id();
  m.hidden = Copy(w->hidden());
  m.closed = Copy(w->closed());
  m.inverted = Copy(w->inverted());
  m.color_of = Copy(w->color_of());
  for (uint32_t i = 0; i < SizeOf(w->voxels()); ++i) {
    const uint8_t shown = w->voxels()->Get(i);
    if (shown > static_cast<uint8_t>(PartSelection::Shown::kNone)) return WrongSelection();
    m.voxels.push_back(static_cast<PartSelection::Shown>(shown));
  }
  for (uint32_t i = 0; i < colors; i += 3)
    m.colors.emplace_back(w->colors()->Get(i), w->colors()->Get(i + 1), w->colors()->Get(i + 2));
  if (m.id == 0) return WrongSelection();
  return m;
}

}  // namespace quarry
