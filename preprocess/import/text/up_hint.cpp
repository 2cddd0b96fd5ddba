#include "preprocess/import/text/up_hint.h"

#include <algorithm>
#include <initializer_list>

#include "preprocess/import/text/text_number.h"

namespace quarry {
namespace {

/// Programs that write y-up and z-up where nobody asks for another axis. Blender turns OBJ, but neither PLY
/// nor STL.
constexpr std::string_view kYUp[] = {"3ds max", "guruware",   "maya",    "cinema 4d",  "zbrush",   "sketchup",
                                     "rhino",   "rhinoceros", "houdini", "daz studio", "mineways", "jmc2obj"};
constexpr std::string_view kZUp[] = {"freecad",     "openscad",     "onshape",      "catia",
                                     "prusaslicer", "slic3r",       "cura",         "metashape",
                                     "pix4d",       "opendronemap", "ifcopenshell", "cloudcompare"};

/// The text in lower case, its words parted and surrounded by one space each.
std::string Words(std::string_view text) {
  std::string words = " ";
  for (const char c : text) {
    const bool letter = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9');
    if (letter)
      words += c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
    else if (words.back() != ' ')
      words += ' ';
  }
  if (words.back() != ' ') words += ' ';
  return words;
}

/// The comments of a file that begins with `head`, a line each.
std::string CommentsOf(std::string_view extension, std::string_view head) {
  constexpr size_t kStlHeader = 80;
  if (EqualsIgnoringCase(extension, ".stl"))
    return std::string(head.substr(0, std::min(kStlHeader, head.find('\n'))));
  const bool ply = EqualsIgnoringCase(extension, ".ply");
  // Lines of other formats begin with '#' too: STEP's data do.
  const auto is_of = [&](const char* known) { return EqualsIgnoringCase(extension, known); };
  if (!ply && !is_of(".obj") && !is_of(".off") && !is_of(".nff") && !is_of(".aff")) return {};
  std::string comments;
  while (!head.empty()) {
    const size_t end = std::min(head.find('\n'), head.size());
    std::string_view line = head.substr(0, end);
    head.remove_prefix(std::min(end + 1, head.size()));
    if (ply && line.starts_with("end_header")) break;
    const bool comment =
        ply ? line.starts_with("comment") || line.starts_with("obj_info") : line.starts_with('#');
    if (comment) (comments += line) += '\n';
  }
  return comments;
}

bool Has(const std::string& words, std::string_view wanted) {
  return words.find(" " + std::string(wanted) + " ") != std::string::npos;
}

/// Whether the words say that `axis`, a letter, points up.
bool Says(const std::string& words, char axis) {
  const std::string a(1, axis);
  const auto any = [&](std::initializer_list<std::string> phrases) {
    return std::ranges::any_of(phrases, [&](const std::string& p) { return Has(words, p); });
  };
  return any({a + " up", a + "up", a + " is up", a + " axis up", a + " axis is up", "up axis " + a,
              "up axis is " + a, "axis up " + a, "upaxis " + a, "up is " + a, "up " + a});
}

UpHint One(bool y, bool z, bool stated) { return y == z ? UpHint{} : UpHint{y ? 1u : 2u, stated}; }

}  // namespace

UpHint UpHintOf(std::string_view extension, std::string_view head) {
  const std::string words = Words(CommentsOf(extension, head));
  const bool y = Says(words, 'y'), z = Says(words, 'z');
  if (y || z) return One(y, z, true);
  const auto by = [&](std::string_view program) { return Has(words, program); };
  const bool turned = EqualsIgnoringCase(extension, ".obj");
  return One(std::ranges::any_of(kYUp, by) || (by("blender") && turned),
             std::ranges::any_of(kZUp, by) || (by("blender") && !turned), false);
}

}  // namespace quarry
