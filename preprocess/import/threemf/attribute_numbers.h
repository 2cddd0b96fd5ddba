#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>
#include <glm/mat4x4.hpp>

#include "preprocess/import/text/text_number.h"

namespace quarry {

// Numbers in attributes of XML. Each returns false, and changes nothing, if the text is null or anything
// else.

inline bool ReadReal(const char* text, double& value) {
  if (text == nullptr) return false;
  TextCursor cursor(text);
  double read;
  if (!ParseReal(cursor, read)) return false;
  cursor.SkipBlanks();
  if (cursor.next != cursor.end) return false;
  value = read;
  return true;
}

/// A whole number from 0 to 4,294,967,294.
inline bool ReadIndex(const char* text, uint32_t& value) {
  if (text == nullptr) return false;
  TextCursor cursor(text);
  cursor.SkipBlanks();
  int64_t read;
  if (!ParseInteger(cursor, read) || read < 0 || read >= 0xFFFFFFFF) return false;
  cursor.SkipBlanks();
  if (cursor.next != cursor.end) return false;
  value = static_cast<uint32_t>(read);
  return true;
}

/// Twelve finite numbers: the rows of a matrix of four rows and three columns, by which row vectors are
/// multiplied.
inline bool ReadTransform(const char* text, glm::dmat4& transform) {
  if (text == nullptr) return false;
  TextCursor cursor(text);
  glm::dmat4 read(1);
  for (int row = 0; row < 4; ++row)
    for (int column = 0; column < 3; ++column)
      if (!ParseReal(cursor, read[row][column]) || !std::isfinite(read[row][column])) return false;
  cursor.SkipBlanks();
  if (cursor.next != cursor.end) return false;
  transform = read;
  return true;
}

}  // namespace quarry
