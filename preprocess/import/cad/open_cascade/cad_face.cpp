#include "preprocess/import/cad/open_cascade/cad_face.h"

#include <BRep_Tool.hxx>
#include <GeomLib.hxx>
#include <Geom_Plane.hxx>
#include <Geom_RectangularTrimmedSurface.hxx>
#include <Poly_Triangulation.hxx>
#include <TopoDS.hxx>
#include <algorithm>
#include <utility>
#include <vector>

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

/// The sum of the normals of the triangles about each point, weighted by their areas.
std::vector<gp_Vec> NormalsOfTriangles(const Poly_Triangulation& mesh) {
  std::vector<gp_Vec> sums(static_cast<size_t>(mesh.NbNodes()), gp_Vec(0, 0, 0));
  for (int t = 1; t <= mesh.NbTriangles(); ++t) {
    int corners[3];
    mesh.Triangle(t).Get(corners[0], corners[1], corners[2]);
    const gp_Pnt first = mesh.Node(corners[0]);
    const gp_Vec normal = gp_Vec(first, mesh.Node(corners[1])).Crossed(gp_Vec(first, mesh.Node(corners[2])));
    for (const int corner : corners) sums[static_cast<size_t>(corner - 1)] += normal;
  }
  return sums;
}

/// Keeps normals of the surface with the triangles, on their side. Where a surface has no normal, as at the
/// apex of a cone, the triangles' counts.
void ComputeNormals(Poly_Triangulation& mesh, const Handle(Geom_Surface) & surface) {
  constexpr double kTolerance = 1e-7;  // where derivatives count as none, as elsewhere in the library
  const std::vector<gp_Vec> of_triangles = NormalsOfTriangles(mesh);
  mesh.AddNormals();
  for (int i = 1; i <= mesh.NbNodes(); ++i) {
    const gp_Vec& of_triangle = of_triangles[static_cast<size_t>(i - 1)];
    gp_Dir direction;
    gp_Vec normal = of_triangle;
    if (GeomLib::NormEstim(surface, mesh.UVNode(i), kTolerance, direction) == 0) normal = direction;
    if (normal.Dot(of_triangle) < 0) normal.Reverse();
    const bool is_null = normal.SquareMagnitude() < 1e-200;
    mesh.SetNormal(i, is_null ? gp_Dir(0, 0, 1) : gp_Dir(normal));
  }
}

void SendNormals(const Poly_Triangulation& mesh, const gp_Trsf& place, bool reversed, CadOutput& out) {
  SendEach(mesh.NbNodes(), kMostCadMessage / 12, CadMessage::kNormals, out, [&](int i, ByteWriter& content) {
    gp_Vec normal = gp_Vec(mesh.Normal(i)).Transformed(place).Normalized();
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
  // The surface where the triangulation is: its own place within the face counts, that of the face does not.
  const Handle(Geom_Surface) surface = BRep_Tool::Surface(TopoDS::Face(face.Located(TopLoc_Location())));
  if (!surface.IsNull() && !IsPlane(surface) && mesh->HasUVNodes()) {
    if (!mesh->HasNormals()) ComputeNormals(*mesh, surface);
    SendNormals(*mesh, to_model, reversed, out);
  }
  // IGES gives mirrors whose scale is not negative.
  const bool mirrored = to_model.VectorialPart().Determinant() < 0;
  SendTriangles(*mesh, reversed != mirrored, out);
  return true;
}

}  // namespace quarry
