#include "common/api/calls.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstring>
#include <utility>

#include "common/api/caller_rays.h"
#include "common/api/open_scenes.h"
#include "common/base/log.h"
#include "common/engine/sources/ray_list.h"
#include "common/kdtree/kernels.h"
#include "common/scene/camera.h"
#include "common/scene/view_basis.h"
#include "common/voxel/store_description.h"

namespace quarry::api {

namespace {

quarry_status StatusOf(ErrorKind kind) {
  switch (kind) {
    case ErrorKind::kUsage:
      return QUARRY_ARGUMENT;
    case ErrorKind::kPermanent:
      return QUARRY_DATA;
    case ErrorKind::kCancelled:
      return QUARRY_CANCELLED;
    case ErrorKind::kMemory:
      return QUARRY_MEMORY;
    case ErrorKind::kFailed:
    case ErrorKind::kCannotResume:
      break;
  }
  return QUARRY_SOURCE;
}

quarry_status Failed(quarry_status status, const char* sentence) {
  KeepSentence(sentence);
  return status;
}

quarry_status NoMemory() {
  return Failed(QUARRY_MEMORY,
                "no memory is left, or the system refuses a thread; give a smaller cache or fewer threads");
}

/// Runs a call's body, a Status. No exception leaves.
template <class Body>
quarry_status Run(Body&& body) {
  try {
    const Status done = body();
    if (done) return QUARRY_OK;
    if (done.error().kind == ErrorKind::kMemory) return NoMemory();
    return Failed(StatusOf(done.error().kind), PrintableName(done.error().message).c_str());
  } catch (const std::exception&) {  // bad_alloc, length_error, system_error of a thread
    return NoMemory();
  }
}

quarry_status Refuse(OpenScenes::Known known) {
  if (known == OpenScenes::Known::kOfParent)
    return Failed(QUARRY_FORKED, "scene was opened before fork(), by the parent; open it in the child");
  return Failed(QUARRY_ARGUMENT, "scene is not open: it is NULL, or was closed");
}

/// Runs a call's body with the scene of a handle.
template <class Body>
quarry_status WithScene(quarry_scene* handle, Body&& body) {
  auto known = OpenScenes::Known::kOpen;
  const quarry_status status = Run([&]() -> Status {
    const OpenScenes::Found found = OpenScenes::OfThisProcess().Find(handle);
    known = found.known;
    return found.scene ? body(*found.scene) : Status();
  });
  return known == OpenScenes::Known::kOpen ? status : Refuse(known);
}

template <class Struct>
Status CheckStruct(const Struct* given, const char* name) {
  if (!given) return BadUsage(fmt::format("{} is NULL", name));
  if (given->size != sizeof(Struct))
    return BadUsage(fmt::format("{0}->size is {1}; set it to sizeof(quarry_{0}), {2}", name, given->size,
                                sizeof(Struct)));
  return {};
}

Status CopyName(const Result<std::string>& found, char* name, size_t capacity, size_t* length) {
  if (!found) return tl::unexpected<Error>(found.error());
  if (!name && capacity > 0) return BadUsage("name is NULL");
  if (length) *length = found->size();
  if (capacity == 0) return {};
  size_t kept = std::min(found->size(), capacity - 1);
  if (kept < found->size())  // no half letter
    while (kept > 0 && (static_cast<unsigned char>((*found)[kept]) & 0xC0) == 0x80) --kept;
  std::memcpy(name, found->data(), kept);
  name[kept] = 0;
  return {};
}

/// Writes hits into the caller's arrays.
class HitWriter {
 public:
  HitWriter(const quarry_hits& hits, const quarry_rays& rays, const SceneMeta& meta)
      : hits_(hits), rays_(rays, meta, 0), meta_(meta) {}

