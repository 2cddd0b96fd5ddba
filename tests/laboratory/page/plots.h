#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"

namespace quarry::laboratory {

/// A column of stacked bars: a value for each part.
struct Column {
  std::string name;
  std::vector<double> values;
};

/// A picture of stacked columns, as figures 7 to 9 of Purcell et al. 2002 are.
struct StackedPlot {
  std::string title, unit;
  std::vector<std::string> parts;
  std::vector<Column> columns;
};

bool GnuplotInstalled();

/// Draws the plot by gnuplot into `path`, a PNG file. Errors: gnuplot is missing or fails; names the file.
Status DrawStacked(const StackedPlot& plot, const std::string& path);
/// Draws a rendered picture under `title` in the same way. Shape: pixels[3 * size * size], linear RGB, the
/// upper row first; `size`: pixels a side.
Status DrawPicture(const std::vector<float>& pixels, uint32_t size, const std::string& title,
                   const std::string& path);

}  // namespace quarry::laboratory
