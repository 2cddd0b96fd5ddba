#include "preprocess/import/cad/open_cascade/cad_styles.h"

#include <TopExp_Explorer.hxx>
#include <XCAFPrs.hxx>
#include <XCAFPrs_IndexedDataMapOfShapeStyle.hxx>
#include <XCAFPrs_Style.hxx>

namespace quarry {

CadStyles::CadStyles(const TDF_Label& definition, const TopoDS_Shape& shape) {
  XCAFPrs_IndexedDataMapOfShapeStyle settings;
  XCAFPrs::CollectStyleSettings(definition, TopLoc_Location(), settings);
  for (XCAFPrs_IndexedDataMapOfShapeStyle::Iterator it(settings); it.More(); it.Next()) {
    const XCAFPrs_Style& style = it.Value();
    if (!style.IsSetColorSurf() && style.IsVisible()) continue;
    if (it.Key().IsSame(shape)) {
      if (style.IsSetColorSurf()) whole_ = style.GetColorSurfRGBA();
      continue;
    }
    Style to;
    if (style.IsSetColorSurf()) to.color = style.GetColorSurfRGBA();
    to.visible = style.IsVisible();
    to.rank = it.Key().ShapeType();
    for (TopExp_Explorer face(it.Key(), TopAbs_FACE); face.More(); face.Next()) {
      const Style* const known = faces_.Seek(face.Current());
      if (!known || known->rank < to.rank) faces_.Bind(face.Current(), to);
    }
  }
}

std::optional<Quantity_ColorRGBA> CadStyles::ColorOf(const TopoDS_Shape& face,
                                                     const CadInstance& instance) const {
  if (const Style* const style = faces_.Seek(face); style && style->color) return style->color;
  if (instance.own) return instance.own;
  return whole_ ? whole_ : instance.inherited;
}

bool CadStyles::IsHidden(const TopoDS_Shape& face) const {
  const Style* const style = faces_.Seek(face);
  return style && !style->visible;
}

}  // namespace quarry
