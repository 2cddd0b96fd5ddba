#include "preprocess/import/threemf/structure.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <iterator>
#include <optional>
#include <string_view>
#include <tuple>

#include "preprocess/import/threemf/attribute_numbers.h"
#include "preprocess/import/threemf/package.h"
#include "preprocess/import/threemf/triangle_look.h"
#include "preprocess/import/threemf/xml_reader.h"

namespace quarry {
namespace {

constexpr double kMillimetre = 0.001;
constexpr size_t kMostText = 1024;  // bytes of a name that is kept; longer ones are cut

/// The length of a unit in metres; 0: no unit of 3MF.
double UnitInMetres(std::string_view unit) {
  constexpr std::pair<std::string_view, double> kUnits[] = {{"micron", 1e-6},     {"millimeter", kMillimetre},
                                                            {"centimeter", 0.01}, {"inch", 0.0254},
                                                            {"foot", 0.3048},     {"meter", 1}};
  for (const auto& [name, metres] : kUnits)
    if (unit == name) return metres;
  return 0;
}

std::string Kept(std::string_view name) { return std::string(name.substr(0, kMostText)); }

/// A use as the file states it: the object may come later, in this part or another.
struct Reference {
  uint32_t part, id;  ///< of the object
  uint32_t user;
  uint32_t user_part;
  glm::dmat4 transform;
};

/// Collects the structure of one part after the other.
class StructureReader final : public XmlHandler {
 public:
  StructureReader(ZipArchive& archive, ThreeMfStructure& structure, WarnOnce& warn)
      : archive_(archive), s_(structure), warn_(warn) {}

  void BeginPart(uint32_t part) {
    part_ = part;
    object_ = group_depth_ = skipped_ = depth_ = 0;
    in_object_ = in_mesh_ = in_build_ = false;
    prefixes_.clear();
    s_.parts[part].first_object = static_cast<uint32_t>(s_.objects.size());
    s_.parts[part].unit_in_metres = kMillimetre;
  }

  void Prefix(std::string_view prefix, std::string_view address) override {
    constexpr size_t kMostPrefixes = 1000;
    if (prefixes_.size() < kMostPrefixes && prefix.size() + address.size() < kMostText)
      prefixes_.emplace(prefix, address);
  }

  Status Start(XmlSpace space, std::string_view name, const XmlAttributes& a) override {
    ++depth_;
    if (skipped_ != 0) return {};
    if (depth_ == 1 && name != "model")
      return Fail(fmt::format("the part is not a model of 3MF: it begins with {}", Quoted(name)));
    if (space == XmlSpace::kCore || space == XmlSpace::kNone) return Core(name, a);
    if (space == XmlSpace::kMaterial) return OfMaterials(name, a);
    skipped_ = depth_;
    LeftOut(space, name);
    return {};
  }

  Status End(XmlSpace, std::string_view name) override {
    if (skipped_ == depth_) skipped_ = 0;
    if (group_depth_ == depth_) group_depth_ = 0;
    --depth_;
    if (skipped_ != 0) return {};
    if (in_mesh_ && name == "mesh") in_mesh_ = false;
    if (in_object_ && name == "object") in_object_ = false;
    if (in_build_ && name == "build") in_build_ = false;
    return {};
  }

  const std::vector<Reference>& references() const { return references_; }

 private:
  using Kind = ThreeMfProperties::Kind;

  Status Core(std::string_view name, const XmlAttributes& a) {
    if (in_mesh_ && name == "vertex") {
      ++Object().vertices;
    } else if (in_mesh_ && name == "triangle") {
      return Triangle(a);
    } else if (in_object_ && name == "mesh") {
      in_mesh_ = true;
    } else if (in_object_ && name == "component") {
      return Use("component", a, object_);
    } else if (in_build_ && name == "item") {
      return part_ == 0 ? Use("item", a, InstanceGraph::kBuild) : Status{};
    } else if (name == "object" && !in_object_) {
      return BeginObject(a);
    } else if (name == "basematerials") {
      return BeginGroup(a, Kind::kMaterials);
    } else if (name == "base" && group_depth_ != 0) {
      return Base(a);
    } else if (name == "build") {
      in_build_ = true;
    } else if (name == "model" && depth_ == 1) {
      return Model(a);
    }
    return {};
  }

  Status OfMaterials(std::string_view name, const XmlAttributes& a) {
    if (name == "colorgroup") return BeginGroup(a, Kind::kColors);
    if (name == "color" && group_depth_ != 0) {
      Rgba8 color;
      const char* const text = a.Find("color");
      if (text == nullptr || !ParseThreeMfColor(text, color))
        return Fail("a colour is written #RRGGBB or #RRGGBBAA");
      return s_.properties.AddColor(color);
    }
    if (depth_ != 3) return {};  // within an element that is left out
    warn_(fmt::format("{}: {} left out", archive_.path(), Quoted(name)));
    uint32_t id;
    const bool is_group =
        name == "texture2dgroup" || name == "compositematerials" || name == "multiproperties";
    if (is_group && ReadIndex(a.Find("id"), id)) return BeginGroup(a, Kind::kLeftOut);
    return {};
  }

