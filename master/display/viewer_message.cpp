#include "master/display/viewer_message.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <glm/geometric.hpp>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>

#include "common/base/json_file.h"
#include "common/scene/default_view.h"

namespace quarry {
namespace {

/// Of a message: lists of parts may be long.
constexpr JsonLimits kLimits{kMostMessageBytes, 16, 1u << 16, 64};
constexpr double kLeastRate = 10, kMostRate = 60, kMostExposure = 100;
constexpr uint64_t kLeastQuality = 30, kMostQuality = 95;

/// The view of a message: missing members have the default's values; without an exposure it is automatic.
Result<ViewDescription> ReadDescription(const JsonValue& object, const ViewDescription& defaults,
                                        const glm::dvec3& offset) {
  ViewDescription description = defaults;
  description.format.exposure.reset();
  description.format.tone.reset();
  QUARRY_ASSIGN(const auto lights, object.Optional("lights"));
  if (lights) {  // instead of the default ones, and of the sky that belongs to them
    description.view.lights.clear();
    description.view.sky = {};
  }
  QUARRY_TRY(ReadView(object, offset, description));
  description.view.transparent = false;  // a page shows the backdrop
  View& view = description.view;
  const bool has_sky = view.environment.is_named() && view.mode == RenderMode::kPath;
  if (!lights && has_sky) {
    view.lights.clear();  // it is the light
    view.sky = {};
  } else if (!lights) {
    TurnDefaultSun(view);
    DropDefaultSun(view);
    DropDefaultLamp(view);
  }
  if (view.aov_mask != 0) return object.Wrong("has layers, which a live view does not show");
  const auto& exposure = description.format.exposure;
  if (exposure && !(std::fabs(*exposure) <= kMostExposure))
    return object.Wrong(fmt::format("has an exposure beyond {} EV", kMostExposure));
  const bool cropped = view.crop.width != 0 && view.crop != PixelRect{0, 0, view.width, view.height};
  if (cropped) return object.Wrong("is cropped, which a live view cannot be");
  view.crop = {};
  return description;
}

Status Normalize(const JsonValue& object, View& view) {
  if (const Status status = NormalizeView(view); !status) return object.Wrong(status.error().message);
  return {};
}

Result<WantedView> ReadWanted(const JsonValue& json, const ViewDescription& defaults,
                              const glm::dvec3& offset, uint64_t most_pixels) {
  QUARRY_TRY(json.HasOnly({"type", "input", "time", "moving", "view"}));
  WantedView wanted;
  QUARRY_ASSIGN(const JsonValue input, json.Member("input"));
  QUARRY_ASSIGN(wanted.input, input.Whole());
  QUARRY_ASSIGN(const JsonValue time, json.Member("time"));
  QUARRY_ASSIGN(wanted.time_ms, time.Number());
  QUARRY_ASSIGN(const JsonValue moving, json.Member("moving"));
  QUARRY_ASSIGN(wanted.moving, moving.Flag());
  QUARRY_ASSIGN(const JsonValue object, json.Member("view"));
  QUARRY_ASSIGN(ViewDescription description, ReadDescription(object, defaults, offset));
  wanted.view = std::move(description.view);
  wanted.exposure = description.format.exposure;
  wanted.tone = description.format.tone;
  const View& view = wanted.view;
  if (std::max(view.width, view.height) > kMostSide)
    return object.Wrong(fmt::format("is more than {} pixels wide or high", kMostSide));
  if (uint64_t{view.width} * view.height > most_pixels)
    return object.Wrong(fmt::format("is {}x{}: more pixels than a view may have here (--view-memory)",
                                    view.width, view.height));
  QUARRY_TRY(Normalize(object, wanted.view));
  return wanted;
}

Result<SaveMessage> ReadSave(const JsonValue& json, const ViewDescription& defaults,
                             const glm::dvec3& offset) {
  QUARRY_TRY(json.HasOnly({"type", "save", "view"}));
  SaveMessage message;
  QUARRY_ASSIGN(const JsonValue save, json.Member("save"));
  QUARRY_ASSIGN(message.save, save.Whole());
  QUARRY_ASSIGN(const auto object, json.Optional("view"));
  if (!object) return message;
  QUARRY_ASSIGN(ViewDescription description, ReadDescription(*object, defaults, offset));
  QUARRY_TRY(Normalize(*object, description.view));
  const CameraSpec camera = description.view.camera;
  message.job = RenderJob{std::move(description.view),
                          {camera},
                          0,
                          {"png", description.format.exposure, description.format.tone}};
  return message;
}

/// A ray in the model's coordinates.
Result<RayQuery> ReadRay(const JsonValue& json, const JsonValue& origin, const glm::dvec3& offset) {
  RayQuery ray;
  QUARRY_TRY(origin.Numbers({&ray.origin.x, 3}, -kFarthestOrigin, kFarthestOrigin));
  ray.origin -= offset;
  QUARRY_ASSIGN(const JsonValue direction, json.Member("direction"));
  QUARRY_TRY(direction.Numbers({&ray.direction.x, 3}, -kFarthestOrigin, kFarthestOrigin));
  const double length = glm::length(ray.direction);
  if (!(length > 0)) return direction.Wrong("has length 0");
  ray.direction /= length;
  return ray;
}

Result<PickMessage> ReadPick(const JsonValue& json, const glm::dvec3& offset) {
  QUARRY_TRY(json.HasOnly({"type", "pick", "x", "y", "origin", "direction"}));
  PickMessage message;
  QUARRY_ASSIGN(const JsonValue pick, json.Member("pick"));
  QUARRY_ASSIGN(message.pick, pick.Whole());
  QUARRY_ASSIGN(const auto origin, json.Optional("origin"));
  if (origin) {
    QUARRY_ASSIGN(message.ray, ReadRay(json, *origin, offset));
    return message;
  }
  QUARRY_ASSIGN(const JsonValue x, json.Member("x"));
  QUARRY_ASSIGN(message.x, x.Number());
  QUARRY_ASSIGN(const JsonValue y, json.Member("y"));
  QUARRY_ASSIGN(message.y, y.Number());
  return message;
}

Status ReadFlag(const JsonValue& json, const char* name, std::optional<bool>& out) {
  QUARRY_ASSIGN(const auto value, json.Optional(name));
  if (!value) return {};
  QUARRY_ASSIGN(out, value->Flag());
  return {};
}

Result<SettingsMessage> ReadSettings(const JsonValue& json) {
  QUARRY_TRY(json.HasOnly({"type", "frame_rate", "quality", "step", "wait", "owners"}));
  SettingsMessage message;
  QUARRY_ASSIGN(const auto rate, json.Optional("frame_rate"));
  if (rate) {
    QUARRY_ASSIGN(message.frame_rate, rate->Number());
    if (!(*message.frame_rate >= kLeastRate && *message.frame_rate <= kMostRate))
      return rate->Wrong(fmt::format("is not between {} and {}", kLeastRate, kMostRate));
  }
  QUARRY_ASSIGN(const auto quality, json.Optional("quality"));
  if (quality) {
    QUARRY_ASSIGN(const uint64_t number, quality->Whole());
    if (number < kLeastQuality || number > kMostQuality)
      return quality->Wrong(fmt::format("is not between {} and {}", kLeastQuality, kMostQuality));
    message.quality = static_cast<int>(number);
  }
  QUARRY_ASSIGN(const auto step, json.Optional("step"));
  if (step) {
    QUARRY_ASSIGN(const uint64_t number, step->Whole());
    if (number > 4 || number == 3) return step->Wrong("is not 0, 1, 2 or 4");
    message.step = static_cast<uint32_t>(number);
  }
  QUARRY_TRY(ReadFlag(json, "wait", message.wait));
  QUARRY_TRY(ReadFlag(json, "owners", message.owners));
  return message;
}

Result<SelectMessage> ReadSelect(const JsonValue& json) {
  QUARRY_TRY(json.HasOnly({"type", "hide", "only", "colors"}));
  QUARRY_ASSIGN(auto lists, ReadPartLists(json));
  return SelectMessage{std::move(lists)};
}

/// Takes the member "selection" out of a message's view. Returns: its lists, null where there is none.
/// Errors: it is no id; it is not known.
Result<std::shared_ptr<const PartLists>> TakeSelection(nlohmann::json& message, const FindLists& find) {
  const auto view = message.is_object() ? message.find("view") : message.end();
  if (view == message.end() || !view->is_object()) return nullptr;
  const auto named = view->find("selection");
  if (named == view->end()) return nullptr;
  const std::string text = named->is_string() ? named->get<std::string>() : std::string();
  uint64_t id = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), id, 16);
  if (text.empty() || error != std::errc() || end != text.data() + text.size())
    return Fail("the selection of a view must be an id in hexadecimal digits");
  view->erase(named);
  auto lists = find ? find(id) : nullptr;
  if (!lists) return Fail(fmt::format("the selection {} is not known here: send its lists again", text));
  return lists;
}

}  // namespace

