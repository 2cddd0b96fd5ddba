#include "tests/laboratory/tables/callgrind.h"

#include <cpuid.h>
#include <fmt/format.h>

#include <cctype>
#include <cstdlib>
#include <fstream>
#include <unordered_map>
#include <utility>

#include "common/base/check.h"
#include "deploy/command/command_output.h"
#include "tests/support/temporary_folder.h"

namespace quarry::laboratory {

bool ValgrindInstalled() { return OutputOf("valgrind", {"--version"}).has_value(); }

std::string WhyNotCounted() {
  if (!ValgrindInstalled()) return "valgrind is not installed";
  constexpr unsigned kExtended = 0x80000001, kRdtscp = 1u << 27;  // of EDX
  unsigned a = 0, b = 0, c = 0, d = 0;
  return __get_cpuid(kExtended, &a, &b, &c, &d) != 0 && (d & kRdtscp) != 0
             ? ""
             : "under valgrind libhwy needs RDTSCP, which this processor lacks";
}

Result<FunctionCosts> CountInstructions(const std::vector<std::string>& command,
                                        std::span<const std::string> functions, bool at_request) {
  QUARRY_CHECK(!command.empty());
  const test::TemporaryFolder folder;
  // Without lines, costs of a function stand together.
  std::vector<std::string> arguments{"-q",
                                     "--tool=callgrind",
                                     "--callgrind-out-file=" + folder.file("profile"),
                                     "--demangle=yes",
                                     "--dump-line=no",
                                     "--compress-strings=no",
                                     "--compress-pos=no"};
  if (at_request) arguments.emplace_back("--instr-atstart=no");
  arguments.insert(arguments.end(), command.begin(), command.end());
  QUARRY_ASSIGN(const CommandOutput run, OutputOf("valgrind", arguments));
  if (run.status != 0)
    return Fail(
        fmt::format("{} failed with status {} under valgrind: {}", command[0], run.status, run.LastError()));
  std::ifstream profile(folder.file("profile"));
  return ReadCallgrindProfile(profile, "the profile of " + command[0], functions);
}

Result<FunctionCosts> ReadCallgrindProfile(std::istream& profile, const std::string& name,
                                           std::span<const std::string> functions) {
  std::unordered_map<std::string, FunctionCost> all;
  FunctionCost *function = nullptr, *callee = nullptr;  // elements of an unordered_map stay where they are
  uint64_t own = 0, total = 0;
  bool of_callee = false;
  for (std::string line; std::getline(profile, line);) {
    const std::string value = line.substr(line.find_first_of("= ") + 1);
    const uint64_t number = std::strtoull(value.c_str(), nullptr, 10);
    if (line.starts_with("fn=")) {
      function = &all[value];
    } else if (line.starts_with("cfn=")) {
      callee = &all[value];
    } else if (line.starts_with("calls=") && callee) {
      callee->calls += number;
      of_callee = true;
    } else if (line.starts_with("totals: ")) {
      total = number;
    } else if (!line.empty() && std::isdigit(static_cast<unsigned char>(line[0])) != 0 && function) {
      // A callee's inclusive cost, as part of the caller's: its own lines hold it a second time.
      function->instructions += number;
      if (!std::exchange(of_callee, false)) own += number;
    }
  }
  if (own != total)
    return Fail(fmt::format("{}: the functions have {} instructions, and the total is {}", name, own, total));
  FunctionCosts costs;
  for (const std::string& part : functions) {
    FunctionCost& sum = costs[part];
    const auto exact = all.find(part);
    for (const auto& [full, cost] : all) {
      if (exact != all.end() ? full != part : full.find(part) == std::string::npos) continue;
      sum.calls += cost.calls;
      sum.instructions += cost.instructions;
    }
  }
  return costs;
}

}  // namespace quarry::laboratory
