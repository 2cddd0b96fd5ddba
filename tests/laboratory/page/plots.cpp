#include "tests/laboratory/page/plots.h"

#include <fmt/format.h>

#include <algorithm>
#include <boost/process.hpp>
#include <cmath>

#include "common/base/bytes.h"
#include "common/base/file.h"
#include "common/math/elementary.h"

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

/// Sends `script` to gnuplot, which makes the file at `path`.
Status Draw(const std::string& script, const std::string& path) {
  namespace bp = boost::process;
  const auto gnuplot = bp::search_path("gnuplot");
  if (gnuplot.empty()) return Fail(path + ": gnuplot is not installed");
  std::error_code error;
  bp::opstream input;
  bp::child child(gnuplot, bp::std_in<input, bp::std_err> bp::null, bp::std_out > bp::null, error);
  if (error) return Fail(fmt::format("{}: gnuplot cannot be started: {}", path, error.message()));
  input << script;
  input.flush();
  input.pipe().close();
  child.wait(error);
  if (error || child.exit_code() != 0) return Fail(path + ": gnuplot could not draw it");
  return {};
}

}  // namespace

bool GnuplotInstalled() { return !boost::process::search_path("gnuplot").empty(); }

Status DrawStacked(const StackedPlot& plot, const std::string& path) {
  return Draw(ScriptOf(plot, path), path);
}

Status DrawPicture(const std::vector<float>& pixels, uint32_t size, const std::string& title,
                   const std::string& path) {
  constexpr int kSide = 620, kHeight = 660;
  std::string script = fmt::format(
      "set terminal pngcairo size {0},{1}\nset output {2}\nset title {3} noenhanced\nunset key\n"
      "unset border\nunset tics\nset size ratio -1\nset xrange [-0.5:{4}-0.5]\nset yrange [-0.5:{4}-0.5]\n"
      "plot '-' binary array=({4},{4}) flip=y format='%uchar' using 1:2:3 with rgbimage\n",
      kSide, kHeight, Quoted(path), Quoted(title), size);
  for (const float value : pixels)
    script += static_cast<char>(std::lround(255 * EncodeSrgb(static_cast<double>(value))));
  return Draw(script, path);
}

}  // namespace quarry::laboratory
