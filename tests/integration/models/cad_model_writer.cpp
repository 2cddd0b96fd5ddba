#include "tests/integration/models/cad_model_writer.h"

#include <fmt/format.h>

#include <BRepAlgoAPI_Cut.hxx>
#include <BRepGProp.hxx>
#include <BRepPrimAPI_MakeBox.hxx>
#include <BRepPrimAPI_MakeCone.hxx>
#include <BRepPrimAPI_MakeCylinder.hxx>
#include <BRepPrimAPI_MakeSphere.hxx>
#include <BRepPrimAPI_MakeTorus.hxx>
#include <GProp_GProps.hxx>
#include <IGESCAFControl_Writer.hxx>
#include <IGESControl_Controller.hxx>
#include <Interface_Static.hxx>
#include <STEPCAFControl_Writer.hxx>
#include <TDataStd_Name.hxx>
#include <TDocStd_Document.hxx>
#include <TopExp_Explorer.hxx>
#include <XCAFApp_Application.hxx>
#include <XCAFDoc_ColorTool.hxx>
#include <XCAFDoc_DocumentTool.hxx>
#include <XCAFDoc_ShapeTool.hxx>
#include <algorithm>

namespace {

constexpr int kPartsOfRack = 100;

/// A solid in the file's unit; its volume depends on `i`.
TopoDS_Shape MakeShape(int i) {
  const double size = 4 + i % 7, more = 0.01 * i;
  switch (i % 5) {
    case 0: {
      const TopoDS_Shape block = BRepPrimAPI_MakeBox(size, size + more, 2 + more).Shape();
      const TopoDS_Shape hole =
          BRepPrimAPI_MakeCylinder(gp_Ax2(gp_Pnt(size / 2, size / 2, -1), gp_Dir(0, 0, 1)), size / 4,
                                   4 + more)
              .Shape();
      return BRepAlgoAPI_Cut(block, hole).Shape();
    }
    case 1:
      return BRepPrimAPI_MakeCylinder(0.5 + more, size).Shape();
    case 2:
      return BRepPrimAPI_MakeSphere(size / 2 + more).Shape();
    case 3:
      return BRepPrimAPI_MakeTorus(size / 2 + more, 0.5 + more / 8).Shape();
    default:
      return BRepPrimAPI_MakeCone(size / 2, 1 + more / 9, 3 + more).Shape();
  }
}

double VolumeOf(const TopoDS_Shape& shape) {
  GProp_GProps properties;
  BRepGProp::VolumeProperties(shape, properties);
  return properties.Mass();
}

/// sRGB of steps that survive rounding.
struct Color {
  int r, g, b;
  std::string text() const { return fmt::format("#{:02x}{:02x}{:02x}", r, g, b); }
  Quantity_Color quantity() const { return {r / 255.0, g / 255.0, b / 255.0, Quantity_TOC_sRGB}; }
};
Color ColorOf(int i) { return {40 + 17 * (i % 11), 30 + 20 * (i % 9), 60 + 10 * (i % 13)}; }
constexpr Color kOfFace{255, 0, 0}, kOfInstance{20, 200, 120};

class Writer {
 public:
  explicit Writer(const WantedAssembly& wanted) : wanted_(wanted) {
    XCAFApp_Application::GetApplication()->NewDocument("MDTV-XCAF", document_);
    XCAFDoc_ShapeTool::SetAutoNaming(false);
    shapes_ = XCAFDoc_DocumentTool::ShapeTool(document_->Main());
    colors_ = XCAFDoc_DocumentTool::ColorTool(document_->Main());
  }

  std::vector<WrittenPart> Run() {
    const TDF_Label root = shapes_->NewShape();
    TDataStd_Name::Set(root, "hall");
    for (int i = 0; i < wanted_.shapes; ++i) AddShape(i);
    for (int first = 0; first < wanted_.parts; first += kPartsOfRack) AddRack(root, first);
    shapes_->UpdateAssemblies();
    return std::move(parts_);
  }
  const Handle(TDocStd_Document) & document() const { return document_; }

