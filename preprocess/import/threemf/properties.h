#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "common/base/status.h"
#include "preprocess/import/model_sink.h"

namespace quarry {

/// Parses "#RRGGBB" or "#RRGGBBAA" into sRGB bytes. False: other text.
bool ParseThreeMfColor(const char* text, Rgba8& color);

/// The materials and colours of a 3MF, in groups that a part numbers. Thread safety: none.
class ThreeMfProperties {
 public:
  /// Limits: a colour takes 4 bytes here, a material some hundred in the scene.
  static constexpr size_t kMostColors = 1 << 22, kMostMaterials = 1 << 16, kMostGroups = 1 << 16;

  enum class Kind : uint8_t {
    kMaterials,
    kColors,
    kLeftOut,  ///< textures and mixtures, which are not read
  };
  /// The look of a corner of a triangle.
  struct Look {
    uint32_t material = kNoIndex;  ///< of the sink
    bool colored = false;          ///< `color`, which is linear, counts
    Rgba8 color;
    bool operator==(const Look& o) const {
      return material == o.material && colored == o.colored && Packed(color) == Packed(o.color);
    }
  };

  /// Begins a group of a part; materials and colours that are added next belong to it. Errors: the part has
  /// the number twice; too many.
  Status BeginGroup(uint32_t part, uint32_t id, Kind kind);
  /// Each adds to the group, if it is of that kind. `color`: as ParseThreeMfColor() gives it. Requires:
  /// BeginGroup(). Errors: too many.
  Status AddMaterial(std::string name, const Rgba8& color);
  Status AddColor(const Rgba8& color);

  /// Gives the materials to the sink.
  void GiveTo(ModelSink& sink);
  bool has_groups() const { return !groups_.empty(); }

  /// The look by number `index` of a group. False: there is no such group, or none that is read, or nothing
  /// by that number.
  bool Find(uint32_t part, uint32_t id, uint32_t index, Look& look) const;

 private:
  struct Group {
    Kind kind = Kind::kLeftOut;
    uint32_t first = 0, count = 0;
  };
  struct Base {
    std::string name;
    Rgba8 color;
  };
  std::map<std::pair<uint32_t, uint32_t>, Group> groups_;
  Group* group_ = nullptr;  ///< the latest
  std::vector<Base> bases_;
  std::vector<uint32_t> materials_;  ///< of each base, the sink's index
  std::vector<Rgba8> colors_;        ///< linear
};

}  // namespace quarry
