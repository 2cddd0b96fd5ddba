#include "common/scene/view_json.h"

#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>

#include "common/scene/scene_summary.h"

namespace quarry {
namespace {

using Catch::Contains;

const std::string kName = "v.json";

Status Read(const std::string& text, ViewDescription& description, const glm::dvec3& offset = {0, 0, 0}) {
  const auto json = ParseJson<nlohmann::json>(text, kName);
  REQUIRE(json.has_value());
  return ReadView(JsonValue(*json, kName), offset, description);
}

std::string ErrorOf(const std::string& text) {
  ViewDescription description;
  const Status status = Read(text, description);
  return status ? "" : status.error().message;
}

View AnyView() {
  View view;
  view.width = 321;
  view.height = 123;
  view.crop = {1, 2, 30, 40};
  view.mode = RenderMode::kWhitted;
  view.spp = 9;
  view.seed = 0xFFFFFFFFFFFFFFFFull;
  view.aov_mask = 0x55;
  view.up_axis = 1;
  view.ao_samples = 7;
  view.ao_distance = 0.1f;
  view.lights = {{LightKind::kPoint, {1, 2, 3}, {4, 5, 6}, {0, 1, 0}, 2.5f, -1.25f},
                 {LightKind::kSun, {0, 0, 1}, {0.1f, 1, 1}}};
  view.lights[1].angle = 2.5f;
  view.lights.push_back({LightKind::kRectangle, {1, 2, 3}, {9, 8, 7}});
  view.lights[2].edges[0] = {1, 0, 0.5f};
  view.lights[2].edges[1] = {0, 2, 0};
  view.bounces = 3;
  view.sky.radiance = {0.5f, 0.75f, 1};
  view.ambient = {0.1f, 0.2f, 0.3f};
  view.background = {0.4f, 0.5f, 0.6f};
  view.backdrop = false;
  view.camera = {{1, 2, 3}, {4, 5, 7}, {0, 1, 0}, 33.5, 0};
  return view;
}

}  // namespace

TEST_CASE("A light at the eye goes where the camera goes", "[view]") {
  RenderJob job;
  ViewDescription description;
  const glm::dvec3 offset(100, 0, 0);
  REQUIRE(Read(R"({"lights": [{"type": "point", "position": "eye", "radiance": [1, 2, 3]}]})", description,
               offset)
              .has_value());
  job.view = description.view;
  REQUIRE((job.view.lights.size() == 1 && job.view.lights[0].at_eye));
  const auto written = ViewToJson(job.view, {}, offset)["lights"][0];
  CHECK(written["position"] == "eye");
  job.cameras = {{{1, 2, 3}, {4, 5, 7}, {0, 1, 0}, 33.5, 0}, {{5, 6, 7}, {4, 5, 8}, {0, 1, 0}, 33.5, 0}};
  CHECK(FrameView(job, 0).lights[0].vector == glm::vec3(1, 2, 3));
  CHECK(FrameView(job, 1).lights[0].vector == glm::vec3(5, 6, 7));
  View view = job.view;
  view.camera = job.cameras[1];
  REQUIRE(NormalizeView(view).has_value());
  CHECK(view.lights[0].vector == glm::vec3(5, 6, 7));
  CHECK_THAT(ErrorOf(R"({"lights": [{"type": "sun", "direction": "eye", "radiance": [1, 1, 1]}]})"),
             Contains("direction: must be"));
  CHECK_THAT(ErrorOf(R"({"lights": [{"type": "point", "position": "ear", "radiance": [1, 1, 1]}]})"),
             Contains("position: must be"));
}

TEST_CASE("A view is restored from JSON bit by bit, whatever the offset", "[view]") {
  const glm::dvec3 offset(500000, 4e6, -8);
  for (const double ortho : {0.0, 12.5}) {
    View view = AnyView();
    view.camera.ortho_height = ortho;
    const std::string text = ViewToJson(view, {"", -1.75}, offset).dump();
    ViewDescription back;
    REQUIRE(Read(text, back, offset).has_value());
    CHECK(ViewToJson(back.view, back.format, offset).dump() == text);
    CHECK(back.view.camera.eye == view.camera.eye);
    CHECK(back.view.lights[0].vector == view.lights[0].vector);
    CHECK(back.view.lights[0].cone_offset == view.lights[0].cone_offset);
    CHECK(back.view.lights[1].angle == 2.5f);
    CHECK(back.view.lights[2].edges[0] == view.lights[2].edges[0]);
    CHECK((back.view.bounces == 3 && back.view.sky == view.sky));
    CHECK(back.view.seed == view.seed);
    CHECK(back.view.ao_distance == view.ao_distance);
    CHECK(back.view.crop == view.crop);
    CHECK(back.format.exposure == -1.75);
  }
}

TEST_CASE("A clear sky needs a sun and a haze that is known; a rectangle needs an area", "[view]") {
  const auto fault = [](auto&& change) {
    View view = AnyView();
    view.crop = {};
    view.mode = RenderMode::kPath;
    change(view);
    const Status status = NormalizeView(view);
    return status ? std::string() : status.error().message;
  };
  CHECK(fault([](View&) {}).empty());
  CHECK(fault([](View& v) { v.sky = {glm::vec3(0), 3}; }).empty());
  CHECK_THAT(fault([](View& v) { v.sky = {glm::vec3(0), 11}; }), Contains("turbidity"));
  CHECK_THAT(fault([](View& v) { v.sky.radiance.x = -1; }), Contains("sky"));
  CHECK(fault([](View& v) { v.sky = {.haze = 3}; }).empty());
  CHECK_THAT(fault([](View& v) { v.sky = {.haze = 0.5f}; }), Contains("--atmosphere"));
  CHECK_THAT(fault([](View& v) { v.sky = {.turbidity = 3, .haze = 3}; }), Contains("one sky"));
  CHECK_THAT(fault([](View& v) { v.sky = {.radiance = glm::vec3(1), .haze = 3}; }), Contains("not both"));
  CHECK_THAT(fault([](View& v) { v.sky = {.haze = 3}, v.lights.erase(v.lights.begin() + 1); }),
             Contains("needs a sun"));
  CHECK_THAT(fault([](View& v) {
               v.sky = {glm::vec3(0), 3}, v.lights.erase(v.lights.begin() + 1);
             }),
             Contains("needs a sun"));
  CHECK_THAT(fault([](View& v) { v.bounces = 65; }), Contains("--bounces"));
  CHECK_THAT(fault([](View& v) { v.lights[1].angle = 91; }), Contains("invalid value"));
  CHECK_THAT(fault([](View& v) { v.lights[2].edges[1] = v.lights[2].edges[0] * 2.0f; }), Contains("no area"));
  CHECK_THAT(fault([](View& v) { v.lights[2].edges[1] = glm::vec3(0); }), Contains("no area"));
}

TEST_CASE("Members that a view leaves out keep their values", "[view]") {
  ViewDescription description;
  description.view = AnyView();
  REQUIRE(Read(R"({"spp": 3})", description).has_value());
  CHECK(description.view.spp == 3);
  CHECK(description.view.width == 321);
  CHECK_FALSE(description.format.exposure.has_value());
}

TEST_CASE("A given background is light; without one the view keeps its backdrop", "[view]") {
  ViewDescription given, none;
  REQUIRE(Read(R"({"background": [0.1, 0.2, 0.3]})", given).has_value());
  CHECK_FALSE(given.view.backdrop);
  REQUIRE(Read(R"({"spp": 2})", none).has_value());
  CHECK(none.view.backdrop);
  CHECK_FALSE(ViewToJson(none.view, {}, {}).contains("background"));
  CHECK(ViewToJson(given.view, {}, {}).contains("background"));
}

TEST_CASE("An invalid view is refused with the place", "[view]") {
  CHECK_THAT(ErrorOf(R"({"sp": 3})"), Contains("v.json: 'sp' is not known"));
  CHECK_THAT(ErrorOf(R"({"camera": {"eye": [0, 0], "at": [0, 0, 0]}})"), Contains("v.json: camera.eye: "));
  CHECK_THAT(ErrorOf(R"({"camera": {"at": [0, 0, 0]}})"), Contains("camera: 'eye' is missing"));
  CHECK_THAT(ErrorOf(R"({"camera": {"eye": [0,0,0], "at": [1,0,0], "fov": 180}})"), Contains("camera.fov: "));
  CHECK_THAT(ErrorOf(R"({"camera": {"eye": [0,0,0], "at": [1,0,0], "ortho": 0}})"),
             Contains("camera.ortho: must be a positive height"));
  CHECK_THAT(ErrorOf(R"({"size": [3]})"), Contains("v.json: size: "));
  CHECK_THAT(ErrorOf(R"({"mode": "photon"})"), Contains("v.json: mode: is not a mode"));
  CHECK_THAT(ErrorOf(R"({"spp": 1.5})"), Contains("v.json: spp: must be a whole number"));
  CHECK_THAT(ErrorOf(R"({"spp": 4294967296})"), Contains("v.json: spp: is too large"));
  CHECK_THAT(ErrorOf(R"({"aov": ["deep"]})"), Contains("v.json: aov[0]: is not a layer"));
  CHECK_THAT(ErrorOf(R"({"up_axis": "x"})"), Contains("v.json: up_axis: must be y or z"));
  CHECK_THAT(ErrorOf(R"({"ao": {"rays": 1}})"), Contains("v.json: ao: 'rays' is not known"));
  CHECK_THAT(ErrorOf(R"({"ao": {"distance": 1e300}})"), Contains("v.json: ao.distance: is too large"));
  CHECK_THAT(ErrorOf(R"({"lights": [{"type": "lamp"}]})"),
             Contains("lights[0].type: must be sun, point or rectangle"));
  CHECK_THAT(ErrorOf(R"({"sky": {"turbidity": 1.5}})"), Contains("v.json: sky.turbidity: must lie between"));
  CHECK_THAT(ErrorOf(R"({"sky": {"atmosphere": 0.5}})"),
             Contains("v.json: sky.atmosphere: must lie between"));
  CHECK_THAT(ErrorOf(R"({"sky": {"colour": 1}})"), Contains("sky: 'colour' is not known"));
  CHECK_THAT(ErrorOf(R"({"lights": [{"type": "rectangle", "position": [0,0,0], "radiance": [1,1,1]}]})"),
             Contains("lights[0]: 'edges' is missing"));
  CHECK_THAT(ErrorOf("[]"), Contains("v.json: must be an object"));
}

TEST_CASE("A view's parts and section are restored from JSON", "[view][parts]") {
  const glm::dvec3 offset(1000, -2000, 8);
  View view = AnyView();
  auto lists = std::make_shared<PartLists>();
  lists->hide = {"a/b", "c*"};
  lists->only = {"a"};
  lists->colors = {{{"a/d"}, glm::vec3(0.25f, 0.5f, 1)}, {{"a/d/e", "f"}, std::nullopt}};
  view.parts.lists = lists;
  view.section = {true, {1, 2, 3}, {4, 6, 8}, {{{1, 1, 1}, {0, -1, 0}}, {{2, 2, 2}, {0.6, 0, 0.8}}}, false};
  const std::string text = ViewToJson(view, {}, offset).dump();
  ViewDescription back;
  REQUIRE(Read(text, back, offset).has_value());
  REQUIRE(back.view.parts.lists);
  CHECK(*back.view.parts.lists == *lists);
  CHECK(back.view.section == view.section);
  CHECK(ViewToJson(back.view, {}, offset).dump() == text);
  CHECK_FALSE(ViewToJson(AnyView(), {}, offset).contains("section"));
}

TEST_CASE("Parts and sections that cannot be are refused in one sentence", "[view][parts]") {
  CHECK_THAT(ErrorOf(R"({"only": []})"), Contains("v.json: only: is empty: nothing would be shown"));
  CHECK_THAT(ErrorOf(R"({"hide": [""]})"), Contains("v.json: hide[0]: is an empty path"));
  CHECK_THAT(ErrorOf(R"({"hide": "a"})"), Contains("v.json: hide: "));
  CHECK_THAT(ErrorOf(R"({"colors": [{"parts": ["a"]}]})"), Contains("colors[0]: 'color' is missing"));
  CHECK_THAT(ErrorOf(R"({"colors": [{"parts": ["a"], "color": [2,0,0]}]})"), Contains("colors[0].color: "));
  CHECK_THAT(ErrorOf(R"({"section": {"box": [[0,0,0]]}})"), Contains("section.box: must be two corners"));
  CHECK_THAT(ErrorOf(R"({"section": {"box": [[0,0,0],[1,0,1]]}})"),
             Contains("section: the section's box is empty: its lower y is not below its upper y"));
  CHECK_THAT(ErrorOf(R"({"section": {"planes": [{"point": [0,0,0], "normal": [0,0,0]}]}})"),
             Contains("plane 1 of the section has no direction"));
  std::string planes;
  for (int i = 0; i < 13; ++i)
    planes += std::string(i ? "," : "") + R"({"point": [0,0,0], "normal": [0,0,1]})";
  CHECK_THAT(ErrorOf(R"({"section": {"planes": [)" + planes + "]}}"),
             Contains("section.planes: has 13 planes, and at most 12 are possible"));
  CHECK_THAT(ErrorOf(R"({"section": {"caps": 1}})"), Contains("section.caps: "));
}

TEST_CASE("A scene's summary is restored from the master's answer", "[view]") {
  SceneViews views;
  views.cameras = {{"door", {{1, 2, 3}, {4, 5, 7}, {0, 1, 0}, 33.5, 0}}};
  views.lights = {{"lamp", LightKind::kPoint, {1, 2, 3}, {0, 0, -1}, {4, 5, 6}, 0.9f, 0.7f},
                  {"sun", LightKind::kSun, {0, 0, 0}, {0, 0, 1}, {1, 1, 1}},
                  {"panel", LightKind::kRectangle, {1, 2, 3}}};
  views.lights[2].edges[0] = {1, 0, 0.5f};
  views.lights[2].edges[1] = {0, 2, 0};
  const glm::dvec3 offset(1000, 2000, 3000);
  Framing framing;
  framing.lower = {-1, -2, -3};
  framing.upper = {4, 5, 6};
  framing.hull = {{-1, -2, -3}, {4, 5, 6}, {0.1f, 0.2f, 0.3f}};
  framing.up_axis = 1;
  framing.interior = true;
  framing.inside = CameraSpec{{0, 1, 2}, {3, 1, 2}, {0, 1, 0}, 70, 0};
  framing.inside_distance = 2.5;
  const nlohmann::ordered_json answer = {{"scene_id", "00"},
                                         {"offset", {1000, 2000, 3000}},
                                         {"plain", true},
                                         {"shines", false},
                                         {"names_emitters", false},
                                         {"materials", {"steel"}},
                                         {"cameras", CamerasToJson(views)},
                                         {"lights", LightsToJson(views)},
                                         {"framing", FramingToJson(framing, offset)}};
  const std::string name = "answer";
  const auto read = [&](const nlohmann::ordered_json& json) {
    static nlohmann::json parsed;
    parsed = nlohmann::json::parse(json.dump());
    return ReadSceneSummary(JsonValue(parsed, name));
  };
  const auto summary = read(answer);
  REQUIRE(summary.has_value());
  CHECK(summary->offset == offset);
  REQUIRE(summary->views.cameras.size() == 1);
  CHECK(summary->views.cameras[0].name == "door");
  CHECK(summary->views.cameras[0].spec.at == views.cameras[0].spec.at);
  CHECK(summary->views.lights == views.lights);
  CHECK_FALSE(summary->names_emitters);
  CHECK(summary->framing.lower == framing.lower);
  CHECK(summary->framing.hull == framing.hull);
  CHECK(summary->plain);
  CHECK(summary->framing.up_axis == 1);
  CHECK(summary->framing.inside->at == framing.inside->at);
  CHECK(summary->framing.inside_distance == 2.5);
  for (const char* const member : {"scene_id", "offset", "plain", "shines", "cameras", "lights", "framing"}) {
    auto without = answer;
    without.erase(member);
    const auto refused = read(without);
    REQUIRE_FALSE(refused.has_value());
    CHECK_THAT(refused.error().message, Contains(member));
  }
  auto empty = answer;
  empty["framing"]["hull"] = nlohmann::ordered_json::array();
  CHECK_FALSE(read(empty).has_value());
}

}  // namespace quarry
