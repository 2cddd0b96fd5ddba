#include "preprocess/import/foreign/foreign_content.h"

#include <algorithm>

#include "common/voxel/store_header.h"
#include "preprocess/import/text/text_number.h"

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
constexpr std::string_view kUnpack = "unpack it, and give the model in it";
constexpr std::string_view kExact =
    "export triangles, as glTF, OBJ or STL, from a CAD program (FreeCAD, say)";
constexpr std::string_view kInstall =
    "install quarry-import-cad, which reads it (the package quarry-cad), or export triangles, as glTF, OBJ "
    "or STL, from a CAD "
    "program (FreeCAD, say)";
constexpr std::string_view kBuilding = "make triangles of it: IfcConvert FILE.ifc FILE.glb";
constexpr std::string_view kUsd = "open it in Blender (File, Import, USD), and export glTF";
constexpr std::string_view kKernel =
    "export glTF, or STEP, from the CAD program that made it, or convert it (CAD Exchanger, say)";
constexpr std::string_view kSurface =
    "write its surface as PLY or STL (ParaView: Extract Surface, Save Data)";
constexpr std::string_view kImage = "give the model that it belongs to";
constexpr std::string_view kVolume =
    "make a surface of it first, as PLY or STL (ParaView: Contour, Save Data; 3D Slicer)";

