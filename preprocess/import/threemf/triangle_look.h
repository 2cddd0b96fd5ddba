#pragma once

#include <cstdint>

#include "common/base/status.h"
#include "preprocess/import/threemf/attribute_numbers.h"
#include "preprocess/import/threemf/xml_reader.h"

namespace quarry {

/// The attributes of a triangle that decide its look. Without p1 it has its object's.
struct TriangleLook {
  bool stated = false;     ///< whether there is a p1
  uint32_t group = 0;      ///< pid; 0: the object's
  uint32_t index[3] = {};  ///< of the corners

  /// Whether the corners name different looks.
  bool differs() const { return index[0] != index[1] || index[0] != index[2]; }

  /// Errors: no whole numbers.
  static Result<TriangleLook> Read(const XmlAttributes& a) {
    TriangleLook look;
    const char* const group = a.Find("pid");
    const char* const first = a.Find("p1");
    if (group != nullptr && !ReadIndex(group, look.group)) return Fail("a pid is a whole number");
    if (first == nullptr) return look;
    look.stated = true;
    if (!ReadIndex(first, look.index[0])) return Fail("a p1 is a whole number");
    look.index[1] = look.index[2] = look.index[0];
    for (int corner = 1; corner < 3; ++corner) {
      const char* const other = a.Find(corner == 1 ? "p2" : "p3");
      if (other != nullptr && !ReadIndex(other, look.index[corner]))
        return Fail("p2 and p3 are whole numbers");
    }
    return look;
  }
};

}  // namespace quarry
