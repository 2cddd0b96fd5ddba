#pragma once

#include <bit>
#include <cmath>
#include <cstdint>

#include "common/math/host_device.h"

// Elementary functions in double that give the same bits on every CPU and on CUDA, unlike a machine's libm.
// They use only +, -, *, / and fma in a fixed order, plus sqrt and trunc, which IEEE 754 defines exactly.
// Accuracy: relative error at most 2e-10 over the stated domains (tested), far below a visible difference.
// The functions without `if` statements have no branches, so that loops over them become vector instructions.
// Thread-safe.

namespace quarry {

/// 2^x for x in [-1000, 1000]; x is clamped outside.
QUARRY_HOST_DEVICE inline double Exp2(double x) {
  x = x < -1000 ? -1000 : (x > 1000 ? 1000 : x);
  const double whole = std::trunc(x + (x < 0 ? -0.5 : 0.5));
  const double y =
      (x - whole) * 0.693147180559945309417;  // |y| <= 0.35: the Taylor series to the 11th power suffices
  double p = 1.0;
  for (int k = 11; k >= 1; --k) p = p * (y / k) + 1.0;
  // The low bits of 2^52 + n, as a double, hold n; the shift makes them the exponent.
  return p * std::bit_cast<double>(std::bit_cast<uint64_t>(whole + (0x1p52 + 1023)) << 52);
}

/// log2(x) for normal positive x. Returns: -1100 for x <= 0 and subnormals.
QUARRY_HOST_DEVICE inline double Log2(double x) {
  const uint64_t bits = std::bit_cast<uint64_t>(x);
  const double m = std::bit_cast<double>((bits & 0xFFFFFFFFFFFFFull) | 0x3FF0000000000000ull);  // [1, 2)
  const double exponent = std::bit_cast<double>(bits >> 52 | 0x4330000000000000ull) - (0x1p52 + 1023);
  const bool upper = m > 1.41421356237309504880;
  const double n = upper ? m * 0.5 : m;
  const double z = (n - 1) / (n + 1);  // |z| <= 0.172; log(n) = 2 atanh(z)
  const double z2 = z * z;
  double p = 0;
  for (int k = 17; k >= 1; k -= 2) p = p * z2 + 1.0 / k;
  const double log = (upper ? exponent + 1 : exponent) + 2 * z * p * 1.44269504088896340736;
  return x >= 2.3e-308 ? log : -1100;
}

/// x^y for x >= 0. 0^y is 0 for y != 0, and x^0 is 1.
QUARRY_HOST_DEVICE inline double Pow(double x, double y) {
  const double power = Exp2(y * Log2(x));
  return y == 0 ? 1 : x > 0 ? power : 0;
}

/// Sine and cosine of x. Units: radians. Requires: |x| <= 1e5.
QUARRY_HOST_DEVICE inline void SinCos(double x, double& sine, double& cosine) {
  const double quarters = x * 0.63661977236758134308;
  const int64_t n = static_cast<int64_t>(quarters < 0 ? quarters - 0.5 : quarters + 0.5);
  const double r = (x - static_cast<double>(n) * 1.57079632673412561417) -
                   // pi/2 as a sum of two constants keeps precision
                   static_cast<double>(n) * 6.07710050650619224932e-11;
  const double r2 = r * r;
  double s = 1, c = 1;
  for (int k = 14; k >= 2; k -= 2) {
    s = 1 - s * r2 / (k * (k + 1));
    c = 1 - c * r2 / (k * (k - 1));
  }
  s *= r;
  const bool swap = n & 1;
  sine = ((n & 2) ? -1.0 : 1.0) * (swap ? c : s);
  cosine = (((n + 1) & 2) ? -1.0 : 1.0) * (swap ? s : c);
}

/// The angle of the point (x, y) from the x axis, in [-pi, pi]; 0 at the origin. Units: radians. Requires:
/// finite numbers.
QUARRY_HOST_DEVICE inline double ArcTan2(double y, double x) {
  constexpr double kPi = 3.14159265358979323846;
  const double across = x < 0 ? -x : x, up = y < 0 ? -y : y;
  const double largest = across > up ? across : up, least = across > up ? up : across;
  const double slope = largest > 0 ? least / largest : 0;  // [0, 1]
  const bool steep = slope > 0.41421356237309504880;       // above half of 45 degrees the rest is small again
  const double z = steep ? (slope - 1) / (slope + 1) : slope, z2 = z * z;
  double series = 0;
  for (int k = 27; k >= 1; k -= 2) series = 1.0 / k - series * z2;
  const double low = z * series + (steep ? kPi / 4 : 0), folded = up > across ? kPi / 2 - low : low;
  const double right = x < 0 ? kPi - folded : folded;
  return y < 0 ? -right : right;
}

/// Tangent of half of `degrees`. Units: degrees. Requires: degrees in (0, 179].
QUARRY_HOST_DEVICE inline double TanHalfDegrees(double degrees) {
  double s = 0, c = 1;
  SinCos(degrees * (3.14159265358979323846 / 360.0), s, c);
  return s / c;
}

/// Encodes a linear value as sRGB; both in [0, 1]. The input is clamped; NaN becomes 0.
/// Source: IEC 61966-2-1.
QUARRY_HOST_DEVICE inline double EncodeSrgb(double linear) {
  if (!(linear > 0)) return 0;
  if (linear >= 1) return 1;
  return linear <= 0.0031308 ? 12.92 * linear : 1.055 * Pow(linear, 1 / 2.4) - 0.055;
}

/// Decodes an sRGB value to a linear value; both in [0, 1]. The input is clamped; NaN becomes 0.
/// Source: IEC 61966-2-1.
QUARRY_HOST_DEVICE inline double DecodeSrgb(double encoded) {
  if (!(encoded > 0)) return 0;
  if (encoded >= 1) return 1;
  return encoded <= 0.04045 ? encoded / 12.92 : Pow((encoded + 0.055) / 1.055, 2.4);
}

}  // namespace quarry
