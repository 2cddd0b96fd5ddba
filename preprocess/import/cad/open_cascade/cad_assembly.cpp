#include "preprocess/import/cad/open_cascade/cad_assembly.h"

#include <fmt/format.h>

#include <NCollection_DataMap.hxx>
#include <Standard_GUID.hxx>
#include <TDF_LabelMap.hxx>
#include <TDF_LabelMapHasher.hxx>
#include <TDF_LabelSequence.hxx>
#include <TDataStd_Name.hxx>
#include <XCAFDoc_ColorTool.hxx>
#include <XCAFDoc_DocumentTool.hxx>
#include <XCAFDoc_ShapeTool.hxx>
#include <unordered_map>

namespace quarry {
namespace {

using Color = std::optional<Quantity_ColorRGBA>;
/// How often a name has been met among siblings.
using Siblings = std::unordered_map<std::string, size_t>;

std::string NameOf(const TDF_Label& label) {
  Handle(TDataStd_Name) name;
  if (!label.FindAttribute(TDataStd_Name::GetID(), name)) return {};
  return TCollection_AsciiString(name->Get()).ToCString();
}

/// Whether a name of an instance was made by a program: "NAUO12", "=>[0:1:1:4]", "12".
bool IsMade(std::string_view name) {
  if (name.starts_with("=>[")) return true;
  if (name.starts_with("NAUO")) name.remove_prefix(4);
  return name.find_first_not_of("0123456789") == name.npos;
}

/// The data that a node of the assembly passes on to the nodes below.
struct Above {
  TopLoc_Location place;
  std::string path;  ///< names, each ended by a zero
  Color color;
  int depth = 0;
};

class Walk {
 public:
  explicit Walk(const CadDocument& document)
      : colors_(XCAFDoc_DocumentTool::ColorTool(document.document->Main())),
        shapes_(XCAFDoc_DocumentTool::ShapeTool(document.document->Main())) {}

  CadAssembly Run() {
    TDF_LabelSequence roots;
    shapes_->GetFreeShapes(roots);
    Siblings siblings;
    for (const TDF_Label& root : roots) Visit(root, {}, siblings);
    return std::move(assembly_);
  }

 private:
  static constexpr int kMostDepth = 256;  // calls lie on the stack

  Color ColorOf(const TDF_Label& label) const {
    Quantity_ColorRGBA color;
    for (const XCAFDoc_ColorType type : {XCAFDoc_ColorSurf, XCAFDoc_ColorGen})
      if (colors_->GetColor(label, type, color)) return color;
    return {};
  }

  static std::string PathOf(const Above& above, std::string name, Siblings& siblings) {
    if (name.empty()) return above.path;
    if (const size_t before = siblings[name]++; before > 0) name += fmt::format(":{}", before + 1);
    return above.path + name + '\0';
  }

  void Visit(const TDF_Label& label, const Above& above, Siblings& siblings) {
    TDF_Label definition = label;
    const bool is_instance = XCAFDoc_ShapeTool::GetReferredShape(label, definition);
    std::string name = is_instance ? NameOf(label) : std::string();
    if (IsMade(name)) name = NameOf(definition);
    if (!colors_->IsVisible(label) || !colors_->IsVisible(definition)) {
      ++assembly_.hidden;
      return;
    }
    Above here;
    here.path = PathOf(above, std::move(name), siblings);
    here.depth = above.depth + 1;
    here.place = is_instance ? above.place * XCAFDoc_ShapeTool::GetLocation(label) : above.place;
    const Color own = is_instance ? ColorOf(label) : Color();
    if (!XCAFDoc_ShapeTool::IsAssembly(definition)) {
      assembly_.instances.push_back({NumberOf(definition), here.place, here.path, own, above.color});
      return;
    }
    if (here.depth >= kMostDepth) {
      ++assembly_.too_deep;
      return;
    }
    const Color of_definition = own ? own : ColorOf(definition);
    here.color = of_definition ? of_definition : above.color;
    TDF_LabelSequence components;
    XCAFDoc_ShapeTool::GetComponents(definition, components);
    Siblings below;
    for (const TDF_Label& component : components) Visit(component, here, below);
  }

  size_t NumberOf(const TDF_Label& definition) {
    if (const size_t* const known = numbers_.Seek(definition)) return *known;
    numbers_.Bind(definition, assembly_.definitions.size());
    assembly_.definitions.push_back(definition);
    return assembly_.definitions.size() - 1;
  }

  Handle(XCAFDoc_ColorTool) colors_;
  Handle(XCAFDoc_ShapeTool) shapes_;
  NCollection_DataMap<TDF_Label, size_t, TDF_LabelMapHasher> numbers_;
  CadAssembly assembly_;
};

}  // namespace

CadAssembly WalkAssembly(const CadDocument& document) { return Walk(document).Run(); }

}  // namespace quarry
