#include "tests/laboratory/tables/instructions.h"

#if __has_include(<valgrind/callgrind.h>)
#include <valgrind/callgrind.h>
#endif

#include <array>

#include "tests/laboratory/tables/callgrind.h"

namespace quarry::laboratory {

namespace {

/// The names of a kernel's multipass form and of its body, as they stand in symbols.
struct Names {
  const char *form, *body;
};
constexpr std::array<Names, kKernels> kNames = {{
    {"PlainMemory>::Generate(", "PlainMemory>::GenerateBody("},
    {"PlainMemory>::Setup(", "PlainMemory>::SetupBody("},
    {"PlainMemory>::Traverse(", "PlainMemory>::TraverseBody("},
    {"PlainMemory>::Up(", "PlainMemory>::UpBody("},
    {"PlainMemory>::Intersect(", "PlainMemory>::TestBody("},
    {"PlainMemory>::Color(", "PlainMemory>::ColorBody<"},
    {"PlainMemory>::Shadow(", "PlainMemory>::ShadowBody<"},
}};
constexpr const char* kLeave = "PlainMemory>::LeaveBody(";

double Share(uint64_t instructions, uint64_t calls) {
  return calls == 0 ? 0 : static_cast<double>(instructions) / static_cast<double>(calls);
}

}  // namespace

Result<InstructionCount> CountKernelInstructions(const std::vector<std::string>& command) {
  std::vector<std::string> functions{kLeave};
  for (const Names& names : kNames) {
    functions.push_back(names.form);
    functions.push_back(names.body);
  }
  QUARRY_ASSIGN(FunctionCosts costs, CountInstructions(command, functions, true));
  InstructionCount count;
  for (uint32_t k = 0; k < kKernels; ++k) {
    const FunctionCost form = costs[kNames[k].form], body = costs[kNames[k].body];
    count.all += form.instructions;
    count.instructions[k].body = Share(body.instructions, body.calls);
    count.instructions[k].form = Share(form.instructions - body.instructions, form.calls);
    if (static_cast<KernelId>(k) == KernelId::kIntersect)
      count.instructions[k].leave = Share(costs[kLeave].instructions, form.calls);
  }
  if (count.all == 0) return Fail("callgrind has seen no kernel of " + command.at(0));
  return count;
}

void StartCountingInstructions() {
#ifdef CALLGRIND_START_INSTRUMENTATION
  CALLGRIND_START_INSTRUMENTATION;
#endif
}

void StopCountingInstructions() {
#ifdef CALLGRIND_STOP_INSTRUMENTATION
  CALLGRIND_STOP_INSTRUMENTATION;
#endif
}

}  // namespace quarry::laboratory
