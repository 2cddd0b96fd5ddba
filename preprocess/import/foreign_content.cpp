#include "preprocess/import/foreign_content.h"

#include <algorithm>

#include "common/voxel/store_format.h"
#include "preprocess/import/text_number.h"

namespace quarry {
namespace {

using namespace std::string_view_literals;

struct Signature {
  std::string_view bytes, what, advice;
  bool may_be_read = false;
};

constexpr std::string_view kExport = "export it as glTF, OBJ or PLY from the program that made it";
constexpr std::string_view kMesh =
    "which has no surface to trace: make a mesh of it first (MeshLab or CloudCompare, say)";

/// What files begin with.
constexpr Signature kSignatures[] = {
    {"version https://git-lfs.github.com/"sv, "a Git LFS pointer, not the model",
     "run \"git lfs pull\" where it comes from"},
    {"\xFD"
     "7zXZ\0"sv,
     "packed by xz", "unpack it first: xz -d (gzip and zstd are unpacked here)"},
    {"\x04\x22\x4D\x18"sv, "packed by LZ4", "unpack it first: lz4 -d (gzip and zstd are unpacked here)"},
    {"7z\xBC\xAF\x27\x1C"sv, "a 7z archive", "unpack it, and give the model in it"},
    {"Rar!\x1A\x07"sv, "a RAR archive", "unpack it, and give the model in it"},
    {kStoreMagic, "a scene store already", "render it: quarry render STORE -o OUT.png"},
    {"#usda"sv, "a USD scene", kExport},
    {"PXR-USDC"sv, "a USD scene", kExport},
    {"Ogawa"sv, "an Alembic file", kExport},
    {"\x89HDF\r\n"sv, "an HDF5 file (Alembic, or data)", kExport},
    {"LASF"sv, "a LAS or LAZ point cloud", kMesh},
    {"ASTM-E57"sv, "an E57 point cloud", kMesh},
    {"# .PCD"sv, "a PCD point cloud", kMesh},
    {"# vtk DataFile"sv, "a VTK file",
     "write its surface as PLY or STL (ParaView: Extract Surface, Save Data)"},
    {"BLENDER"sv, "a Blender file", "export it as glTF or PLY from Blender", true},
    {"#VRML"sv, "a VRML file", kExport, true},
    {"#X3D"sv, "an X3D file", kExport, true},
    {"3D Geometry File Format"sv, "a Rhino file", kExport},
    {"AC10"sv, "an AutoCAD drawing (DWG)", kExport, true},
    {"\xD0\xCF\x11\xE0\xA1\xB1\x1A\xE1"sv, "a file of 3ds Max, SolidWorks or an office program", kExport},
    {"%PDF"sv, "a PDF document", kExport},
    {"\x89PNG"sv, "an image (PNG)", "give the model that it belongs to"},
    {"\xFF\xD8\xFF"sv, "an image (JPEG)", "give the model that it belongs to"},
    {"<!DOCTYPE html"sv, "a web page", "download the model itself"},
    {"<html"sv, "a web page", "download the model itself"},
    {"newmtl"sv, "a material library", "give the OBJ file that names it"},
};

ForeignContent Zip(std::string_view extension) {
  for (const std::string_view zipped : {".3mf", ".amf", ".zae", ".pk3"})
    if (EqualsIgnoringCase(extension, zipped)) return {};  // models that are zip archives; Assimp reads them
  if (EqualsIgnoringCase(extension, ".usdz")) return {"a USD scene", std::string(kExport)};
  return {"a zip archive", "unpack it, and give the model in it"};
}

}  // namespace

ForeignContent RecognizeForeign(std::string_view start, std::string_view extension) {
  if (start.starts_with("PK\3\4") || start.starts_with("PK\5\6")) return Zip(extension);
  if (start.starts_with("BZh") && start.substr(4).starts_with("1AY&SY"))
    return {"packed by bzip2", "unpack it first: bzip2 -d (gzip and zstd are unpacked here)"};
  if (start.size() > 262 && start.substr(257, 5) == "ustar")
    return {"a tar archive", "unpack it, and give the model in it"};
  if (start.starts_with("\xEF\xBB\xBF")) start.remove_prefix(3);
  while (!start.empty() && IsSpace(start.front())) start.remove_prefix(1);
  for (const Signature& s : kSignatures)
    if (s.bytes.size() <= start.size() && EqualsIgnoringCase(start.substr(0, s.bytes.size()), s.bytes))
      return {std::string(s.what), std::string(s.advice), s.may_be_read};
  const auto holds = [&](std::string_view text) { return start.find(text) != std::string_view::npos; };
  if (start.starts_with("ISO-10303-21"))
    return holds("'IFC")
               ? ForeignContent{"an IFC building model", "convert it to glTF or OBJ (IfcConvert)", true}
               : ForeignContent{"a STEP file, of exact surfaces",
                                "export triangles, as glTF, OBJ or STL, from a CAD program (FreeCAD, say)"};
  if (!start.starts_with('<')) return {};
  if (holds("<VTKFile"))
    return {"a VTK file", "write its surface as PLY or STL (ParaView: Extract Surface, Save Data)"};
  if (holds("<X3D")) return {"an X3D file", std::string(kExport), true};
  return {};
}

}  // namespace quarry
