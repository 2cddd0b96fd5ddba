#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <functional>
#include <limits>

#include "common/base/log.h"
#include "common/base/number.h"
#include "common/command_line/command_line.h"
#include "common/program/run_program.h"
#include "common/program/version_text.h"
#include "scenes/mesh_writer.h"
#include "scenes/scene.h"

namespace quarry::scenes {
namespace {

volatile std::sig_atomic_t interrupted = 0;

void OnSignal(int) { interrupted = 1; }

/// Temporaries are removed on the way out, so signals only ask to stop.
void CatchSignals() {
  struct sigaction action {};
  action.sa_handler = OnSignal;
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
  sigaction(SIGHUP, &action, nullptr);
}

/// One line that renews itself on a terminal, a plain line now and then elsewhere.
class Progress {
 public:
  explicit Progress(bool quiet) : quiet_(quiet), terminal_(isatty(STDERR_FILENO) != 0) {}

  Status operator()(uint64_t done, uint64_t total) {
    if (interrupted) return Fail("Interrupted; nothing was kept.");
    const auto now = Clock::now();
    if (quiet_ || now < next_) return {};
    next_ = now + std::chrono::milliseconds(terminal_ ? 200 : 5000);
    const double part = static_cast<double>(done) / static_cast<double>(total);
    const double elapsed = std::chrono::duration<double>(now - start_).count();
    const double left = part > 0 ? elapsed / part - elapsed : 0;
    LogRaw(fmt::format("{}{:3.0f} %, about {:.0f} s left{}", terminal_ ? "\r" : "", 100 * part, left,
                       terminal_ ? "   " : "\n"));
    return {};
  }

  void Done(const std::string& path, uint64_t triangles) {
    if (quiet_) return;
    const double elapsed = std::chrono::duration<double>(Clock::now() - start_).count();
    Log(fmt::format("{}{}: {} triangles in {:.1f} s", terminal_ ? "\r" : "", path, triangles, elapsed));
  }

  /// Leaves the renewed line, so that an error has its own.
  void Break() {
    if (!quiet_ && terminal_) Log("");
  }

 private:
  using Clock = std::chrono::steady_clock;
  bool quiet_, terminal_;
  Clock::time_point start_ = Clock::now();
  Clock::time_point next_ = start_ + std::chrono::milliseconds(500);
};

struct Arguments {
  std::string kind, output;
  SceneOptions options;
  bool quiet = false, force = false;
};

const char* Describe(const std::string& kind) {
  if (kind == "plant") return "a power plant: pipes, boilers, tanks, gratings, most of them hidden";
  if (kind == "city") return "blocks of buildings of many shapes with recessed windows";
  if (kind == "terrain") return "a fractal mountain range with a lake";
  if (kind == "forest") return "hills with trees, no two alike";
  if (kind == "stadium") return "a teapot in a stadium: most triangles in a thousandth of the extent";
  return "a Cornell box with a mirror ball and a glass ball";
}

void DeclareArguments(CLI::App& app, Arguments& arguments) {
  app.require_subcommand(1);
  app.footer(
      "Examples:\n"
      "  quarry-scene plant --triangles 12500000 -o plant.ply\n"
      "  quarry-scene forest --triangles 300000 --seed 7 -o forest.obj\n"
      "Beside the model it writes OUT.path.json (a walk of 60 cameras), and OUT.materials.json (PLY) or "
      "OUT.mtl (OBJ).\n"
      "The same kind, count and seed give the same bytes.\n");
  for (const std::string& kind : SceneKinds()) {
    CLI::App* scene = app.add_subcommand(kind, Describe(kind));
    scene->add_option("--triangles", arguments.options.triangles, "Number of triangles, 1000 to 1000000000")
        ->required()
        ->check(WholeNumber(kFewestTriangles, kMostTriangles));
    scene
        ->add_option("--seed", arguments.options.seed,
                     "Seed of random numbers: each gives another scene of the kind")
        ->check(WholeNumber(0, std::numeric_limits<uint64_t>::max()))
        ->capture_default_str();
    if (kind == "plant")
      scene
          ->add_option("--lamps", arguments.options.lamps,
                       "Tubes that shine, two of the triangles each; 1000 are left at least")
          ->check(WholeNumber(0, kMostTriangles / 2))
          ->capture_default_str();
    scene->add_option("-o,--output", arguments.output, "OUT.ply (binary) or OUT.obj")->required();
    scene->add_flag("--force", arguments.force, "Replace files of other kinds too");
    scene->add_flag("!--no-colors", arguments.options.colors, "Positions, materials and parts only");
    scene->add_flag("--quiet", arguments.quiet, "Show no progress");
    scene->footer(fmt::format("Example: quarry-scene {0} --triangles 1000000 -o {0}.ply", kind));
    scene->callback([&arguments, kind] { arguments.kind = kind; });
  }
}

int Run(const Arguments& arguments) {
  CatchSignals();
  Progress progress(arguments.quiet);
  Status written = CheckSceneOutputs(arguments.output, arguments.force);
  const uint64_t most_lamps = (arguments.options.triangles - kFewestTriangles) / 2;
  if (arguments.options.lamps > most_lamps)
    written = BadUsage(
        fmt::format("--lamps must be at most {}, since each takes two of the triangles and {} must be left",
                    most_lamps, kFewestTriangles));
  if (written) {
    const auto scene = MakeScene(arguments.kind, arguments.options);
    written = WriteScene(*scene, arguments.options, arguments.output, std::ref(progress));
  }
  if (!written) {
    progress.Break();
    return ExitStatus(written);
  }
  progress.Done(arguments.output, arguments.options.triangles);
  return 0;
}

int Main(int argc, char** argv) {
  Arguments arguments;
  CLI::App app("Writes procedural scenes of any size as PLY or OBJ files.", "quarry-scene");
  DeclareArguments(app, arguments);
  app.set_version_flag(
      "--version", [] { return VersionText("quarry-scene"); },
      "Print version, build and libraries, and exit");
  if (const auto ended = ParseCommandLine(app, argc, argv)) return *ended;
  return Run(arguments);
}

}  // namespace
}  // namespace quarry::scenes

int main(int argc, char** argv) {
  return quarry::RunProgram({"quarry-scene", "nothing was kept"}, argc, argv, quarry::scenes::Main);
}
