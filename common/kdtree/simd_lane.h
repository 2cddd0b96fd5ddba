#pragma once

// Only Highway's static target; x86-64-v3 has all that its AVX2 target needs except AES.
#define HWY_COMPILE_ONLY_STATIC
#define HWY_DISABLE_PCLMUL_AES
#include <hwy/cache_control.h>
#include <hwy/highway.h>

#include <cstdint>

// The only file that uses Highway. A source file that includes it is compiled for one instruction set
// (-march) and instantiates the kernels for it. The types below are in the namespace of that target, so that
// a program can hold instances for several targets.

namespace quarry {
namespace HWY_NAMESPACE {  // NOLINT

namespace hn = hwy::HWY_NAMESPACE;

/// Vectors of `kWidth` lanes. ScalarLane describes the operations.
template <uint32_t kWidth>
struct SimdLanes {
  static constexpr uint32_t kLanes = kWidth;
  static constexpr uint32_t kHalves = kLanes > HWY_LANES(double) ? 2 : 1;
  using FloatTag = hn::FixedTag<float, kLanes>;
  using IntTag = hn::FixedTag<uint32_t, kLanes>;
  using DoubleTag = hn::FixedTag<double, kLanes / kHalves>;
  using HalfTag = hn::FixedTag<float, kLanes / kHalves>;
  static constexpr uint32_t kAllLanes = (1u << kLanes) - 1;
  using Float = hn::Vec<FloatTag>;
  using Int = hn::Vec<IntTag>;
  using Double = hn::Vec<DoubleTag>;
  using HalfFloat = hn::Vec<HalfTag>;
  using Mask = hn::Mask<FloatTag>;

  static HWY_INLINE Float Set(float x) { return hn::Set(FloatTag(), x); }
  static HWY_INLINE Int SetInt(uint32_t x) { return hn::Set(IntTag(), x); }
  static HWY_INLINE Double SetDouble(double x) { return hn::Set(DoubleTag(), x); }
  static HWY_INLINE Float Load(const float* p) { return hn::Load(FloatTag(), p); }
  static HWY_INLINE Float LoadU(const float* p) { return hn::LoadU(FloatTag(), p); }
  static HWY_INLINE Int LoadInt(const uint32_t* p) { return hn::Load(IntTag(), p); }
  static HWY_INLINE void Store(Float x, float* p) { hn::Store(x, FloatTag(), p); }
  static HWY_INLINE void StoreInt(Int x, uint32_t* p) { hn::Store(x, IntTag(), p); }
  static HWY_INLINE Float AsFloat(Int x) { return hn::BitCast(FloatTag(), x); }
  static HWY_INLINE Int AsInt(Float x) { return hn::BitCast(IntTag(), x); }

  static HWY_INLINE Float Fma(Float a, Float b, Float c) { return hn::MulAdd(a, b, c); }
  static HWY_INLINE Float Negate(Float a) { return hn::Neg(a); }
  static HWY_INLINE Float Abs(Float a) { return hn::Abs(a); }
  static HWY_INLINE Float CopySign(Float magnitude, Float sign) { return hn::CopySign(magnitude, sign); }
  static HWY_INLINE Float Min(Float a, Float b) { return hn::Min(a, b); }
  static HWY_INLINE Float Max(Float a, Float b) { return hn::Max(a, b); }
  static HWY_INLINE Float Select(Mask m, Float a, Float b) { return hn::IfThenElse(m, a, b); }
  static HWY_INLINE Int SelectInt(Mask m, Int a, Int b) {
    return hn::IfThenElse(hn::RebindMask(IntTag(), m), a, b);
  }

  static HWY_INLINE Mask Less(Float a, Float b) { return hn::Lt(a, b); }
  static HWY_INLINE Mask LessEqual(Float a, Float b) { return hn::Le(a, b); }
  static HWY_INLINE Mask Equal(Float a, Float b) { return hn::Eq(a, b); }
  static HWY_INLINE Mask LessInt(Int a, Int b) { return hn::RebindMask(FloatTag(), hn::Lt(a, b)); }
  static HWY_INLINE Mask EqualInt(Int a, Int b) { return hn::RebindMask(FloatTag(), hn::Eq(a, b)); }
  static HWY_INLINE Mask HasBits(Int a, uint32_t bits) {
    const Int wanted = SetInt(bits);
    return EqualInt(hn::And(a, wanted), wanted);
  }
  static HWY_INLINE Int Iota() { return hn::Iota(IntTag(), 0); }
  static HWY_INLINE Int AddInt(Int a, Int b) { return a + b; }

