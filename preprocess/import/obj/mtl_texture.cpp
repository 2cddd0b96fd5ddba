#include "preprocess/import/obj/mtl_texture.h"

#include <cmath>
#include <utility>

namespace quarry {
namespace {

/// Reads one to three numbers into `values`, whose other numbers stay.
bool UpToThree(TextCursor& rest, double (&values)[3]) {
  if (!ParseReal(rest, values[0])) return false;
  for (int i = 1; i < 3; ++i) {
    TextCursor after = rest;
    double value;
    if (after.AtEnd() || !ParseReal(after, value)) break;
    values[i] = value;
    rest = after;
  }
  return true;
}

bool IsOn(std::string_view word) { return EqualsIgnoringCase(word, "on"); }

bool Channel(std::string_view word, TexturePick& pick) {
  constexpr std::pair<char, TexturePick> kPicks[] = {{'r', TexturePick::kRed},
                                                     {'g', TexturePick::kGreen},
                                                     {'b', TexturePick::kBlue},
                                                     {'l', TexturePick::kLuminance},
                                                     {'m', TexturePick::kScalar}};
  for (const auto& [letter, picked] : kPicks)
    if (word.size() == 1 && (word[0] | 32) == letter) {
      pick = picked;
      return true;
    }
  return false;
}

/// Options read so far.
struct Options {
  double scale[3] = {1, 1, 1}, offset[3] = {0, 0, 0}, turbulence[3] = {0, 0, 0}, range[3] = {0, 1, 0};
  double bump = 1;
  bool clamp = false;
};

/// Reads the option `name`. Nothing: it is no option.
std::optional<bool> Option(std::string_view name, TextCursor& rest, Options& options, MtlTexture& texture) {
  const auto is = [&](std::string_view option) { return EqualsIgnoringCase(name, option); };
  if (is("-s")) return UpToThree(rest, options.scale);
  if (is("-o")) return UpToThree(rest, options.offset);
  if (is("-t")) return UpToThree(rest, options.turbulence);
  if (is("-mm")) return UpToThree(rest, options.range);
  if (is("-bm")) return ParseReal(rest, options.bump);
  if (is("-imfchan")) {
    const std::string_view channel = rest.Word();
    if (EqualsIgnoringCase(channel, "z")) texture.left_out = "-imfchan z";
    return texture.left_out == "-imfchan z" || Channel(channel, texture.pick);
  }
  if (is("-clamp")) {
    options.clamp = IsOn(rest.Word());
    return true;
  }
  for (const char* passed : {"-blendu", "-blendv", "-boost", "-cc", "-texres", "-type"})
    if (is(passed)) return !rest.Word().empty();
  return std::nullopt;
}

}  // namespace

std::optional<MtlTexture> MtlTextureFor(std::string_view keyword) {
  struct Known {
    const char* keyword;
    TextureUse use;
    bool color;
    TexturePick pick;
  };
  constexpr Known kKnown[] = {{"map_Kd", TextureUse::kDiffuse, true, TexturePick::kColor},
                              {"map_Ks", TextureUse::kSpecular, true, TexturePick::kColor},
                              {"map_Ke", TextureUse::kEmission, true, TexturePick::kColor},
                              {"map_d", TextureUse::kOpacity, false, TexturePick::kScalar},
                              {"map_bump", TextureUse::kBump, false, TexturePick::kColor},
                              {"bump", TextureUse::kBump, false, TexturePick::kColor},
                              {"norm", TextureUse::kNormal, false, TexturePick::kColor},
                              {"map_Kn", TextureUse::kNormal, false, TexturePick::kColor}};
  for (const Known& known : kKnown) {
    if (!EqualsIgnoringCase(keyword, known.keyword)) continue;
    MtlTexture texture;
    texture.binding.use = known.use;
    texture.color = known.color;
    texture.pick = known.pick;
    return texture;
  }
  return std::nullopt;
}

namespace {

/// Reads options up to a word that is none. False: an option is malformed.
bool ReadOptions(TextCursor& rest, Options& options, MtlTexture& texture) {
  for (;;) {
    TextCursor after = rest;
    const std::string_view word = after.Word();
    if (!word.starts_with('-')) return true;
    const std::optional<bool> read = Option(word, after, options, texture);
    if (!read) return true;  // a file name may begin with a hyphen
    if (!*read) return false;
    rest = after;
  }
}

/// Reads the options that stand behind the name of a file, where some programs write them, and returns the
/// name without them. Words belong to the name unless all of the line after them is options.
std::string_view TakeOptionsBehind(std::string_view name, Options& options, MtlTexture& texture) {
  for (size_t at = name.find(" -"); at != name.npos; at = name.find(" -", at + 1)) {
    TextCursor rest(name.substr(at));
    Options behind = options;
    MtlTexture with = texture;
    if (!ReadOptions(rest, behind, with) || !rest.AtEnd()) continue;
    options = behind;
    texture = with;
    name = name.substr(0, at);
    while (name.ends_with(' ') || name.ends_with('\t')) name.remove_suffix(1);
    return name;
  }
  return name;
}

}  // namespace

bool ParseMtlTexture(TextCursor& rest, MtlTexture& texture) {
  Options options;
  if (!ReadOptions(rest, options, texture)) return false;
  std::string_view name = TakeOptionsBehind(rest.Name(), options, texture);
  if (name.size() >= 2 && name.front() == '"' && name.back() == '"') name = name.substr(1, name.size() - 2);
  if (name.empty()) return false;
  texture.file = std::string(name);
  const double values[] = {options.scale[0], options.scale[1], options.offset[0], options.offset[1],
                           options.bump,     options.range[0], options.range[1]};
  for (const double value : values)
    if (!(std::fabs(value) <= 1e30)) return false;
  texture.binding.transform = {
      static_cast<float>(options.scale[0]),  0,
      static_cast<float>(options.offset[0]), 0,
      static_cast<float>(-options.scale[1]), static_cast<float>(1 - options.offset[1])};
  if (options.clamp) texture.binding.wrap_s = texture.binding.wrap_t = TextureWrap::kClamp;
  const bool relief = texture.binding.use == TextureUse::kBump || texture.binding.use == TextureUse::kNormal;
  texture.binding.factor = glm::vec4(static_cast<float>(options.range[1] * (relief ? options.bump : 1)));
  if (options.turbulence[0] != 0 || options.turbulence[1] != 0) texture.left_out = "-t";
  if (options.range[0] != 0) texture.left_out = "the base of -mm";
  return true;
}

}  // namespace quarry
