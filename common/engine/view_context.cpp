#include "common/engine/view_context.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <utility>

#include "common/engine/integrators/make_integrator.h"
#include "common/engine/surfaces/section_clip.h"
#include "common/engine/surfaces/see_through/cut_outs.h"
#include "common/engine/surfaces/shown_parts.h"
#include "common/scene/view_basis.h"

namespace quarry {
namespace {

PixelCone PixelConeOf(const View& view) {
  const ViewBasis basis = MakeViewBasis(view.camera, view.height);
  const auto side = static_cast<float>(std::sqrt(glm::dot(basis.right, basis.right)));
  return basis.orthographic ? PixelCone{side, 0} : PixelCone{0, side};
}

TextureUses UsesFor(const View& view, const SceneSurfaces& surfaces, const Integrator& integrator) {
  if (!surfaces.textured()) return 0;
  return integrator.needs().uses | (view.has(Aov::kAlbedo) ? UseBit(TextureUse::kDiffuse) : 0);
}

std::shared_ptr<const HitFilter> FilterFor(const Catalog& scene, const HitRule& rule) {
  const bool has_glass = rule.passes_glass && std::ranges::any_of(scene.materials, LetsLightThrough);
  return scene.meta.masks || has_glass ? std::make_shared<const CutOuts>(rule) : nullptr;
}

std::shared_ptr<const SectionClip> ClipOf(const SectionCut& section, const SceneMeta& scene) {
  if (section.empty()) return nullptr;
  auto clip = std::make_shared<const SectionClip>(section, scene);
  return clip->empty() ? nullptr : clip;
}

}  // namespace

ViewContext::ViewContext(View a_view, const Catalog& scene, std::shared_ptr<const SceneSurfaces> a_surfaces,
                         std::shared_ptr<const Integrator> an_integrator,
                         std::shared_ptr<const ShownParts> parts, const EnvironmentPages& environment)
    : view(std::move(a_view)),
      catalog(scene),
      surfaces(a_surfaces ? std::move(a_surfaces) : std::make_shared<const SceneSurfaces>(scene)),
      integrator(an_integrator ? std::move(an_integrator) : MakeIntegrator(view, scene, environment)),
      filter(FilterFor(scene, integrator->needs().hits)),
      section(ClipOf(view.section, scene.meta)),
      shown(parts || !view.parts.selection ? std::move(parts)
                                           : std::make_shared<const ShownParts>(scene, view.parts.selection)),
      makes_caps(integrator->needs().pixels && section && section->caps() && shown &&
                 !shown->selection().closed.empty()),
      colors_parts(shown && !shown->selection().colors.empty()),
      has_attributes(integrator->needs().attributes),
      texture_uses(UsesFor(view, *surfaces, *integrator)),
      tints_light((texture_uses & UseBit(TextureUse::kDiffuse)) != 0 && surfaces->tints_light() &&
                  InfoOf(view.mode).uses_lights),
      cone(PixelConeOf(view)),
      top(shown ? shown->top() : scene.top_tree()),
      camera(view.camera, view.width, view.height, scene.meta.root_lower, scene.meta.root_upper),
      words(WordsPerPixel(view.aov_mask)),
      offset(OffsetFromSurfaces(scene.meta.padding)) {}

}  // namespace quarry
