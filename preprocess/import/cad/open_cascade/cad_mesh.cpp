#include "preprocess/import/cad/open_cascade/cad_mesh.h"

#include <fmt/format.h>

#include <BRepBndLib.hxx>
#include <BRepMesh_IncrementalMesh.hxx>
#include <BRepTools.hxx>
#include <Bnd_Box.hxx>
#include <Standard_Failure.hxx>
#include <TopExp_Explorer.hxx>
#include <TopoDS.hxx>
#include <XCAFDoc_ShapeTool.hxx>
#include <algorithm>
#include <cmath>

#include "common/scene/material.h"
#include "preprocess/import/cad/open_cascade/cad_face.h"

namespace quarry {
namespace {

/// A linear deflection that is not seen in a picture of the whole model, 2,000 pixels wide.
constexpr double kDeflectionOfDiagonal = 1.0 / 2000;
/// Thirty sides make a circle: its area is 0.7 % too small.
constexpr double kAngle = 12;
constexpr double kRadians = 3.14159265358979323846 / 180;
/// Shortest edge of a triangle over the deflection. The library's own 0.1 makes squares of small holes.
constexpr double kShortest = 0.01;

/// `value` with two digits, for people.
double Rounded(double value) {
  const double step = std::pow(10.0, std::floor(std::log10(value)) - 1);
  return std::round(value / step) * step;
}

/// The box of an assembly's shapes in millimetres. Shapes that reach to infinity have none.
Bnd_Box BoxOf(const CadAssembly& assembly, const std::vector<TopoDS_Shape>& shapes) {
  std::vector<Bnd_Box> boxes(shapes.size());
  for (size_t i = 0; i < shapes.size(); ++i) try {
      BRepBndLib::Add(shapes[i], boxes[i], false);
    } catch (const Standard_Failure&) {  // a damaged shape; its triangles may be sound
      boxes[i].SetVoid();
    }
  Bnd_Box all;
  for (const CadInstance& instance : assembly.instances)
    if (const Bnd_Box& box = boxes[instance.definition]; !box.IsVoid() && !box.IsOpen())
      all.Add(box.Transformed(instance.place.Transformation()));
  return all;
}

}  // namespace

CadMesher::CadMesher(const CadDocument& document, const CadAssembly& assembly, CadDeflection deflection,
                     CadOutput& out)
    : document_(document), assembly_(assembly), deflection_(deflection), out_(out) {
  for (const TDF_Label& definition : assembly.definitions)
    shapes_.push_back({XCAFDoc_ShapeTool::GetShape(definition), 0, nullptr});
  for (const CadInstance& instance : assembly.instances) ++shapes_[instance.definition].uses;
}

bool CadMesher::Run() {
  SendFacts();
  const std::vector<CadInstance>& instances = assembly_.instances;
  for (size_t i = 0; i < instances.size(); ++i) {
    Shape& shape = shapes_[instances[i].definition];
    out_.Progress(kCadTransferred +
                  (1 - kCadTransferred) * static_cast<double>(i) / static_cast<double>(instances.size()));
    out_.Put(CadMessage::kPart, instances[i].part);
    if (!shape.styles) {
      shape.styles = std::make_unique<CadStyles>(assembly_.definitions[instances[i].definition], shape.shape);
      out_.Flush();  // a crash is blamed on the part
      Mesh(shape.shape);
      if (MemoryIsShort()) return false;
    }
    SendInstance(instances[i], shape);
    if (--shape.uses > 0) continue;
    BRepTools::Clean(shape.shape, true);
    shape.styles.reset();
    shape.shape.Nullify();
  }
  if (without_triangles_.count > 0 && MemoryIsShort(true)) return false;
  WarnOfLosses();
  ByteWriter content;
  content.Put(uint64_t{instances.size()});
  content.Put(faces_);
  out_.Put(CadMessage::kDone, content.bytes());
  return true;
}

void CadMesher::SendFacts() {
  std::vector<TopoDS_Shape> shapes;
  for (const Shape& shape : shapes_) shapes.push_back(shape.shape);
  const Bnd_Box box = BoxOf(assembly_, shapes);
  gp_Pnt low(0, 0, 0), high(1, 1, 1);
  if (!box.IsVoid()) low = box.CornerMin(), high = box.CornerMax();
  const double unit = document_.millimetres;
  if (deflection_.angle <= 0) deflection_.angle = kAngle;
  if (deflection_.linear <= 0)
    deflection_.linear = Rounded(std::max(low.Distance(high), 1e-3) / unit * kDeflectionOfDiagonal);
  ByteWriter content;
  for (int a = 1; a <= 3; ++a) content.Put((low.Coord(a) + high.Coord(a)) / 2 / unit);
  content.Put(deflection_.linear);
  content.Put(deflection_.angle);
  content.PutArray(document_.unit);
  out_.Put(CadMessage::kFacts, content.bytes());
}

void CadMesher::Mesh(const TopoDS_Shape& shape) const {
  IMeshTools_Parameters parameters;
  parameters.Deflection = deflection_.linear * document_.millimetres;
  parameters.Angle = deflection_.angle * kRadians;
  parameters.MinSize = kShortest * parameters.Deflection;
  parameters.InParallel = false;  // triangles in one order
  try {
    BRepMesh_IncrementalMesh(shape, parameters);
  } catch (const Standard_Failure&) {  // faces without triangles are counted
  }
}

void CadMesher::SendInstance(const CadInstance& instance, const Shape& shape) {
  bool any = false;
  for (TopExp_Explorer it(shape.shape, TopAbs_FACE); it.More(); it.Next()) {
    const TopoDS_Face& face = TopoDS::Face(it.Current());
    any = true;
    if (shape.styles->IsHidden(face)) {
      ++hidden_faces_;
      continue;
    }
    const uint32_t material = MaterialOf(shape.styles->ColorOf(face, instance));
    if (SendFace(face, instance.place, 1 / document_.millimetres, material, out_))
      ++faces_;
    else if (without_triangles_.count++ == 0)
      without_triangles_.part = instance.part;
  }
  if (!any && without_faces_.count++ == 0) without_faces_.part = instance.part;
}

uint32_t CadMesher::MaterialOf(const std::optional<Quantity_ColorRGBA>& color) {
  if (!color) return kNoIndex;
  const Quantity_Color& rgb = color->GetRGB();
  const std::array<float, 4> key{static_cast<float>(rgb.Red()), static_cast<float>(rgb.Green()),
                                 static_cast<float>(rgb.Blue()), color->Alpha()};
  const auto [it, is_new] = materials_.try_emplace(key, static_cast<uint32_t>(materials_.size()));
  if (is_new) {
    ByteWriter content;
    for (const float x : key) content.Put(x);
    out_.Put(CadMessage::kMaterial, content.bytes());
  }
  return it->second;
}

void CadMesher::WarnOfLosses() const {
  const auto where = [](const Loss& loss) {
    return loss.part.empty() ? std::string() : fmt::format(", the first in \"{}\"", loss.part);
  };
  if (without_triangles_.count > 0)
    out_.Put(CadMessage::kWarning,
             fmt::format("Open CASCADE makes no triangles of {} faces{}; they are left out",
                         without_triangles_.count, where(without_triangles_)));
  if (without_faces_.count > 0)
    out_.Put(CadMessage::kWarning,
             fmt::format("{} shapes have no faces (curves or points){}; they are left out",
                         without_faces_.count, where(without_faces_)));
  if (assembly_.too_deep > 0)
    out_.Put(CadMessage::kWarning,
             fmt::format("{} assemblies are nested below 256 others; they are left out", assembly_.too_deep));
  if (assembly_.hidden + hidden_faces_ > 0)
    out_.Put(CadMessage::kWarning, fmt::format("the file hides {} shapes and {} faces; they are left out",
                                               assembly_.hidden, hidden_faces_));
}

}  // namespace quarry
