#include "tests/laboratory/plots.h"

#include <fmt/format.h>

#include <algorithm>
#include <boost/process.hpp>

#include "common/base/bytes.h"
#include "common/base/file.h"

namespace quarry::laboratory {

namespace {

/// A string of a gnuplot script.
std::string Quoted(std::string text) {
  std::erase_if(text, [](char c) { return c == '"' || c == '\\' || c == '\n'; });
  return '"' + text + '"';
}

std::string ScriptOf(const StackedPlot& plot, const std::string& path) {
  std::string script = fmt::format(
      "set terminal pngcairo size 900,560\nset output {}\nset title {} noenhanced\nset ylabel {} noenhanced\n"
      "set style data histograms\nset style histogram rowstacked\nset style fill solid 0.85 border -1\n"
      "set boxwidth 0.7\nset key outside right invert noenhanced\nset grid ytics\nset yrange [0:*]\n"
      "set xtics noenhanced rotate by -25\n$data << END\n",
      Quoted(path), Quoted(plot.title), Quoted(plot.unit));
  for (const Column& column : plot.columns) {
    script += Quoted(column.name);
    for (const double value : column.values) script += fmt::format(" {:.9g}", value);
    script += "\n";
  }
  script += "END\nplot ";
  for (size_t p = 0; p < plot.parts.size(); ++p)
    script +=
        fmt::format("{}$data using {}:xtic(1) title {}", p == 0 ? "" : ", ", p + 2, Quoted(plot.parts[p]));
  return script + "\n";
}

}  // namespace

bool GnuplotInstalled() { return !boost::process::search_path("gnuplot").empty(); }

Status DrawStacked(const StackedPlot& plot, const std::string& path) {
  namespace bp = boost::process;
  const auto gnuplot = bp::search_path("gnuplot");
  if (gnuplot.empty()) return Fail(path + ": gnuplot is not installed");
  std::error_code error;
  bp::opstream script;
  bp::child child(gnuplot, bp::std_in<script, bp::std_err> bp::null, bp::std_out > bp::null, error);
  if (error) return Fail(fmt::format("{}: gnuplot cannot be started: {}", path, error.message()));
  script << ScriptOf(plot, path);
  script.flush();
  script.pipe().close();
  child.wait(error);
  if (error || child.exit_code() != 0) return Fail(path + ": gnuplot could not draw it");
  return {};
}

}  // namespace quarry::laboratory
