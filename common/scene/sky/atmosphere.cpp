#include "common/scene/sky/atmosphere.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <glm/common.hpp>
#include <mutex>
#include <numbers>

#include "common/math/elementary.h"

namespace quarry {
namespace {

using glm::dvec3;

constexpr double kPi = std::numbers::pi;
// Units: km. Red, green and blue stand for 680, 550 and 440 nm. Source: Hillaire 2020, table 1.
constexpr double kGround = 6360, kTop = 6460, kEye = kGround + 0.001;
constexpr dvec3 kAir{5.802e-3, 13.558e-3, 33.1e-3}, kOzone{0.650e-3, 1.881e-3, 0.085e-3};
constexpr double kAirScale = 8, kHazeScale = 1.2;
constexpr double kHazeAlbedo = 0.9, kHazeForward = 0.8;  ///< the share that haze scatters; how much forward
constexpr double kGroundAlbedo = 0.3;                    ///< of the earth, which lights the air from below
constexpr double kSunRadius = 0.00465;                   ///< radians

double Exp(double x) { return Exp2(x * 1.44269504088896341); }
dvec3 Exp(const dvec3& x) { return {Exp(x.x), Exp(x.y), Exp(x.z)}; }

/// Shares of light that a kilometre of air scatters, by air and by haze, and takes in all.
struct Medium {
  dvec3 air, taken;
  double haze;
};

/// Source: Chandrasekhar 1960, for air; Cornette & Shanks 1992, for haze. `c`: cosine of the angle by which
/// light turns.
double AirPhase(double c) { return 3 / (16 * kPi) * (1 + c * c); }
double HazePhase(double c) {
  constexpr double g = kHazeForward;
  const double wide = 1 + g * g - 2 * g * c;
  return 3 / (8 * kPi) * (1 - g * g) * (1 + c * c) / ((2 + g * g) * wide * std::sqrt(wide));
}

/// Air with haze, and the shares of light that pass through it. Units: km; cosines are of angles from the
/// zenith.
class Air {
 public:
  explicit Air(double haze) : haze_((haze - 1) * kAir.y * kAirScale / kHazeScale) { FillDepths(); }

  Medium At(double radius) const {
    const double height = std::max(radius - kGround, 0.0);
    const dvec3 air = kAir * Exp(-height / kAirScale);
    const double haze = haze_ * Exp(-height / kHazeScale);
    const double ozone = std::max(1 - std::fabs(height - 25) / 15, 0.0);
    return {air, air + haze + kOzone * ozone, haze * kHazeAlbedo};
  }
  /// The share of the sun's light that comes to a point.
  dvec3 SunAt(double radius, double cosine) const {
    const double seen = Seen(radius, cosine);
    return seen > 0 ? Exp(-TabledDepth(radius, std::max(cosine, Horizon(radius)))) * seen : dvec3(0);
  }
  /// The same, without a table: slow.
  dvec3 SunExactlyAt(double radius, double cosine) const {
    return Exp(-Depth(radius, std::max(cosine, Horizon(radius)))) * Seen(radius, cosine);
  }
  static double ToTop(double radius, double cosine) {
    return -radius * cosine + std::sqrt(std::max(radius * radius * (cosine * cosine - 1) + kTop * kTop, 0.0));
  }

 private:
  static constexpr int kSteps = 80, kHeights = 32, kCosines = 256;

  static double Horizon(double radius) {
    return -std::sqrt(std::max(1 - kGround * kGround / (radius * radius), 0.0));
  }
  /// The part of the sun's disc above the horizon, taken as growing evenly.
  static double Seen(double radius, double cosine) {
    return std::clamp((cosine - Horizon(radius)) / (2 * kSunRadius) + 0.5, 0.0, 1.0);
  }

