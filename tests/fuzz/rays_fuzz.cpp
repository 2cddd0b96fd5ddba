// The calls of quarry.h: the bytes are rays, the ways in which they are asked, and a store, as it is and with
// all checksums made right. Each call comes back with a status, a sentence where it fails, and nothing
// written beyond its arrays.
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

#include "common/api/quarry.h"
#include "tests/fuzz/store_mend.h"

namespace {

constexpr size_t kWays = 8, kMostRays = 16, kRayBytes = 8 * sizeof(double);

/// An array of results that notices what is written beyond its end.
template <class Number>
class Guarded {
 public:
  explicit Guarded(size_t count) : numbers_(count + 1) {
    std::memset(&numbers_[count], 0x5A, sizeof(Number));
  }
  ~Guarded() {
    Number untouched;
    std::memset(&untouched, 0x5A, sizeof untouched);
    if (std::memcmp(&numbers_.back(), &untouched, sizeof untouched) != 0) std::abort();
  }
  Number* data() { return numbers_.data(); }
  Number operator[](size_t i) const { return numbers_[i]; }

 private:
  std::vector<Number> numbers_;
};

bool Came(quarry_status status) {
  if (status != QUARRY_OK && quarry_error()[0] == 0) std::abort();
  return status == QUARRY_OK;
}

quarry_hits HitsIn(Guarded<double>& t, Guarded<uint32_t>& triangle, Guarded<uint32_t>& part,
                   Guarded<float>& uv, Guarded<float>& normal) {
  quarry_hits hits = QUARRY_HITS_INIT;
  hits.t = t.data();
  hits.triangle = triangle.data();
  hits.part = part.data();
  hits.uv = uv.data();
  hits.normal = normal.data();
  return hits;
}

void AskAll(quarry_scene* scene, const quarry_rays& rays) {
  Guarded<uint32_t> counts(rays.count);
  if (!Came(quarry_count(scene, &rays, counts.data()))) return;
  std::vector<uint64_t> splits{0};
  for (size_t i = 0; i < rays.count; ++i) splits.push_back(splits.back() + counts[i]);
  const size_t n = splits.back();
  Guarded<double> t(n);
  Guarded<uint32_t> triangle(n), part(n);
  Guarded<float> uv(2 * n), normal(3 * n);
  const quarry_hits hits = HitsIn(t, triangle, part, uv, normal);
  if (!Came(quarry_all(scene, &rays, splits.data(), &hits))) return;
  for (size_t i = 0; i < rays.count; ++i)
    for (uint64_t k = splits[i]; k + 1 < splits[i + 1]; ++k)
      if (!(t[k] <= t[k + 1])) std::abort();
}

void Ask(quarry_scene* scene, const uint8_t* ways, const std::vector<uint8_t>& numbers) {
  quarry_rays rays = QUARRY_RAYS_INIT;
  rays.type = static_cast<quarry_number>(ways[0] % 3);
  rays.flags = ways[1] % 3;
  rays.count = numbers.size() / kRayBytes;
  rays.origins = numbers.data();
  rays.directions = numbers.data() + (rays.type == QUARRY_FLOAT32 ? 12 : 24);
  rays.stride = kRayBytes;
  rays.t_stride = kRayBytes;
  if (ways[2] & 1) rays.tnear = numbers.data() + 48;
  if (ways[2] & 2) rays.tfar = numbers.data() + 56;
  const size_t n = rays.count;
  Guarded<uint8_t> any(n);
  Came(quarry_any(scene, &rays, any.data()));
  Guarded<double> t(n);
  Guarded<uint32_t> triangle(n), part(n);
  Guarded<float> uv(2 * n), normal(3 * n);
  const quarry_hits hits = HitsIn(t, triangle, part, uv, normal);
  Came(quarry_nearest(scene, &rays, &hits));
  AskAll(scene, rays);
}

void Open(const uint8_t* ways, const std::vector<uint8_t>& numbers, const void* store, size_t size) {
  const int fd = memfd_create("store", 0);
  if (fd < 0 || write(fd, store, size) != static_cast<ssize_t>(size)) std::abort();
  quarry_options options = QUARRY_OPTIONS_INIT;
  options.threads = 1;
  options.cache_bytes = ways[3] & 1 ? 64 << 20 : size_t{ways[4]} << 12;
  quarry_scene* scene = nullptr;
  if (Came(quarry_open(("/proc/self/fd/" + std::to_string(fd)).c_str(), &options, &scene))) {
    char name[16];
    Came(quarry_part_name(scene, ways[5], name, ways[6] % sizeof name, nullptr));
    Came(quarry_material_name(scene, ways[5], name, sizeof name, nullptr));
    Ask(scene, ways, numbers);
    if (!Came(quarry_close(scene)) || Came(quarry_close(scene))) std::abort();
  }
  close(fd);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  if (size < kWays) return 0;
  const size_t rays = std::min<size_t>(data[7] % (kMostRays + 1), (size - kWays) / kRayBytes);
  const std::vector<uint8_t> numbers(data + kWays, data + kWays + rays * kRayBytes);
  const uint8_t* const store = data + kWays + numbers.size();
  const size_t left = size - kWays - numbers.size();
  Open(data, numbers, store, left);
  const auto* const bytes = reinterpret_cast<const std::byte*>(store);
  std::vector<std::byte> mended(bytes, bytes + left);
  quarry::fuzz::MendStore(mended);
  Open(data, numbers, mended.data(), mended.size());
  return 0;
}
