#include "preprocess/import/threemf/package.h"

#include <fmt/format.h>

#include <algorithm>
#include <string>
#include <vector>

#include "preprocess/import/text/text_number.h"
#include "preprocess/import/threemf/xml_reader.h"

namespace quarry {
namespace {

/// The value of a hexadecimal digit, or -1.
int HexDigit(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return -1;
}

std::string PartNameDecoded(std::string_view text) {
  std::string out;
  for (size_t i = 0; i < text.size(); ++i) {
    const int high = text[i] == '%' && i + 2 < text.size() ? HexDigit(text[i + 1]) : -1;
    const int low = high >= 0 ? HexDigit(text[i + 2]) : -1;
    const int code = 16 * high + low;
    if (low < 0 || code == 0) {
      out += text[i];
      continue;
    }
    out += static_cast<char>(code);
    i += 2;
  }
  return out;
}

/// Takes the model's name and the presence of a store of keys from the archive's relationships.
class Relationships final : public XmlHandler {
 public:
  std::string model;
  bool encrypted = false;

  Status Start(XmlSpace, std::string_view name, const XmlAttributes& attributes) override {
    if (name != "Relationship") return {};
    const char* const type = attributes.Find("Type");
    const char* const target = attributes.Find("Target");
    if (type == nullptr || target == nullptr) return {};
    const std::string_view kind = type;
    if (model.empty() && kind.ends_with("/3dmodel")) model = target;
    encrypted |= kind.ends_with("/keystore");
    return {};
  }
  Status End(XmlSpace, std::string_view) override { return {}; }
};

/// The name in an archive, without a slash in front.
std::string PartName(std::string_view target) {
  std::vector<std::string_view> folders;
  size_t begin = 0;
  while (begin <= target.size()) {
    const size_t end = std::min(target.find_first_of("/\\", begin), target.size());
    const std::string_view step = target.substr(begin, end - begin);
    if (step == "..") {
      if (!folders.empty()) folders.pop_back();
    } else if (!step.empty() && step != ".") {
      folders.push_back(step);
    }
    begin = end + 1;
  }
  return fmt::format("{}", fmt::join(folders, "/"));
}

}  // namespace

std::optional<uint64_t> FindPart(const ZipArchive& archive, std::string_view target) {
  const std::string name = PartName(target);
  std::string backslashes = name;
  std::ranges::replace(backslashes, '/', '\\');
  // The last two are of writers that do not keep to zip's rules.
  for (const std::string& spelling : {name, PartNameDecoded(name), backslashes, "/" + name})
    if (const std::optional<uint64_t> part = archive.Find(spelling)) return part;
  return std::nullopt;
}

Result<uint64_t> FindModelPart(ZipArchive& archive) {
  Relationships relationships;
  if (const auto part = FindPart(archive, "_rels/.rels")) QUARRY_TRY(ReadXml(archive, *part, relationships));
  if (relationships.encrypted)
    return Fail(
        fmt::format("{}: has encrypted parts (3MF's secure content), which are not read; export it "
                    "without them",
                    archive.path()));
  if (!relationships.model.empty()) {
    if (const auto part = FindPart(archive, relationships.model)) return *part;
    return Fail(
        fmt::format("{}: its model, {}, is not in the archive", archive.path(), Quoted(relationships.model)));
  }
  if (const auto part = FindPart(archive, "3D/3dmodel.model")) return *part;
  return Fail(fmt::format(
      "{}: is a zip archive without a 3D model, so not a 3MF; unpack it, and give the model in it",
      archive.path()));
}

}  // namespace quarry