  static HWY_INLINE Mask And(Mask a, Mask b) { return hn::And(a, b); }
  static HWY_INLINE Mask Or(Mask a, Mask b) { return hn::Or(a, b); }
  static HWY_INLINE Mask AndNot(Mask no, Mask b) { return hn::AndNot(no, b); }
  static HWY_INLINE Mask Xor(Mask a, Mask b) { return hn::Xor(a, b); }
  static HWY_INLINE Mask NoLanes() { return hn::MaskFromVec(hn::Zero(FloatTag())); }
  static HWY_INLINE bool None(Mask m) { return hn::AllFalse(FloatTag(), m); }
  static HWY_INLINE uint32_t Count(Mask m) { return static_cast<uint32_t>(hn::CountTrue(FloatTag(), m)); }
  static HWY_INLINE uint32_t Bits(Mask m) {
    uint64_t bits = 0;
    hn::StoreMaskBits(FloatTag(), m, reinterpret_cast<uint8_t*>(&bits));
    return static_cast<uint32_t>(bits);
  }
  static HWY_INLINE Mask FromBits(uint32_t bits) {
    const uint64_t word = bits;
    return hn::LoadMaskBits(FloatTag(), reinterpret_cast<const uint8_t*>(&word));
  }

  template <uint32_t kHalf>
  static HWY_INLINE Double Widen(Float x) {
    if constexpr (kHalves == 1)
      return hn::PromoteTo(DoubleTag(), x);
    else if constexpr (kHalf == 0)
      return hn::PromoteTo(DoubleTag(), hn::LowerHalf(HalfTag(), x));
    else
      return hn::PromoteTo(DoubleTag(), hn::UpperHalf(HalfTag(), x));
  }
  static HWY_INLINE HalfFloat Narrow(Double x) { return hn::DemoteTo(HalfTag(), x); }
  static HWY_INLINE uint32_t NegativeBits(Double x) { return DoubleBits(hn::Lt(x, hn::Zero(DoubleTag()))); }
  static HWY_INLINE uint32_t PositiveBits(Double x) { return DoubleBits(hn::Lt(hn::Zero(DoubleTag()), x)); }
  static HWY_INLINE Double MinDouble(Double a, Double b) { return hn::Min(a, b); }
  static HWY_INLINE Double MaxDouble(Double a, Double b) { return hn::Max(a, b); }
  static HWY_INLINE Float Join(HalfFloat low, HalfFloat high) {
    if constexpr (kHalves == 1)
      return low;
    else
      return hn::Combine(FloatTag(), high, low);
  }

 private:
  static HWY_INLINE auto BlockPair(const float* low, const float* high) {
    const hn::FixedTag<float, 4> four;
    return hn::Combine(hn::FixedTag<float, 8>(), hn::LoadU(four, high), hn::LoadU(four, low));
  }
  /// Four floats from `first` on at each of at[0], at[4], ...: one block of 16 bytes each.
  template <uint32_t kFloats = kLanes>
  static HWY_INLINE auto Blocks(const float* const* at, uint32_t first) {
    if constexpr (kFloats == 16)
      return hn::Combine(hn::FixedTag<float, kFloats>(), BlockPair(at[8] + first, at[12] + first),
                         BlockPair(at[0] + first, at[4] + first));
    else
      return BlockPair(at[0] + first, at[4] + first);
  }
  /// The inverse: writes the blocks.
  template <class V>
  static HWY_INLINE void StoreBlocks(V x, float* const* at, uint32_t first) {
    const hn::DFromV<V> d;
    if constexpr (hn::MaxLanes(d) == 4) {
      hn::StoreU(x, d, at[0] + first);
    } else {
      const hn::Half<decltype(d)> half;
      StoreBlocks(hn::LowerHalf(half, x), at, first);
      StoreBlocks(hn::UpperHalf(half, x), at + hn::MaxLanes(half), first);
    }
  }

