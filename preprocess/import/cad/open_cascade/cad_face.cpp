#include "preprocess/import/cad/open_cascade/cad_face.h"

#include <BRep_Tool.hxx>
#include <GeomLib.hxx>
#include <Geom_Plane.hxx>
#include <Geom_RectangularTrimmedSurface.hxx>
#include <Poly_Triangulation.hxx>
#include <algorithm>
#include <utility>

namespace quarry {
namespace {

bool IsPlane(Handle(Geom_Surface) surface) {
  if (const auto trimmed = Handle(Geom_RectangularTrimmedSurface)::DownCast(surface); !trimmed.IsNull())
    surface = trimmed->BasisSurface();
  return surface->IsKind(STANDARD_TYPE(Geom_Plane));
}

/// Calls put(i, content) for i from 1 to `count`, and sends the contents in messages of at most `most`
/// elements.
template <class Put>
void SendEach(int count, int most, CadMessage kind, CadOutput& out, Put put) {
  for (int begin = 1; begin <= count; begin += most) {
    ByteWriter content;
    for (int i = begin; i <= count && i < begin + most; ++i) put(i, content);
    out.Put(kind, content.bytes());
  }
}

void SendPoints(const Poly_Triangulation& mesh, const gp_Trsf& place, double scale, CadOutput& out) {
  SendEach(mesh.NbNodes(), kMostCadMessage / 24, CadMessage::kPoints, out, [&](int i, ByteWriter& content) {
    gp_Pnt point = mesh.Node(i);
    point.Transform(place);
    for (const double x : {point.X(), point.Y(), point.Z()}) content.Put(x * scale);
  });
}

/// The mean of the normals of the triangles about a point, weighted by their areas.
gp_Vec NormalOfTriangles(const Poly_Triangulation& mesh, int point) {
  gp_Vec sum(0, 0, 0);
  for (int t = 1; t <= mesh.NbTriangles(); ++t) {
    int a, b, c;
    mesh.Triangle(t).Get(a, b, c);
    if (a != point && b != point && c != point) continue;
    const gp_Pnt first = mesh.Node(a);
    sum += gp_Vec(first, mesh.Node(b)).Crossed(gp_Vec(first, mesh.Node(c)));
  }
  return sum;
}

/// The surface has no normal at a few points, as at the apex of a cone.
gp_Vec NormalAt(const Poly_Triangulation& mesh, const Handle(Geom_Surface) & surface, int point) {
  constexpr double kTolerance = 1e-7;  // where derivatives count as none, as elsewhere in the library
  gp_Dir direction;
  gp_Vec normal(0, 0, 0);
  if (GeomLib::NormEstim(surface, mesh.UVNode(point), kTolerance, direction) <= 1)
    normal = gp_Vec(direction);
  else
    normal = NormalOfTriangles(mesh, point);
  return normal.SquareMagnitude() > 0 ? normal.Normalized() : gp_Vec(0, 0, 1);
}

void SendNormals(const Poly_Triangulation& mesh, const Handle(Geom_Surface) & surface, const gp_Trsf& place,
                 bool reversed, CadOutput& out) {
  SendEach(mesh.NbNodes(), kMostCadMessage / 12, CadMessage::kNormals, out, [&](int i, ByteWriter& content) {
    gp_Vec normal = NormalAt(mesh, surface, i).Transformed(place).Normalized();
    if (reversed) normal.Reverse();
    for (const double x : {normal.X(), normal.Y(), normal.Z()}) content.Put(static_cast<float>(x));
  });
}

void SendTriangles(const Poly_Triangulation& mesh, bool turned, CadOutput& out) {
  SendEach(mesh.NbTriangles(), kMostCadMessage / 12, CadMessage::kTriangles, out,
           [&](int i, ByteWriter& content) {
             int a, b, c;
             mesh.Triangle(i).Get(a, b, c);
             if (turned) std::swap(b, c);
             for (const int corner : {a, b, c}) content.Put(static_cast<uint32_t>(corner - 1));
           });
}

}  // namespace

bool SendFace(const TopoDS_Face& face, const TopLoc_Location& place, double scale, uint32_t material,
              CadOutput& out) {
  TopLoc_Location of_face;
  const Handle(Poly_Triangulation) mesh = BRep_Tool::Triangulation(face, of_face);
  if (mesh.IsNull() || mesh->NbTriangles() == 0) return false;
  const gp_Trsf to_model = (place * of_face).Transformation();
  const bool reversed = face.Orientation() == TopAbs_REVERSED;
  ByteWriter begin;
  begin.Put(material);
  out.Put(CadMessage::kFace, begin.bytes());
  SendPoints(*mesh, to_model, scale, out);
  TopLoc_Location of_surface;
  const Handle(Geom_Surface)& surface = BRep_Tool::Surface(face, of_surface);
  if (!surface.IsNull() && !IsPlane(surface) && mesh->HasUVNodes())
    SendNormals(*mesh, surface, to_model, reversed, out);
  SendTriangles(*mesh, reversed != to_model.IsNegative(), out);
  return true;
}

}  // namespace quarry
