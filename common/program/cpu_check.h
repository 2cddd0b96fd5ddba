#pragma once

namespace quarry {

/// Makes the program end with a sentence instead of a signal on a processor without AVX2, FMA and BMI2.
/// Calling this function first in main links the check, which runs before any other initialiser.
void RequireCpu();

}  // namespace quarry