  void LeftOut(XmlSpace space, std::string_view name) {
    if (space == XmlSpace::kTriangleSets) return;  // they name triangles, and change none
    if (space == XmlSpace::kBeamLattice)
      warn_(fmt::format("{}: beams of lattices left out", archive_.path()));
    else if (space == XmlSpace::kSlice)
      warn_(fmt::format("{}: slices left out", archive_.path()));
    else if (space == XmlSpace::kOther && depth_ > 2)
      warn_(fmt::format("{}: elements {} left out, of an extension that is not read", archive_.path(),
                        Quoted(name)));
  }

  Status Model(const XmlAttributes& a) {
    if (const char* const unit = a.Find("unit")) {
      const double metres = UnitInMetres(unit);
      if (metres == 0)
        warn_(fmt::format("{}: the unit {} is not one of 3MF; taken as millimetres", archive_.path(),
                          Quoted(unit)));
      else
        s_.parts[part_].unit_in_metres = metres;
    }
    const char* const required = a.Find("requiredextensions");
    TextCursor prefixes(required == nullptr ? "" : required);
    for (std::string_view prefix; !(prefix = prefixes.Word()).empty();) {
      const auto at = prefixes_.find(prefix);
      if (at == prefixes_.end() || SpaceOf(at->second) != XmlSpace::kOther) continue;
      return Fail(fmt::format("needs the extension {}, which is not read; export it without", at->second));
    }
    return {};
  }

  Status BeginObject(const XmlAttributes& a) {
    if (s_.objects.size() >= ThreeMfStructure::kMostObjects)
      return Fail(fmt::format("has more than {} objects", ThreeMfStructure::kMostObjects));
    ThreeMfStructure::Object object{part_, 0, {}};
    if (!ReadIndex(a.Find("id"), object.id)) return Fail("an object needs an id, a whole number");
    if (const char* const name = a.Find("name")) object.name = Kept(name);
    if (const char* const group = a.Find("pid")) {
      s_.uses_properties = true;
      if (!ReadIndex(group, object.group)) return Fail("a pid is a whole number");
    }
    if (const char* const index = a.Find("pindex"); index && !ReadIndex(index, object.index))
      return Fail("a pindex is a whole number");
    if (a.Find(XmlSpace::kSlice, "slicestackid") != nullptr) LeftOut(XmlSpace::kSlice, "");
    object_ = static_cast<uint32_t>(s_.objects.size());
    in_object_ = true;
    ++s_.parts[part_].objects;
    s_.objects.push_back(std::move(object));
    return {};
  }

  Status Triangle(const XmlAttributes& a) {
    ++Object().triangles;
    QUARRY_ASSIGN(const TriangleLook look, TriangleLook::Read(a));
    s_.uses_properties |= look.group != 0;
    if (look.differs()) ++Object().blended;
    return {};
  }

  Status BeginGroup(const XmlAttributes& a, Kind kind) {
    uint32_t id;
    if (!ReadIndex(a.Find("id"), id)) return Fail("a group of materials or colours needs an id");
    group_depth_ = kind == Kind::kLeftOut ? 0 : depth_;
    return s_.properties.BeginGroup(part_, id, kind);
  }

  Status Base(const XmlAttributes& a) {
    const char* const name = a.Find("name");
    const char* const text = a.Find("displaycolor");
    constexpr Rgba8 kGrey{231, 231, 231, 255};  // sRGB of the default material's
    Rgba8 color = kGrey;
    if (text != nullptr && !ParseThreeMfColor(text, color))
      return Fail("a displaycolor is written #RRGGBB or #RRGGBBAA");
    return s_.properties.AddMaterial(name == nullptr ? "" : Kept(name), color);
  }

  /// A component or an item of the build.
  Status Use(const char* kind, const XmlAttributes& a, uint32_t user) {
    if (references_.size() >= InstanceGraph::kMostUses)
      return Fail(fmt::format("has more than {} components and items", InstanceGraph::kMostUses));
    Reference r{part_, 0, user, part_, glm::dmat4(1)};
    if (!ReadIndex(a.Find("objectid"), r.id))
      return Fail(fmt::format("a {} needs an objectid, a whole number", kind));
    if (const char* const text = a.Find("transform"); text && !ReadTransform(text, r.transform))
      return Fail(fmt::format("the transform of a {} is not twelve numbers", kind));
    if (const char* const path = a.Find(XmlSpace::kProduction, "path")) {
      QUARRY_ASSIGN(r.part, PartAt(path));
    }
    references_.push_back(r);
    return {};
  }