/// First bytes of known formats.
constexpr Signature kSignatures[] = {
    {"version https://git-lfs.github.com/"sv, "a Git LFS pointer, not the model",
     "run \"git lfs pull\" in its repository"},
    {"/annex/objects/"sv, "a git-annex pointer, not the model", "run \"git annex get\" in its repository"},
    {"\x1F\x8B"sv, "packed twice", "unpack it once: gzip -d"},
    {"\x28\xB5\x2F\xFD"sv, "packed twice", "unpack it once: zstd -d"},
    {"\x1F\x9D"sv, "packed by compress", "unpack it first: gzip -d (gzip and zstd are unpacked here)"},
    {"\x5D\0\0"sv, "packed by LZMA", "unpack it first: xz -d (gzip and zstd are unpacked here)"},
    {"LZIP"sv, "packed by lzip", "unpack it first: lzip -d (gzip and zstd are unpacked here)"},
    {"\xFD"
     "7zXZ\0"sv,
     "packed by xz", "unpack it first: xz -d (gzip and zstd are unpacked here)"},
    {"\x04\x22\x4D\x18"sv, "packed by LZ4", "unpack it first: lz4 -d (gzip and zstd are unpacked here)"},
    {"\x02\x21\x4C\x18"sv, "packed by LZ4", "unpack it first: lz4 -d (gzip and zstd are unpacked here)"},
    {"7z\xBC\xAF\x27\x1C"sv, "a 7z archive", kUnpack},
    {"Rar!\x1A\x07"sv, "a RAR archive", kUnpack},
    {"MSCF\0\0\0\0"sv, "a CAB archive", kUnpack},
    {kStoreMagic, "a scene store already", "render it: quarry render STORE -o OUT.png"},
    {"#usda"sv, "a USD scene", kUsd},
    {"PXR-USDC"sv, "a USD scene", kUsd},
    {"Ogawa"sv, "an Alembic file", kExport},
    {"\x89HDF\r\n"sv, "an HDF5 file (Alembic, or data)", kExport},
    {"LASF"sv, "a LAS or LAZ point cloud", kMesh},
    {"ASTM-E57"sv, "an E57 point cloud", kMesh},
    {"# .PCD"sv, "a PCD point cloud", kMesh},
    {"NGSP"sv, "a file of Gaussian splats (SPZ)", kMesh},
    {"b3dm"sv, "a tile of 3D Tiles (b3dm)", "take the GLB out of it: npx 3d-tiles-tools b3dmToGlb"},
    {"i3dm"sv, "a tile of 3D Tiles (i3dm)", "take the GLB out of it: npx 3d-tiles-tools i3dmToGlb"},
    {"cmpt"sv, "a composite tile of 3D Tiles", "take the GLBs out of it: npx 3d-tiles-tools cmptToGlb"},
    {"pnts"sv, "a tile of 3D Tiles that is a point cloud", kMesh},
    {"# vtk DataFile"sv, "a VTK file", kSurface},
    {"$MeshFormat"sv, "a Gmsh mesh", "write its surface as STL or PLY (gmsh FILE -0 -o OUT.stl)"},
    {"MeshVersionFormatted"sv, "a Medit mesh", "write its surface as STL, OBJ or PLY (meshio convert)"},
    {"ncols"sv, "a grid of heights", "make a mesh of it first (QGIS or gdal2xyz and MeshLab, say)"},
    {"DRACO"sv, "a mesh packed by Draco", "unpack it first: draco_decoder -i FILE -o OUT.ply"},
    {"OCTM"sv, "an OpenCTM mesh", "convert it to PLY or OBJ (MeshLab, ctmconv)"},
    {"BLENDER"sv, "a Blender file", "export it as glTF or PLY from Blender", true},
    {"QC4DC4D6"sv, "a Cinema 4D file", kExport},
    {"\xFF\xFE\xFF\x0ES\0k\0"sv, "a SketchUp file", kExport},
    {"SketchUp"sv, "a SketchUp file", kExport},
    {"//Maya ASCII"sv, "a Maya scene", kExport},
    {"#VRML"sv, "a VRML file", kExport, true},
    {"#X3D"sv, "an X3D file", kExport, true},
    {"3D Geometry File Format"sv, "a Rhino file", kExport},
    {"AC10"sv, "an AutoCAD drawing (DWG)", kExport, true},
    {"\xD0\xCF\x11\xE0\xA1\xB1\x1A\xE1"sv, "a file of 3ds Max, SolidWorks or an office program", kExport},
    {"(DWF V"sv, "an Autodesk drawing (DWF)", kExport},
    {"#Inventor V"sv, "an Open Inventor file", kExport},
    {"\xA1nrm"sv, "an OpenSceneGraph file", "convert it to OBJ or PLY (osgconv)"},
    {"#Ascii Scene"sv, "an OpenSceneGraph file", "convert it to OBJ or PLY (osgconv)"},
    {"MATLAB 5.0"sv, "a file of MATLAB", "write it as a model with faces first (stlwrite)"},
    {"\x08\x09\xFE\x02"sv, "a MicroStation drawing (DGN)", kExport},
    {"**ABCDEFGHIJKLMNOPQRSTUVWXYZ"sv, "a Parasolid file, of exact surfaces", kKernel},
    {"PS\0\0\0"sv, "a Parasolid file, of exact surfaces", kKernel},
    {"DBRep_DrawableShape"sv, "a BREP file, of exact surfaces", kExact},
    {"CASCADE Topology"sv, "a BREP file, of exact surfaces", kExact},
    {"ACIS BinaryFile"sv, "an ACIS file, of exact surfaces", kExact},
    {"V5_CFV2"sv, "a CATIA file, of exact surfaces", kExact},
    {"#UGC:2"sv, "a Creo file, of exact surfaces", kExact},
    {"U3D\0"sv, "a U3D file", kExport},
    {"\xC1\x83\x2A\x9E"sv, "an asset of Unreal", kExport},
    {"%YAML"sv, "a YAML file (an asset of Unity, say)", kExport},
    {"UnityFS"sv, "an asset of Unity", kExport},
    {"%PDF"sv, "a PDF document", kExport},
    {"\x89PNG"sv, "an image (PNG)", kImage},
    {"\xFF\xD8\xFF"sv, "an image (JPEG)", kImage},
    {"\x76\x2F\x31\x01"sv, "an image (EXR)", kImage},
    {"#?RADIANCE"sv, "an image (HDR)", kImage},
    {"#?RGBE"sv, "an image (HDR)", kImage},
    {"II*\0"sv, "an image (TIFF)", kImage},
    {"MM\0*\0\0\0\x08"sv, "an image (TIFF)", kImage},
    {"GIF8"sv, "an image (GIF)", kImage},
    {"DDS \x7C"sv, "an image (DDS)", kImage},
    {"\xABKTX "sv, "an image (KTX)", kImage},
    {"8BPS"sv, "an image (PSD)", kImage},
    {" BDV"sv, "an OpenVDB volume", kVolume},
    {"\x93NUMPY"sv, "a NumPy array", "write it as a model with faces first (trimesh, meshio, Open3D)"},
    {"\x7F"
     "ELF"sv,
     "a program", "give a model"},
    {"MZ\x90"sv, "a program", "give a model"},
    {"<!DOCTYPE html"sv, "a web page", "download the model itself"},
    {"<html"sv, "a web page", "download the model itself"},
};

