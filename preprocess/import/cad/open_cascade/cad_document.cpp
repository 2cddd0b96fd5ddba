#include "preprocess/import/cad/open_cascade/cad_document.h"

#include <fmt/format.h>

#include <IGESCAFControl_Reader.hxx>
#include <IGESData_GlobalSection.hxx>
#include <IGESData_IGESModel.hxx>
#include <Interface_Static.hxx>
#include <Message_ProgressIndicator.hxx>
#include <Message_ProgressScope.hxx>
#include <STEPCAFControl_Reader.hxx>
#include <STEPConstruct_ExternRefs.hxx>
#include <TColStd_SequenceOfAsciiString.hxx>
#include <TCollection_HAsciiString.hxx>
#include <XCAFApp_Application.hxx>
#include <XCAFDoc_DocumentTool.hxx>
#include <XCAFDoc_ShapeTool.hxx>
#include <algorithm>
#include <cctype>
#include <fstream>
#include <streambuf>
#include <vector>

namespace quarry {
namespace {

/// Reports the share of a file that has been read.
class ReportingFile : public std::streambuf {
 public:
  ReportingFile(const std::string& path, CadOutput& out) : out_(out), buffer_(1 << 18) {
    file_.open(path, std::ios::binary | std::ios::ate);
    size_ = std::max<double>(1, static_cast<double>(file_.tellg()));
    file_.seekg(0);
  }
  bool is_open() const { return file_.is_open(); }

 protected:
  int_type underflow() override {
    file_.read(buffer_.data(), static_cast<std::streamsize>(buffer_.size()));
    const std::streamsize n = file_.gcount();
    if (n <= 0) return traits_type::eof();
    done_ += static_cast<double>(n);
    out_.Progress(kCadRead * std::min(1.0, done_ / size_));
    setg(buffer_.data(), buffer_.data(), buffer_.data() + n);
    return traits_type::to_int_type(buffer_[0]);
  }

 private:
  CadOutput& out_;
  std::ifstream file_;
  std::vector<char> buffer_;
  double size_ = 1, done_ = 0;
};

/// Reports the share of a file's entities that have become shapes.
class TransferProgress : public Message_ProgressIndicator {
 public:
  explicit TransferProgress(CadOutput& out) : out_(out) {}

 protected:
  void Show(const Message_ProgressScope&, const Standard_Boolean) override {
    out_.Progress(kCadRead + (kCadTransferred - kCadRead) * GetPosition());
  }

