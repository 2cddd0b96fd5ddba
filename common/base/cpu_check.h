#pragma once

namespace quarry {

/// Linking this file's object (by calling it first in main) makes a program end with a sentence, not a
/// signal, on a processor without AVX2 and FMA. The test itself runs before any other initialiser.
void RequireCpu();

}  // namespace quarry