/// Extensions of files whose first bytes are not enough.
constexpr Signature kExtensions[] = {
    {".splat"sv, "a file of Gaussian splats", kMesh},
    {".ksplat"sv, "a file of Gaussian splats", kMesh},
    {".pcd"sv, "a PCD point cloud", kMesh},
    {".ptx"sv, "a PTX point cloud", kMesh},
    {".skp"sv, "a SketchUp file", kExport},
    {".rvt"sv, "a Revit file", kExport},
    {".rfa"sv, "a Revit file", kExport},
    {".max"sv, "a 3ds Max file", kExport},
    {".sldprt"sv, "a SolidWorks file", kExact},
    {".sldasm"sv, "a SolidWorks file", kExact},
    {".ipt"sv, "an Inventor file", kExact},
    {".iam"sv, "an Inventor file", kExact},
    {".dgn"sv, "a MicroStation drawing (DGN)", kExport},
    {".c4d"sv, "a Cinema 4D file", kExport},
    {".jt"sv, "a JT file, of a CAD program", kKernel},
    {".x_t"sv, "a Parasolid file, of exact surfaces", kKernel},
    {".x_b"sv, "a Parasolid file, of exact surfaces", kKernel},
    {".ifczip"sv, "an IFC building model, packed", kBuilding},
    {".ifcxml"sv, "an IFC building model", kBuilding},
    {".sat"sv, "an ACIS file, of exact surfaces", kExact},
    {".sab"sv, "an ACIS file, of exact surfaces", kExact},
    {".scad"sv, "a program of OpenSCAD", "let it write an STL first: openscad FILE -o OUT.stl"},
    {".prc"sv, "a PRC file", kExport},
    {".fcstd"sv, "a FreeCAD file", kExact},
    {".f3d"sv, "a Fusion 360 file", kExact},
    {".f3z"sv, "a Fusion 360 file", kExact},
    {".dwfx"sv, "an Autodesk drawing (DWF)", kExport},
    {".slpk"sv, "an I3S scene layer", kExport},
    {".sldlfp"sv, "a SolidWorks file", kExact},
    {".bdf"sv, "a mesh of finite elements", "write its surface as STL or PLY (meshio convert)"},
    {".inp"sv, "a mesh of finite elements", "write its surface as STL or PLY (meshio convert)"},
    {".gcode"sv, "a program for a printer (G-code)", "give the model from which it was made"},
};

/// Extensions of models that Quarry reads, whatever they hold.
bool IsOfModel(std::string_view extension) {
  constexpr std::string_view kModels[] = {".ply", ".obj",  ".stl", ".off", ".nff",
                                          ".aff", ".gltf", ".glb", ".3mf"};
  return std::ranges::any_of(kModels,
                             [&](std::string_view known) { return EqualsIgnoringCase(extension, known); });
}

std::string_view AfterSpaces(std::string_view text) {
  while (!text.empty() && IsSpace(text.front())) text.remove_prefix(1);
  return text;
}

/// The text after lines that are blank or begin with '#'.
std::string_view AfterComments(std::string_view text) {
  for (text = AfterSpaces(text); text.starts_with('#'); text = AfterSpaces(text))
    text.remove_prefix(std::min(text.size(), text.find_first_of("\r\n")));
  return text;
}

/// The text after XML comments.
std::string_view AfterXmlComments(std::string_view text) {
  for (size_t end; text.starts_with("<!--") && (end = text.find("-->")) != text.npos;)
    text = AfterSpaces(text.substr(end + 3));
  return text;
}

/// Whether the first lines are rows of at least three numbers, all equally long. The first line may be a
/// count or name the columns; the last may be cut.
bool IsTableOfNumbers(std::string_view text) {
  size_t rows = 0, columns = 0, other = 0;
  text = AfterComments(text);
  while (rows + other < 10 && !text.empty()) {
    const std::string_view line = text.substr(0, text.find_first_of("\r\n"));
    if (line.size() == text.size() && rows > 1) break;
    text = AfterSpaces(text.substr(line.size()));
    std::string spaced(line);
    std::ranges::replace_if(
        spaced, [](char c) { return c == ',' || c == ';'; }, ' ');
    TextCursor cursor(spaced);
    size_t numbers = 0;
    double value;
    while (!cursor.AtEnd() && ParseReal(cursor, value)) ++numbers;
    const bool row = cursor.AtEnd() && numbers >= 3 && (rows == 0 || numbers == columns);
    if (!row && (rows != 0 || ++other > 1)) return false;
    if (!row) continue;
    columns = numbers;
    ++rows;
  }
  return rows >= 2;
}

/// Whether columns 73 on of the first line are S and a number, as in IGES's 80-column lines.
bool IsIges(std::string_view start) {
  return start.size() >= 80 && start[72] == 'S' && start.substr(0, 72).find('\n') == start.npos &&
         AfterSpaces(start.substr(73, 7)).find_first_not_of("0123456789 ") == start.npos;
}