  /// The depth of the air from points to its top. Source of the table's axes: Bruneton & Neyret 2008,
  /// section 4.
  void FillDepths() {
    for (size_t h = 0; h < kHeights; ++h)
      for (size_t c = 0; c < kCosines; ++c) {
        const double wide = kWide * static_cast<double>(h) / (kHeights - 1);
        const double radius = std::sqrt(wide * wide + kGround * kGround);
        const double least = kTop - radius, most = wide + kWide;
        const double length = least + (most - least) * static_cast<double>(c) / (kCosines - 1);
        double cosine = 1;
        if (length > 0) cosine = (kWide * kWide - wide * wide - length * length) / (2 * radius * length);
        depths_[h * kCosines + c] = Depth(radius, std::clamp(cosine, -1.0, 1.0));
      }
  }
  dvec3 Depth(double radius, double cosine) const {
    const double length = ToTop(radius, cosine);
    dvec3 depth(0);
    for (int i = 0; i < kSteps; ++i) {
      const double a = static_cast<double>(i) / kSteps, b = (i + 1.0) / kSteps;
      const double t = length * (a * a + b * b) / 2;
      depth +=
          At(std::sqrt(radius * radius + t * t + 2 * radius * t * cosine)).taken * (length * (b * b - a * a));
    }
    return depth;
  }
  dvec3 TabledDepth(double radius, double cosine) const {
    const double wide = std::sqrt(std::max(radius * radius - kGround * kGround, 0.0));
    const double least = kTop - radius, most = wide + kWide;
    const double r = std::clamp(wide / kWide, 0.0, 1.0) * (kHeights - 1);
    const double c = std::clamp((ToTop(radius, cosine) - least) / (most - least), 0.0, 1.0) * (kCosines - 1);
    const size_t i = std::min<size_t>(static_cast<size_t>(r), kHeights - 2);
    const size_t j = std::min<size_t>(static_cast<size_t>(c), kCosines - 2);
    const double y = r - static_cast<double>(i), x = c - static_cast<double>(j);
    const auto across = [&](size_t row) {
      return depths_[row * kCosines + j] * (1 - x) + depths_[row * kCosines + j + 1] * x;
    };
    return across(i) * (1 - y) + across(i + 1) * y;
  }

  const double kWide = std::sqrt(kTop * kTop - kGround * kGround);  ///< from the horizon to the air's top
  const double haze_;                                               ///< taken by a kilometre at the ground
  std::array<dvec3, size_t{kHeights} * kCosines> depths_{};
};

/// Light that is scattered more than once, by directions at levels of the air, all over a sun at one height.
/// Directions are where light comes from: cells of equal size in the cosine from the zenith and in the angle
/// from the sun's side; both halves are alike. Levels stand at the fourth powers of their shares.
/// Source: the method of successive orders of scattering, van de Hulst 1980, in level layers.
class Scattered {
 public:
  Scattered(const Air& air, double sun) : air_(air), sun_(sun), sun_side_(std::sqrt(1 - sun * sun)) {
    std::vector<dvec3> source(size_t{kLevels} * kDirections);
    for (size_t level = 0; level < kLevels; ++level) FirstSource(level, &source[level * kDirections]);
    std::vector<dvec3> light(source.size());
    dvec3 before(0), all(0);
    for (int order = 2; order <= kOrders; ++order) {
      Carry(source, light, order == 2);
      before = all;
      all = dvec3(0);
      for (size_t level = 0; level < kLevels; ++level)
        all += Scatter(level, &light[level * kDirections], &source[level * kDirections]);
      for (size_t i = 0; i < source.size(); ++i) sent_[i] += source[i];
    }
    // Further orders fall off by the same factor.
    const dvec3 factor = all / glm::max(before, dvec3(1e-300));
    for (size_t i = 0; i < source.size(); ++i) sent_[i] += source[i] * factor / (dvec3(1) - factor);
  }

  /// The light that a kilometre of air scatters toward a viewer who looks into this direction. `turn`:
  /// radians from the sun's side, in [0, pi].
  dvec3 Sent(double height, double cosine, double turn) const {
    const double l = std::sqrt(std::sqrt(std::clamp(height / (kTop - kGround), 0.0, 1.0))) * (kLevels - 1);
    const double m = std::clamp((cosine + 1) / 2 * kCosines - 0.5, 0.0, kCosines - 1.0);
    const double t = std::clamp(turn / kPi * kTurns - 0.5, 0.0, kTurns - 1.0);
    const auto i = std::min<size_t>(static_cast<size_t>(l), kLevels - 2);
    const auto j = std::min<size_t>(static_cast<size_t>(m), kCosines - 2);
    const auto k = std::min<size_t>(static_cast<size_t>(t), kTurns - 2);
    const double z = l - static_cast<double>(i), y = m - static_cast<double>(j),
                 x = t - static_cast<double>(k);
    const auto along = [&](size_t level, size_t row) {
      const dvec3* const at = &sent_[level * kDirections + row * kTurns + k];
      return at[0] * (1 - x) + at[1] * x;
    };
    const auto over = [&](size_t level) { return along(level, j) * (1 - y) + along(level, j + 1) * y; };
    return over(i) * (1 - z) + over(i + 1) * z;
  }

 private:
  static constexpr size_t kLevels = 28, kCosines = 24, kTurns = 12, kDirections = kCosines * kTurns;
  static constexpr int kOrders = 12, kInCell = 3;
  /// Solid angle of a cell and of its like on the other side.
  static constexpr double kSolid = 2 * (2.0 / kCosines) * (kPi / kTurns);