  /// The number of a part, which is read later if it is new.
  Result<uint32_t> PartAt(const std::string& path) {
    if (const auto known = part_of_.find(path); known != part_of_.end()) return known->second;
    const std::optional<uint64_t> entry = FindPart(archive_, path);
    if (!entry || path.size() > kMostText) return Fail(fmt::format("{} is not in the archive", Quoted(path)));
    const auto same = std::ranges::find(s_.parts, *entry, &ThreeMfStructure::Part::entry);
    const auto part = static_cast<uint32_t>(same - s_.parts.begin());
    if (same == s_.parts.end()) s_.parts.push_back({*entry});
    part_of_.emplace(path, part);
    return part;
  }

  ThreeMfStructure::Object& Object() { return s_.objects[object_]; }

  ZipArchive& archive_;
  ThreeMfStructure& s_;
  WarnOnce& warn_;
  std::vector<Reference> references_;
  std::map<std::string, uint32_t> part_of_;                   ///< by path as written
  std::map<std::string, std::string, std::less<>> prefixes_;  ///< to addresses
  uint32_t part_ = 0, object_ = 0;
  int depth_ = 0, skipped_ = 0, group_depth_ = 0;  ///< depths of elements, from 1; 0: none
  bool in_object_ = false, in_mesh_ = false, in_build_ = false;
};

/// Makes the references uses in the graph. Errors: an object is not there, or there twice.
Status Link(const std::string& path, const std::vector<Reference>& references, ThreeMfStructure& s) {
  std::map<std::pair<uint32_t, uint32_t>, uint32_t> index;
  for (uint32_t i = 0; i < s.objects.size(); ++i)
    if (!index.emplace(std::pair(s.objects[i].part, s.objects[i].id), i).second)
      return Fail(fmt::format("{}: two objects have the id {}", path, s.objects[i].id));
  for (const Reference& r : references) {
    const auto object = index.find({r.part, r.id});
    if (object == index.end())
      return Fail(fmt::format("{}: {} shows object {}, which is not there", path,
                              r.user == InstanceGraph::kBuild
                                  ? std::string("the build")
                                  : fmt::format("object {}", s.objects[r.user].id),
                              r.id));
    const double ratio = s.parts[r.part].unit_in_metres / s.parts[r.user_part].unit_in_metres;
    glm::dmat4 transform = r.transform;
    if (r.part != r.user_part && ratio != 1)
      for (int row = 0; row < 3; ++row) transform[row] *= ratio;
    s.graph.Add({object->second, r.user, transform});
  }
  return {};
}

/// Errors: more instances than are read, or vertices or triangles than the scene can number.
Status CheckCounts(const std::string& path, const ThreeMfStructure& s) {
  constexpr double kMostElements = 4294967294.0;
  double instances = 0, vertices = 0, triangles = 0;
  for (uint32_t i = 0; i < s.objects.size(); ++i) {
    const ThreeMfStructure::Object& object = s.objects[i];
    if (object.triangles == 0) continue;
    const double count = s.graph.count(i);
    instances += count;
    vertices += count * (static_cast<double>(object.vertices) + 3 * static_cast<double>(object.blended));
    triangles += count * static_cast<double>(object.triangles);
  }
  if (instances > static_cast<double>(InstanceGraph::kMostInstances))
    return Fail(
        fmt::format("{}: shows its objects {:.0f} times in all, by components in components; at most "
                    "{} instances are read",
                    path, instances, InstanceGraph::kMostInstances));
  if (vertices > kMostElements || triangles > kMostElements)
    return Fail(
        fmt::format("{}: has {:.0f} vertices and {:.0f} triangles, all instances counted; at most "
                    "4,294,967,294 of each are read",
                    path, vertices, triangles));
  return {};
}

}  // namespace

Result<ThreeMfStructure> ReadThreeMfStructure(ZipArchive& archive, uint64_t model_part, WarnOnce& warn) {
  ThreeMfStructure s;
  s.parts.push_back({model_part});
  StructureReader reader(archive, s, warn);
  for (uint32_t part = 0; part < s.parts.size(); ++part) {
    reader.BeginPart(part);
    QUARRY_TRY(ReadXml(archive, s.parts[part].entry, reader));
  }
  const auto objects = static_cast<uint32_t>(s.objects.size());
  QUARRY_TRY(Link(archive.path(), reader.references(), s));
  if (!s.graph.IsShownByBuild() && objects != 0) {
    warn(fmt::format("{}: its build shows no object; all are shown", archive.path()));
    s.graph.ShowAll(objects);
  }
  if (const std::optional<uint32_t> endless = s.graph.Count(objects))
    return Fail(fmt::format("{}: object {} lies within itself, or more than {} components deep",
                            archive.path(), s.objects[*endless].id, InstanceGraph::kMostDepth));
  QUARRY_TRY(CheckCounts(archive.path(), s));
  if (s.properties.has_groups() && !s.uses_properties)
    warn(fmt::format("{}: has materials or colours that no object uses", archive.path()));
  return s;
}

}  // namespace quarry