ForeignContent Content(const Signature& s) {
  return {std::string(s.what), std::string(s.advice), s.may_be_read};
}

/// Recognises formats by bytes other than the first.
ForeignContent Within(std::string_view start) {
  const auto at = [&](size_t place, std::string_view bytes) {
    return start.size() >= place + bytes.size() && start.substr(place, bytes.size()) == bytes;
  };
  if (at(0, "BZh") && at(4, "1AY&SY"))
    return {"packed by bzip2", "unpack it first: bzip2 -d (gzip and zstd are unpacked here)"};
  if (at(257, "ustar")) return {"a tar archive", std::string(kUnpack)};
  const bool is_xml = at(2, "<\0"sv) || at(2, "\0<"sv);  // which Assimp reads in UTF-16, too
  if ((at(0, "\xFF\xFE") && !at(2, "\xFF\x0E")) || at(0, "\xFE\xFF"))
    return {"text in UTF-16", "write it as UTF-8: iconv -f UTF-16 -t UTF-8", is_xml};
  if (at(0, "RIFF") && at(8, "WEBP")) return {"an image (WebP)", std::string(kImage)};
  if (at(4, "ftyp")) return {"a video, or an image (HEIF, AVIF)", std::string(kImage)};
  if (at(128, "DICM")) return {"a DICOM volume or image", std::string(kVolume)};
  if (at(344, "n+1"sv) || at(344, "ni1"sv)) return {"a NIfTI volume", std::string(kVolume)};
  if (at(0, "FOR") && start.substr(0, 64).find("MAYA") != start.npos)
    return {"a Maya scene", std::string(kExport)};
  if (at(0, "Version ") && start.substr(0, 80).find(" JT ") != start.npos)
    return {"a JT file, of a CAD program", std::string(kKernel)};
  if (IsIges(start))
    return {"an IGES file, of exact surfaces", std::string(kInstall), false, CadFormat::kIges};
  return {};
}

ForeignContent Zip(std::string_view extension) {
  for (const std::string_view zipped : {".3mf", ".amf", ".zae", ".pk3"})
    if (EqualsIgnoringCase(extension, zipped)) return {};  // models that are zip archives
  if (EqualsIgnoringCase(extension, ".usdz")) return {"a USD scene", std::string(kUsd)};
  return {"a zip archive", "unpack it, and give the model in it"};
}

}  // namespace

ForeignContent RecognizeForeign(std::string_view start, std::string_view extension) {
  if (start.starts_with("ply")) return {};
  for (const Signature& s : kExtensions)
    if (EqualsIgnoringCase(extension, s.bytes)) return Content(s);
  for (const char* zip : {"PK\3\4", "PK\5\6", "PK\7\x8"})
    if (start.starts_with(zip)) return Zip(extension);
  if (ForeignContent content = Within(start); !content.what.empty()) return content;
  if (start.starts_with("\xEF\xBB\xBF")) start.remove_prefix(3);
  const std::string_view text = AfterXmlComments(AfterSpaces(start));
  for (const std::string_view begun : {start, text})
    for (const Signature& s : kSignatures)
      if (s.bytes.size() <= begun.size() && EqualsIgnoringCase(begun.substr(0, s.bytes.size()), s.bytes))
        return Content(s);
  if (const std::string_view library = AfterComments(text);
      library.size() > 6 && EqualsIgnoringCase(library.substr(0, 6), "newmtl"))
    return {kMaterialLibrary, "give the OBJ file that names it"};
  const auto holds = [&](std::string_view word) { return text.find(word) != std::string_view::npos; };
  if (text.starts_with("ISO-10303-21"))
    return holds("'IFC") ? ForeignContent{"an IFC building model", std::string(kBuilding), true}
                         : ForeignContent{"a STEP file, of exact surfaces", std::string(kInstall), false,
                                          CadFormat::kStep};
  // OFF may begin like a table.
  if (!IsOfModel(extension) && IsTableOfNumbers(text))
    return {"a table of numbers (a point cloud, or a grid of heights)", std::string(kMesh), true};
  if (!text.starts_with('<')) return {};
  if (holds("<VTKFile")) return {"a VTK file", std::string(kSurface)};
  if (holds("<X3D")) return {"an X3D file", std::string(kExport), true};
  if (holds("<html") || holds("<HTML")) return {"a web page", "download the model itself"};
  if (!IsOfModel(extension)) return {};
  return {"an XML file of a kind that is not known", "give the model itself, or " + std::string(kExport),
          true};
}

}  // namespace quarry