  static double HeightOf(size_t level) {
    const double share = static_cast<double>(level) / (kLevels - 1);
    return (kTop - kGround) * share * share * share * share;
  }
  static size_t RowOf(size_t direction) { return direction / kTurns; }
  static double CosineOf(size_t direction) {
    return -1 + 2 * (static_cast<double>(RowOf(direction)) + 0.5) / kCosines;
  }
  /// A direction within a cell; x lies on the sun's side. `a`, `b`: in [0, 1].
  static dvec3 Within(size_t direction, double a, double b) {
    const double cosine = -1 + 2 * (static_cast<double>(RowOf(direction)) + a) / kCosines;
    double sine = 0, turn = 1;
    SinCos(kPi * (static_cast<double>(direction % kTurns) + b) / kTurns, sine, turn);
    const double side = std::sqrt(std::max(1 - cosine * cosine, 0.0));
    return {side * turn, side * sine, cosine};
  }
  /// The mean of a phase over a cell and its like on the other side.
  template <class Phase>
  static double MeanOver(size_t direction, const dvec3& from, Phase&& phase) {
    double sum = 0;
    for (int a = 0; a < kInCell; ++a)
      for (int b = 0; b < kInCell; ++b) {
        const dvec3 d = Within(direction, (a + 0.5) / kInCell, (b + 0.5) / kInCell);
        sum += phase(d.x * from.x + d.y * from.y + d.z * from.z) +
               phase(d.x * from.x - d.y * from.y + d.z * from.z);
      }
    return sum / (2 * kInCell * kInCell);
  }
  /// The share of light of each direction that haze scatters into each, by rows of the latter: times kSolid.
  static const std::vector<double>& HazeShares() {
    static const std::vector<double> shares = [] {
      std::vector<double> made(kDirections * kDirections);
      for (size_t to = 0; to < kDirections; ++to) {
        double sum = 0;
        double* const row = &made[to * kDirections];
        for (size_t from = 0; from < kDirections; ++from)
          sum += row[from] = MeanOver(from, Within(to, 0.5, 0.5), HazePhase);
        for (size_t from = 0; from < kDirections; ++from) row[from] /= sum;  // no light is lost
      }
      return made;
    }();
    return shares;
  }

  /// The sun's light that a level scatters, into each direction.
  void FirstSource(size_t level, dvec3* source) const {
    const double radius = kGround + HeightOf(level);
    const Medium m = air_.At(radius);
    const dvec3 light = air_.SunAt(radius, sun_), to_sun(sun_side_, 0, sun_);
    for (size_t d = 0; d < kDirections; ++d)
      source[d] = light * (m.air * MeanOver(d, to_sun, AirPhase) + m.haze * MeanOver(d, to_sun, HazePhase));
  }

  /// The light at all levels of what is sent at all levels. Layers are level; a ray's way through one is that
  /// through a shell of the earth, so that flat rays end.
  void Carry(const std::vector<dvec3>& source, std::vector<dvec3>& light, bool of_sun) const {
    std::array<Medium, kLevels> media;
    for (size_t level = 0; level < kLevels; ++level) media[level] = air_.At(kGround + HeightOf(level));
    const auto layer = [&](size_t from, size_t to, size_t d) {
      const double thick = std::fabs(HeightOf(from) - HeightOf(to)), cosine = std::fabs(CosineOf(d));
      const double way = -kGround * cosine +
                         std::sqrt(kGround * kGround * cosine * cosine + 2 * kGround * thick + thick * thick);
      const dvec3 taken = (media[from].taken + media[to].taken) * 0.5, through = Exp(-taken * way);
      const dvec3 sent = (source[from * kDirections + d] + source[to * kDirections + d]) * 0.5;
      light[to * kDirections + d] =
          light[from * kDirections + d] * through + sent * (dvec3(1) - through) / taken;
    };
    dvec3 on_ground = of_sun ? air_.SunAt(kGround, sun_) * std::max(sun_, 0.0) : dvec3(0);
    for (size_t d = kDirections / 2; d < kDirections; ++d) {
      light[(kLevels - 1) * kDirections + d] = dvec3(0);
      for (size_t level = kLevels - 1; level > 0; --level) layer(level, level - 1, d);
      on_ground += light[d] * (CosineOf(d) * kSolid);
    }
    for (size_t d = 0; d < kDirections / 2; ++d) {
      light[d] = on_ground * (kGroundAlbedo / kPi);
      for (size_t level = 0; level + 1 < kLevels; ++level) layer(level, level + 1, d);
    }
  }

