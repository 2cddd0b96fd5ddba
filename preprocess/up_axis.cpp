#include "preprocess/up_axis.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <initializer_list>

#include "preprocess/import/model_reader.h"
#include "preprocess/import/text/text_number.h"
#include "preprocess/import/text/up_hint.h"
#include "preprocess/preprocess_options.h"

namespace quarry {
namespace {

/// Bytes at a model's beginning that are read for comments.
constexpr size_t kHead = 64 << 10;
/// Evidence of habits: a format's decides where triangles say little; a program's weighs as much as a base
/// that is plain to see, a statement more.
constexpr double kObj = 0.25, kStl = -0.25, kCad = -0.5, kProgram = 1, kStatement = 4;

/// STEP or IGES: nearly all CAD programs have z up.
bool IsCad(const std::string& extension) {
  return std::ranges::any_of(std::initializer_list<const char*>{".step", ".stp", ".stpz", ".iges", ".igs"},
                             [&](const char* e) { return EqualsIgnoringCase(extension, e); });
}

double HintOf(const std::string& model, const std::string& extension, uint64_t unpack_limit) {
  if (model == "-") return 0;
  Result<ModelReader> reader = ModelReader::Open(model, unpack_limit);
  if (!reader) return 0;
  reader->Ensure(kHead);
  const UpHint hint = UpHintOf(extension, reader->view().substr(0, kHead));
  if (hint.axis == 0) return 0;
  return (hint.stated ? kStatement : kProgram) * (hint.axis == 1 ? 1 : -1);
}

}  // namespace

uint32_t StatedUpAxis(const std::vector<std::string>& models) {
  const auto have = [](const std::string& m, std::initializer_list<const char*> extensions) {
    const std::string extension = std::filesystem::path(m).extension().string();
    return std::ranges::any_of(extensions, [&](const char* e) { return EqualsIgnoringCase(extension, e); });
  };
  if (std::ranges::all_of(models, [&](const std::string& m) { return have(m, {".3mf"}); })) return 2;
  const auto has_y_up = [&](const std::string& m) {
    return !have(m, {"", ".ply", ".obj", ".stl", ".off", ".nff", ".aff", ".3mf", ".gz", ".zst"}) &&
           !IsCad(std::filesystem::path(m).extension().string());
  };
  return std::ranges::all_of(models, has_y_up) ? 1 : 0;
}

UpHabit UpHabitOf(const std::vector<std::string>& models, uint64_t unpack_limit) {
  UpHabit habit;
  for (const std::string& m : models) {
    const std::string extension = std::filesystem::path(UnpackedPath(m)).extension().string();
    const bool obj = EqualsIgnoringCase(extension, ".obj"), stl = EqualsIgnoringCase(extension, ".stl");
    const bool cad = IsCad(extension);
    habit.formats += obj ? kObj : stl ? kStl : cad ? kCad : 0;
    if (obj || stl || cad) habit.format = obj ? "OBJ" : stl ? "STL" : "CAD";
    habit.comments += HintOf(m, extension, unpack_limit);
  }
  const auto count = static_cast<double>(std::max<size_t>(models.size(), 1));
  habit.formats /= count;
  habit.comments /= count;
  if (models.size() > 1) habit.format.clear();
  return habit;
}

Sureness SurenessOf(double triangles, const UpHabit& habit) {
  constexpr double kLikely = 0.12, kSure = 0.5;
  const double all = triangles + habit.evidence();
  const bool overruled = (all > 0) != (triangles > 0);
  const double size = std::fabs(habit.comments != 0 ? all : triangles);
  if (size < kLikely || (overruled && habit.comments == 0)) return Sureness::kToss;
  return size < kSure ? Sureness::kLikely : Sureness::kSure;
}

std::string GuessText(uint32_t axis, double triangles, const UpHabit& habit) {
  const Sureness sureness = SurenessOf(triangles, habit);
  const char *guess = axis == 1 ? "y" : "z", *other = axis == 1 ? "z" : "y";
  std::string how = fmt::format("a {} guess", kSurenessNames[static_cast<int>(sureness)]);
  if (sureness == Sureness::kToss)
    how = habit.comments == 0 && habit.formats != 0 && !habit.format.empty()
              ? fmt::format("no clear evidence, so as usual for {}", habit.format)
              : "no clear evidence";
  return fmt::format("up axis: {}, {} (--up-axis {} for the other)", guess, how, other);
}

}  // namespace quarry
