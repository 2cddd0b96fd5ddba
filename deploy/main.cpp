#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <system_error>

#include "common/base/cleanup.h"
#include "common/base/cpu_check.h"
#include "common/base/version.h"
#include "deploy/cluster.h"
#include "deploy/info_command.h"
#include "deploy/render_command.h"

namespace quarry {
namespace {

/// `quarry bench WHAT ...` is the program quarry-bench-WHAT beside this one.
[[noreturn]] void RunBench(int argc, char** argv) {
  const std::string what = argc > 2 ? argv[2] : "";
  const std::string program = SiblingProgram("quarry-bench-" + what);
  if (argc > 2) ::execv(program.c_str(), argv + 2);
  fmt::print(stderr, "quarry: bench '{}' is not known (programs quarry-bench-* are built with the tests)\n",
             what);
  std::exit(2);
}

int Main(int argc, char** argv) {
  RequireCpu();
  if (argc > 1 && std::string(argv[1]) == "bench") RunBench(argc, argv);
  InstallSignalHandlers("quarry", "frames finished before are kept, nothing partial is left");
  CLI::App app{"Quarry: ray tracing of triangle models larger than memory, on the machines at hand."};
  app.footer(
      "Examples:\n  quarry render plant.ply -o plant.png --mode whitted --workers 3\n"
      "  quarry render plant.quarry -o walk.png --camera-path plant.path.json --frames 0-59\n"
      "  quarry info plant.quarry --json\n  quarry verify plant.quarry\n  quarry bench import plant.ply");
  app.set_version_flag("--version", std::string("quarry ") + kVersion);
  app.require_subcommand(1);
  RenderArguments render;
  AddRenderOptions(*app.add_subcommand("render", "Render a picture, or a path of them"), render);
  std::string scene;
  bool json = false, quiet = false;
  auto* info = app.add_subcommand("info", "Tell what a store holds");
  info->add_option("scene", scene, "The store")->required();
  info->add_flag("--json", json, "As JSON");
  auto* verify = app.add_subcommand("verify", "Read and check every byte of a store");
  verify->add_option("scene", scene, "The store")->required();
  verify->add_flag("--quiet", quiet, "Print errors only");
  app.add_subcommand("bench", "Run a benchmark program (built with the tests)");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : 2;
  }
  Status status;
  try {
    status = app.got_subcommand("render") ? Render(render)
             : app.got_subcommand("info") ? PrintInfo(scene, json)
                                          : Verify(scene, quiet);
    std::fflush(stdout);
  } catch (const std::system_error& e) {  // of fmt::print
    status = Fail(fmt::format("standard output cannot be written: {}", e.code().message()));
  }
  if (status) return 0;
  fmt::print(stderr, "quarry: {}\n", status.error().message);
  return status.error().exit_status;
}

}  // namespace
}  // namespace quarry

int main(int argc, char** argv) { return quarry::Main(argc, argv); }