  /// Whether surfaces are wanted.
  static bool WantsSurfaces(const quarry_hits& hits) { return hits.part || hits.material || hits.normal; }
  /// Writes entry `at`: a hit of ray `ray`. `surface`: null if none are wanted.
  void Write(size_t at, size_t ray, const Hit& hit, const HitSurface* surface) const {
    const bool is_hit = hit.triangle != kNoTriangle;
    if (hits_.t) hits_.t[at] = is_hit ? TOf(ray, hit) : std::numeric_limits<double>::infinity();
    if (hits_.triangle) hits_.triangle[at] = hit.triangle;
    if (hits_.uv) {
      hits_.uv[2 * at] = is_hit ? hit.b1 : 0;
      hits_.uv[2 * at + 1] = is_hit ? hit.b2 : 0;
    }
    if (!surface) return;
    if (hits_.part) hits_.part[at] = is_hit ? surface->part : QUARRY_NONE;
    if (hits_.material) hits_.material[at] = is_hit ? surface->material : QUARRY_NONE;
    if (hits_.normal)
      for (int a = 0; a < 3; ++a)
        hits_.normal[3 * at + static_cast<size_t>(a)] = is_hit ? surface->normal[a] : 0.0f;
  }

 private:
  double TOf(size_t ray, const Hit& hit) const {
    RayQuery query;
    rays_.Read(ray, std::span(&query, 1));
    const bool stays = IsWithinReach(query.origin, meta_.root_lower, meta_.root_upper);
    const double start = stays ? 0 : RayOfQuery(query, meta_).start;
    return (start + static_cast<double>(hit.t)) / CallerRays::UnitOf(query);
  }