Result<ViewerMessage> ReadViewerMessage(std::string_view text, const ViewDescription& defaults,
                                        const glm::dvec3& offset, uint64_t most_pixels,
                                        const FindLists& find) {
  static const std::string kName = "the browser's message";
  QUARRY_ASSIGN(auto parsed, ParseJson<nlohmann::json>(text, kName, kLimits));
  QUARRY_ASSIGN(const auto lists, TakeSelection(parsed, find));
  const JsonValue json(parsed, kName);
  QUARRY_ASSIGN(const JsonValue type, json.Member("type"));
  const Result<std::string> name = type.Text();
  if (name == "view") {
    QUARRY_ASSIGN(WantedView wanted, ReadWanted(json, defaults, offset, most_pixels));
    if (lists) wanted.view.parts.lists = lists;
    return wanted;
  }
  if (name == "pick") return ReadPick(json, offset);
  if (name == "settings") return ReadSettings(json);
  if (name == "save") {
    QUARRY_ASSIGN(SaveMessage save, ReadSave(json, defaults, offset));
    if (save.job && lists) save.job->view.parts.lists = lists;
    return save;
  }
  if (name == "select") return ReadSelect(json);
  if (name != "ack") return type.Wrong("is not a known type of message");
  QUARRY_TRY(json.HasOnly({"type", "frame"}));
  QUARRY_ASSIGN(const JsonValue frame, json.Member("frame"));
  QUARRY_ASSIGN(const uint64_t number, frame.Whole());
  return AckMessage{number};
}

}  // namespace quarry