 private:
  struct Shape {
    TDF_Label label;
    std::string name;
    double volume = 0;
    std::vector<std::string> colors;
    bool face = false;   ///< has a face of a colour of its own
    bool whole = false;  ///< and no other
  };

  void AddShape(int i) {
    const TopoDS_Shape shape = MakeShape(i);
    Shape to{shapes_->AddShape(shape, false), fmt::format("part {}", i), VolumeOf(shape), {}, i % 4 == 1};
    TDataStd_Name::Set(to.label, to.name.c_str());
    if (i % 3 > 0) {
      colors_->SetColor(to.label, ColorOf(i).quantity(), XCAFDoc_ColorSurf);
      to.colors.push_back(ColorOf(i).text());
    }
    if (to.face) {
      TopExp_Explorer face(shape, TopAbs_FACE);
      colors_->SetColor(shapes_->AddSubShape(to.label, face.Current()), kOfFace.quantity(),
                        XCAFDoc_ColorSurf);
      face.Next();
      to.whole = !face.More();
    }
    made_.push_back(std::move(to));
  }

  void AddRack(const TDF_Label& root, int first) {
    const TDF_Label rack = shapes_->NewShape();
    const std::string name = fmt::format("rack {}", first / kPartsOfRack);
    TDataStd_Name::Set(rack, name.c_str());
    std::vector<int> met(made_.size());
    for (int i = first; i < std::min(first + kPartsOfRack, wanted_.parts); ++i) {
      const size_t number = static_cast<size_t>(i) % made_.size();
      AddPart(rack, "hall/" + name, made_[number], i, ++met[number]);
    }
    gp_Trsf place;
    place.SetTranslation(gp_Vec(0, 0, 30.0 * first / kPartsOfRack));
    shapes_->AddComponent(root, rack, TopLoc_Location(place));
  }

  void AddPart(const TDF_Label& rack, const std::string& path, const Shape& shape, int i, int met) {
    gp_Trsf turn, place;
    turn.SetRotation(gp_Ax1(gp_Pnt(0, 0, 0), gp_Dir(1, 1, 0)), 0.1 * i);
    place.SetTranslation(gp_Vec(30.0 * (i % 10), 30.0 * (i / 10 % 10), 0));
    const TDF_Label component = shapes_->AddComponent(rack, shape.label, TopLoc_Location(place * turn));
    TDataStd_Name::Set(component, shape.name.c_str());
    WrittenPart part;
    part.path = path + "/" + shape.name + (met > 1 ? fmt::format(":{}", met) : "");
    part.volume = shape.volume;
    part.colors = shape.colors;
    if (i % 10 == 9) {
      colors_->SetColor(component, kOfInstance.quantity(), XCAFDoc_ColorSurf);
      part.colors = {kOfInstance.text()};
    }
    if (shape.whole) part.colors.clear();
    if (shape.face) part.colors.push_back(kOfFace.text());
    std::ranges::sort(part.colors);
    parts_.push_back(std::move(part));
  }

  const WantedAssembly& wanted_;
  Handle(TDocStd_Document) document_;
  Handle(XCAFDoc_ShapeTool) shapes_;
  Handle(XCAFDoc_ColorTool) colors_;
  std::vector<Shape> made_;
  std::vector<WrittenPart> parts_;
};

}  // namespace

std::vector<WrittenPart> WriteAssembly(const std::string& path, const WantedAssembly& wanted) {
  STEPCAFControl_Writer step;  // makes the parameters below known
  IGESControl_Controller::Init();
  Interface_Static::SetCVal("write.step.unit", wanted.unit.c_str());
  Interface_Static::SetCVal("write.iges.unit", wanted.unit.c_str());
  Writer writer(wanted);
  std::vector<WrittenPart> parts = writer.Run();
  if (!path.ends_with(".iges"))
    return step.Transfer(writer.document(), STEPControl_AsIs, wanted.apart ? "part" : nullptr) &&
                   step.Write(path.c_str()) == IFSelect_RetDone
               ? parts
               : std::vector<WrittenPart>();
  IGESCAFControl_Writer iges;
  if (!iges.Transfer(writer.document()) || !iges.Write(path.c_str())) parts.clear();
  return parts;
}