  /// The light that a level scatters, of the light there. Returns: its sum over the directions.
  dvec3 Scatter(size_t level, const dvec3* light, dvec3* source) const {
    // Air: 1 + cos^2 needs the sum of the light and its second moments.
    std::array<dvec3, 5> moments{};
    for (size_t d = 0; d < kDirections; ++d) {
      const dvec3 v = Within(d, 0.5, 0.5), power = light[d] * kSolid;
      const std::array<double, 5> terms{1, v.x * v.x, v.y * v.y, v.z * v.z, 2 * v.x * v.z};
      for (size_t i = 0; i < terms.size(); ++i) moments[i] += power * terms[i];
    }
    const Medium m = air_.At(kGround + HeightOf(level));
    const std::vector<double>& shares = HazeShares();
    dvec3 all(0);
    for (size_t d = 0; d < kDirections; ++d) {
      const dvec3 v = Within(d, 0.5, 0.5);
      const dvec3 air = (moments[0] + moments[1] * (v.x * v.x) + moments[2] * (v.y * v.y) +
                         moments[3] * (v.z * v.z) + moments[4] * (v.x * v.z)) *
                        (3 / (16 * kPi));
      dvec3 haze(0);
      if (m.haze > 0)
        for (size_t from = 0; from < kDirections; ++from)
          haze += light[from] * shares[d * kDirections + from];
      source[d] = m.air * air + haze * m.haze;
      all += source[d];
    }
    return all;
  }

  const Air& air_;
  const double sun_, sun_side_;
  std::vector<dvec3> sent_ = std::vector<dvec3>(kLevels * kDirections);
};

/// Radiance from a direction at the ground. `turn`: radians from the sun's side. A sun whose irradiance is 1.
dvec3 SkyAt(const Air& air, const Scattered& scattered, double cosine, double turn, double sun) {
  constexpr int kSteps = 48;
  double sine = 0, ahead = 1;
  SinCos(turn, sine, ahead);
  const double side = std::sqrt(1 - cosine * cosine);
  const double toward = std::clamp(cosine * sun + side * std::sqrt(1 - sun * sun) * ahead, -1.0, 1.0);
  const double length = Air::ToTop(kEye, cosine);
  dvec3 light(0), passed(1);
  double begin = 0;
  for (int i = 1; i <= kSteps; ++i) {  // steps grow with the square of their number
    const double share = static_cast<double>(i) / kSteps, end = length * share * share;
    const double t = (begin + end) / 2, radius = std::sqrt(kEye * kEye + t * t + 2 * kEye * t * cosine);
    const Medium m = air.At(radius);
    const dvec3 through = Exp(-m.taken * (end - begin));
    const dvec3 once = (m.air * AirPhase(toward) + m.haze * HazePhase(toward)) *
                       air.SunAt(radius, (kEye * sun + t * toward) / radius);
    const dvec3 more = scattered.Sent(radius - kGround, (kEye * cosine + t) / radius, turn);
    light += passed * (once + more) * (dvec3(1) - through) / m.taken;
    passed *= through;
    begin = end;
  }
  return light;
}

AtmosphereTable TableOf(double haze, double sun) {
  const auto air = std::make_unique<const Air>(haze);
  const Scattered scattered(*air, sun);
  AtmosphereTable table;
  for (uint32_t row = 0; row < AtmosphereTable::kRows; ++row)
    for (uint32_t column = 0; column < AtmosphereTable::kColumns; ++column) {
      const double r = static_cast<double>(row) / (AtmosphereTable::kRows - 1);
      const double c = static_cast<double>(column) / (AtmosphereTable::kColumns - 1);
      // A sun whose light is 1 has an irradiance of pi.
      table.radiance.emplace_back(SkyAt(*air, scattered, r * r, kPi * c * c, sun) * kPi);
    }
  table.sun = glm::vec3(air->SunExactlyAt(kEye, sun));
  return table;
}

}  // namespace

std::shared_ptr<const AtmosphereTable> MakeAtmosphere(float haze, float sun_height) {
  struct Known {
    float haze, sun;
    std::shared_ptr<const AtmosphereTable> table;
  };
  constexpr size_t kMostKnown = 8;
  static std::mutex mutex;
  static std::deque<Known> known;
  const float sun = std::clamp(sun_height, kLeastTwilight, 1.0f);
  {
    const std::lock_guard lock(mutex);
    for (const Known& k : known)
      if (k.haze == haze && k.sun == sun) return k.table;
  }
  auto table =
      std::make_shared<const AtmosphereTable>(TableOf(static_cast<double>(haze), static_cast<double>(sun)));
  const std::lock_guard lock(mutex);
  known.push_front({haze, sun, table});
  if (known.size() > kMostKnown) known.pop_back();
  return table;
}

std::vector<Light> LightsInAir(const View& view) {
  std::vector<Light> lights = view.lights;
  const auto sun = std::ranges::find(lights, LightKind::kSun, &Light::kind);
  if (view.sky.atmosphere && sun != lights.end()) sun->radiance *= view.sky.atmosphere->sun;
  return lights;
}

}  // namespace quarry