  const quarry_hits& hits_;
  const CallerRays rays_;
  const SceneMeta& meta_;
};

HitRule RuleOf(const quarry_rays& rays) { return {(rays.flags & QUARRY_GLASS_PASSES) != 0, 0.5f}; }

const HitSurface* SurfaceOf(const RenderedTile& tile, size_t i) {
  return tile.surfaces.empty() ? nullptr : &tile.surfaces[i];
}

Status CheckSplits(const uint64_t* splits, size_t count) {
  if (!splits) return BadUsage("splits is NULL");
  if (splits[0] != 0) return BadUsage(fmt::format("splits[0] is {}; it is 0", splits[0]));
  for (size_t i = 0; i < count; ++i)
    if (splits[i + 1] < splits[i])
      return BadUsage(fmt::format("splits[{}] is less than splits[{}]", i + 1, i));
  return {};
}

}  // namespace

quarry_status Open(const char* place, const quarry_options* options, quarry_scene** scene) {
  bool has_kernels = true;
  const quarry_status status = Run([&]() -> Status {
    has_kernels = !Kernels().empty();
    if (!has_kernels) return {};
    if (!place) return BadUsage("place is NULL");
    if (!scene) return BadUsage("scene is NULL");
    quarry_options chosen = QUARRY_OPTIONS_INIT;
    if (options) {
      QUARRY_TRY(CheckStruct(options, "options"));
      chosen = *options;
    }
    QUARRY_ASSIGN(std::shared_ptr<OpenScene> opened, OpenScene::Open(place, chosen));
    *scene = OpenScenes::OfThisProcess().Add(std::move(opened));
    return {};
  });
  if (has_kernels) return status;
  return Failed(QUARRY_PROCESSOR, "QUARRY_ISA names no instruction set that this processor has");
}

quarry_status Close(quarry_scene* scene) {
  if (!scene) return QUARRY_OK;
  auto known = OpenScenes::Known::kOpen;
  const quarry_status status = Run([&]() -> Status {
    const OpenScenes::Found found = OpenScenes::OfThisProcess().Take(scene);
    known = found.known;
    if (found.scene) found.scene->Close();
    return {};
  });
  return known == OpenScenes::Known::kOpen ? status : Refuse(known);
}

quarry_status Describe(quarry_scene* scene, quarry_description* description) {
  return WithScene(scene, [&](OpenScene& open) -> Status {
    QUARRY_TRY(CheckStruct(description, "description"));
    quarry_description d = QUARRY_DESCRIPTION_INIT;
    const SceneMeta& meta = open.meta();
    const auto [lower, upper] = ModelBounds(meta);
    for (int a = 0; a < 3; ++a) {
      d.lower[a] = lower[a];
      d.upper[a] = upper[a];
      d.offset[a] = meta.offset[a];
    }
    d.unit_in_metres = meta.unit_in_metres;
    d.up_axis = meta.up_axis;
    d.materials = static_cast<uint32_t>(open.store().catalog().materials.size());
    d.parts = open.store().part_count();
    d.triangles = meta.kept_triangles();
    d.triangle_ids = meta.input_triangles;
    d.voxels = open.store().catalog().voxels.size();
    d.decoded_bytes = open.store().catalog().DecodedBytes();
    d.largest_block_bytes = meta.largest_decoded;
    *description = d;
    return {};
  });
}

quarry_status PartName(quarry_scene* scene, uint32_t part, char* name, size_t capacity, size_t* length) {
  return WithScene(scene, [&](OpenScene& open) -> Status {
    if (const uint64_t parts = open.store().part_count(); part >= parts)
      return BadUsage(fmt::format("part is {}; the scene has {} parts", part, parts));
    return CopyName(open.store().PartName(part), name, capacity, length);
  });
}

quarry_status MaterialName(quarry_scene* scene, uint32_t material, char* name, size_t capacity,
                           size_t* length) {
  return WithScene(scene, [&](OpenScene& open) -> Status {
    if (const size_t materials = open.store().catalog().materials.size(); material >= materials)
      return BadUsage(fmt::format("material is {}; the scene has {} materials", material, materials));
    return CopyName(open.store().MaterialName(material), name, capacity, length);
  });
}

quarry_status Nearest(quarry_scene* scene, const quarry_rays* rays, const quarry_hits* hits) {
  return WithScene(scene, [&](OpenScene& open) -> Status {
    QUARRY_TRY(CheckArrays(rays));
    QUARRY_TRY(CheckStruct(hits, "hits"));
    const HitWriter writer(*hits, *rays, open.meta());
    const auto write = [&](size_t first, const RenderedTile& tile) {
      for (size_t i = 0; i < tile.hits.size(); ++i)
        writer.Write(first + i, first + i, tile.hits[i], SurfaceOf(tile, i));
    };
    return open.Ask(*rays, {RayGoal::kNearest, HitWriter::WantsSurfaces(*hits), RuleOf(*rays)}, write);
  });
}

quarry_status Any(quarry_scene* scene, const quarry_rays* rays, uint8_t* hit) {
  return WithScene(scene, [&](OpenScene& open) -> Status {
    QUARRY_TRY(CheckArrays(rays));
    if (!hit && rays->count > 0) return BadUsage("hit is NULL");
    const auto write = [&](size_t first, const RenderedTile& tile) {
      for (const Hit& h : tile.hits) hit[first++] = h.triangle != kNoTriangle ? 1 : 0;
    };
    return open.Ask(*rays, {RayGoal::kAny, false, RuleOf(*rays)}, write);
  });
}

quarry_status Count(quarry_scene* scene, const quarry_rays* rays, uint32_t* counts) {
  return WithScene(scene, [&](OpenScene& open) -> Status {
    QUARRY_TRY(CheckArrays(rays));
    if (!counts && rays->count > 0) return BadUsage("counts is NULL");
    const auto write = [&](size_t first, const RenderedTile& tile) {
      std::ranges::copy(tile.counts, counts + first);
    };
    return open.Ask(*rays, {RayGoal::kCount, false, RuleOf(*rays)}, write);
  });
}

quarry_status All(quarry_scene* scene, const quarry_rays* rays, const uint64_t* splits,
                  const quarry_hits* hits) {
  return WithScene(scene, [&](OpenScene& open) -> Status {
    QUARRY_TRY(CheckArrays(rays));
    QUARRY_TRY(CheckStruct(hits, "hits"));
    QUARRY_TRY(CheckSplits(splits, rays->count));
    const HitWriter writer(*hits, *rays, open.meta());
    std::atomic<size_t> differs{SIZE_MAX};
    const auto write = [&](size_t first, const RenderedTile& tile) {
      size_t next = 0;
      for (size_t i = 0; i < tile.counts.size(); ++i) {
        const size_t ray = first + i, count = tile.counts[i];
        if (splits[ray] + count != splits[ray + 1]) {
          differs = std::min(differs.load(), ray);
          return;
        }
        for (size_t k = 0; k < count; ++k, ++next)
          writer.Write(splits[ray] + k, ray, tile.hits[next], SurfaceOf(tile, next));
      }
    };
    Renderer::RayAsk ask{RayGoal::kAll, HitWriter::WantsSurfaces(*hits), RuleOf(*rays)};
    ask.splits = std::span(splits, rays->count + 1);
    QUARRY_TRY(open.Ask(*rays, ask, write));
    if (const size_t ray = differs; ray != SIZE_MAX)
      return BadUsage(fmt::format("splits[{}] - splits[{}] is {}, which is not the number of the ray's hits",
                                  ray + 1, ray, splits[ray + 1] - splits[ray]));
    return {};
  });
}

quarry_status Pinhole(const double* eye, const double* at, const double* up, double fov_degrees,
                      int which_fov, uint32_t width, uint32_t height, double* rays) {
  return Run([&]() -> Status {
    if (!eye || !at || !up || !rays) return BadUsage("eye, at, up or rays is NULL");
    if (which_fov != QUARRY_VERTICAL && which_fov != QUARRY_HORIZONTAL)
      return BadUsage(fmt::format("which_fov is {}; it is QUARRY_VERTICAL or QUARRY_HORIZONTAL", which_fov));
    if (width == 0 || height == 0) return BadUsage("width or height is 0");
    const CameraSpec camera{
        {eye[0], eye[1], eye[2]}, {at[0], at[1], at[2]}, {up[0], up[1], up[2]}, fov_degrees};
    if (!(fov_degrees > 0) || fov_degrees > 179)
      return BadUsage(fmt::format("fov_degrees is {}; it lies in (0, 179]", fov_degrees));
    const ViewBasis view = MakeViewBasis(camera, which_fov == QUARRY_VERTICAL ? height : width);
    const auto is_sound = [](const glm::dvec3& v) { return Dot(v, v) > 0 && std::isfinite(Dot(v, v)); };
    if (!is_sound(view.forward))
      return BadUsage("eye and at are the same, too near or too far apart, or no numbers");
    if (!is_sound(view.right) || !is_sound(view.down))
      return BadUsage("up is no number, or lies along the way from eye to at");
    for (uint32_t y = 0; y < height; ++y)
      for (uint32_t x = 0; x < width; ++x) {
        const glm::dvec3 direction = view.forward + AcrossOf(view, x + 0.5, y + 0.5, width, height);
        for (int a = 0; a < 3; ++a) {
          rays[a] = view.eye[a];
          rays[3 + a] = direction[a];
        }
        rays += 6;
      }
    return {};
  });
}

quarry_status Cancel(quarry_scene* scene, uint64_t tag) {
  return WithScene(scene, [&](OpenScene& open) -> Status {
    open.Cancel(tag);
    return {};
  });
}

quarry_status Measure(quarry_scene* scene, quarry_statistics* statistics) {
  return WithScene(scene, [&](OpenScene& open) -> Status {
    QUARRY_TRY(CheckStruct(statistics, "statistics"));
    *statistics = open.Measure();
    return {};
  });
}

}  // namespace quarry::api
