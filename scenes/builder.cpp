#include "scenes/builder.h"

#include <algorithm>
#include <utility>

namespace quarry::scenes {
namespace {

// Elements of a piece before it is handed on; the largest shape (shapes.h) adds as many again.
constexpr size_t kPieceElements = 32768;

void Require(Status status) {
  if (!status) throw GenerationStopped{std::move(status.error())};
}

}  // namespace

Builder::Builder(MeshReceiver& receiver) : receiver_(receiver), wants_positions_(receiver.WantsPositions()) {
  mesh_.vertices.reserve(2 * kPieceElements);
  mesh_.faces.reserve(3 * kPieceElements);
}

void Builder::Part(std::string name) {
  Flush();
  if (part_begun_) ++part_;
  part_begun_ = false;
  part_name_ = std::move(name);
}

void Builder::Use(uint16_t material, const glm::vec3& tint) {
  material_ = material;
  for (int i = 0; i < 3; ++i)
    tint_[i] = static_cast<uint8_t>(std::clamp(tint[i], 0.0f, 1.0f) * 255.0f + 0.5f);
}

void Builder::BeginShape() {
  if (mesh_.vertices.size() >= kPieceElements || mesh_.faces.size() >= kPieceElements) Flush();
}

uint32_t Builder::Vertex(const glm::vec3& position) {
  mesh_.vertices.push_back({position, tint_[0], tint_[1], tint_[2]});
  return static_cast<uint32_t>(mesh_.vertices.size() - 1);
}

void Builder::Triangle(uint32_t a, uint32_t b, uint32_t c) {
  mesh_.faces.push_back({a, b, c, material_});
  ++triangles_;
}

void Builder::Quad(uint32_t a, uint32_t b, uint32_t c, uint32_t d) {
  Triangle(a, b, c);
  Triangle(a, c, d);
}

void Builder::Finish() { Flush(); }

void Builder::Flush() {
  if (mesh_.faces.empty()) {
    mesh_.vertices.clear();
    return;
  }
  if (!part_begun_) Require(receiver_.BeginPart(part_, part_name_));
  part_begun_ = true;
  Require(receiver_.AddPiece(mesh_, part_));
  mesh_.vertices.clear();
  mesh_.faces.clear();
}

}  // namespace quarry::scenes
