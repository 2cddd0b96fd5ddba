// Gives the bytes to each reader of JSON. The first byte chooses: camera path, lights, library of materials,
// credentials, view, a master's summary of a scene.
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <string>

#include "common/remote/http_options.h"
#include "common/scene/material_json.h"
#include "common/scene/scene_summary.h"
#include "common/scene/view_json.h"
#include "deploy/command/scene_files.h"

namespace {

using namespace quarry;

/// A reader names the fault, or gives a usable value.
template <class Value, class Check>
void MustBeUsable(const Result<Value>& result, Check&& check) {
  if (!result && result.error().message.empty()) std::abort();
  if (result && !check(*result)) std::abort();
}

bool IsFinite(const glm::dvec3& v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

/// A view that is read and written is read again as the same.
void ReadAsView(const std::string& path) {
  const auto json = ReadJsonFile<nlohmann::json>(path);
  if (!json) return;
  ViewDescription read, again;
  const Status status = ReadView(JsonValue(*json, path), glm::dvec3(1e3), read);
  if (!status && status.error().message.empty()) std::abort();
  if (!status || !NormalizeView(read.view)) return;
  const std::string text = ViewToJson(read.view, read.format, glm::dvec3(1e3)).dump();
  const auto written = ParseJson<nlohmann::json>(text, path);
  if (!written || !ReadView(JsonValue(*written, path), glm::dvec3(1e3), again)) std::abort();
  if (ViewToJson(again.view, again.format, glm::dvec3(1e3)).dump() != text) std::abort();
}

void ReadAsSummary(const std::string& path) {
  const auto json = ReadJsonFile<nlohmann::json>(path);
  if (!json) return;
  MustBeUsable(ReadSceneSummary(JsonValue(*json, path)), [](const SceneSummary& summary) {
    return IsFinite(summary.framing.lower) && IsFinite(summary.framing.upper);
  });
}

void Read(uint8_t reader, const std::string& path) {
  switch (reader % 6) {
    case 0:
      return MustBeUsable(ReadCameraPath(path), [](const std::vector<CameraSpec>& cameras) {
        for (const CameraSpec& c : cameras)
          if (!IsFinite(c.eye) || !IsFinite(c.at) || !IsFinite(c.up) || !(c.fov_degrees > 0)) return false;
        return !cameras.empty();
      });
    case 1: {
      View view;
      const Status status = ReadLights(path, glm::dvec3(1e6), view);
      if (!status && status.error().message.empty()) std::abort();
      for (const Light& light : view.lights)
        if (!IsFinite(light.vector) || !IsFinite(light.radiance)) std::abort();
      return;
    }
    case 2:
      return MustBeUsable(ReadMaterialJson(path), [](const MaterialLibrary& library) {
        for (const Material& m : library.materials)
          if (!IsFinite(m.diffuse) || !(m.ior >= 1)) return false;
        if (library.images.size() != library.materials.size()) return false;
        for (const auto& images : library.images)
          for (const MaterialLibrary::Image& image : images) {
            if (image.file.empty() || static_cast<uint32_t>(image.binding.use) >= kTextureUses) return false;
            for (const float x : image.binding.transform)
              if (!std::isfinite(x)) return false;
          }
        return true;
      });
    case 4:
      return ReadAsView(path);
    case 5:
      return ReadAsSummary(path);
    default:
      return MustBeUsable(ReadAwsCredentials(path),
                          [](const AwsCredentials& c) { return !c.secret_key.empty(); });
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  if (size == 0) return 0;
  const int fd = memfd_create("json", 0);
  if (fd < 0 || write(fd, data + 1, size - 1) != static_cast<ssize_t>(size - 1)) std::abort();
  fchmod(fd, 0600);  // credentials are their owner's alone
  Read(data[0], "/proc/self/fd/" + std::to_string(fd));
  close(fd);
  return 0;
}