 public:
  static HWY_INLINE void Prefetch(const void* at, size_t bytes) {
    for (size_t i = 0; i < bytes; i += 64) hwy::Prefetch(static_cast<const char*>(at) + i);
  }
  static HWY_INLINE void PrefetchFar(const void* at, size_t bytes) {
    for (size_t i = 0; i < bytes; i += 64) __builtin_prefetch(static_cast<const char*>(at) + i, 0, 2);
  }
  static HWY_INLINE uint32_t Choose(const uint8_t* masks, uint32_t bit, const uint32_t* ids, uint32_t n,
                                    uint32_t* out) {
    const hn::FixedTag<uint8_t, kLanes> bytes;
    const Int wanted = SetInt(1u << bit);
    uint32_t m = 0;
    for (uint32_t i = 0; i < n; i += kLanes) {
      const Int mask = hn::PromoteTo(IntTag(), hn::LoadU(bytes, masks + i));
      const auto has =
          hn::And(hn::Ne(hn::And(mask, wanted), hn::Zero(IntTag())), hn::FirstN(IntTag(), n - i));
      hn::StoreU(hn::Compress(hn::LoadU(IntTag(), ids + i), has), IntTag(), out + m);
      m += static_cast<uint32_t>(hn::CountTrue(IntTag(), has));
    }
    return m;
  }
  static HWY_INLINE float Least(Float x) { return hn::GetLane(hn::MinOfLanes(FloatTag(), x)); }
  /// Single loads are faster than gathers where microcode slows gathers down (tests/bench/history/kdtree.md).
  static HWY_INLINE void Gather4(const float* const* at, uint32_t first, Float& x, Float& y, Float& z,
                                 Float& w) {
    Transpose(Blocks(at, first), Blocks(at + 1, first), Blocks(at + 2, first), Blocks(at + 3, first), x, y, z,
              w);
  }
  static HWY_INLINE void Scatter4(float* const* at, uint32_t first, Float x, Float y, Float z, Float w) {
    Float r[4];
    Transpose(x, y, z, w, r[0], r[1], r[2], r[3]);
#pragma GCC unroll 4
    for (uint32_t i = 0; i < 4; ++i) StoreBlocks(r[i], at + i, first);
  }
  /// Lane by lane rather than corner by corner, so that the addresses of eight triangles need no registers.
  template <class At>
  static HWY_INLINE void GatherCorners(At&& at, uint32_t last, Float (&x)[3], Float (&y)[3], Float (&z)[3]) {
    static_assert(kLanes == 8);
    alignas(16) static constexpr uint8_t kOrder[3][16] = {
        {4, 5, 6, 7, 8, 9, 10, 11, 0, 1, 2, 3, 12, 13, 14, 15},
        {8, 9, 10, 11, 0, 1, 2, 3, 4, 5, 6, 7, 12, 13, 14, 15},
        {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15}};
    const hn::Repartition<uint8_t, FloatTag> bytes;
    const auto order = hn::LoadDup128(bytes, kOrder[last]);
    Float block[3][4];
#pragma GCC unroll 4
    for (uint32_t i = 0; i < 4; ++i) {
      const auto low = at(i), high = at(i + 4);
#pragma GCC unroll 3
      for (uint32_t k = 0; k < 3; ++k)
        block[k][i] = hn::BitCast(
            FloatTag(), hn::TableLookupBytes(hn::BitCast(bytes, BlockPair(low.at[k], high.at[k])), order));
    }
#pragma GCC unroll 3
    for (uint32_t k = 0; k < 3; ++k) {
      Float unused;
      Transpose(block[k][0], block[k][1], block[k][2], block[k][3], x[k], y[k], z[k], unused);
    }
  }

 private:
  static HWY_INLINE void Transpose(Float r0, Float r1, Float r2, Float r3, Float& x, Float& y, Float& z,
                                   Float& w) {
    const hn::Repartition<double, FloatTag> d;
    const FloatTag f;
    const auto xy01 = hn::BitCast(d, hn::InterleaveLower(f, r0, r1));
    const auto xy23 = hn::BitCast(d, hn::InterleaveLower(f, r2, r3));
    const auto zw01 = hn::BitCast(d, hn::InterleaveUpper(f, r0, r1));
    const auto zw23 = hn::BitCast(d, hn::InterleaveUpper(f, r2, r3));
    x = hn::BitCast(f, hn::InterleaveLower(d, xy01, xy23));
    y = hn::BitCast(f, hn::InterleaveUpper(d, xy01, xy23));
    z = hn::BitCast(f, hn::InterleaveLower(d, zw01, zw23));
    w = hn::BitCast(f, hn::InterleaveUpper(d, zw01, zw23));
  }
  static HWY_INLINE uint32_t DoubleBits(hn::Mask<DoubleTag> m) {
    uint64_t bits = 0;
    hn::StoreMaskBits(DoubleTag(), m, reinterpret_cast<uint8_t*>(&bits));
    return static_cast<uint32_t>(bits);
  }
};
/// Rays: as many lanes as a float vector of this target has.
using SimdLane = SimdLanes<HWY_LANES(float)>;
/// Children of a wide node: eight lanes on every target.
using WideLane = SimdLanes<8>;
static_assert(SimdLane::kLanes == 8 || SimdLane::kLanes == 16, "AVX2 or AVX-512");

}  // namespace HWY_NAMESPACE
}  // namespace quarry
