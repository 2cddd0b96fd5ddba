#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <fstream>
#include <functional>
#include <glm/vec3.hpp>
#include <string>

namespace quarry::test {

/// Writes an image of all directions as .hdr: `color` of each texel, as the format rounds it. `width` is
/// twice the height.
inline void WriteSky(const std::string& path, uint32_t width,
                     const std::function<glm::vec3(uint32_t x, uint32_t y)>& color) {
  std::ofstream out(path, std::ios::binary);
  out << "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y " << width / 2 << " +X " << width << "\n";
  for (uint32_t y = 0; y < width / 2; ++y)
    for (uint32_t x = 0; x < width; ++x) {
      const glm::vec3 c = color(x, y);
      const float most = std::max({c.x, c.y, c.z});
      int exponent = 0;
      if (most > 0) std::frexp(most, &exponent);
      const float scale = most > 0 ? std::ldexp(256.0f, -exponent) : 0;
      for (const float value : {c.x, c.y, c.z})
        out.put(static_cast<char>(static_cast<uint8_t>(value * scale)));
      out.put(most > 0 ? static_cast<char>(exponent + 128) : '\0');
    }
}

}  // namespace quarry::test
