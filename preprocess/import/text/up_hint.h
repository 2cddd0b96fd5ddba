#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace quarry {

/// The up axis that the comments at a model's beginning name or suggest.
struct UpHint {
  uint32_t axis = 0;    ///< 1 for y, 2 for z; 0: nothing, or both
  bool stated = false;  ///< in words such as "Z-up"; else by the habit of the program that wrote it
};

/// Reads the comments of OBJ and OFF, the header of PLY, and the name or header of STL. `extension`: the
/// format's, with its dot, in any case. `head`: the first bytes of the file. Thread-safe.
UpHint UpHintOf(std::string_view extension, std::string_view head);

}  // namespace quarry
