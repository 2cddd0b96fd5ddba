// Quarry for C++17: quarry.h with exceptions and a scene that closes itself.
#pragma once

#include <cstdint>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "quarry.h"

namespace quarry {

/// A call that failed: its status and its sentence.
class Failure : public std::runtime_error {
 public:
  explicit Failure(quarry_status status) : std::runtime_error(quarry_error()), status_(status) {}
  quarry_status status() const { return status_; }

 private:
  quarry_status status_;
};

/// An open scene. Its calls are those of quarry.h, and throw Failure. Thread-safe but for moves.
class OpenedScene {
 public:
  /// `cache_bytes`, `threads`: 0 for the defaults.
  explicit OpenedScene(const std::string& place, std::uint64_t cache_bytes = 0, std::uint32_t threads = 0) {
    quarry_options options = QUARRY_OPTIONS_INIT;
    options.cache_bytes = cache_bytes;
    options.threads = threads;
    Check(quarry_open(place.c_str(), &options, &scene_));
  }
  OpenedScene(OpenedScene&& other) noexcept : scene_(std::exchange(other.scene_, nullptr)) {}
  OpenedScene& operator=(OpenedScene&& other) noexcept {
    std::swap(scene_, other.scene_);
    return *this;
  }
  ~OpenedScene() { quarry_close(scene_); }

  /// For the calls of quarry.h.
  quarry_scene* handle() const { return scene_; }
  quarry_description Describe() const {
    quarry_description description = QUARRY_DESCRIPTION_INIT;
    Check(quarry_describe(scene_, &description));
    return description;
  }
  std::string PartName(std::uint32_t part) const { return Name(quarry_part_name, part); }
  std::string MaterialName(std::uint32_t material) const { return Name(quarry_material_name, material); }
  void Nearest(const quarry_rays& rays, const quarry_hits& hits) const {
    Check(quarry_nearest(scene_, &rays, &hits));
  }
  /// 1 or 0 for each ray.
  std::vector<std::uint8_t> Any(const quarry_rays& rays) const {
    std::vector<std::uint8_t> hit(rays.count);
    Check(quarry_any(scene_, &rays, hit.data()));
    return hit;
  }
  std::vector<std::uint32_t> Count(const quarry_rays& rays) const {
    std::vector<std::uint32_t> counts(rays.count);
    Check(quarry_count(scene_, &rays, counts.data()));
    return counts;
  }
  void All(const quarry_rays& rays, const std::uint64_t* splits, const quarry_hits& hits) const {
    Check(quarry_all(scene_, &rays, splits, &hits));
  }
  void Cancel(std::uint64_t tag = QUARRY_EVERY_TAG) const { Check(quarry_cancel(scene_, tag)); }

 private:
  static void Check(quarry_status status) {
    if (status != QUARRY_OK) throw Failure(status);
  }
  template <class Call>
  std::string Name(Call call, std::uint32_t id) const {
    std::size_t length = 0;
    Check(call(scene_, id, nullptr, 0, &length));
    std::string name(length + 1, 0);
    Check(call(scene_, id, &name[0], name.size(), nullptr));
    name.resize(length);
    return name;
  }

  quarry_scene* scene_ = nullptr;
};

}  // namespace quarry