 private:
  CadOutput& out_;
};

struct Unit {
  const char* names[4];  ///< in small letters; the first is the one shown
  double millimetres;
};
constexpr Unit kUnits[] = {
    {{"mm", "millimetre", "millimeter", "mm"}, 1}, {{"in", "inch", "inches", "inch"}, 25.4},
    {{"m", "metre", "meter", "m"}, 1000},          {{"cm", "centimetre", "centimeter", "cm"}, 10},
    {{"ft", "foot", "feet", "ft"}, 304.8},         {{"um", "micrometre", "micrometer", "micron"}, 1e-3},
    {{"mi", "mile", "mi", "miles"}, 1609344},      {{"km", "kilometre", "kilometer", "km"}, 1e6},
    {{"mil", "mil", "thou", "mils"}, 0.0254},      {{"uin", "microinch", "uin", "microinches"}, 25.4e-6},
    {{"yd", "yard", "yd", "yards"}, 914.4},        {{"nm", "nanometre", "nanometer", "nm"}, 1e-6},
    {{"dm", "decimetre", "decimeter", "dm"}, 100}};

const Unit* FindUnit(std::string name) {
  std::ranges::transform(name, name.begin(),
                         [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  for (const Unit& unit : kUnits)
    for (const char* const known : unit.names)
      if (name == known) return &unit;
  return nullptr;
}

/// Sets the document's unit to the first unit that its file names.
void SetUnit(const std::vector<std::string>& names, CadDocument& document, CadOutput& out) {
  const Unit* const unit = names.empty() ? nullptr : FindUnit(names[0]);
  if (!unit) {
    out.Put(CadMessage::kWarning,
            names.empty() ? std::string("names no unit of length; its coordinates are taken as millimetres")
                          : fmt::format("names \"{}\" as its unit of length, which is unknown; its "
                                        "coordinates are given in millimetres",
                                        names[0]));
    return;
  }
  document.unit = unit->names[0];
  document.millimetres = unit->millimetres;
  for (const std::string& name : names) {
    if (FindUnit(name) == unit) continue;
    return out.Put(CadMessage::kWarning, fmt::format("has parts in \"{}\" and in \"{}\"; all are given in {}",
                                                     names[0], name, document.unit));
  }
}

Handle(TDocStd_Document) NewDocument() {
  XCAFDoc_ShapeTool::SetAutoNaming(false);
  Handle(TDocStd_Document) document;
  XCAFApp_Application::GetApplication()->NewDocument("MDTV-XCAF", document);
  Interface_Static::SetCVal("xstep.cascade.unit", "MM");
  return document;
}

/// Warns of the files that a STEP file names, which Open CASCADE would read. Names that could reach a file
/// end the import: a model of a stranger has no business with other files of the machine.
Status CheckExternFiles(const STEPCAFControl_Reader& reader, CadOutput& out) {
  STEPConstruct_ExternRefs refs(reader.Reader().WS());
  refs.LoadExternRefs();
  constexpr size_t kShown = 1000;
  std::string first;
  for (Standard_Integer i = 1; i <= refs.NbExternRefs(); ++i) {
    const Standard_CString named = refs.FileName(i);
    const std::string name = named != nullptr ? named : "";
    if (name.starts_with('/') || name.find("..") != name.npos)
      return Fail(
          fmt::format("has parts in the file \"{}\", outside the model's folder, which is not read; "
                      "export the assembly as one file",
                      name.substr(0, kShown)));
    if (first.empty()) first = name.substr(0, kShown);
  }
  if (refs.NbExternRefs() > 0)
    out.Put(
        CadMessage::kWarning,
        fmt::format("has parts in {} other files (\"{}\" is one), which are left out; give them as models "
                    "of their own, or export the assembly as one file",
                    refs.NbExternRefs(), first));
  return {};
}

Result<CadDocument> ReadStep(const std::string& path, CadOutput& out) {
  CadDocument read;
  read.document = NewDocument();
  STEPCAFControl_Reader reader;
  reader.SetGDTMode(false);
  reader.SetMatMode(false);
  reader.SetViewMode(false);
  reader.SetPropsMode(false);
  reader.SetLayerMode(false);
  ReportingFile file(path, out);
  if (!file.is_open()) return Fail("cannot be opened");
  std::istream stream(&file);
  // Files that the model names are looked for beside this name, which has no folder: none is found.
  if (reader.ChangeReader().ReadStream("/proc/self/no-folder/model", stream) != IFSelect_RetDone)
    return Fail("Open CASCADE cannot read it: it is damaged, or not a STEP file");
  TColStd_SequenceOfAsciiString lengths, angles, solid_angles;
  reader.ChangeReader().FileUnits(lengths, angles, solid_angles);
  std::vector<std::string> units;
  for (const TCollection_AsciiString& name : lengths) units.emplace_back(name.ToCString());
  SetUnit(units, read, out);
  QUARRY_TRY(CheckExternFiles(reader, out));
  Handle(TransferProgress) progress = new TransferProgress(out);
  if (!reader.Transfer(read.document, progress->Start()))
    return Fail("is a STEP file in which Open CASCADE finds no shapes");
  return read;
}

/// The unit of an IGES file: a number of the standard's, or a name (3).
std::vector<std::string> IgesUnits(const IGESData_GlobalSection& section) {
  constexpr const char* kNumbered[] = {"", "in", "mm", "", "ft", "mi", "m", "km", "mil", "um", "cm", "uin"};
  const int flag = section.UnitFlag();
  if (flag > 0 && flag < 12 && *kNumbered[flag]) return {kNumbered[flag]};
  if (section.UnitName().IsNull() || section.UnitName()->IsEmpty()) return {};
  return {section.UnitName()->ToCString()};
}

Result<CadDocument> ReadIges(const std::string& path, CadOutput& out) {
  CadDocument read;
  read.document = NewDocument();
  IGESCAFControl_Reader reader;
  reader.SetLayerMode(false);
  if (reader.ReadFile(path.c_str()) != IFSelect_RetDone)
    return Fail("Open CASCADE cannot read it: it is damaged, or not an IGES file");
  if (const Handle(IGESData_IGESModel) model = reader.IGESModel(); !model.IsNull())
    SetUnit(IgesUnits(model->GlobalSection()), read, out);
  Handle(TransferProgress) progress = new TransferProgress(out);
  if (!reader.Transfer(read.document, progress->Start()))
    return Fail("is an IGES file in which Open CASCADE finds no surfaces");
  return read;
}

}  // namespace

Result<CadDocument> ReadCadDocument(CadFormat format, const std::string& path, CadOutput& out) {
  return format == CadFormat::kIges ? ReadIges(path, out) : ReadStep(path, out);
}

}  // namespace quarry
