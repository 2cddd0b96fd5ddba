#include "common/command_line/command_line.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <charconv>
#include <cstdlib>
#include <numeric>
#include <sstream>
#include <vector>

#include "common/base/log.h"

namespace quarry {
namespace {

/// Letters to insert, delete, replace or exchange with their neighbour (optimal string alignment).
size_t Distance(const std::string& a, const std::string& b) {
  const size_t width = b.size() + 1;
  std::vector<size_t> rows(3 * width);
  size_t *before = &rows[0], *above = &rows[width], *row = &rows[2 * width];
  std::iota(above, above + width, size_t{0});
  for (size_t i = 1; i <= a.size(); ++i) {
    row[0] = i;
    for (size_t j = 1; j <= b.size(); ++j) {
      row[j] = std::min({above[j] + 1, row[j - 1] + 1, above[j - 1] + (a[i - 1] != b[j - 1])});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1])
        row[j] = std::min(row[j], before[j - 2] + 1);
    }
    std::swap(before, above);
    std::swap(above, row);
  }
  return above[b.size()];
}

/// The command whose arguments were being parsed, and the words that a person types to reach it.
struct Place {
  CLI::App* command;
  std::string words;
};

Place PlaceOf(CLI::App& app) {
  Place place{&app, app.get_name()};
  while (!place.command->get_subcommands().empty()) {
    place.command = place.command->get_subcommands().front();
    place.words += ' ' + place.command->get_name();
  }
  return place;
}

std::vector<std::string> LongOptions(const CLI::App& command) {
  std::vector<std::string> names;
  for (const CLI::Option* option : command.get_options())
    for (const std::string& name : option->get_lnames())
      if (!option->get_group().empty()) names.push_back("--" + name);
  return names;
}

std::vector<std::string> Commands(CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::App* command : app.get_subcommands({})) names.push_back(command->get_name());
  return names;
}

std::string Suggestion(const std::string& text, std::span<const std::string> candidates) {
  const std::string nearest = Nearest(text, candidates);
  return nearest.empty() ? "" : fmt::format("; did you mean {}?", nearest);
}

/// A sentence about the typed words that fit nowhere; empty when there are none.
std::string Unknown(const Place& place) {
  std::vector<std::string> left = place.command->remaining();
  if (left.empty()) return "";
  const auto dashed = std::ranges::find_if(
      left, [](const std::string& text) { return text.starts_with('-') && text != "-"; });
  if (dashed != left.end()) {
    const std::string name = dashed->substr(0, dashed->find('='));
    return fmt::format("{} is not an option{}", name, Suggestion(name, LongOptions(*place.command)));
  }
  if (const std::vector<std::string> commands = Commands(*place.command); !commands.empty())
    return fmt::format("'{}' is not a command{}", left.front(), Suggestion(left.front(), commands));
  double number = 0;
  const std::string& first = left.front();
  const auto [end, error] = std::from_chars(first.data(), first.data() + first.size(), number);
  const bool of_list = error == std::errc() && (end == first.data() + first.size() || *end == ',');
  return fmt::format("'{}' is one argument too many{}", first,
                     of_list ? "; lists of numbers have no blanks: 1,2,3" : "");
}

std::string Sentence(const CLI::ParseError& error, const Place& place) {
  const bool of_names =
      dynamic_cast<const CLI::ExtrasError*>(&error) || dynamic_cast<const CLI::RequiredError*>(&error);
  std::string text = of_names ? Unknown(place) : "";
  if (text.empty()) text = error.what();
  if (const size_t missing = text.find(": 1 required"); missing != std::string::npos)
    text = text.substr(0, missing) + " needs a value";
  if (const size_t end = text.find('\n'); end != std::string::npos) text.resize(end);
  while (text.ends_with('.')) text.pop_back();
  const bool question = text.ends_with('?');
  return fmt::format("{}: {}{}", place.words, text,
                     question ? "" : fmt::format("; see {} --help", place.words));
}

}  // namespace

std::string Nearest(const std::string& text, std::span<const std::string> candidates) {
  std::string best;
  size_t least = std::max<size_t>(1, text.size() / 3) + 1;
  for (const std::string& candidate : candidates) {
    size_t distance = Distance(text, candidate);
    if (text.size() > 3 && candidate.starts_with(text)) distance = 1;  // cut short
    if (distance >= least) continue;
    least = distance;
    best = candidate;
  }
  return best;
}

std::string Listed(std::span<const std::string> names, std::string_view last_word) {
  std::string text = names.front();
  for (size_t i = 1; i < names.size(); ++i)
    text += (i + 1 == names.size() ? fmt::format(" {} ", last_word) : ", ") + names[i];
  return text;
}

bool WasTyped(const CLI::App& command, const char* name) {
  const CLI::Option* const option = command.get_option(name);
  return option->count() > 0 &&
         (option->get_envname().empty() || !std::getenv(option->get_envname().c_str()));
}

void RefuseWithoutEffect(CLI::App& command, std::span<const NoEffect> rules) {
  command.final_callback([&command, rules] {
    for (const NoEffect& rule : rules)
      if (WasTyped(command, rule.option) && WasTyped(command, rule.beside))
        throw CLI::ValidationError(
            fmt::format("{} has no effect with {}; leave one of them out", rule.option, rule.beside));
  });
}

std::optional<int> ParseCommandLine(CLI::App& app, int argc, char** argv) {
  try {
    app.parse(argc, argv);
    return std::nullopt;
  } catch (const CLI::Success& answered) {
    std::ostringstream text;
    const int status = app.exit(answered, text, text);
    PrintRaw(text.str());
    return status;
  } catch (const CLI::ParseError& error) {
    Log(Sentence(error, PlaceOf(app)));
    return 2;
  }
}

}  // namespace quarry
